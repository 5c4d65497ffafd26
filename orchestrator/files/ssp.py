"""Read SSP files: a .ssp, a folder, or an .ssd; nested systems become one flat system.

A component `add` of a system `inner` is called `inner_add`. Connectors of systems, and
signals of dictionaries, pass on what they receive: a connection through them becomes
one from component to component, with the product of its transformations, and a value
that is given to one of them is given to all that it reaches. As SSP 1.0 specifies,
values of an outer system take precedence over those of an inner one, and an unmapped
parameter of a parameter set with a mapping keeps its own name.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from math import isfinite
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple
from urllib.parse import unquote

from lxml import etree

from desat.components.contract.block import Scalar
from desat.components.contract.units import Unit

from ..system.errors import DesatError, nearest
from ..system.interface import MISSING, Signal, base_name
from ..system.model import Component, Connection, Connector, Fmu
from ..system.options import Options
from ..system.parameters import expand, in_unit_of, known_unit, unit_of
from . import library, paths
from .connect import warn, warning_of_namesake
from .draft import Draft, component_of
from .io import contents, inside, regular
from .xml import parse_bytes, validate

SSD = "http://ssp-standard.org/SSP1/SystemStructureDescription"
SSC = "http://ssp-standard.org/SSP1/SystemStructureCommon"
SSV = "http://ssp-standard.org/SSP1/SystemStructureParameterValues"
SSM = "http://ssp-standard.org/SSP1/SystemStructureParameterMapping"
SSB = "http://ssp-standard.org/SSP1/SystemStructureSignalDictionary"
OSP = "http://opensimulationplatform.com/SSP/OSPAnnotations"
OMS = "https://raw.githubusercontent.com/OpenModelica/OMSimulator/master/schema/oms.xsd"
FILE = "SystemStructure.ssd"
FMU_TYPE = "application/x-fmu-sharedlibrary"
# File with description, numbers and plots of a packed scenario; other tools ignore it.
ABOUT = "extra/desat/scenario.json"


def read(path: Path, options: Options) -> Draft:
    """Read an SSP file: components, connections and values.

    Parameters
    ----------
    path
        A .ssp, a folder with a SystemStructure.ssd, or an .ssd.
    options
        Whether it may name files outside its folder, and what its components run as.

    Raises
    ------
    DesatError
        If the file cannot be used; problems of what it names are in the draft.
    """
    if not path.exists():
        raise DesatError(f"{path}: no such file or folder")
    if not path.is_dir():
        regular(path, str(path))
    if path.is_file() and path.suffix != ".ssd":
        folder, prefix = library.extract(path), f"{path.name}/"
    else:
        folder, prefix = (path if path.is_dir() else path.parent), ""
    file = path if path.suffix == ".ssd" else inside(folder, FILE)
    if not file.exists():
        raise DesatError(f"{path}: holds no {FILE}")
    place = prefix + file.name if prefix else str(file)
    draft = _Reader(folder, file, place, prefix, options).read()
    file = inside(folder, ABOUT)
    if file.exists():
        from .reader import read_packed  # imports pydantic, so only if needed

        draft.about = content = read_packed(file, f"{prefix}{ABOUT}")
        draft.output_classes.update(content.output_classes)
        # archives without it were packed before the key existed
        draft.substeps = content.substeps or 1
        draft.accuracy = content.accuracy or draft.accuracy
    return draft


# Namespaces of prefixes that a file uses without declaring them.
PREFIXES = {
    "ssd": SSD,
    "ssc": SSC,
    "ssv": SSV,
    "ssm": SSM,
    "ssb": SSB,
    "osp": OSP,
    "oms": OMS,
}


# Kind of a connector -> whether it receives values.
_TAKES = {
    "input": True,
    "parameter": True,
    "output": False,
    "calculatedParameter": False,
}


MOST_SIZE = 100_000  # elements of a dimension of an array connector
# Types of SSP 2.0 -> those of SSP 1.0; the others have one name.
_TYPES = {
    **dict.fromkeys(("Float64", "Float32"), "Real"),
    **dict.fromkeys(
        (f"{sign}Int{bits}" for sign in ("", "U") for bits in (8, 16, 32, 64)),
        "Integer",
    ),
}


def _type_of(element: Any) -> str:
    """Return the type that an element names, as SSP 1.0 calls it."""
    name: str = etree.QName(element).localname
    return _TYPES.get(name, name)


def indices_of(shape: Sequence[int]) -> Iterator[str]:
    """Yield the suffixes of an array's elements, `[1]` or `[1,2]`; "" for a scalar."""
    for index in product(*(range(1, n + 1) for n in shape)):
        yield f"[{','.join(map(str, index))}]" if index else ""


class _End(NamedTuple):
    """A connector, with the path of its system or component.

    The path is `inner.add`; "" is the outermost system.
    """

    path: str
    connector: str


@dataclass(frozen=True)
class _Link:
    """A connection as it is written, or several in sequence."""

    start: _End
    end: _End
    line: int
    factor: float = 1.0
    offset: float = 0.0
    converts: bool = True

    def after(self, first: _Link) -> _Link:
        """Combine this connection with the one before it."""
        return replace(
            self,
            start=first.start,
            factor=self.factor * first.factor,
            offset=self.factor * first.offset + self.offset,
            converts=self.converts and first.converts,
        )


class _SetValue(NamedTuple):
    """Value of a parameter set, by its name where the set is bound."""

    name: str
    # a text names an item of an enumeration; an array is a list
    value: Scalar | str | list[Scalar | str]
    unit: Unit | str | None  # a text is the name of an unknown unit
    at: str  # file and line
    unit_name: str = ""  # as it is written
    also: str = ""  # file and line of another value of the same name in the set

    def through(self, factor: float, offset: float, converts: bool) -> _SetValue:
        """Apply a transformation to the value.

        Raises DesatError if the value is a text.
        """
        unit, name = (self.unit, self.unit_name) if converts else (None, "")
        if (factor, offset) == (1.0, 0.0):
            return self._replace(unit=unit, unit_name=name)
        several = self.value if isinstance(self.value, list) else [self.value]
        numbers: list[Scalar | str] = [
            factor * x + offset for x in several if not isinstance(x, str)
        ]
        if len(numbers) != len(several):
            raise DesatError(
                f"{self.at}: {self.name} = {self.value}: a transformation needs a number"
            )
        value = numbers if isinstance(self.value, list) else numbers[0]
        return self._replace(value=value, unit=unit, unit_name=name)


class _Reader:
    """Reader of one SSP file."""

    def __init__(
        self, folder: Path, file: Path, place: str, prefix: str, options: Options
    ) -> None:
        """Prepare to read a file; `place` and `prefix` name it and its folder in messages."""
        self.options = options
        self.folder, self.file, self.place, self.prefix = folder, file, place, prefix
        self.result = Draft(place)
        self.problems, self.warnings = self.result.problems, self.result.warnings
        self.components: dict[str, Component] = {}  # by path
        # paths of systems and dictionaries -> path by which their connectors are known
        self.relays: dict[str, str] = {"": ""}
        self.kinds: dict[_End, str] = {}  # of listed connectors
        self.shapes: dict[_End, tuple[int, ...]] = {}  # of those that are arrays
        self.links: list[_Link] = []
        # path where each value is bound; a later value replaces an earlier one
        self.values: list[tuple[str, _SetValue]] = []
        # values by component and name, as they reach it
        self.set_values: dict[tuple[str, str], _SetValue] = {}
        self.hints: dict[str, float] = {}  # step (s) of single components, by path

    def at(self, element: Any) -> str:
        """Return file and line of an element, for messages."""
        return f"{self.place}:{element.sourceline}"

    def read(self) -> Draft:
        """Read the file into a draft."""
        root = self.parse(self.file, self.place)
        name = etree.QName(root)
        if name.localname == "SystemStructureDescription" and name.namespace != SSD:
            raise DesatError(
                f"{self.place}: its namespace is {name.namespace or 'none'}, that of a "
                f"draft before SSP 1.0; {SSD} is needed"
            )
        if root.tag != f"{{{SSD}}}SystemStructureDescription":
            raise DesatError(f"{self.place}: not an SSP SystemStructureDescription")
        self.validate(root, "SystemStructureDescription.xsd", self.place)
        element = root.find(f"{{{SSD}}}System")
        if element is None:
            raise DesatError(f"{self.place}: holds no System")
        draft = self.result
        draft.name = element.get("name", "")
        self.walk(element, "")
        if not self.components:
            self.problems.append(
                f"{self.at(element)}: holds no component: nothing runs"
            )
        reached = self.flatten()
        for path, value in self.values:
            self.give(path, value, value.name, reached)
        self.experiment(root)
        for path, component in self.components.items():
            if component.name in draft.components:
                self.problems.append(
                    f"{self.place}:{component.line}: component {path} twice"
                )
            ratio = 1
            if (hint := self.hints.get(path)) is not None and draft.step:
                ratio = max(1, round(hint / draft.step))
            component = replace(component, step_ratio=ratio)
            draft.components[component.name] = component
        draft.unchecked = dict.fromkeys(draft.components, "")
        self.assign()
        return draft

    def parse(self, file: Path, place: str) -> Any:
        """Parse a file and return its root.

        Known prefixes that the file does not declare are declared, with a warning.
        """
        data, declared = contents(file, place), ""
        while True:
            try:
                return parse_bytes(data, place)
            except DesatError as error:
                lacking = re.search(
                    r"Namespace prefix (\w+) .*is not defined", str(error)
                )
                prefix = lacking.group(1) if lacking else ""
                if prefix not in PREFIXES or f" {prefix} " in declared:
                    raise
                declared += f" {prefix} "
                text = f' xmlns:{prefix}="{PREFIXES[prefix]}"'.encode()
                root = re.search(rb"<[^\s?!/>]+", data)
                data = data[: root.end()] + text + data[root.end() :] if root else data
                self.warnings.append(
                    f"{place}: prefix {prefix} is not declared: taken for "
                    f"{PREFIXES[prefix]}"
                )

    def validate(self, root: Any, schema: str, place: str) -> None:
        """Check a document against its schema, if it is of SSP 1.0."""
        version = root.get("version", "")
        if version.startswith("2."):
            self.warnings.append(
                f"{place}: version {version}: read as 1.0, without its schema"
            )
        else:
            self.problems += validate(root, schema, place)

    def walk(
        self, system: Any, path: str, above: Mapping[str, str] = MappingProxyType({})
    ) -> None:
        """Collect the elements of a system, the innermost first.

        `above` maps the dictionaries of the enclosing systems to the paths of their
        connectors.
        """
        dictionaries = {**above, **self.dictionaries(system, path)}
        for child in system.iterfind(f"{{{SSD}}}Connectors/{{{SSD}}}Connector"):
            end = _End(path, child.get("name", ""))
            self.kinds[end] = child.get("kind", "")
            self.note_shape(child, end)
        for child in system.iterfind(f"{{{SSD}}}Elements/*"):
            tag, name = etree.QName(child).localname, child.get("name", "")
            within = f"{path}.{name}" if path else name
            if "." in name:
                self.problems.append(
                    f"{self.at(child)}: component {name!r}: a name is needed "
                    "without ., which parts a system from its own"
                )
            if within in self.components or within in self.relays:
                self.problems.append(f"{self.at(child)}: component {within} twice")
            if tag == "Component":
                self.components[within] = self.component(child, within)
                self.values += [(within, value) for value in self.bindings(child)]
            elif tag == "System":
                self.relays[within] = within
                self.walk(child, within, dictionaries)
            elif tag == "SignalDictionaryReference":
                of = child.get("dictionary", "")
                if of not in dictionaries:
                    self.warnings.append(
                        f"{self.at(child)}: {within}: no system that it is in has a dictionary "
                        f"{of}: taken for one of the whole file"
                    )
                self.relays[within] = dictionaries.get(of, f"dictionary {of}")
            else:
                raise DesatError(
                    f"{self.at(child)}: element {name} is a {tag}; Component, System "
                    "and SignalDictionaryReference are supported"
                )
        for child in system.iterfind(f"{{{SSD}}}Connections/{{{SSD}}}Connection"):
            self.links += self.elements_of(self.link(child, path))
        self.values += [(path, value) for value in self.bindings(system)]

    def dictionaries(self, system: Any, path: str) -> dict[str, str]:
        """Return the path of the connectors of each signal dictionary of a system.

        Its file (.ssb) is only checked against the schema, because it defines nothing
        but types.
        """
        read = {}
        for child in system.iterfind(
            f"{{{SSD}}}SignalDictionaries/{{{SSD}}}SignalDictionary"
        ):
            read[child.get("name", "")] = f"dictionary {path}.{child.get('name', '')}"
            if child.get("source") is not None:
                root, place = self.named_file(child)
                if root is not None:
                    self.validate(root, "SystemStructureSignalDictionary.xsd", place)
        return read

    def flatten(self) -> dict[_End, list[_Link]]:
        """Add the connections from component to component to the draft.

        Return how each connector of a system or dictionary reaches the components that
        it feeds. Raises DesatError if a connector is its own source.
        """
        into: dict[_End, _Link] = {}
        systems = set(self.relays.values())
        for link in self.links:
            within = link.end.path in systems and link.end.path != ""
            if within and into.setdefault(link.end, link) is not link:
                end = ".".join(filter(None, link.end))
                self.problems.append(
                    f"{self.place}:{link.line}: {end} has two sources, also "
                    f"line {into[link.end].line}"
                )
        reached: dict[_End, list[_Link]] = {}
        for link in self.links:
            if link.end.path in systems:
                continue
            flat, passed = link, set[_End]()
            while flat.start.path in systems:
                if flat.start in passed:
                    raise DesatError(
                        f"{self.place}:{link.line}: {'.'.join(flat.start)} is its "
                        "own source"
                    )
                passed.add(flat.start)
                reached.setdefault(flat.start, []).append(flat)
                if flat.start not in into:
                    break
                flat = flat.after(into[flat.start])
            else:
                self.result.connections.append(
                    Connection(
                        self.named(flat.start.path),
                        flat.start.connector,
                        self.named(link.end.path),
                        link.end.connector,
                        link.line,
                        flat.factor,
                        flat.offset,
                        flat.converts,
                    )
                )
        return reached

    def named(self, path: str) -> str:
        """Return the name of a component in the flat system."""
        return path.replace(".", "_")

    def give(
        self, path: str, value: _SetValue, name: str, reached: dict[_End, list[_Link]]
    ) -> None:
        """Set a value of the component that a name means in a system.

        If the name is that of a connector, all components that it feeds are set.
        """
        if path in self.components:
            self.give_to(self.components[path], name, value)
            return
        if links := reached.get(_End(self.relays[path], name)):
            for link in links:
                if (component := self.components.get(link.end.path)) is not None:
                    value_here = value.through(link.factor, link.offset, link.converts)
                    self.give_to(component, link.end.connector, value_here)
            return
        element, _, rest = name.partition(".")
        within = f"{path}.{element}" if path else element
        if rest and (within in self.components or within in self.relays):
            self.give(within, value, rest, reached)
        else:
            self.warnings.append(
                f"{value.at}: {value.name} reaches no component: left out"
            )

    def give_to(self, component: Component, name: str, value: _SetValue) -> None:
        """Keep a parameter set's value of a component's parameter; the last counts."""
        self.set_values[component.name, name] = value

    def assign(self) -> None:
        """Set the parameters of the components, the structural ones first."""
        draft = self.result

        def is_structural(item: tuple[tuple[str, str], _SetValue]) -> bool:
            (owner, name), _ = item
            return name in draft.components[owner].interface.structural

        for (owner, name), value in sorted(
            self.set_values.items(), key=lambda item: not is_structural(item)
        ):
            component = draft.components[owner]
            place = f"{value.at}: {owner}.{name}"
            component.origins[name] = place
            component.origins.setdefault(base_name(name), place)
            if component.interface is MISSING:
                continue
            try:
                self.assign_value(component, name, value, place)
            except DesatError as error:
                draft.refused[owner, base_name(name)] = str(error)
            if name in component.interface.structural:
                draft.resize(component)

    def assign_value(
        self, component: Component, name: str, value: _SetValue, place: str
    ) -> None:
        """Set a parameter in the unit of its variable.

        A name that matches no variable is left out with a warning (SSP 1.0).

        Raises
        ------
        DesatError
            If the value does not fit, or one parameter set gives two values.
        """
        interface = component.interface
        variable = interface.signals.get(name)
        signals = [variable] if variable else interface.elements.get(name, ())
        if not (signals or interface.role):
            other = name.partition(".")[0]
            if other != name and other in self.result.components:
                raise DesatError(
                    f"{place}: it names {other}, but the set is that of {component.name}"
                )
            hint = nearest(name, interface.signals)
            text = f"{place}: {component.source} has no variable {name}{hint}: left out"
            warn(self.result, text)
            return
        number = value.value
        if value.unit is not None and signals:
            signal = signals[0]
            if value.unit_name == signal.unit_name:
                text = warning_of_namesake(value.unit, signal.unit, signal, place)
                warn(self.result, text)
            elif not (signal.unit_name or interface.role):
                warn(
                    self.result,
                    f"{place}: {name} has no unit: its value, which was given with one, is "
                    "taken as it is",
                )
            else:
                number = _converted_value(value, signal, place)
        at = f"{place}: {component.name}"
        component.parameters.update(expand(interface, name, number, at))
        if value.also:
            raise DesatError(f"{value.at} and {value.also}: {name} is given twice")

    def component(self, element: Any, path: str) -> Component:
        """Read a component: source, connectors and step size hint."""
        source = self.source_of(element)
        kind = element.get("type") or FMU_TYPE
        if kind != FMU_TYPE:
            raise DesatError(
                f"{self.at(element)}: component {path} is of type {kind[:80]}, no FMU "
                f"({FMU_TYPE})"
            )
        if (proxy := re.fullmatch(r"proxyfmu://[^?]*\?file=(.+)", source)) is not None:
            source = proxy[1]
            self.warnings.append(
                f"{self.at(element)}: {path}: of proxyfmu its file alone is used: "
                f"{source} runs here"
            )
        if self.inside(element, source) is None:
            source = ""
        fmu = library.find(source, self.folder) if source else None
        connectors: dict[str, Connector] = {}
        name = self.named(path)
        for child in element.iterfind(f"{{{SSD}}}Connectors/{{{SSD}}}Connector"):
            kind = next(
                (
                    c
                    for c in child
                    if etree.QName(c).namespace == SSC
                    and etree.QName(c).localname != "Dimension"
                ),
                None,
            )
            end = _End(path, child.get("name", ""))
            self.kinds[end] = child.get("kind", "")
            self.note_shape(child, end)
            for index in indices_of(self.shapes.get(end, ())):
                connector = Connector(
                    f"{end.connector}{index}",
                    self.kinds[end],
                    "" if kind is None else _type_of(kind),
                    "" if kind is None else kind.get("unit", ""),
                    child.sourceline,
                )
                if connector.name in connectors:
                    self.problems.append(
                        f"{self.at(child)}: {name}.{connector.name} is listed twice"
                    )
                connectors[connector.name] = connector
        hint = element.find(f".//{{{OSP}}}StepSizeHint")
        if hint is not None:
            self.hints[path] = self.number(hint, "value", "0")
        facts = {"line": element.sourceline, "connectors": connectors}
        is_foreign = not self.file.absolute().is_relative_to(paths.SCENARIOS)
        try:
            return component_of(
                name, source, fmu, self.options.blocks, is_foreign, **facts
            )
        except DesatError as error:
            if source:  # what lies outside the folder is refused already
                self.problems.append(f"{self.at(element)}: {name}: {error}")
            return Component(name, source, MISSING, fmu=fmu, **facts)

    def source_of(self, element: Any) -> str:
        """Return the file that an element names, relative to the folder if it is in it.

        A URI may have the scheme `file`.
        """
        source = unquote(element.get("source", "")).replace("\\", "/")
        if uri := re.fullmatch(r"(?i)file:(?://(?:localhost)?(?=/))?(.+)", source):
            source = re.sub(r"^/([A-Za-z]:)", r"\1", uri[1])
            for folder in (self.folder.absolute(), self.folder.resolve()):
                source = source.removeprefix(f"{folder.as_posix()}/")
        return source

    def inside(self, element: Any, source: str) -> Path | None:
        """Return the path of a file that the system names.

        For a file outside it is None, and a problem is added.
        """
        if self.options.outside and "\0" not in source:
            return self.folder / source
        try:
            return inside(self.folder, source)
        except DesatError as error:
            self.problems.append(
                f"{self.at(element)}: source {error}; --allow-outside allows it"
            )
            return None

    def number(self, element: Any, key: str, default: str = "") -> float:
        """Parse a finite number from an attribute.

        Raises DesatError if it is none.
        """
        text = element.get(key, default)
        try:
            if isfinite(number := float(text)):
                return number
        except ValueError:
            pass
        raise DesatError(
            f"{self.at(element)}: {key} = {text[:40]!r}: a finite number is needed"
        )

    def link(self, element: Any, path: str) -> _Link:
        """Read a connection in the system at a path, directed from source to target.

        The kinds of the connectors decide the direction, not start and end (SSP 1.0,
        `Connection`).
        """
        ends, takes = [], []
        for side in ("start", "end"):
            connector, child = (
                element.get(f"{side}Connector"),
                element.get(f"{side}Element"),
            )
            if connector is None:
                raise DesatError(
                    f"{self.at(element)}: a connection names two connectors"
                )
            at = ".".join(filter(None, (path, child))) if child else path
            kind = self.kinds.get(_End(at, connector))
            # seen from inside, an input of a system is a source
            inwards = child is None
            takes.append(None if kind not in _TAKES else _TAKES[kind] is not inwards)
            ends.append(_End(self.relays.get(at, at), connector))
        if takes in ([True, False], [True, None], [None, False]):
            ends.reverse()
        factor, offset = self.transformation(element, f"{ends[0]} -> {ends[1]}")
        start, end = ends
        return _Link(
            start, end, element.sourceline, factor, offset, self.converts(element)
        )

    def note_shape(self, connector: Any, end: _End) -> None:
        """Record the shape of an array connector of SSP 2.0, from its dimensions."""
        sizes = []
        for dimension in connector.iter(f"{{{SSD}}}Dimension", f"{{{SSC}}}Dimension"):
            text = dimension.get("size", "")
            if not (text.isascii() and text.isdigit() and 0 < int(text) <= MOST_SIZE):
                size = f"size {text!r}" if text else "no size"
                self.problems.append(
                    f"{self.at(dimension)}: {'.'.join(filter(None, end))}: a Dimension of "
                    f"{size}; a number from 1 to {MOST_SIZE} is needed"
                )
                return
            sizes.append(int(text))
        if sizes:
            self.shapes[end] = tuple(sizes)

    def elements_of(self, link: _Link) -> Iterator[_Link]:
        """Yield a connection of scalars, or those of the elements of two arrays."""
        ends = (link.start, link.end)
        shapes = [self.shapes.get(end, ()) for end in ends]
        if shapes[0] != shapes[1]:
            start, end = (".".join(filter(None, e)) for e in ends)
            sizes = [" x ".join(map(str, s)) or "a scalar" for s in shapes]
            self.problems.append(
                f"{self.place}:{link.line}: {start} -> {end}: {sizes[0]} does not fit "
                f"{sizes[1]}"
            )
            return
        for index in indices_of(shapes[0]):
            yield replace(
                link,
                start=link.start._replace(connector=link.start.connector + index),
                end=link.end._replace(connector=link.end.connector + index),
            )

    def converts(self, element: Any) -> bool:
        """Return whether units are converted."""
        return element.get("suppressUnitConversion", "false") not in ("true", "1")

    def transformation(self, element: Any, of: str) -> tuple[float, float]:
        """Return factor and offset of a connection or of an entry of a mapping.

        Raises DesatError if the transformation is not linear.
        """
        factor, offset = 1.0, 0.0
        for child in element:
            if child.tag == f"{{{SSC}}}LinearTransformation":
                factor = self.number(child, "factor", "1")
                offset = self.number(child, "offset", "0")
            elif etree.QName(child).localname.endswith("Transformation"):
                raise DesatError(
                    f"{self.at(child)}: {etree.QName(child).localname} of {of} is not "
                    "supported; LinearTransformation is"
                )
        return factor, offset

    def named_file(self, element: Any) -> tuple[Any, str]:
        """Parse the file that an element names by `source`.

        Return its root and its name in messages. If it does not exist the root is None,
        and a problem is added.
        """
        source = self.source_of(element)
        file, place = self.inside(element, source), f"{self.prefix}{source}"
        if file is None:
            return None, place
        if not file.exists():
            self.problems.append(f"{self.at(element)}: {source} is missing")
            return None, place
        return self.parse(file, place), place

    def bindings(self, element: Any) -> list[_SetValue]:
        """Read the values of the parameter sets bound to a component or system.

        Mappings are applied.
        """
        values: list[_SetValue] = []
        for binding in element.iterfind(
            f"{{{SSD}}}ParameterBindings/{{{SSD}}}ParameterBinding"
        ):
            if binding.get("source") is None:
                root = binding.find(f"{{{SSD}}}ParameterValues/{{{SSV}}}ParameterSet")
                place = self.place
            else:
                root, place = self.named_file(binding)
                if root is not None:
                    self.validate(root, "SystemStructureParameterValues.xsd", place)
            if root is None:
                continue
            mapped, prefix = self.mapping(binding), binding.get("prefix", "")
            bound: dict[
                str, _SetValue
            ] = {}  # another set may give it, too; then the later one counts
            for parameter in root.iterfind(f"{{{SSV}}}Parameters/{{{SSV}}}Parameter"):
                value = next(iter(parameter), None)
                if value is None:
                    continue
                source, at = (
                    prefix + parameter.get("name", ""),
                    f"{place}:{value.sourceline}",
                )
                unit = self.unit(value.get("unit"), root, f"{at}: {source}")
                unit_name = value.get("unit", "")
                read = _SetValue(
                    source, self.values_of(value, place), unit, at, unit_name
                )
                for name, factor, offset, converts in mapped.get(
                    source, [(source, 1.0, 0.0, True)]
                ):
                    converted = read._replace(name=name).through(
                        factor, offset, converts
                    )
                    other = bound.setdefault(name, converted)
                    if other[:3] != converted[:3]:
                        converted = converted._replace(also=other.at)
                    values.append(converted)
        return values

    def mapping(self, binding: Any) -> dict[str, list[tuple[str, float, float, bool]]]:
        """Read the mapping of a binding.

        It maps a name in the source to (name of the target, factor, offset, whether
        units are converted) of each entry.
        """
        targets: dict[str, list[tuple[str, float, float, bool]]] = {}
        element = binding.find(f"{{{SSD}}}ParameterMapping")
        if element is None:
            return targets
        if element.get("source") is None:
            root = element.find(f"{{{SSM}}}ParameterMapping")
            reader = self
        else:
            root, place = self.named_file(element)
            reader = _Reader(self.folder, self.file, place, self.prefix, self.options)
            if root is not None:
                self.validate(root, "SystemStructureParameterMapping.xsd", place)
        for entry in () if root is None else root.iterfind(f"{{{SSM}}}MappingEntry"):
            source, target = entry.get("source", ""), entry.get("target", "")
            transformed = reader.transformation(entry, f"{source} -> {target}")
            targets.setdefault(source, []).append(
                (target, *transformed, reader.converts(entry))
            )
        return targets

    def unit(self, name: str | None, root: Any, place: str) -> Unit | str | None:
        """Return the unit of a value.

        It is one of the parameter set's own units, or one of ours, or the name itself
        if the unit is unknown.
        """
        if name is None:
            return None
        for unit in root.iterfind(f"{{{SSV}}}Units/{{{SSC}}}Unit"):
            base = unit.find(f"{{{SSC}}}BaseUnit")
            if unit.get("name") == name and base is not None:
                try:
                    exponents = {k: int(base.get(k, "0")) for k in Unit._fields[:6]}
                except ValueError as error:
                    raise DesatError(f"{place}: unit {name}: {error}") from error
                factor, offset = (
                    self.number(base, "factor", "1"),
                    self.number(base, "offset", "0"),
                )
                if base.get("mol", "0") == base.get("cd", "0") == "0":
                    return Unit(**exponents, factor=factor, offset=offset)
        if (known := known_unit(name)) is not None:
            return known
        try:
            return unit_of(name)
        except DesatError:
            return name

    def values_of(self, element: Any, place: str) -> Scalar | str | list[Scalar | str]:
        """Parse the value of a parameter, or those of an array of SSP 2.0.

        Raises DesatError if one is not of its type.
        """
        text = str(element.get("value", ""))
        texts = text.split()
        if etree.QName(element).localname not in _TYPES or len(texts) < 2:
            return self.value(element, text, place)
        return [self.value(element, part, place) for part in texts]

    def value(self, element: Any, text: str, place: str) -> Scalar | str:
        """Parse a value of a parameter.

        Raises DesatError if it is not of its type.
        """
        kind = _type_of(element)
        try:
            if kind == "Real":
                return float(text)
            if kind == "Enumeration":
                return int(text) if re.fullmatch(r"[+-]?\d+", text) else text
            if kind == "Integer":
                return int(text)
            if kind == "String":
                return text
            if kind == "Boolean":
                return {"true": True, "1": True, "false": False, "0": False}[text]
        except (ValueError, KeyError) as error:
            raise DesatError(
                f"{place}:{element.sourceline}: {text!r} is no {kind}"
            ) from error
        raise DesatError(
            f"{place}:{element.sourceline}: a {kind} value is not supported"
        )

    def experiment(self, root: Any) -> None:
        """Read the times of the file.

        Missing times are taken from its FMUs, with a warning.
        """
        draft = self.result
        experiment = root.find(f"{{{SSD}}}DefaultExperiment")
        if experiment is not None:
            draft.start = self.number(experiment, "startTime", "0")
            if experiment.get("stopTime") is not None:
                draft.stop = self.number(experiment, "stopTime")
            for element in experiment.iter(f"{{{OSP}}}FixedStepAlgorithm"):
                if element.get("baseStepSize"):
                    draft.step = self.number(element, "baseStepSize")
        for element in root.iterfind(
            f"{{{SSD}}}System/{{{SSD}}}Annotations//{{{OMS}}}FixedStepMaster"
        ):
            if draft.step is None and element.get("stepSize"):
                draft.step = self.number(element, "stepSize")
        if draft.step is not None and draft.stop is not None:
            return
        fmus = dict.fromkeys(
            c.fmu for c in self.components.values() if c.fmu is not None
        )
        suggested = [(fmu.path, *_suggested(fmu)) for fmu in fmus]
        steps = [(step, path) for path, step, _ in suggested if step]
        stops = [(stop, path) for path, _, stop in suggested if stop]
        if draft.step is None and steps:
            draft.step, path = min(steps)
            draft.guesses["step"] = (
                f"{self.place}: no step: {draft.step:g} s of {path.name}, or --step"
            )
        if draft.stop is None and stops:
            draft.stop, path = max(stops)
            draft.guesses["stop"] = (
                f"{self.place}: no stop time: {draft.stop:g} s of {path.name}, or "
                "--stop"
            )


def _converted_value(
    value: _SetValue, signal: Signal, place: str
) -> Scalar | str | list[Scalar | str]:
    """Convert a value that was given with a unit to the unit of its variable.

    Raises DesatError if the units do not fit.
    """
    assert value.unit is not None
    number, unit = value.value, value.unit
    if isinstance(number, str) or unit == signal.unit_name:
        return number
    if not isinstance(number, list):
        return in_unit_of(signal, number, unit, place)
    return [
        x if isinstance(x, str) else in_unit_of(signal, x, unit, place) for x in number
    ]


def _suggested(fmu: Fmu) -> tuple[float | None, float | None]:
    """Return step and stop time (s) that an FMU's file suggests.

    They are None if it suggests none, or if it is no readable FMU, which is reported
    elsewhere.
    """
    try:
        experiment = fmu.description.defaultExperiment
        step, stop = (
            getattr(experiment, key, None) for key in ("stepSize", "stopTime")
        )
        return step and float(step), stop and float(stop)
    except (DesatError, OSError, ValueError):
        return None, None
