"""Seeds of the fuzzer: small files in which all that the readers know occurs."""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Callable
from functools import cache

SSD = b"""<?xml version="1.0" encoding="UTF-8"?>
<ssd:SystemStructureDescription xmlns:ssd="http://ssp-standard.org/SSP1/SystemStructureDescription"
 xmlns:ssc="http://ssp-standard.org/SSP1/SystemStructureCommon"
 xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues"
 xmlns:osp="http://opensimulationplatform.com/SSP/OSPAnnotations" name="small" version="1.0">
 <ssd:System name="system">
  <ssd:ParameterBindings><ssd:ParameterBinding prefix="wheels."><ssd:ParameterValues>
   <ssv:ParameterSet name="inline" version="1.0"><ssv:Parameters>
    <ssv:Parameter name="torque_limit"><ssv:Real value="0.01" unit="N.m"/></ssv:Parameter>
   </ssv:Parameters></ssv:ParameterSet></ssd:ParameterValues></ssd:ParameterBinding>
  </ssd:ParameterBindings>
  <ssd:Elements>
   <ssd:Component name="source" type="application/x-fmu-sharedlibrary" source="resources/FIRST.fmu">
    <ssd:Connectors><ssd:Connector name="tau_cmd_wheel[1]" kind="output"><ssc:Real unit="N.m"/>
    </ssd:Connector><ssd:Connector name="tau_cmd_wheel[2]" kind="output"><ssc:Real/>
    </ssd:Connector>MORE</ssd:Connectors>
    <ssd:Annotations><ssc:Annotation type="com.opensimulationplatform">
     <osp:StepSizeHint value="1.0"/></ssc:Annotation></ssd:Annotations>
   </ssd:Component>
   <ssd:Component name="wheels" type="application/x-fmu-sharedlibrary"
    source="resources/SECOND.fmu">
    <ssd:ParameterBindings><ssd:ParameterBinding source="p.ssv"/></ssd:ParameterBindings>
   </ssd:Component>
  </ssd:Elements>
  <ssd:Connections>
   <ssd:Connection startElement="source" startConnector="tau_cmd_wheel[1]" endElement="wheels"
    endConnector="tau_cmd_wheel[1]"/>
   <ssd:Connection startElement="source" startConnector="tau_cmd_wheel[2]" endElement="wheels"
    endConnector="tau_cmd_wheel[2]" suppressUnitConversion="true">
    <ssc:LinearTransformation factor="2.0" offset="0.5"/></ssd:Connection>WIRES
  </ssd:Connections>
 </ssd:System>
 <ssd:DefaultExperiment startTime="0" stopTime="10"><ssd:Annotations>
  <ssc:Annotation type="com.opensimulationplatform"><osp:Algorithm>
   <osp:FixedStepAlgorithm baseStepSize="1.0" numWorkerThreads="0"/></osp:Algorithm>
  </ssc:Annotation></ssd:Annotations></ssd:DefaultExperiment>
</ssd:SystemStructureDescription>
"""
SSV = b"""<?xml version="1.0" encoding="UTF-8"?>
<ssv:ParameterSet xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues"
 xmlns:ssc="http://ssp-standard.org/SSP1/SystemStructureCommon" name="p" version="1.0">
 <ssv:Parameters>
  <ssv:Parameter name="speed_limit"><ssv:Real value="1000" unit="turn"/></ssv:Parameter>
  <ssv:Parameter name="h_start_wheel[1]"><ssv:Real value="0.5"/></ssv:Parameter>
  <ssv:Parameter name="seed"><ssv:Integer value="3"/></ssv:Parameter>
 </ssv:Parameters>
 <ssv:Units><ssc:Unit name="turn"><ssc:BaseUnit rad="1" s="-1" factor="6.28"/></ssc:Unit>
 </ssv:Units>
</ssv:ParameterSet>
"""
ABOUT = json.dumps({
    "name": "small", "title": "Small", "story": "Two.", "cell": {"method": "x"},
    "labels": {"method": "X"}, "twin": "other", "inner": 1,
    "numbers": {
        "end": {"title": "End", "signal": "wheels.h_wheel", "measure": "largest", "unit": "N.m.s",
                "window": [0.0, 5.0], "element": 1},
        "better": {"title": "Better", "of": "end", "reference": "other", "form": "saving"}},
    "plots": [{"title": "h", "signals": ["wheels.h_wheel"], "unit": "mN.m.s", "points": 100,
               "limits": ["wheels.torque_limit", 2.0, {"value": 1.0, "name": "limit"}],
               "components": ["1"]}],
    "dispersions": {"wheels.torque_limit": {"uniform": [-1.0, 1.0]}, "*.seed": {"seed": True}},
    "output_classes": {"source.tau_cmd_wheel": "interval"},
    "stop_when": {"signal": "wheels.h_wheel", "below": 0.1, "unit": "N.m.s", "held": 2.0},
}).encode()  # fmt: skip
TOML = b"""title = "Own {method}"
story = "Two sentences."
step = 1.0
stop = 10.0

[shared]
inertia_wheel = [1.0e-3, 1.0e-3, 1.0e-3, 1.0e-3]

[parameters.wheels]
torque_limit = 0.01
h_start_wheel = [0.1, 0.2, 0.3, 0.4]

[decimation]
manager = 1

[output_classes]
"manager.tau_cmd_wheel" = "interval"

[numbers.end]
title = "End"
signal = "wheels.h_wheel"
measure = "largest"
percent_of = "wheels.inertia_wheel * wheels.speed_limit"
unit = "%"

[plots.h]
title = "h"
signals = ["wheels.h_wheel"]
limits = [0.5]

[paper.row]
table = "2"
quantity = "end"
unit = "%"
columns = ["a", "b"]
values = { x = [1.0, 2.0] }
tolerance = "3 %"
only = ["x"]

[dispersions]
"wheels.h_start_wheel" = { normal = [0.0, 1.0] }

[stop_when]
signal = "wheels.h_wheel"
above = "wheels.inertia_wheel * wheels.speed_limit"

[axes.method.x]
label = "X"
parameters.wheels.torque_limit = 0.02
[axes.case.a]
label = "A"
"""
CRAFT = b"""title = "Own"
stop = 10.0

[components]
manager = "manager_test_signal"
wheels = "wheels"

[wiring]
"manager.h_wheel" = false
"wheels.tau_cmd_wheel" = "manager.tau_cmd_wheel"

[shared]
inertia_wheel = [1.0e-3, 1.0e-3, 1.0e-3, 1.0e-3]

[parameters.wheels]
speed_limit = 500.0
"""
XML = b"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="theirs" guid="{1}" description="d">
<CoSimulation modelIdentifier="theirs" canHandleVariableCommunicationStepSize="true"/>
<UnitDefinitions><Unit name="N.m"><BaseUnit kg="1" m="2" s="-2" factor="1.0"/></Unit>
<Unit name="rad/s"><BaseUnit rad="1" s="-1"/></Unit>
<Unit name="N.m.s"><BaseUnit kg="1" m="2" s="-1"/></Unit>
</UnitDefinitions>
<TypeDefinitions><SimpleType name="Torque"><Real unit="N.m" min="-1" max="1"/></SimpleType>
</TypeDefinitions>
<DefaultExperiment startTime="0.0" stopTime="1.0" stepSize="0.1"/>
<ModelVariables>
<ScalarVariable name="u[1]" valueReference="0" causality="input"><Real start="0.0" unit="N.m"/>
</ScalarVariable>
<ScalarVariable name="u[2]" valueReference="9" causality="input"><Real start="0"/></ScalarVariable>
<ScalarVariable name="tau_cmd_wheel[1]" valueReference="1" causality="output" description="e">
<Real declaredType="Torque"/></ScalarVariable>
<ScalarVariable name="tau_cmd_wheel[2]" valueReference="2" causality="output"><Real/>
</ScalarVariable>
<ScalarVariable name="n" valueReference="3" causality="parameter" variability="fixed">
<Integer start="3" min="0" max="9"/></ScalarVariable>
<ScalarVariable name="b" valueReference="4" causality="parameter" variability="fixed">
<Boolean start="true"/><Annotations><Tool name="desat"><Variable choices="a b" mean="true"/></Tool>
</Annotations></ScalarVariable>
<ScalarVariable name="torque_limit" valueReference="5" causality="parameter" variability="fixed">
<Real start="1" unit="N.m"/></ScalarVariable>
<ScalarVariable name="speed_limit" valueReference="6" causality="parameter" variability="fixed">
<Real start="1" unit="rad/s"/></ScalarVariable>
<ScalarVariable name="h_start_wheel[1]" valueReference="7" causality="parameter"
 variability="fixed"><Real start="1" unit="N.m.s"/></ScalarVariable>
<ScalarVariable name="seed" valueReference="8" causality="parameter" variability="fixed">
<Integer start="1"/></ScalarVariable>
<ScalarVariable name="h_wheel[1]" valueReference="10" causality="output"><Real unit="N.m.s"/>
</ScalarVariable>
</ModelVariables>
<ModelStructure><Outputs><Unknown index="3" dependencies="1"/><Unknown index="4"/></Outputs>
<InitialUnknowns><Unknown index="3"/></InitialUnknowns></ModelStructure>
</fmiModelDescription>
"""


def _zip(entries: dict[str, bytes]) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as made:
        for name, data in entries.items():
            made.writestr(zipfile.ZipInfo(name), data)
    return buffer.getvalue()


def _system(first: bytes, second: bytes) -> bytes:
    return SSD.replace(b"FIRST", first).replace(b"SECOND", second)


MORE = b'<ssd:Connector name="tau_cmd_wheel[%d]" kind="output"/>'
WIRE = (b'<ssd:Connection startElement="source" startConnector="tau_cmd_wheel[%d]" '
        b'endElement="wheels" endConnector="tau_cmd_wheel[%d]"/>')  # fmt: skip
OURS = (
    _system(b"manager_test_signal", b"wheels")
    .replace(b"MORE", MORE % 3 + MORE % 4)
    .replace(b"WIRES", WIRE % (3, 3) + WIRE % (4, 4))
)
THEIRS = _system(b"theirs", b"theirs").replace(b"MORE", b"").replace(b"WIRES", b"")
THEIRS = THEIRS.replace(b'endConnector="tau_cmd_wheel[', b'endConnector="u[')


@cache
def seeds() -> dict[str, bytes]:
    """A seed of each kind of file."""
    fmu = _zip({"modelDescription.xml": XML, "binaries/linux64/theirs.so": b""})
    files = {"SystemStructure.ssd": THEIRS, "p.ssv": SSV, "extra/desat/scenario.json": ABOUT,
             "resources/theirs.fmu": fmu}  # fmt: skip
    return {"ssd": OURS, "ssv": SSV, "json": ABOUT, "toml": TOML, "craft": CRAFT, "xml": XML,
            "fmu": fmu, "ssp": _zip(files)}  # fmt: skip


TARGETS = {
    "ssd": ("ours", "ours/SystemStructure.ssd"),
    "ssv": ("ours", "ours/p.ssv"),
    "json": ("ours", "ours/extra/desat/scenario.json"),
    "toml": ("own/own.toml", "own/own.toml"),
    "craft": ("own/own.toml", "own/craft.toml"),
    "xml": ("theirs", "theirs/resources/theirs.fmu"),
    "fmu": ("theirs", "theirs/resources/theirs.fmu"),
    "ssp": ("packed.ssp", "packed.ssp"),
}
"""What is prepared, and the file within that is mutated."""
FILES: dict[str, Callable[[], bytes]] = {
    "ours/SystemStructure.ssd": lambda: OURS,
    "ours/p.ssv": lambda: SSV,
    "ours/extra/desat/scenario.json": lambda: ABOUT,
    "own/own.toml": lambda: TOML,
    "own/craft.toml": lambda: CRAFT,
    "theirs/SystemStructure.ssd": lambda: THEIRS,
    "theirs/p.ssv": lambda: SSV,
    "theirs/resources/theirs.fmu": lambda: seeds()["fmu"],
}
"""The files around."""
