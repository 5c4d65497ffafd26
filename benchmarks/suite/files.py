"""Write the systems of the suite as SSP files."""

from __future__ import annotations

import io
import re
import subprocess
import tempfile
import zipfile
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from xml.sax.saxutils import quoteattr
from zlib import crc32

from desat.fmus.native import targets_of

SOURCE = Path(__file__).with_name("suite.c")
HEAD = '<?xml version="1.0" encoding="UTF-8"?>\n'
SSP = "http://ssp-standard.org/SSP1/SystemStructure"
OSP = "http://opensimulationplatform.com/SSP/OSPAnnotations"
NAMESPACES = (
    f'xmlns:ssd="{SSP}Description" xmlns:ssc="{SSP}Common" '
    f'xmlns:ssv="{SSP}ParameterValues" xmlns:ssm="{SSP}ParameterMapping"'
)
#: libcosim reads its algorithm and step here.
STEP = (
    '<ssd:Annotations><ssc:Annotation type="com.opensimulationplatform">'
    '<osp:Algorithm><osp:FixedStepAlgorithm baseStepSize="1" numWorkerThreads="0"/>'
    "</osp:Algorithm></ssc:Annotation></ssd:Annotations>"
)
UNITS = {
    "m": 'm="1"',
    "km": 'm="1" factor="1000"',
    "s": 's="1"',
    "K": 'K="1"',
    "degC": 'K="1" offset="273.15"',
}
ITEMS = range(8)  # of the enumeration `law`
ARRAYS = (70, 71)  # references of the arrays
PLATFORMS_3 = {"linux64": "x86_64-linux", "win64": "x86_64-windows"}
TIME = (
    '<Float64 name="time" valueReference="66" causality="independent" '
    'variability="continuous"/>'
)
SIZE = 72  # reference of the structural parameter

Archive = dict[str, bytes]
Spoil = Callable[[Archive], object]


@dataclass(frozen=True)
class Variable:
    """A variable of suite.c: its reference decides what it is."""

    name: str
    reference: int
    type: str = "Real"
    unit: str = ""
    inner: str = ""
    start: str = ""

    @property
    def causality(self) -> str:
        """Return the causality that belongs to the reference."""
        if self.reference == SIZE:
            return "structuralParameter"
        if self.reference < 8 or self.reference == ARRAYS[0]:
            return "input"
        return "parameter" if self.reference < 16 else "output"

    @property
    def start_text(self) -> str:
        """Return the start value that suite.c has, as a description writes it."""
        n = self.reference if self.reference < 8 else 0
        if self.start:
            return self.start
        if self.type == "Boolean":
            return "true" if n % 2 else "false"
        if self.type in ("String", "Binary"):
            return ("a" if self.type == "String" else "61") * n
        return str(n)


@dataclass(frozen=True)
class Component:
    """A component and its FMU; `spoil` changes the entries of the FMU's archive."""

    name: str
    variables: tuple[Variable, ...]
    fault: int = 0
    version: str = "2.0"
    inside: str = ""
    spoil: Spoil | None = None


@dataclass(frozen=True)
class System:
    """A system of the suite, and what a good importer does with it.

    `numbers` has values at `stop`, after steps of 1 s. `refused` allows a message
    instead of them; without numbers, a message is needed.
    """

    name: str
    about: str
    components: tuple[Component, ...]
    wires: tuple[str, ...] = ()
    numbers: Mapping[str, float] = field(default_factory=dict)
    refused: bool = False
    stop: float = 10.0
    layout: str = ""
    inside: str = ""
    files: dict[str, str] = field(default_factory=dict)
    spoil: Spoil | None = None
    share: float = 1.0  # of the bytes of the .ssp that are written

    @property
    def version(self) -> str:
        """Return the newest FMI version of the components."""
        return max(c.version for c in self.components)


@cache
def libraries(platforms: str = "") -> Archive:
    """Compile suite.c for platforms as `targets_of` names them: an FMU's entries."""
    entries = {}
    with tempfile.TemporaryDirectory() as folder:
        for target in targets_of(platforms):
            name = f"suite{target.suffix}"
            command = [*target.compiler, "-O1", "-fPIC", *target.link, str(SOURCE)]
            subprocess.run([*command, "-o", name, "-lm"], cwd=folder, check=True)
            path = f"binaries/{target.platform}/{name}"
            entries[path] = Path(folder, name).read_bytes()
    return entries


def element(tag: str, inner: str = "", **attributes: object) -> str:
    """Return an XML element; attributes that are empty are left out."""
    texts = [f" {k}={quoteattr(str(v))}" for k, v in attributes.items() if v != ""]
    return f"<{tag}{''.join(texts)}>{inner}</{tag}>"


def zipped(entries: Iterable[tuple[str, bytes]]) -> bytes:
    """Return an archive with these entries."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in entries:
            archive.writestr(zipfile.ZipInfo(name), data, zipfile.ZIP_DEFLATED)
    return file.getvalue()


# --- FMUs -----------------------------------------------------------------------------


def _variable(variable: Variable, version: str) -> str:
    of_type: dict[str, object] = {"unit": variable.unit}
    if variable.type == "Enumeration":
        of_type["declaredType"] = "law"
    inner = variable.inner
    if variable.causality != "output":
        if variable.type == "Clock":
            of_type["intervalVariability"] = "triggered"
        elif version == "3.0" and variable.type in ("String", "Binary"):
            inner += element("Start", value=variable.start_text)
        else:
            of_type["start"] = variable.start_text
    outer: dict[str, object] = {
        "name": variable.name,
        "valueReference": variable.reference,
        "causality": variable.causality,
    }
    if "arameter" in variable.causality:
        outer["variability"] = "fixed"
    elif variable.type not in ("Real", "Float64", "Float32", "Clock"):
        outer["variability"] = "discrete"
    if version == "3.0":
        return element(variable.type, inner, **outer, **of_type)
    return element("ScalarVariable", element(variable.type, "", **of_type), **outer)


def _types(version: str) -> str:
    items = "".join(element("Item", name=f"i{n}", value=n) for n in ITEMS)
    if version == "3.0":
        return element("EnumerationType", items, name="law")
    return element("SimpleType", element("Enumeration", items), name="law")


def _source(reference: int) -> int:
    """Return the reference on which an output depends at once; -1 if there is none."""
    if reference == ARRAYS[1]:
        return ARRAYS[0]
    return reference % 16 if reference < 48 else -1


def _structure(component: Component) -> str:
    """Return the inside of ModelStructure: outputs, and the same as initial unknowns."""
    third = component.version == "3.0"
    places = {
        v.reference: v.reference if third else i
        for i, v in enumerate(component.variables, 1)
    }
    texts = []
    for tag in ("Output", "InitialUnknown"):
        rows = ""
        for variable in component.variables:
            if variable.causality == "output":
                place = places[variable.reference]
                source = places.get(_source(variable.reference), "")
                name, key = (tag, "valueReference") if third else ("Unknown", "index")
                rows += f'<{name} {key}="{place}" dependencies="{source}"/>'
        texts.append(rows if third else element(f"{tag}s", rows))
    return "".join(texts)


def description(component: Component) -> str:
    """Return the modelDescription.xml of a component's FMU."""
    units = {v.unit for v in component.variables} - {""}
    parts = ""
    if units:
        parts = element(
            "UnitDefinitions",
            "".join(
                f'<Unit name="{u}"><BaseUnit {UNITS[u]}/></Unit>' for u in sorted(units)
            ),
        )
    if any(v.type == "Enumeration" for v in component.variables):
        parts += element("TypeDefinitions", _types(component.version))
    token_key = "guid" if component.version == "2.0" else "instantiationToken"
    # some hosts take two FMUs with one token for the same
    contents = repr((component.name, component.variables)).encode()
    token = f"{{suite-{component.fault}-{crc32(contents):08x}}}"
    variables = "".join(_variable(v, component.version) for v in component.variables)
    if component.version == "3.0":
        variables += TIME
    return (
        f'{HEAD}<fmiModelDescription fmiVersion="{component.version}" '
        f'modelName="suite" {token_key}="{token}"><CoSimulation '
        'modelIdentifier="suite" canHandleVariableCommunicationStepSize="true"/>'
        f"{parts}{element('ModelVariables', variables)}"
        f"{element('ModelStructure', _structure(component))}</fmiModelDescription>"
    )


def fmu(component: Component, platforms: str = "") -> bytes:
    """Return a component's FMU."""
    entries = {"modelDescription.xml": description(component).encode()}
    for name, data in libraries(platforms).items():
        if component.version == "3.0":
            for old, new in PLATFORMS_3.items():
                name = name.replace(f"/{old}/", f"/{new}/")
        entries[name] = data
    if component.spoil:
        component.spoil(entries)
    return zipped(entries.items())


# --- systems --------------------------------------------------------------------------


def wire(text: str) -> str:
    """Return the connection `a.y|b.u[|INNER or ATTRIBUTES]`."""
    start, end, *more = text.split("|")
    attributes = ""
    for kind, name in (("start", start), ("end", end)):
        owner, _, connector = name.partition(".")
        attributes += f' {kind}Element="{owner}" {kind}Connector={quoteattr(connector)}'
    inner = more[0] if more else ""
    if not inner.startswith("<"):
        attributes, inner = f"{attributes} {inner}", ""
    return f"<ssd:Connection{attributes}>{inner}</ssd:Connection>"


def connectors(variables: Iterable[Variable]) -> str:
    """Return the connectors of these variables."""
    rows = ""
    for v in variables:
        kind = v.causality.replace("structuralP", "p")
        name = "law" if v.type == "Enumeration" else ""
        type_ = element(f"ssc:{v.type}", unit=v.unit, name=name)
        sizes = re.findall(r'start="(\d+)"', v.inner) or (["3"] if v.inner else [])
        type_ += "".join(element("ssc:Dimension", size=n) for n in sizes)
        rows += element("ssd:Connector", type_, name=v.name, kind=kind)
    return element("ssd:Connectors", rows)


def structure(system: System) -> str:
    """Return the SystemStructure.ssd of a system."""
    parts = {
        c.name: element(
            "ssd:Component",
            connectors(c.variables) + c.inside,
            name=c.name,
            type="application/x-fmu-sharedlibrary",
            source=f"resources/{c.name}.fmu",
        )
        for c in system.components
    }
    elements = system.layout.format_map(parts) or "".join(parts.values())
    inner = system.inside + element("ssd:Elements", elements)
    if system.wires:
        inner += element("ssd:Connections", "".join(map(wire, system.wires)))
    variables = [v for c in system.components for v in c.variables]
    after = ""
    if any(v.type == "Enumeration" for v in variables):
        items = "".join(element("ssc:Item", name=f"i{n}", value=n) for n in ITEMS)
        law = element("ssc:Enumeration", items, name="law")
        after = element("ssd:Enumerations", law)
    if units := sorted({v.unit for v in variables} - {""}):
        texts = (
            f'<ssc:Unit name="{u}"><ssc:BaseUnit {UNITS[u]}/></ssc:Unit>' for u in units
        )
        after += element("ssd:Units", "".join(texts))
    version = "2.0" if system.version == "3.0" else "1.0"
    return (
        f"{HEAD}<ssd:SystemStructureDescription {NAMESPACES} "
        f'xmlns:osp="{OSP}" name="{system.name}" version="{version}">'
        f"{element('ssd:System', inner, name=system.name)}{after}"
        f'<ssd:DefaultExperiment startTime="0" stopTime="{system.stop:g}">{STEP}'
        "</ssd:DefaultExperiment>"
        "</ssd:SystemStructureDescription>"
    )


def package(system: System, platforms: str = "") -> bytes:
    """Return the .ssp of a system."""
    entries = {"SystemStructure.ssd": structure(system).encode()}
    for component in system.components:
        entries[f"resources/{component.name}.fmu"] = fmu(component, platforms)
    entries |= {name: text.encode() for name, text in system.files.items()}
    if system.spoil:
        system.spoil(entries)
    data = zipped(entries.items())
    return data[: int(system.share * len(data))]
