"""Define the sliders of a page: parameters by the names of `--set`, and ranges."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

from desat.components.contract.roles import Manager
from desat.components.contract.units import conversion
from desat.components.physics.orbit import EARTH_RADIUS

from ..analyses.management import is_braking
from ..files.scenario import Scenario
from ..runs.prepare import prepare
from ..system.errors import DesatError, nearest
from ..system.interface import Signal, base_name
from ..system.model import System, Values
from ..system.options import Options, with_assignment
from ..system.parameters import expand, parse_value, unit_of
from ..system.typed import JsonObject
from ..system.wheels import smallest_capacity
from .values import differing, reached

# m: heights of the default range of a craft below the upper one
LOW_ORBIT = (2.0e5, 1.5e6)
# ends of the names of vectors in space: frames, and the start of an orbit
VECTORS = ("_body", "_eci", "_lvlh", "_earth", "_start")
# parameters that are constants of the translated loop: no sliders
BAKED = ("sample_time", "delay", "axes_wheel", "axes_coil")


@dataclass(frozen=True)
class Slider:
    """A parameter that a page moves.

    Its own unit is the shown value times `factor`, plus `offset`.
    """

    name: str  # as in `--set`
    title: str
    targets: tuple[str, ...]  # parameters that it sets: several for `shared.NAME`
    # `one`: a number; `element`: of an array; `each`: all elements that exist, where they
    # are equal; `length`: norm of a vector, `largest`: largest magnitude of another
    # array, whose elements keep their proportions
    form: str
    element: int
    there: tuple[bool, ...]  # for `each`: which elements exist
    unit: str
    factor: float
    offset: float
    low: float  # in the shown unit, as `high`
    high: float
    start: float  # of the scenario, in the shown unit
    height: bool = False  # a radius from the Earth's centre
    is_requested: bool = False

    def page_data(self) -> JsonObject:
        """Return the data of the slider for the page."""
        return asdict(self)

    @property
    def holds_start(self) -> bool:
        """Return whether the scenario's own value lies within the range."""
        return self.low <= self.start <= self.high

    def value_text(self, shown: float, before: Any) -> str:
        """Return `NAME=VALUE` as `--set` accepts it.

        `before` is the value of the parameter without the slider.
        """
        value = shown * self.factor + self.offset
        if self.form in ("one", "element"):
            return (
                f"{self.name}={shown!r} {self.unit}"
                if self.unit
                else f"{self.name}={value!r}"
            )
        if self.form == "each":
            values = [value if there else 0.0 for there in self.there]
        else:
            values = [x * (value / size(before, self.form)) for x in before]
        return f"{self.name}={','.join(map(repr, values))}"


def size(values: Sequence[float], form: str) -> float:
    """Return the size of an array that a slider's form moves."""
    # hypot of a browser has other bits
    return (
        math.sqrt(sum(x * x for x in values))
        if form == "length"
        else max(map(abs, values))
    )


def parts_of(text: str) -> tuple[str, str, str]:
    """Parse name, lower and upper end of `NAME=FROM:TO`, or raise DesatError."""
    name, equals, ends = text.partition("=")
    low, colon, high = ends.partition(":")
    if not (equals and colon and low.strip() and high.strip()):
        raise DesatError(
            f"--slider {text}: the form is NAME=FROM:TO, as "
            "torquers.m_limit=0.1:0.4 or 'torquers.m_limit=0.1 A.m2:0.4 A.m2'"
        )
    return name, low, high


def asked_of(text: str, system: System) -> Slider:
    """Return the slider of `NAME=FROM:TO`.

    Raises
    ------
    DesatError
        If it is impossible; the text says what is allowed.
    """
    name, low, high = parts_of(text)
    slider = _slider(name.strip(), system, f"--slider {text}")
    _, signals = _signals(name.strip(), system, f"--slider {text}")
    owner = slider.targets[0].partition(".")[0]
    interface = system.components[owner].interface
    place = f"--slider {text}: {owner}"
    values = []
    for end in (low, high):
        elements = expand(interface, signals[0].name, parse_value(end.strip()), place)
        values.append(
            (float(elements[signals[0].name]) - slider.offset) / slider.factor
        )
    if not values[0] < values[1]:
        raise DesatError(f"--slider {text}: from a lower value to a higher one")
    return replace(
        slider, low=_round(values[0]), high=_round(values[1]), is_requested=True
    )


ORBIT = (
    ("environment", "altitude"),
    ("environment", "semi_major_axis"),
    ("environment", "inclination"),
)
COILS = (("torquers", "m_limit"), ("spacecraft", "residual_dipole_body"))
THRUSTERS = (
    ("manager", "begin"),
    ("manager", "end"),
    ("thrusters", "tau_level"),
    ("thrusters", "thrust"),
    ("thrusters", "arm"),
    ("thrusters", "position_nozzle"),
)

# of a tumbling craft that coils brake
TUMBLING = (
    ("spacecraft", "omega_start_body"),
    ("torquers", "m_limit"),
    ("magnetometer", "noise"),
)
# choice of a torque on surfaces, and the lever arm of that torque on an area
LEVERS = (
    ("aerodynamics", "centre_drag_body"),
    ("radiation", "centre_radiation_body"),
)
ON_PLATES = "offset_plates_body"


def _surfaces(system: System) -> tuple[tuple[str, str], ...]:
    """Return the lever arm of drag, or else of radiation, as far as they act."""
    craft = system.roles.get("spacecraft")
    if craft is None:
        return ()
    acting = [
        ("spacecraft", lever if craft.choice(choice) == "area" else ON_PLATES)
        for choice, lever in LEVERS
        if choice in craft.values and craft.choice(choice) != "none"
    ]
    return tuple(acting[:1])  # where there is air, drag is the larger one


def usual(system: System) -> list[Slider]:
    """Return the default sliders of a page, as far as the system has them.

    A craft that dumps by thrusters alone has those of its dumps, a tumbling one those of
    its start and of what brakes it. Where there are coils there are also those of the
    orbit, of the coils and of the wheels, and the gain of the law. The lever arm of drag
    or radiation is among them where it acts.
    """
    start = ("wheels", "h_start_wheel")
    wheels = (("wheels", "speed_limit"), start)
    gain = ("manager", _gain(system))
    names: tuple[tuple[str, str], ...]
    manager = system.roles.get("manager")
    if manager is not None and is_braking(manager):
        names = (*ORBIT, *TUMBLING, gain)
    elif "thrusters" not in system.roles:
        names = (*ORBIT, *COILS, *_surfaces(system), gain, *wheels)
    elif "torquers" in system.roles:
        names = (*ORBIT, *COILS, *_surfaces(system), gain, *THRUSTERS, *wheels)
    else:
        names = (*THRUSTERS, *_surfaces(system), start)
    sliders = []
    for owner, name in names:
        component = system.roles.get(owner)
        if component is None or name not in component.interface.arrays:
            continue
        array = f"{component.name}.{name}"
        for element in _names_to_move(array, component.values[name], system):
            ranged = usual_of(element, system)
            if ranged is not None:
                sliders.append(ranged)
    return sliders


def _names_to_move(name: str, value: Any, system: System) -> list[str]:
    """Return the names of a parameter's sliders: itself, or its elements.

    An element is moved alone where values about three axes differ.
    """
    if not isinstance(value, list) or len(value) != len("xyz"):
        return [name]
    if _slider(name, system, f"--slider {name}").form != "largest":
        return [name]
    return [f"{name}[{i}]" for i, x in enumerate(value, 1) if x]


def usual_of(name: str, system: System) -> Slider | None:
    """Return the slider of a parameter with the range that is usual for it.

    None where there is nothing to move.

    Raises
    ------
    DesatError
        If the system has no such parameter, or a page cannot move it.
    """
    return _range(_slider(name, system, f"--slider {name}"), base_name(name), system)


def _gain(system: System) -> str:
    """Return the parameter that sets the speed of the manager's law."""
    manager = system.roles.get("manager")
    if manager is None or manager.block is None:
        return "gain"
    block = manager.block
    laws = block.offers if issubclass(block, Manager) else ()
    return next((law.rate for law in laws if law.rate), "gain")


def _range(slider: Slider, name: str, system: System) -> Slider | None:
    """Return a slider with its usual range, or None where there is nothing to move."""
    name = name.partition(".")[2]
    value = slider.start
    if name == "inclination":
        return replace(slider, low=0.0, high=110.0 if value <= 110.0 else 180.0)
    if name in ("semi_major_axis", "altitude"):
        ground = EARTH_RADIUS if slider.height else 0.0
        if value * slider.factor - ground > LOW_ORBIT[1]:
            return None
        low, high = ((ground + x) / slider.factor for x in LOW_ORBIT)
        return replace(slider, low=_round(low), high=_round(high))
    if name == "h_start_wheel" and slider.form == "each" and value == 0.0:
        most = _wheel_capacity(system) / slider.factor
        return replace(slider, high=_round(0.9 * most, 2)) if most else None
    if value == 0.0:
        return None
    if name in ("begin", "end") and {"begin", "end"} <= _manager_values(system).keys():
        return _threshold(slider, name, system)
    low = {"residual_dipole_body": 0.0, "h_start_wheel": 0.0, "speed_limit": 0.05}.get(
        name, 0.1
    )
    high = {"residual_dipole_body": 5.0, "speed_limit": 1.5, "h_start_wheel": 2.0}.get(
        name, 4.0
    )
    first, last = sorted((_round(low * value, 2), _round(high * value, 2)))
    return replace(slider, low=first, high=last)


def _manager_values(system: System) -> Values:
    """Return the parameters of the manager."""
    manager = system.roles.get("manager")
    return {} if manager is None else manager.values


def _wheel_capacity(system: System) -> float:
    """Return the capacity of the smallest wheel (N m s), 0 where there is none."""
    wheels = system.roles.get("wheels")
    if wheels is None:
        return 0.0
    return smallest_capacity(wheels.values)


def _threshold(slider: Slider, name: str, system: System) -> Slider:
    """Return the slider of a threshold of dumps, whose end stays below their begin."""
    values = _manager_values(system)
    if name == "end":
        low, high = (
            0.1 * values["end"],
            min(4.0 * values["end"], 0.95 * values["begin"]),
        )
    else:
        low = max(0.1 * values["begin"], 1.05 * values["end"])
        high = max(
            values["begin"], min(4.0 * values["begin"], 0.95 * _wheel_capacity(system))
        )
    return replace(
        slider, low=_round(low / slider.factor, 3), high=_round(high / slider.factor, 3)
    )


def _signals(
    name: str, system: System, place: str
) -> tuple[list[str], Sequence[Signal]]:
    """Return the parameters that a name stands for, and the scalars of the first.

    Raises DesatError if there are none or a page cannot move them.
    """
    variable = name.partition(".")[2]
    owners = owners_of(name, system)
    names_allowed = {
        f"{c.name}.{array}"
        for c in system.components.values()
        for array, of in c.interface.arrays.items()
        if of[0].causality == "parameter" and _moves(of[0])
    }
    component = system.components.get(owners[0]) if owners else None
    signals = (
        component.interface.elements.get(variable, ()) if component is not None else ()
    )
    if not signals:
        raise DesatError(
            f"{place}: {system.name} has no parameter {name}{nearest(name, names_allowed)}; "
            "`desat show` lists them"
        )
    first = signals[0]
    if first.causality != "parameter" or not _moves(first):
        raise DesatError(
            f"{place}: {name} is {_reason_against(first)}: a page moves parameters that are "
            "numbers of the type Real"
        )
    return [f"{c}.{first.array}" for c in owners], signals


def owners_of(name: str, system: System) -> list[str]:
    """Return the components that have `COMPONENT.NAME` or `shared.NAME`."""
    owner, _, variable = name.partition(".")
    if owner != "shared":
        return [owner]
    return [
        c.name for c in system.components.values() if variable in c.interface.elements
    ]


def _moves(signal: Signal) -> bool:
    """Return whether a page can move a parameter."""
    return signal.kind == "Real" and not signal.choices and signal.array not in BAKED


def _reason_against(signal: Signal) -> str:
    """Describe a signal that cannot be a slider."""
    if signal.array in BAKED:
        return "what the loop is written out with"
    if signal.choices:
        return f"a choice of {', '.join(signal.choices)}"
    return (
        f"of the type {signal.kind}"
        if signal.kind != "Real"
        else f"an {signal.causality}"
    )


def _slider(name: str, system: System, place: str) -> Slider:
    """Return a slider without a range, or raise DesatError."""
    targets, signals = _signals(name, system, place)
    owner, _, parameter = targets[0].partition(".")
    values, first = system.components[owner].values[parameter], signals[0]
    form, element = "one", 0
    there: tuple[bool, ...] = (True,)
    if len(signals) > 1:
        there = _there(system, owner, values)
        form = _array_form(first, values, there)
        value = size(values, form)
        if form == "each":
            value = next(
                (x for x, is_there in zip(values, there, strict=True) if is_there), 0.0
            )
    elif first.name != first.array:
        names = [s.name for s in system.components[owner].interface.arrays[parameter]]
        form, element = "element", names.index(first.name) + 1
        value = values[element - 1]
    else:
        value = values
    size_shown = (
        _wheel_capacity(system) if parameter == "h_start_wheel" else float(value)
    )
    unit, factor, offset = _shown(first, size_shown)
    text = first.description.partition(";")[0].partition(":")[0].partition(",")[0]
    text = text.partition(" for `")[0] + (f" [{element}]" if element else "")
    return Slider(
        name,
        text,
        tuple(targets),
        form,
        element,
        there,
        unit,
        factor,
        offset,
        0.0,
        0.0,
        _round((float(value) - offset) / factor, 12),
        height=first.array == "semi_major_axis",
    )


def _array_form(signal: Signal, values: Sequence[float], there: Sequence[bool]) -> str:
    """Return how a slider moves an array: `length`, `each` or `largest`."""
    is_vector = (
        len(values) == len("xyz")
        and signal.array.endswith(VECTORS)
        and "each axis" not in signal.description
    )
    if is_vector and any(values):
        return "length"
    existing = {x for x, is_there in zip(values, there, strict=True) if is_there}
    return "each" if len(existing) <= 1 else "largest"


def _there(system: System, owner: str, values: Sequence[float]) -> tuple[bool, ...]:
    """Return which elements of an array exist.

    Of an array of wheels these are the wheels that exist, of another one the elements
    that are not 0, or all.
    """
    spin = system.components[owner].values.get("inertia_wheel")
    if isinstance(spin, list) and len(spin) == len(values):
        return tuple(x > 0.0 for x in spin)
    return tuple(x != 0.0 or not any(values) for x in values)


def _shown(signal: Signal, value: float) -> tuple[str, float, float]:
    """Return the shown unit, and factor and offset from it to the parameter's own."""
    own_unit = signal.unit_name if signal.unit_name != "1" else ""
    shown_unit = {"rad": "deg", "rad/s": "rpm", "N.m.s": "mN.m.s", "N.m": "mN.m"}.get(
        own_unit, own_unit
    )
    if signal.array.startswith("omega"):
        shown_unit = "deg/s"
    if own_unit == "m" and abs(value) >= 1e4:
        shown_unit = "km"
    if own_unit.startswith("N.m") and abs(value) >= 1.0:
        shown_unit = own_unit
    if signal.unit is None or shown_unit == own_unit:
        return own_unit, 1.0, 0.0
    factor_and_offset = conversion(unit_of(shown_unit), signal.unit)
    return (
        (shown_unit, *factor_and_offset)
        if factor_and_offset is not None
        else (own_unit, 1.0, 0.0)
    )


def _round(value: float, digits: int = 6) -> float:
    """Round a number to some digits."""
    return float(f"{value:.{digits}g}")


def refused(
    slider: Slider,
    target: Scenario,
    options: Options,
    system: System,
    ordered: list[dict[str, Any]],
) -> str:
    """Return why a page cannot move a slider of a system, or "" where it can.

    It can if its parameter is allowed at both ends of the range and all other
    parameters that change follow from it by products.
    """
    by_others = {f["name"] for f in ordered} & {*slider.targets}
    if by_others:
        text = next(f["of"]["text"] for f in ordered if f["name"] in by_others)
        return f"the scenario has it follow {text}: move that"
    owners = [t.partition(".") for t in slider.targets]
    owner, _, name = next(o for o in owners if o[0] in system.components)
    before = system.components[owner].values[name]
    for value_shown in (slider.low, slider.high):
        options_moved = with_assignment(options, slider.value_text(value_shown, before))
        try:
            moved_system, _ = prepare(target, options_moved).or_raise()
        except DesatError as error:
            return str(error).splitlines()[0]
        beyond = differing(system, moved_system) - reached({*slider.targets}, ordered)
        if beyond:
            return f"{min(beyond)} is computed from it, by more than a product"
    return ""
