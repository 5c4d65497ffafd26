"""SSP files: read one (a .ssp, a folder, or an .ssd), and pack one that every tool can load.

Reading takes SSP 1.0 with one flat system. Packing writes the universal profile: what libcosim,
Ecos, OMSimulator and fmpy load alike (one flat system, listed connectors wired, one parameter
set per component, the step size in annotations).
"""

from __future__ import annotations

import io
import json
import os
import zipfile
from pathlib import Path
from typing import Any
from urllib.parse import unquote

from lxml import etree

from desat.components.contract.block import Scalar
from desat.components.contract.units import Unit

from ..system.errors import DesatError
from ..system.expression import unit_of
from ..system.model import Component, Connection, Connector, System
from . import library
from .xml import parse_bytes, validate

SSD = "http://ssp-standard.org/SSP1/SystemStructureDescription"
SSC = "http://ssp-standard.org/SSP1/SystemStructureCommon"
SSV = "http://ssp-standard.org/SSP1/SystemStructureParameterValues"
OSP = "http://opensimulationplatform.com/SSP/OSPAnnotations"
OMS = "https://raw.githubusercontent.com/OpenModelica/OMSimulator/master/schema/oms.xsd"
FILE = "SystemStructure.ssd"
ABOUT = "extra/desat/scenario.json"
"""Where a packed scenario keeps its story, numbers and plots; other tools pass it by."""


# --- reading ----------------------------------------------------------------------------------


def read(path: Path) -> tuple[System, list[str]]:
    """A system from a .ssp, a folder with a SystemStructure.ssd, or an .ssd, and its schema
    errors. Raises DesatError where there is nothing to go on with."""
    if not path.exists():
        raise DesatError(f"{path}: no such file or folder")
    if path.is_file() and path.suffix != ".ssd":
        folder, where = library.extract(path), f"{path.name}/"
    else:
        folder, where = (path if path.is_dir() else path.parent), ""
    file = path if path.suffix == ".ssd" else folder / FILE
    if not file.exists():
        raise DesatError(f"{path}: holds no {FILE}")
    reader = _Reader(folder, file, where + file.name if where else str(file), where)
    system = reader.system()
    about = folder / ABOUT
    if about.exists():
        system.about = json.loads(about.read_text(encoding="utf-8"))
        system.output_classes.update(system.about.get("output_classes", {}))
    return system, reader.problems


class _Reader:
    def __init__(self, folder: Path, file: Path, where: str, prefix: str) -> None:
        self.folder, self.file, self.where, self.prefix = folder, file, where, prefix
        self.problems: list[str] = []

    def at(self, element: Any) -> str:
        return f"{self.where}:{element.sourceline}"

    def system(self) -> System:
        root = parse_bytes(self.file.read_bytes(), self.where)
        if root.tag != f"{{{SSD}}}SystemStructureDescription":
            raise DesatError(f"{self.where}: not an SSP 1.0 SystemStructureDescription")
        self.problems += validate(root, "SystemStructureDescription.xsd", self.where)
        element = root.find(f"{{{SSD}}}System")
        if element is None:
            raise DesatError(f"{self.where}: holds no System")
        system = System(element.get("name", ""), self.where, {}, [])
        for child in element.iterfind(f"{{{SSD}}}Elements/*"):
            if child.tag == f"{{{SSD}}}Component":
                component = self.component(child)
                if component.name in system.components:
                    self.problems.append(f"{self.at(child)}: component {component.name} twice")
                system.components[component.name] = component
            else:
                tag = etree.QName(child).localname
                raise DesatError(
                    f"{self.at(child)}: element {child.get('name')} is a {tag}; only components of "
                    "one flat system are supported"
                )
        for child in element.iterfind(f"{{{SSD}}}Connections/{{{SSD}}}Connection"):
            self.connection(child, system)
        for binding, name, value, unit in self.bindings(element):
            owner, _, variable = name.partition(".")
            if owner in system.components:
                system.components[owner].parameters[variable] = value
                if unit is not None:
                    system.components[owner].units[variable] = unit
            else:
                self.problems.append(
                    f"{self.at(binding)}: parameter {name} belongs to no component"
                )
        self.experiment(root, system)
        for child in element.iterfind(f"{{{SSD}}}Elements/{{{SSD}}}Component"):
            hint = child.find(f".//{{{OSP}}}StepSizeHint")
            if hint is not None and system.step:
                decimation = max(1, round(float(hint.get("value", "0")) / system.step))
                system.components[child.get("name")].decimation = decimation
        return system

    def component(self, element: Any) -> Component:
        source = unquote(element.get("source", ""))
        component = Component(
            element.get("name", ""),
            source,
            line=element.sourceline,
            fmu=library.find(source, self.folder),
        )
        for child in element.iterfind(f"{{{SSD}}}Connectors/{{{SSD}}}Connector"):
            kind = next((c for c in child if etree.QName(c).namespace == SSC), None)
            connector = Connector(
                child.get("name", ""),
                child.get("kind", ""),
                "" if kind is None else etree.QName(kind).localname,
                "" if kind is None else kind.get("unit", ""),
                child.sourceline,
            )
            if connector.name in component.connectors:
                self.problems.append(
                    f"{self.at(child)}: {component.name}.{connector.name} is listed twice"
                )
            component.connectors[connector.name] = connector
        for _, name, value, unit in self.bindings(element):
            component.parameters[name] = value
            if unit is not None:
                component.units[name] = unit
        return component

    def connection(self, element: Any, system: System) -> None:
        if element.get("startElement") is None or element.get("endElement") is None:
            raise DesatError(
                f"{self.at(element)}: a connector of the system itself is not supported"
            )
        connection = Connection(
            element.get("startElement"), element.get("startConnector"),
            element.get("endElement"), element.get("endConnector"),
            line=element.sourceline,
            converts=element.get("suppressUnitConversion", "false") not in ("true", "1"),
        )  # fmt: skip
        for child in element:
            if child.tag == f"{{{SSC}}}LinearTransformation":
                connection.factor = float(child.get("factor", "1"))
                connection.offset = float(child.get("offset", "0"))
            elif etree.QName(child).namespace == SSC:
                raise DesatError(
                    f"{self.at(child)}: {etree.QName(child).localname} of {connection} is not "
                    "supported; LinearTransformation is"
                )
        system.connections.append(connection)

    def bindings(self, element: Any) -> list[tuple[Any, str, Scalar, Unit | None]]:
        """(binding, prefixed name, value, its unit where one is given) of the parameter sets bound
        to a component or system."""
        found: list[tuple[Any, str, Scalar, Unit | None]] = []
        for binding in element.iterfind(f"{{{SSD}}}ParameterBindings/{{{SSD}}}ParameterBinding"):
            if binding.find(f"{{{SSD}}}ParameterMapping") is not None:
                raise DesatError(f"{self.at(binding)}: a ParameterMapping is not supported")
            prefix = binding.get("prefix", "")
            source = binding.get("source")
            if source is None:
                root = binding.find(f"{{{SSD}}}ParameterValues/{{{SSV}}}ParameterSet")
                where = self.where
            else:
                file = self.folder / unquote(source)
                where = f"{self.prefix}{source}"
                if not file.exists():
                    self.problems.append(f"{self.at(binding)}: {source} is missing")
                    continue
                root = parse_bytes(file.read_bytes(), where)
                self.problems += validate(root, "SystemStructureParameterValues.xsd", where)
            if root is None:
                continue
            for parameter in root.iterfind(f"{{{SSV}}}Parameters/{{{SSV}}}Parameter"):
                value = next(iter(parameter), None)
                if value is not None:
                    name, at = prefix + parameter.get("name", ""), f"{where}:{value.sourceline}"
                    unit = self.unit(value.get("unit"), root, f"{at}: {name}")
                    found.append((binding, name, self.value(value, where), unit))
        return found

    def unit(self, name: str | None, root: Any, where: str) -> Unit | None:
        """The unit that a value is given in: of the parameter set's own units, or one of ours."""
        if name is None:
            return None
        for unit in root.iterfind(f"{{{SSV}}}Units/{{{SSC}}}Unit"):
            base = unit.find(f"{{{SSC}}}BaseUnit")
            if unit.get("name") == name and base is not None:
                exponents = {k: int(base.get(k, "0")) for k in ("kg", "m", "s", "A", "K", "rad")}
                factor, offset = float(base.get("factor", "1")), float(base.get("offset", "0"))
                if base.get("mol", "0") == base.get("cd", "0") == "0":
                    return Unit(**exponents, factor=factor, offset=offset)
        try:
            return unit_of(name)
        except DesatError as error:
            self.problems.append(f"{where}: {error}")
            return None

    def value(self, element: Any, where: str) -> Scalar:
        kind, text = etree.QName(element).localname, element.get("value", "")
        try:
            if kind == "Real":
                return float(text)
            if kind in ("Integer", "Enumeration"):
                return int(text)
            if kind == "Boolean":
                return {"true": True, "1": True, "false": False, "0": False}[text]
        except (ValueError, KeyError) as error:
            raise DesatError(f"{where}:{element.sourceline}: {text!r} is no {kind}") from error
        raise DesatError(f"{where}:{element.sourceline}: a {kind} value is not supported")

    def experiment(self, root: Any, system: System) -> None:
        experiment = root.find(f"{{{SSD}}}DefaultExperiment")
        if experiment is None:
            return
        system.start = float(experiment.get("startTime", "0"))
        if experiment.get("stopTime") is not None:
            system.stop = float(experiment.get("stopTime"))
        for element in experiment.iter():
            if etree.QName(element).localname == "FixedStepAlgorithm" and (
                step := element.get("baseStepSize")
            ):
                system.step = float(step)


# --- packing ----------------------------------------------------------------------------------


def pack(system: System, target: Path) -> None:
    """Write a system as one self-contained .ssp in the universal profile.

    Components that step once in several steps get a step-size hint, which of the other tools only
    libcosim reads. Raises DesatError for what they would misread: a connection that converts units
    or values, a component without a file.
    """
    for connection in system.connections:
        if (connection.factor, connection.offset) != (1.0, 0.0):
            raise DesatError(
                f"{system.where}:{connection.line}: {connection} converts its value; other tools "
                "would not, so it cannot be packed"
            )
    wired = {(c.source, c.output) for c in system.connections}
    wired |= {(c.target, c.input) for c in system.connections}
    members: dict[str, bytes] = {}
    root = etree.Element(
        f"{{{SSD}}}SystemStructureDescription",
        name=system.name.replace("/", "_"),
        version="1.0",
        # declared here: libcosim takes a declaration further down for content
        nsmap={"ssd": SSD, "ssc": SSC, "ssv": SSV, "osp": OSP, "oms": OMS},
    )
    top = _sub(root, "System", name="system")
    elements = _sub(top, "Elements")
    for component in system.components.values():
        if component.fmu is None or component.interface is None:
            raise DesatError(f"{system.where}: {component.name}: no FMU {component.source}")
        source = f"resources/{Path(component.source).name}"
        members[source] = component.fmu.read_bytes()
        element = _sub(
            elements, "Component", name=component.name, type="application/x-fmu-sharedlibrary",
            implementation="CoSimulation", source=source,
        )  # fmt: skip
        connectors = _sub(element, "Connectors")
        for signal in component.interface.signals.values():
            if (component.name, signal.name) in wired:
                connector = _sub(connectors, "Connector", name=signal.name, kind=signal.causality)
                etree.SubElement(connector, f"{{{SSC}}}{signal.kind}")
        if component.parameters:
            file = f"resources/{component.name}.ssv"
            members[file] = _parameter_set(component)
            bindings = _sub(element, "ParameterBindings")
            _sub(bindings, "ParameterBinding", source=file)
        if component.decimation > 1:
            assert system.step is not None
            annotation = _annotation(element, "com.opensimulationplatform")
            hint = repr(component.decimation * system.step)
            etree.SubElement(annotation, f"{{{OSP}}}StepSizeHint", value=hint)
    connections = _sub(top, "Connections")
    for c in system.connections:
        _sub(
            connections, "Connection", startElement=c.source, startConnector=c.output,
            endElement=c.target, endConnector=c.input,
        )  # fmt: skip
    _annotate_for_omsimulator(top, system)
    _default_experiment(root, system)
    members[FILE] = _text(root)
    if system.about:
        members[ABOUT] = json.dumps(system.about, indent=1, sort_keys=True).encode()
    _write_archive(members, target)


def _sub(parent: Any, tag: str, /, **attributes: str) -> Any:
    return etree.SubElement(parent, f"{{{SSD}}}{tag}", attributes)


def _annotation(parent: Any, kind: str) -> Any:
    return etree.SubElement(_sub(parent, "Annotations"), f"{{{SSC}}}Annotation", type=kind)


def _text(root: Any) -> bytes:
    return bytes(etree.tostring(root, xml_declaration=True, encoding="UTF-8", pretty_print=True))


def _parameter_set(component: Component) -> bytes:
    root = etree.Element(
        f"{{{SSV}}}ParameterSet", name="parameters", version="1.0", nsmap={"ssv": SSV, "ssc": SSC}
    )
    parameters = etree.SubElement(root, f"{{{SSV}}}Parameters")
    assert component.interface is not None
    for name, value in component.parameters.items():
        parameter = etree.SubElement(parameters, f"{{{SSV}}}Parameter", name=name)
        kind = component.interface.signals[name].kind
        text = str(value).lower() if isinstance(value, bool) else repr(value)
        etree.SubElement(parameter, f"{{{SSV}}}{kind}", value=text)
    return _text(root)


def _annotate_for_omsimulator(top: Any, system: System) -> None:
    annotation = _annotation(top, "org.openmodelica")
    oms = etree.SubElement(annotation, f"{{{OMS}}}Annotations")
    information = etree.SubElement(oms, f"{{{OMS}}}SimulationInformation")
    etree.SubElement(
        information, f"{{{OMS}}}FixedStepMaster", description="oms-ma", stepSize=f"{system.step!r}"
    )


def _default_experiment(root: Any, system: System) -> None:
    experiment = _sub(root, "DefaultExperiment", startTime=f"{system.start!r}")
    if system.stop is not None:
        experiment.set("stopTime", repr(system.stop))
    annotation = _annotation(experiment, "com.opensimulationplatform")
    algorithm = etree.SubElement(annotation, f"{{{OSP}}}Algorithm")
    etree.SubElement(
        algorithm,
        f"{{{OSP}}}FixedStepAlgorithm",
        baseStepSize=f"{system.step!r}",
        numWorkerThreads="0",
    )


def _write_archive(members: dict[str, bytes], target: Path) -> None:
    target.parent.mkdir(parents=True, exist_ok=True)
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for name, data in sorted(members.items()):
            info = zipfile.ZipInfo(name)
            info.create_system, info.external_attr = 3, 0o644 << 16
            # hundreds of these with the same FMUs: level 6 takes thrice the time for 10 % less
            archive.writestr(info, data, zipfile.ZIP_DEFLATED, compresslevel=1)
    part = target.with_name(f"{target.name}.{os.getpid()}.part")
    part.write_bytes(buffer.getvalue())
    part.replace(target)
