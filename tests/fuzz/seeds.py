"""Seeds of the fuzzer: small files in which all that the readers know occurs."""

from __future__ import annotations

import io
import json
import re
import zipfile
from collections.abc import Callable, Iterator
from functools import cache

from desat.files import paths

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
    <ssd:ParameterBindings><ssd:ParameterBinding source="p.ssv">
     <ssd:ParameterMapping source="p.ssm"/></ssd:ParameterBinding></ssd:ParameterBindings>
   </ssd:Component>
   <ssd:SignalDictionaryReference name="bus" dictionary="signals"><ssd:Connectors>
    <ssd:Connector name="x" kind="inout"><ssc:Real unit="N.m"/></ssd:Connector></ssd:Connectors>
   </ssd:SignalDictionaryReference>
  </ssd:Elements>
  <ssd:Connections>
   <ssd:Connection startElement="source" startConnector="tau_cmd_wheel[1]" endElement="bus"
    endConnector="x"/>
   <ssd:Connection startElement="bus" startConnector="x" endElement="wheels"
    endConnector="tau_cmd_wheel[1]"/>
   <ssd:Connection startElement="source" startConnector="tau_cmd_wheel[2]" endElement="wheels"
    endConnector="tau_cmd_wheel[2]" suppressUnitConversion="true">
    <ssc:LinearTransformation factor="2.0" offset="0.5"/></ssd:Connection>WIRES
  </ssd:Connections>
  <ssd:SignalDictionaries><ssd:SignalDictionary name="signals" source="d.ssb"/>
  </ssd:SignalDictionaries>
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
SSM = b"""<?xml version="1.0" encoding="UTF-8"?>
<ssm:ParameterMapping xmlns:ssm="http://ssp-standard.org/SSP1/SystemStructureParameterMapping"
 xmlns:ssc="http://ssp-standard.org/SSP1/SystemStructureCommon" version="1.0">
 <ssm:MappingEntry source="speed_limit" target="speed_limit" suppressUnitConversion="false">
  <ssc:LinearTransformation factor="0.5" offset="1.0"/></ssm:MappingEntry>
 <ssm:MappingEntry source="seed" target="seed"/>
</ssm:ParameterMapping>
"""
SSB = b"""<?xml version="1.0" encoding="UTF-8"?>
<ssb:SignalDictionary xmlns:ssb="http://ssp-standard.org/SSP1/SystemStructureSignalDictionary"
 xmlns:ssc="http://ssp-standard.org/SSP1/SystemStructureCommon" version="1.0">
 <ssb:DictionaryEntry name="x"><ssc:Real unit="N.m"/></ssb:DictionaryEntry>
 <ssb:Units><ssc:Unit name="N.m"><ssc:BaseUnit kg="1" m="2" s="-2"/></ssc:Unit></ssb:Units>
</ssb:SignalDictionary>
"""
ABOUT = json.dumps(
    {
        "name": "small",
        "title": "Small",
        "description": "Two.",
        "cell": {"method": "x"},
        "labels": {"method": "X"},
        "baseline": "other",
        "substeps": 1,
        "numbers": {
            "end": {
                "title": "End",
                "signal": "wheels.h_wheel",
                "measure": "largest",
                "unit": "N.m.s",
                "window": [0.0, 5.0],
                "element": 1,
            },
            "better": {
                "title": "Better",
                "of": "end",
                "reference": "other",
                "form": "saving",
            },
        },
        "plots": [
            {
                "title": "h",
                "signals": ["wheels.h_wheel"],
                "unit": "mN.m.s",
                "points": 100,
                "limits": [
                    "wheels.h_start_wheel[1]",
                    2.0,
                    {"value": 1.0, "name": "limit"},
                ],
                "components": ["1"],
            }
        ],
        "dispersions": {
            "wheels.torque_limit": {"uniform": [-1.0, 1.0]},
            "*.seed": {"seed": True},
        },
        "output_classes": {"source.tau_cmd_wheel": "interval"},
        "stop_when": {
            "signal": "wheels.h_wheel",
            "below": 0.1,
            "unit": "N.m.s",
            "held": 2.0,
        },
    }
).encode()
TOML = b"""title = "Own {method}"
description = "Two sentences."
step = 1.0
stop = 10.0

[shared]
inertia_wheel = [1.0e-3, 1.0e-3, 1.0e-3, 1.0e-3]

[parameters.wheels]
torque_limit = 0.01
h_start_wheel = [0.1, 0.2, 0.3, 0.4]

[step_ratio]
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
XML_1 = b"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="1.0" modelName="theirs" modelIdentifier="theirs" guid="{1}"
 numberOfContinuousStates="0" numberOfEventIndicators="0">
<UnitDefinitions><BaseUnit unit="rad"><DisplayUnitDefinition displayUnit="deg" gain="57.3"/>
</BaseUnit></UnitDefinitions>
<TypeDefinitions><Type name="Torque"><RealType unit="N.m" min="-1" max="1"/></Type>
</TypeDefinitions>
<DefaultExperiment startTime="0.0" stopTime="1.0" tolerance="0.0001"/>
<ModelVariables>
<ScalarVariable name="u[1]" valueReference="0" causality="input"><Real start="0.0" unit="N.m"/>
</ScalarVariable>
<ScalarVariable name="u[2]" valueReference="1" causality="input"><Real start="0"/></ScalarVariable>
<ScalarVariable name="tau_cmd_wheel[1]" valueReference="2" causality="output">
<Real declaredType="Torque"/><DirectDependency><Name>u[1]</Name></DirectDependency></ScalarVariable>
<ScalarVariable name="tau_cmd_wheel[2]" valueReference="3" causality="output"><Real/>
</ScalarVariable>
<ScalarVariable name="again" valueReference="3" causality="output" alias="alias"><Real/>
</ScalarVariable>
<ScalarVariable name="torque_limit" valueReference="4" causality="internal" variability="parameter">
<Real start="1" unit="N.m"/></ScalarVariable>
<ScalarVariable name="speed_limit" valueReference="5" causality="internal" variability="parameter">
<Real start="1" unit="rad/s"/></ScalarVariable>
<ScalarVariable name="h_start_wheel[1]" valueReference="6" causality="internal"
 variability="parameter"><Real start="1" unit="N.m.s"/></ScalarVariable>
<ScalarVariable name="seed" valueReference="0" causality="internal" variability="parameter">
<Integer start="1" min="0" max="9"/></ScalarVariable>
<ScalarVariable name="b" valueReference="0" causality="input"><Boolean start="true"/>
</ScalarVariable>
<ScalarVariable name="h_wheel[1]" valueReference="7" causality="output"><Real unit="N.m.s"/>
</ScalarVariable>
</ModelVariables>
<Implementation><CoSimulation_StandAlone><Capabilities
 canHandleVariableCommunicationStepSize="true"/></CoSimulation_StandAlone></Implementation>
</fmiModelDescription>
"""
XML_3 = b"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="3.0" modelName="theirs" instantiationToken="{1}" description="d">
<CoSimulation modelIdentifier="theirs" canHandleVariableCommunicationStepSize="true"/>
<UnitDefinitions><Unit name="N.m"><BaseUnit kg="1" m="2" s="-2" factor="1.0"/></Unit>
<Unit name="rad/s"><BaseUnit rad="1" s="-1"/></Unit>
<Unit name="N.m.s"><BaseUnit kg="1" m="2" s="-1"/></Unit>
</UnitDefinitions>
<TypeDefinitions><Float64Type name="Torque" unit="N.m" min="-1" max="1"/>
<EnumerationType name="M"><Item name="off" value="0"/><Item name="on" value="1"/></EnumerationType>
</TypeDefinitions>
<DefaultExperiment startTime="0.0" stopTime="1.0" stepSize="0.1"/>
<ModelVariables>
<Float64 name="time" valueReference="0" causality="independent"/>
<UInt64 name="n" valueReference="1" causality="structuralParameter" start="2"/>
<Float64 name="u" valueReference="2" causality="input" start="0.0 0.5" unit="N.m">
<Dimension valueReference="1"/></Float64>
<Float64 name="tau_cmd_wheel" valueReference="5" causality="output" declaredType="Torque">
<Dimension start="2"/></Float64>
<Float32 name="torque_limit" valueReference="8" causality="parameter" variability="fixed" start="1"
 unit="N.m"/>
<Float64 name="speed_limit" valueReference="9" causality="parameter" variability="fixed" start="1"
 unit="rad/s"/>
<Float64 name="h_start_wheel" valueReference="10" causality="parameter" variability="fixed"
 start="1" unit="N.m.s"><Dimension start="1"/></Float64>
<Int32 name="seed" valueReference="12" causality="parameter" variability="fixed" start="1" min="0"/>
<Boolean name="b" valueReference="13" causality="parameter" variability="fixed" start="true">
<Annotations><Annotation type="desat"><Variable choices="a b" mean="true"/></Annotation>
</Annotations></Boolean>
<Enumeration name="m" declaredType="M" valueReference="14" causality="input" start="1"/>
<String name="said" valueReference="15" causality="parameter"><Start value="x"/></String>
<Binary name="blob" valueReference="16" causality="input"/>
<Float64 name="h_wheel" valueReference="17" causality="output" unit="N.m.s"><Dimension start="1"/>
</Float64>
</ModelVariables>
<ModelStructure><Output valueReference="5" dependencies="2"/><Output valueReference="17"/>
<InitialUnknown valueReference="5"/></ModelStructure>
</fmiModelDescription>
"""


def _zip(entries: dict[str, bytes]) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in entries.items():
            archive.writestr(zipfile.ZipInfo(name), data)
    return buffer.getvalue()


def _system(first: bytes, second: bytes) -> bytes:
    return SSD.replace(b"FIRST", first).replace(b"SECOND", second)


MORE = b'<ssd:Connector name="tau_cmd_wheel[%d]" kind="output"/>'
WIRE = (
    b'<ssd:Connection startElement="source" startConnector="tau_cmd_wheel[%d]" '
    b'endElement="wheels" endConnector="tau_cmd_wheel[%d]"/>'
)
OURS = (
    _system(b"manager_test_signal", b"wheels")
    .replace(b"MORE", MORE % 3 + MORE % 4)
    .replace(b"WIRES", WIRE % (3, 3) + WIRE % (4, 4))
)
THEIRS = _system(b"theirs", b"theirs").replace(b"MORE", b"").replace(b"WIRES", b"")
THEIRS = THEIRS.replace(b'endConnector="tau_cmd_wheel[', b'endConnector="u[')

BARE = "bare"
"""The end of the kinds of files in a system without stop time and step: its FMUs
suggest them."""
WITHOUT_TIMES = re.sub(
    rb"<ssd:DefaultExperiment.*</ssd:DefaultExperiment>", b"", THEIRS, flags=re.S
)


def plain_kind(kind: str) -> str:
    """Return the kind of a file without what says in which system it stands."""
    return kind.removesuffix(BARE)


@cache
def library_of_ours() -> bytes:
    """A library that could be loaded: it is read, and never loaded."""
    fmu = paths.fmus() / "native" / "tachometers.fmu"
    with zipfile.ZipFile(fmu) as archive:
        names = (n for n in archive.namelist() if n.startswith("binaries/linux64/"))
        return archive.read(next(names))


@cache
def seeds() -> dict[str, bytes]:
    """A seed of each kind of file."""
    library = library_of_ours()
    fmu = _zip({"modelDescription.xml": XML, "binaries/linux64/theirs.so": library})
    files = {
        "SystemStructure.ssd": THEIRS,
        "p.ssv": SSV,
        "p.ssm": SSM,
        "d.ssb": SSB,
        "extra/desat/scenario.json": ABOUT,
        "resources/theirs.fmu": fmu,
    }
    results = {
        "ssd": OURS,
        "ssv": SSV,
        "ssm": SSM,
        "ssb": SSB,
        "json": ABOUT,
        "toml": TOML,
        "craft": CRAFT,
        "xml": XML,
        "xml1": XML_1,
        "xml3": XML_3,
        "fmu": fmu,
        "ssp": _zip(files),
    }
    files["SystemStructure.ssd"] = WITHOUT_TIMES
    bare = {
        "ssd": WITHOUT_TIMES,
        "xml": XML,
        "xml1": XML_1.replace(b' stopTime="1.0"', b' stopTime="1.0" stepSize="0.1"'),
        "xml3": XML_3,
        "fmu": fmu,
        "ssp": _zip(files),
    }
    return results | {f"{kind}{BARE}": data for kind, data in bare.items()}


TARGETS = {
    "ssd": ("ours", "ours/SystemStructure.ssd"),
    "ssv": ("ours", "ours/p.ssv"),
    "ssm": ("ours", "ours/p.ssm"),
    "ssb": ("ours", "ours/d.ssb"),
    "json": ("ours", "ours/extra/desat/scenario.json"),
    "toml": ("own/own.toml", "own/own.toml"),
    "craft": ("own/own.toml", "own/craft.toml"),
    "xml": ("theirs", "theirs/resources/theirs.fmu"),
    "xml1": ("theirs", "theirs/resources/theirs.fmu"),
    "xml3": ("theirs", "theirs/resources/theirs.fmu"),
    "fmu": ("theirs", "theirs/resources/theirs.fmu"),
    "ssp": ("packed.ssp", "packed.ssp"),
    f"ssd{BARE}": (BARE, f"{BARE}/SystemStructure.ssd"),
    f"xml{BARE}": (BARE, f"{BARE}/resources/theirs.fmu"),
    f"xml1{BARE}": (BARE, f"{BARE}/resources/theirs.fmu"),
    f"xml3{BARE}": (BARE, f"{BARE}/resources/theirs.fmu"),
    f"fmu{BARE}": (BARE, f"{BARE}/resources/theirs.fmu"),
    f"ssp{BARE}": (f"packed_{BARE}.ssp", f"packed_{BARE}.ssp"),
}
"""What is prepared, and the file within that is mutated."""
FILES: dict[str, Callable[[], bytes]] = {
    "ours/SystemStructure.ssd": lambda: OURS,
    "ours/p.ssv": lambda: SSV,
    "ours/p.ssm": lambda: SSM,
    "ours/d.ssb": lambda: SSB,
    "ours/extra/desat/scenario.json": lambda: ABOUT,
    "own/own.toml": lambda: TOML,
    "own/craft.toml": lambda: CRAFT,
    "theirs/SystemStructure.ssd": lambda: THEIRS,
    "theirs/p.ssv": lambda: SSV,
    "theirs/p.ssm": lambda: SSM,
    "theirs/d.ssb": lambda: SSB,
    "theirs/resources/theirs.fmu": lambda: seeds()["fmu"],
    f"{BARE}/SystemStructure.ssd": lambda: WITHOUT_TIMES,
    f"{BARE}/p.ssv": lambda: SSV,
    f"{BARE}/p.ssm": lambda: SSM,
    f"{BARE}/d.ssb": lambda: SSB,
    f"{BARE}/resources/theirs.fmu": lambda: seeds()["fmu"],
}
"""The files around."""


# --- model descriptions with one fault each -------------------------------------------

CAUSALITIES = {
    b"2.0": (
        "parameter",
        "calculatedParameter",
        "input",
        "output",
        "local",
        "independent",
    ),
    b"3.0": (
        "parameter",
        "calculatedParameter",
        "structuralParameter",
        "input",
        "output",
        "local",
        "independent",
    ),
}
VARIABILITIES = ("constant", "fixed", "tunable", "discrete", "continuous")
ALLOWED = {
    "parameter": "fixed tunable",
    "calculatedParameter": "fixed tunable",
    "structuralParameter": "fixed tunable",
    "input": "discrete continuous",
    "output": "constant discrete continuous",
    "local": "constant fixed tunable discrete continuous",
    "independent": "continuous",
}
"""By the tables of the standards (FMI 2.0.4, 2.2.7; FMI 3.0.1, 2.4.7.4)."""
NOWHERE = (b"0", b"99", b"-1", b"x", b"1.5", b"", b"18446744073709551616")


def forbidden_pairs() -> Iterator[tuple[str, str, bytes]]:
    """Yield kind, fault and model description for each forbidden causality and
    variability."""
    for kind, text, old in (
        (
            "xml",
            XML,
            b'name="n" valueReference="3" causality="parameter" variability="fixed"',
        ),
        (
            "xml3",
            XML_3,
            b'name="torque_limit" valueReference="8" causality="parameter" '
            b'variability="fixed"',
        ),
    ):
        version = re.search(rb'fmiVersion="(.*?)"', text)[1]
        place = old.partition(b" causality")[0]
        for causality in CAUSALITIES[version]:
            for variability in VARIABILITIES:
                if variability in ALLOWED[causality].split():
                    continue
                for initial in ("", ' initial="exact"'):
                    pair = (
                        f' causality="{causality}" variability="{variability}"{initial}'
                    )
                    assert old in text
                    yield (
                        kind,
                        f"{pair[1:]} of {kind}",
                        text.replace(old, place + pair.encode()),
                    )


POINTERS = (
    (
        "xml",
        b'<Unknown index="3" dependencies="1"/>',
        (
            b'<Unknown index="#" dependencies="1"/>',
            b'<Unknown index="3" dependencies="#"/>',
            b'<Unknown index="3" dependencies="1 #"/>',
        ),
    ),
    ("xml", b'<Unknown index="4"/>', (b'<Unknown index="#"/>',)),
    ("xml", b'<Real start="0"/>', (b'<Real start="0" derivative="#"/>',)),
    (
        "xml3",
        b'<Output valueReference="5" dependencies="2"/>',
        (
            b'<Output valueReference="#" dependencies="2"/>',
            b'<Output valueReference="5" dependencies="#"/>',
            b'<Output valueReference="5" dependencies="2 #"/>',
        ),
    ),
    (
        "xml3",
        b'<InitialUnknown valueReference="5"/>',
        (b'<InitialUnknown valueReference="#"/>',),
    ),
    ("xml3", b'<Dimension valueReference="1"/>', (b'<Dimension valueReference="#"/>',)),
)
"""Kind, what refers to another variable, and what takes its place; `#` is the
reference."""


def pointing_nowhere() -> Iterator[tuple[str, str, bytes]]:
    """Yield kind, fault and model description for each reference to no variable."""
    full = {"xml": XML, "xml3": XML_3}
    for kind, right, changes in POINTERS:
        assert right in full[kind]
        for wrong in changes:
            for reference in NOWHERE:
                is_list = b"dependencies" in wrong.partition(b"#")[0]
                is_time = kind == "xml3" and reference == b"0"
                if is_time or (is_list and not reference):
                    continue  # the standard allows these
                result = wrong.replace(b"#", reference)
                yield kind, result.decode(), full[kind].replace(right, result, 1)
