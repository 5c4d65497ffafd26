"""Read craft files: which block fills each role of a spacecraft, and how it is wired.

    title = "A rigid body with wheels, dumping while it points to nadir"
    stop = 600.0                          # s, unless a scenario gives another

    [components]
    environment = "environment_kepler"    # role = a block's name, or an FMU: "path/to/its.fmu"
    magnetometer = "magnetometer"
    magnetometer_2 = "magnetometer"       # a further instance: ROLE_anything

    [wiring]                              # "component.input" = "component.output", or false
    "manager.b_body" = "magnetometer_2.b_body"
    "spacecraft.density" = false

    [body]                                # to check whether the other figures are likely
    mass = "12 kg"
    sides = ["0.2 m", "0.2 m", "0.3 m"]   # along x, y, z of the body
    [hardware]                            # a class or a product for a component (`hardware.py`)
    wheels = "class:30mNms"
    [shared]                              # a parameter for every component that has it
    [parameters.manager]                  # parameters (or unconnected inputs) of one component

Everything else is wired as the roles declare (`source` in
`components/contract/roles.py`): each input is fed by the first of its sources whose
component exists. A further instance is fed as its role is; its outputs are unused unless
[wiring] connects them. Paths of FMUs are relative to the craft file.

`desat pack --ssd` writes the same system as a standard SSD beside the craft file:
`craft.toml` gives `SystemStructure.ssd`, `NAME.craft.toml` gives `NAME.ssd`.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from desat.fmus import registry

from ..system.body import Body
from ..system.errors import DesatError, nearest
from ..system.interface import (
    Interface,
    asked_for,
    elements,
    interface_of_block,
    misfit,
    names,
    usual_sources,
)
from ..system.layer import SHARED, Layer, Place, Value
from ..system.model import Connection, Connector, Fmu
from ..system.parameters import expand
from ..system.quantity import Quantity
from . import hardware, library, paths
from .io import TomlTable, line_of, lines, parsed, text, utf8_name

FILE = "craft.toml"
ENDING = ".craft.toml"
KEYS = (
    "title",
    "stop",
    "body",
    "components",
    "wiring",
    "hardware",
    "shared",
    "parameters",
)
BODY = ("mass", "sides")


def files(folder: Path) -> list[Path]:
    """Return the craft files of a folder, sorted."""
    return sorted([*folder.glob(FILE), *folder.glob(f"*{ENDING}")])


def read(path: Path) -> Layer:
    """Read the layer of a craft file: components, connections and values.

    Raises
    ------
    DesatError
        If anything but the values is wrong with the file, with a line for each problem.
    """
    return _Reader(path).layer()


def stem(path: Path) -> str:
    """Return the name of a craft file without its endings."""
    return path.name.removesuffix(".toml").removesuffix(".craft")


# --- reading --------------------------------------------------------------------------


class _Reader:
    """Reader of one craft file."""

    def __init__(self, path: Path) -> None:
        self.folder = path.parent
        self.place = paths.shown(path)
        self.problems: list[str] = []
        source = text(path, self.place)
        self.data = parsed(source, self.place)
        self.lines = lines(source)
        name = path.resolve().parent.name if path.name == FILE else stem(path)
        if path.name.endswith(ENDING):
            name = f"{path.resolve().parent.name}_{name}"
        if not name.isascii():
            name = utf8_name(name)
        self.result = Layer(self.place, name=name)
        self.interfaces: dict[str, Interface] = {}
        self.roles: dict[str, str] = {}

    def layer(self) -> Layer:
        """Read the file into a layer."""
        self.top()
        self.body()
        for name, source in self.table("components").items():
            self.component(name, source)
        self.stop_here()
        wiring = self.wiring()
        for owner, interface in self.interfaces.items():
            for name in dict.fromkeys(s.array for s in interface.inputs):
                self.feed(owner, name, wiring)
        self.result.places = [
            replace(place, connectors=self.connectors_of(place))
            for place in self.result.places
        ]
        self.hardware()
        self.parameters()
        self.stop_here()
        return self.result

    def stop_here(self) -> None:
        """Raise DesatError if there are problems so far."""
        if self.problems:
            raise DesatError("\n".join(dict.fromkeys(self.problems)))

    def at(self, key: str) -> str:
        """Return file, line and key, for messages."""
        return f"{self.place}:{self.line(key)}: {key}"

    def line(self, key: str) -> int:
        """Return the line of a key, or of the nearest table around it."""
        return line_of(self.lines, key) or 1

    def problem(self, key: str, message: str) -> None:
        """Add a problem of a key."""
        self.problems.append(f"{self.at(key)}{message}")

    def table(self, key: str) -> TomlTable:
        """Return a table of the file; empty if it is missing or no table."""
        value = self.data.get(key, {})
        if isinstance(value, dict):
            return value
        self.problem(key, f" = {value!r}: a table [{key}] is needed")
        return {}

    def top(self) -> None:
        """Read the keys at the top of the file."""
        for key in self.data:
            if key not in KEYS:
                self.problem(key, f": unknown key{nearest(key, KEYS)}")
        if not isinstance(self.data.get("title", ""), str):
            self.problem("title", f" = {self.data['title']!r}: a text is needed")
        elif "title" in self.data:
            self.result.title = self.data["title"]
        stop = self.data.get("stop")
        if isinstance(stop, (int, float)) and not isinstance(stop, bool):
            self.result.stop = float(stop)
        elif stop is not None:
            self.problem("stop", f" = {stop!r}: a time in seconds is needed")
        if self.data.get("components", {}) == {}:
            self.problems.append(
                f"{self.place}: there is no component; name some in [components]"
            )

    def body(self) -> None:
        """Read mass and sides, if the file gives them."""
        table = self.table("body")
        for key in table:
            if key not in BODY:
                self.problem(f"body.{key}", f": unknown key{nearest(key, BODY)}")
        if not table:
            return
        try:
            mass = self.quantity("mass", "kg", table.get("mass"))
            sides = table.get("sides")
            if not isinstance(sides, list) or len(sides) != 3:
                raise DesatError(
                    f"{self.at('body.sides')} = {sides!r}: three sides are needed"
                )
            a, b, c = (self.quantity("sides", "m", x) for x in sides)
            self.result.body = Body(mass, (a, b, c))
        except DesatError as error:
            self.problems.append(str(error))

    def quantity(self, key: str, unit: str, value: Any) -> float:
        """Convert a figure of the body to `unit`.

        Raises DesatError if it is not above 0.
        """
        form = Quantity(f"{self.at(f'body.{key}')} =", unit, 0.0, 1e9, above=True)
        if isinstance(value, (int, float, str)) and not isinstance(value, bool):
            return form(value)
        raise DesatError(
            f"{self.at(f'body.{key}')} = {value!r}: a number in {unit} is needed"
        )

    def component(self, name: str, source: Any) -> None:
        """Add a component to the layer."""
        key = f"components.{name}"
        if not isinstance(source, str):
            self.problem(
                key,
                f" = {source!r}: the name of a block or the path of an FMU is needed",
            )
            return
        is_file = "/" in source or source.endswith(".fmu")
        try:
            fmu, interface = (
                self.from_file(source) if is_file else self.from_block(source)
            )
        except DesatError as error:
            self.problem(key, f" = {source}: {error}")
            return
        if role := self.role(name, source, interface):
            self.roles[name], self.interfaces[name] = role, interface
            file = source if is_file else f"resources/{source}.fmu"
            place = Place(name, file, fmu, interface, line=self.line(key))
            self.result.places.append(place)

    def from_file(self, source: str) -> tuple[Fmu, Interface]:
        """Load the FMU and interface of a component from a file."""
        path = self.folder / source
        if not path.exists():
            raise DesatError(f"no such file in {self.folder}")
        fmu = library.load(path)
        return fmu, fmu.interface

    def from_block(self, source: str) -> tuple[Fmu | None, Interface]:
        """Return our FMU, if it is built, and the interface of a block."""
        if source not in registry.names():
            raise DesatError(f"no such block{nearest(source, registry.names())}")
        return library.of_ours(f"{source}.fmu"), interface_of_block(source)

    def role(self, name: str, source: str, interface: Interface) -> str:
        """Return the role of a component from its name.

        If its interface declares another role the result is empty, and a problem is
        added.
        """
        key, known = f"components.{name}", usual_sources()
        by_name = [r for r in known if name == r or name.startswith(f"{r}_")]
        if not by_name:
            self.problem(key, f": no role {name}{nearest(name, known)}")
            return ""
        role = max(by_name, key=len)
        if interface.role and interface.role != role:
            of_role = [
                n for n in registry.names() if registry.block_class(n).role == role
            ]
            self.problem(
                key,
                f" = {source}: its role is {interface.role}, not {role}"
                f"{nearest(source, of_role)}",
            )
            return ""
        return role

    def wiring(self) -> dict[tuple[str, str], str]:
        """Read [wiring]: component and input -> `component.output`.

        The output is empty if the input stays unwired.
        """
        entries: dict[tuple[str, str], Any] = {}
        for name, value in self.table("wiring").items():
            if isinstance(value, dict):
                entries |= {(name, i): v for i, v in value.items()}
            else:
                component, _, variable = name.partition(".")
                entries[component, variable] = value
        result: dict[tuple[str, str], str] = {}
        components = self.interfaces
        for (name, variable), value in entries.items():
            key = f"wiring.{name}.{variable}".rstrip(".")
            if name not in components:
                self.problem(key, f": no component {name}{nearest(name, components)}")
            elif not variable:
                self.problem(key, ": the form is COMPONENT.INPUT")
            elif variable not in (known := names(self.interfaces[name], "input")):
                self.problem(
                    key, f": {name} has no input {variable}{nearest(variable, known)}"
                )
            elif value is False:
                result[name, variable] = ""
            elif isinstance(value, str) and value:
                result[name, variable] = value
            else:
                self.problem(
                    key, f' = {value!r}: "component.output" or false is needed'
                )
        return result

    def feed(self, target: str, name: str, wiring: dict[tuple[str, str], str]) -> None:
        """Connect the elements of an input, by [wiring] or else by its role."""
        key = f"wiring.{target}.{name}"
        source = wiring.get((target, name))
        if source is None:
            role = self.roles[target]
            usual = usual_sources()[role].get(name, ())
            if (role, name) in asked_for() and not self.is_needed(target, name):
                return
            source = next(
                (s for s in usual if s.partition(".")[0] in self.interfaces), ""
            )
            key = f"components.{target}"
        if not source:
            return
        owner, _, output = source.partition(".")
        if owner not in self.interfaces:
            hint = nearest(owner, self.interfaces)
            self.problem(key, f" = {source}: no component {owner}{hint}")
            return
        outputs = elements(self.interfaces[owner], output, "output")
        inputs = elements(self.interfaces[target], name, "input")
        if not outputs:
            hint = nearest(output, names(self.interfaces[owner], "output"))
            lack = f"{owner} has no output {output}, which {target}.{name} would take"
            self.problem(key, f": {lack}{hint}")
        elif reason := misfit(outputs, inputs):
            self.problem(key, f": {source} does not fit {target}.{name}: {reason}")
        else:
            self.result.connections += [
                Connection(
                    owner, outputs[i].name, target, inputs[i].name, line=self.line(key)
                )
                for i in inputs
            ]

    def is_needed(self, target: str, name: str) -> bool:
        """Return whether something in a component needs an input."""
        return any(s.needed_by for s in self.interfaces[target].arrays.get(name, ()))

    def connectors_of(self, place: Place) -> dict[str, Connector]:
        """Return the wired connectors of a component, as an SSD lists them."""
        interface = self.interfaces[place.name]
        wired = {c.input for c in self.result.connections if c.target == place.name}
        wired |= {c.output for c in self.result.connections if c.source == place.name}
        return {
            s.name: Connector(s.name, s.causality, s.kind, line=place.line)
            for s in (*interface.inputs, *interface.outputs)
            if s.name in wired
        }

    def hardware(self) -> None:
        """Set the parameters that the components' classes or products determine."""
        for name, chosen in self.table("hardware").items():
            key = f"hardware.{name}"
            if name not in self.interfaces:
                self.problem(
                    key, f": no component {name}{nearest(name, self.interfaces)}"
                )
                continue
            if not isinstance(chosen, str):
                self.problem(
                    key, f' = {chosen!r}: "class:NAME" or "product:NAME" is needed'
                )
                continue
            mine = self.interfaces[name]
            role, has = self.roles[name], frozenset(names(mine, "parameter"))
            try:
                typical, figures = hardware.figures(role, chosen)
                present: dict[str, Any] = {
                    x: self.number(name, x) for x in ("axes_wheel", "arm") if x in has
                }
                found = hardware.values(role, typical, figures, has, present)
            except DesatError as error:
                self.problem(key, f" = {chosen}: {error}")
                continue
            for parameter, value in found.items():
                if parameter not in has:
                    self.problem(
                        key, f" = {chosen}: {name} has no parameter {parameter}"
                    )
                    continue
                self.give(self.owner(name, parameter), parameter, value, key)

    def owner(self, name: str, parameter: str) -> str:
        """Return the component, or SHARED if components share its parameter."""
        signals = self.interfaces[name].elements.get(parameter, ())
        return SHARED if any(s.shared for s in signals) else name

    def number(self, owner: str, parameter: str) -> Any:
        """Return the value of a parameter in the file, in SI, or its start value.

        An array becomes a flat list.
        """
        parameters = self.table("parameters").get(owner, {})
        value = parameters.get(parameter) if isinstance(parameters, dict) else None
        value = self.table("shared").get(parameter) if value is None else value
        signals = self.interfaces[owner].elements.get(parameter, ())
        elements = (
            {}
            if value is None
            else expand(self.interfaces[owner], parameter, value, parameter)
        )
        flat = [elements.get(s.name, s.start) for s in signals]
        return flat if len(flat) > 1 else flat[0]

    def parameters(self) -> None:
        """Set the values of [shared], then those of [parameters]."""
        for name, value in self.table("shared").items():
            self.give(SHARED, name, value, f"shared.{name}")
        for component, values in self.table("parameters").items():
            key = f"parameters.{component}"
            if component not in self.interfaces:
                hint = nearest(component, self.interfaces)
                self.problem(key, f": no component {component}{hint}")
            elif not isinstance(values, dict):
                self.problem(key, f" = {values!r}: a table [{key}] is needed")
            else:
                for name, value in values.items():
                    self.give(component, name, value, f"{key}.{name}")

    def give(self, owner: str, name: str, value: Any, key: str) -> None:
        """Add a value to the layer."""
        origin = self.at(key)
        self.result.values.append(
            Value(owner, name, value, origin, origin, raises=True)
        )
