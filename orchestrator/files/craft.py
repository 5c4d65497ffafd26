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
    [dispersions]                         # what is not known for sure, as of each of its scenarios

Everything else is wired as the roles declare (`source` in
`components/contract/roles.py`): each input is fed by the first of its sources whose
component exists. A further instance is fed as its role is; its outputs are unused unless
[wiring] connects them. Paths of FMUs are relative to the craft file.

`desat pack --ssd` writes the same system as a standard SSD beside the craft file:
`craft.toml` gives `SystemStructure.ssd`, `NAME.craft.toml` gives `NAME.ssd`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from desat.components.contract.block import NOZZLES, WHEELS
from desat.fmus import registry

from ..system.body import Body
from ..system.errors import DesatError, nearest
from ..system.interface import (
    asked_for,
    elements,
    misfit,
    names,
    usual_sources,
)
from ..system.model import Component, Connection
from ..system.options import Options
from ..system.parameters import expand
from ..system.quantity import Quantity
from . import hardware, library, paths
from .draft import SHARED, Assignment, Draft, component_of
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
    "dispersions",  # read with the scenarios (`scenario.py`)
)
BODY = ("mass", "sides")
# What says how many wheels or nozzles there are: table, key, axis of the array, usual
# number, and those that are taken.
SIZES = (
    ("shared", "axes_wheel", 1, WHEELS, range(3, 9)),
    ("parameters", "thrusters", 0, NOZZLES, range(1, 17)),
)


def files(folder: Path) -> list[Path]:
    """Return the craft files of a folder, sorted."""
    return sorted([*folder.glob(FILE), *folder.glob(f"*{ENDING}")])


def stem(path: Path) -> str:
    """Return the name of a craft file without its endings."""
    return path.name.removesuffix(".toml").removesuffix(".craft")


# --- reading --------------------------------------------------------------------------


class CraftFile:
    """Craft file as it is written, with the lines of its keys and its problems."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.place = paths.shown(path)
        source = text(path, self.place)
        self.data = parsed(source, self.place)
        self.lines = lines(source)
        self.problems: list[str] = []

    def stop_here(self) -> None:
        """Raise DesatError if there are problems so far."""
        if self.problems:
            raise DesatError("\n".join(dict.fromkeys(self.problems)))

    def line(self, key: str) -> int:
        """Return the line of a key, or of the nearest table around it."""
        return line_of(self.lines, key) or 1

    def at(self, key: str) -> str:
        """Return file, line and key, for messages."""
        return f"{self.place}:{self.line(key)}: {key}"

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


def read(path: Path, options: Options) -> Draft:
    """Read a craft file: components, connections and values.

    Raises
    ------
    DesatError
        If anything is wrong with the file, with a line for each problem.
    """
    file = CraftFile(path)
    draft = Draft(file.place, _name_of(path), problems=file.problems)
    _read_top(file, draft)
    file.table("dispersions")  # says so where it is none
    _read_body(file, draft)
    # as many wheels and nozzles as their tables have, where that is not the usual number
    for table, key, axis, size, most in SIZES:
        rows = file.data.get(table, {}).get(key)
        if table == "parameters" and isinstance(rows, dict):
            rows = rows.get("position_nozzle")
        if isinstance(rows, list) and rows and isinstance(rows[0], list):
            count = (len(rows), len(rows[0]))[axis]
            if count not in most:
                limits = f"{most[0]} to {most[-1]} are taken"
                file.problem(f"{table}.{key}", f": {count} {size.kind}; {limits}")
            elif count != size:
                draft.sizes[size.kind] = count
    for name, source in file.table("components").items():
        _read_component(file, draft, name, source, options)
    file.stop_here()
    wiring = _read_wiring(file, draft.components)
    for component in draft.components.values():
        for name in names(component.interface, "input"):
            _connect(file, draft, component, name, wiring)
    values = [*_hardware_values(file, draft.components), *_table_values(file, draft)]
    file.stop_here()
    draft.assign(values)
    file.stop_here()
    return draft


def _name_of(path: Path) -> str:
    """Return the name of a craft's system: its folder's, and that of the file."""
    folder = path.resolve().parent.name
    name = folder if path.name == FILE else stem(path)
    if path.name.endswith(ENDING):
        name = f"{folder}_{name}"
    return name if name.isascii() else utf8_name(name)


def _read_top(file: CraftFile, draft: Draft) -> None:
    """Read the keys at the top of the file."""
    for key in file.data:
        if key not in KEYS:
            file.problem(key, f": unknown key{nearest(key, KEYS)}")
    title, stop = file.data.get("title", ""), file.data.get("stop")
    if isinstance(title, str):
        draft.title = title
    else:
        file.problem("title", f" = {title!r}: a text is needed")
    if isinstance(stop, (int, float)) and not isinstance(stop, bool):
        draft.stop = float(stop)
    elif stop is not None:
        file.problem("stop", f" = {stop!r}: a time in seconds is needed")
    if file.data.get("components", {}) == {}:
        file.problems.append(
            f"{file.place}: there is no component; name some in [components]"
        )


def _read_body(file: CraftFile, draft: Draft) -> None:
    """Read mass and sides, if the file gives them."""
    table = file.table("body")
    for key in table:
        if key not in BODY:
            file.problem(f"body.{key}", f": unknown key{nearest(key, BODY)}")
    if not table:
        return
    try:
        mass = _quantity(file, "mass", "kg", table.get("mass"))
        sides = table.get("sides")
        if not isinstance(sides, list) or len(sides) != 3:
            raise DesatError(
                f"{file.at('body.sides')} = {sides!r}: three sides are needed"
            )
        a, b, c = (_quantity(file, "sides", "m", x) for x in sides)
        draft.body = Body(mass, (a, b, c))
    except DesatError as error:
        file.problems.append(str(error))


def _quantity(file: CraftFile, key: str, unit: str, value: Any) -> float:
    """Convert a figure of the body to `unit`.

    Raises DesatError if it is not above 0.
    """
    at = file.at(f"body.{key}")
    form = Quantity(f"{at} =", unit, 0.0, 1e9, above=True)
    if isinstance(value, (int, float, str)) and not isinstance(value, bool):
        return form(value)
    raise DesatError(f"{at} = {value!r}: a number in {unit} is needed")


def _read_component(
    file: CraftFile, draft: Draft, name: str, source: Any, options: Options
) -> None:
    """Add a component to the draft, with its FMU or bare block."""
    key = f"components.{name}"
    if not isinstance(source, str):
        file.problem(
            key, f" = {source!r}: the name of a block or the path of an FMU is needed"
        )
        return
    is_file = "/" in source or source.endswith(".fmu")
    try:
        if is_file and not (path := file.path.parent / source).exists():
            raise DesatError(f"no such file in {file.path.parent}")
        if not is_file and source not in registry.names():
            raise DesatError(f"no such block{nearest(source, registry.names())}")
        in_archive = source if is_file else f"resources/{source}.fmu"
        fmu = library.load(path) if is_file else library.of_ours(in_archive)
        if draft.sizes and not is_file:
            in_archive, fmu = draft.of_ours(source)
        component = component_of(
            name, in_archive, fmu, options.blocks, line=file.line(key)
        )
    except DesatError as error:
        file.problem(key, f" = {source}: {error}")
        return
    if reason := _role_problem(component, source):
        file.problem(key, reason)
        return
    draft.components[name] = component


def role_of(name: str) -> str:
    """Return the role that the name of a component begins with; "" if there is none."""
    roles = [r for r in usual_sources() if name == r or name.startswith(f"{r}_")]
    return max(roles, key=len, default="")


def _role_problem(component: Component, source: str) -> str:
    """Explain why the FMU of a component does not suit the role of its name, or ""."""
    role, own_role = role_of(component.name), component.interface.role
    if not role:
        hint = nearest(component.name, usual_sources())
        return f": no role {component.name}{hint}"
    if own_role in ("", role):
        return ""
    of_role = [n for n in registry.names() if registry.block_class(n).role == role]
    return f" = {source}: its role is {own_role}, not {role}{nearest(source, of_role)}"


# --- wiring ---------------------------------------------------------------------------


def _read_wiring(
    file: CraftFile, components: Mapping[str, Component]
) -> dict[tuple[str, str], str]:
    """Read [wiring]: component and input -> `component.output`.

    The output is empty if the input stays unwired.
    """
    entries: dict[tuple[str, str], Any] = {}
    for name, value in file.table("wiring").items():
        if isinstance(value, dict):
            entries |= {(name, i): v for i, v in value.items()}
        else:
            component, _, variable = name.partition(".")
            entries[component, variable] = value
    result: dict[tuple[str, str], str] = {}
    for (name, variable), value in entries.items():
        key = f"wiring.{name}.{variable}".rstrip(".")
        if name not in components:
            file.problem(key, f": no component {name}{nearest(name, components)}")
        elif not variable:
            file.problem(key, ": the form is COMPONENT.INPUT")
        elif variable not in (inputs := names(components[name].interface, "input")):
            file.problem(
                key, f": {name} has no input {variable}{nearest(variable, inputs)}"
            )
        elif value is False:
            result[name, variable] = ""
        elif isinstance(value, str) and value:
            result[name, variable] = value
        else:
            file.problem(key, f' = {value!r}: "component.output" or false is needed')
    return result


def _connect(
    file: CraftFile,
    draft: Draft,
    target: Component,
    name: str,
    wiring: Mapping[tuple[str, str], str],
) -> None:
    """Connect the elements of an input, by [wiring] or else by its role."""
    key = f"wiring.{target.name}.{name}"
    source = wiring.get((target.name, name))
    if source is None:
        key, source = f"components.{target.name}", _usual_source(draft, target, name)
    if not source:
        return
    owner, _, output = source.partition(".")
    if owner not in draft.components:
        hint = nearest(owner, draft.components)
        file.problem(key, f" = {source}: no component {owner}{hint}")
        return
    outputs = elements(draft.components[owner].interface, output, "output")
    inputs = elements(target.interface, name, "input")
    if not outputs:
        hint = nearest(output, names(draft.components[owner].interface, "output"))
        lack = f"{owner} has no output {output}, which {target.name}.{name} would take"
        file.problem(key, f": {lack}{hint}")
        return
    if reason := misfit(outputs, inputs):
        file.problem(key, f": {source} does not fit {target.name}.{name}: {reason}")
        return
    if any(outputs[i].unit_name != signal.unit_name for i, signal in inputs.items()):
        draft.unchecked.setdefault(target.name, "")  # units are to be converted
    line = file.line(key)
    draft.connections += [
        Connection(owner, outputs[i].name, target.name, inputs[i].name, line)
        for i in inputs
    ]


def _usual_source(draft: Draft, target: Component, name: str) -> str:
    """Return the output that feeds an input by its role, or ""."""
    role = role_of(target.name)
    is_needed = any(s.needed_by for s in target.interface.arrays[name])
    if (role, name) in asked_for() and not is_needed:
        return ""
    usual = usual_sources()[role].get(name, ())
    return next((s for s in usual if s.partition(".")[0] in draft.components), "")


# --- values ---------------------------------------------------------------------------


def _hardware_values(
    file: CraftFile, components: Mapping[str, Component]
) -> Iterator[Assignment]:
    """Yield the parameters that the components' classes or products determine."""
    for name, chosen in file.table("hardware").items():
        key = f"hardware.{name}"
        if name not in components:
            file.problem(key, f": no component {name}{nearest(name, components)}")
            continue
        if not isinstance(chosen, str):
            file.problem(
                key, f' = {chosen!r}: "class:NAME" or "product:NAME" is needed'
            )
            continue
        component, role = components[name], role_of(name)
        has = frozenset(names(component.interface, "parameter"))
        try:
            typical, figures = hardware.figures(role, chosen)
            present: dict[str, Any] = {
                x: _number(file, component, x)
                for x in ("axes_wheel", "arm")
                if x in has
            }
            values = hardware.values(role, typical, figures, has, present)
        except DesatError as error:
            file.problem(key, f" = {chosen}: {error}")
            continue
        for parameter, value in values.items():
            if parameter not in has:
                file.problem(key, f" = {chosen}: {name} has no parameter {parameter}")
                continue
            signals = component.interface.elements[parameter]
            owner = SHARED if any(s.shared for s in signals) else name
            yield Assignment(owner, parameter, value, file.at(key))


def _number(file: CraftFile, component: Component, parameter: str) -> Any:
    """Return the value of a parameter in the file, in SI, or its start value.

    An array becomes a flat list.
    """
    parameters = file.table("parameters").get(component.name, {})
    value = parameters.get(parameter) if isinstance(parameters, dict) else None
    value = file.table("shared").get(parameter) if value is None else value
    interface, scalars = component.interface, {}
    if value is not None:
        scalars = expand(interface, parameter, value, parameter)
    flat = [scalars.get(s.name, s.start) for s in interface.elements.get(parameter, ())]
    return flat if len(flat) > 1 else flat[0]


def _table_values(file: CraftFile, draft: Draft) -> Iterator[Assignment]:
    """Yield the values of [shared], then those of [parameters]."""
    for name, value in file.table("shared").items():
        yield Assignment(SHARED, name, value, file.at(f"shared.{name}"))
    for owner, values in file.table("parameters").items():
        key = f"parameters.{owner}"
        if owner not in draft.components:
            hint = nearest(owner, draft.components)
            file.problem(key, f": no component {owner}{hint}")
        elif not isinstance(values, dict):
            file.problem(key, f" = {values!r}: a table [{key}] is needed")
        else:
            for name, value in values.items():
                yield Assignment(owner, name, value, file.at(f"{key}.{name}"))
