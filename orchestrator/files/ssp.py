"""SSP files, read: a .ssp, a folder, or an .ssd; SSP 1.0 with one flat system."""

from __future__ import annotations

from dataclasses import replace
from math import isfinite
from pathlib import Path
from typing import Any
from urllib.parse import unquote

from lxml import etree

from desat.components.contract.block import Scalar
from desat.components.contract.units import Unit

from ..system.draft import Draft, DraftComponent
from ..system.errors import DesatError
from ..system.interface import base_name
from ..system.model import Connection, Connector
from ..system.parameters import unit_of
from . import library
from .io import contents, inside, regular
from .xml import parse_bytes, validate

SSD = "http://ssp-standard.org/SSP1/SystemStructureDescription"
SSC = "http://ssp-standard.org/SSP1/SystemStructureCommon"
SSV = "http://ssp-standard.org/SSP1/SystemStructureParameterValues"
OSP = "http://opensimulationplatform.com/SSP/OSPAnnotations"
OMS = "https://raw.githubusercontent.com/OpenModelica/OMSimulator/master/schema/oms.xsd"
FILE = "SystemStructure.ssd"
ABOUT = "extra/desat/scenario.json"
"""Where a packed scenario keeps its story, numbers and plots; other tools pass it by."""


def read(path: Path) -> Draft:
    """A system from a .ssp, a folder with a SystemStructure.ssd, or an .ssd, interfaces not yet
    loaded. Raises DesatError where there is nothing to go on with."""
    if not path.exists():
        raise DesatError(f"{path}: no such file or folder")
    if not path.is_dir():
        regular(path, str(path))
    if path.is_file() and path.suffix != ".ssd":
        folder, where = library.extract(path), f"{path.name}/"
    else:
        folder, where = (path if path.is_dir() else path.parent), ""
    file = path if path.suffix == ".ssd" else inside(folder, FILE)
    if not file.exists():
        raise DesatError(f"{path}: holds no {FILE}")
    reader = _Reader(folder, file, where + file.name if where else str(file), where)
    draft = reader.system()
    file = inside(folder, ABOUT)
    if file.exists():
        from .reader import travelled  # pydantic, only where there is something to check

        draft.about = content = travelled(file, f"{where}{ABOUT}")
        draft.output_classes.update(content.output_classes)
        draft.inner = content.inner or 1  # what says none was packed before it was said
        draft.accuracy = content.accuracy or draft.accuracy
    draft.problems = reader.problems
    return draft


class _Reader:
    def __init__(self, folder: Path, file: Path, where: str, prefix: str) -> None:
        self.folder, self.file, self.where, self.prefix = folder, file, where, prefix
        self.problems: list[str] = []

    def at(self, element: Any) -> str:
        return f"{self.where}:{element.sourceline}"

    def system(self) -> Draft:
        root = parse_bytes(contents(self.file, self.where), self.where)
        if root.tag != f"{{{SSD}}}SystemStructureDescription":
            raise DesatError(f"{self.where}: not an SSP 1.0 SystemStructureDescription")
        self.problems += validate(root, "SystemStructureDescription.xsd", self.where)
        element = root.find(f"{{{SSD}}}System")
        if element is None:
            raise DesatError(f"{self.where}: holds no System")
        draft = Draft(element.get("name", ""), self.where)
        for child in element.iterfind(f"{{{SSD}}}Elements/*"):
            if child.tag == f"{{{SSD}}}Component":
                component = self.component(child)
                if component.name in draft.components:
                    self.problems.append(f"{self.at(child)}: component {component.name} twice")
                draft.components[component.name] = component
            else:
                tag = etree.QName(child).localname
                raise DesatError(
                    f"{self.at(child)}: element {child.get('name')} is a {tag}; only components of "
                    "one flat system are supported"
                )
        draft.connections = [
            self.connection(c)
            for c in element.iterfind(f"{{{SSD}}}Connections/{{{SSD}}}Connection")
        ]
        for binding, name, value, unit, at in self.bindings(element):
            owner, _, variable = name.partition(".")
            if owner in draft.components:
                _give(draft.components[owner], variable, value, unit, f"{at}: {name}")
            else:
                self.problems.append(
                    f"{self.at(binding)}: parameter {name} belongs to no component"
                )
        self.experiment(root, draft)
        for child in element.iterfind(f"{{{SSD}}}Elements/{{{SSD}}}Component"):
            hint = child.find(f".//{{{OSP}}}StepSizeHint")
            if hint is not None and draft.step:
                decimation = max(1, round(self.number(hint, "value", "0") / draft.step))
                draft.components[child.get("name", "")].decimation = decimation
        return draft

    def component(self, element: Any) -> DraftComponent:
        source = unquote(element.get("source", ""))
        component = DraftComponent(
            element.get("name", ""), source, line=element.sourceline,
            fmu=library.find(source, self.folder) if self.inside(element, source) else None,
        )  # fmt: skip
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
        for _, name, value, unit, at in self.bindings(element):
            _give(component, name, value, unit, f"{at}: {component.name}.{name}")
        return component

    def inside(self, element: Any, source: str) -> Path | None:
        """The path of a file that the system names; None, and a problem, for one outside."""
        try:
            return inside(self.folder, source)
        except DesatError as error:
            self.problems.append(f"{self.at(element)}: source {error}")
            return None

    def number(self, element: Any, key: str, default: str = "") -> float:
        """A finite number. Raises DesatError."""
        text = element.get(key, default)
        try:
            if isfinite(number := float(text)):
                return number
        except ValueError:
            pass
        raise DesatError(f"{self.at(element)}: {key} = {text[:40]!r}: a finite number is needed")

    def connection(self, element: Any) -> Connection:
        source, target = element.get("startElement"), element.get("endElement")
        output, input_ = element.get("startConnector"), element.get("endConnector")
        if output is None or input_ is None:
            raise DesatError(f"{self.at(element)}: a connection names two connectors")
        if source is None or target is None:
            raise DesatError(
                f"{self.at(element)}: a connector of the system itself is not supported"
            )
        connection = Connection(
            source, output, target, input_, line=element.sourceline,
            converts=element.get("suppressUnitConversion", "false") not in ("true", "1"),
        )  # fmt: skip
        for child in element:
            if child.tag == f"{{{SSC}}}LinearTransformation":
                factor = self.number(child, "factor", "1")
                offset = self.number(child, "offset", "0")
                connection = replace(connection, factor=factor, offset=offset)
            elif etree.QName(child).namespace == SSC:
                raise DesatError(
                    f"{self.at(child)}: {etree.QName(child).localname} of {connection} is not "
                    "supported; LinearTransformation is"
                )
        return connection

    def bindings(self, element: Any) -> list[tuple[Any, str, Scalar, Unit | None, str]]:
        """(binding, prefixed name, value, its unit where one is given, file and line) of the
        parameter sets bound to a component or system."""
        values: list[tuple[Any, str, Scalar, Unit | None, str]] = []
        given: dict[str, str] = {}
        for binding in element.iterfind(f"{{{SSD}}}ParameterBindings/{{{SSD}}}ParameterBinding"):
            if binding.find(f"{{{SSD}}}ParameterMapping") is not None:
                raise DesatError(f"{self.at(binding)}: a ParameterMapping is not supported")
            prefix = binding.get("prefix", "")
            source = binding.get("source")
            if source is None:
                root = binding.find(f"{{{SSD}}}ParameterValues/{{{SSV}}}ParameterSet")
                where = self.where
            else:
                file = self.inside(binding, unquote(source))
                where = f"{self.prefix}{source}"
                if file is None:
                    continue
                if not file.exists():
                    self.problems.append(f"{self.at(binding)}: {source} is missing")
                    continue
                root = parse_bytes(contents(file, where), where)
                self.problems += validate(root, "SystemStructureParameterValues.xsd", where)
            if root is None:
                continue
            for parameter in root.iterfind(f"{{{SSV}}}Parameters/{{{SSV}}}Parameter"):
                value = next(iter(parameter), None)
                if value is not None:
                    name, at = prefix + parameter.get("name", ""), f"{where}:{value.sourceline}"
                    if name in given:
                        self.problems.append(f"{at} and {given[name]}: {name} is given twice")
                    given[name] = at
                    unit = self.unit(value.get("unit"), root, f"{at}: {name}")
                    values.append((binding, name, self.value(value, where), unit, at))
        return values

    def unit(self, name: str | None, root: Any, where: str) -> Unit | None:
        """The unit that a value is given in: of the parameter set's own units, or one of ours."""
        if name is None:
            return None
        for unit in root.iterfind(f"{{{SSV}}}Units/{{{SSC}}}Unit"):
            base = unit.find(f"{{{SSC}}}BaseUnit")
            if unit.get("name") == name and base is not None:
                try:
                    exponents = {k: int(base.get(k, "0")) for k in Unit._fields[:6]}
                except ValueError as error:
                    raise DesatError(f"{where}: unit {name}: {error}") from error
                factor, offset = self.number(base, "factor", "1"), self.number(base, "offset", "0")
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

    def experiment(self, root: Any, draft: Draft) -> None:
        experiment = root.find(f"{{{SSD}}}DefaultExperiment")
        if experiment is None:
            return
        draft.start = self.number(experiment, "startTime", "0")
        if experiment.get("stopTime") is not None:
            draft.stop = self.number(experiment, "stopTime")
        for element in experiment.iter():
            if etree.QName(element).localname == "FixedStepAlgorithm" and element.get(
                "baseStepSize"
            ):
                draft.step = self.number(element, "baseStepSize")


def _give(
    component: DraftComponent, name: str, value: Scalar, unit: Unit | None, where: str
) -> None:  # fmt: skip
    """Give a component's parameter the value that a parameter set has."""
    component.parameters[name] = value
    component.given[name] = where
    component.given.setdefault(base_name(name), where)
    if unit is not None:
        component.units[name] = unit
