"""Write a new craft's folder from the facts that its owner knows.

It holds `craft.toml` with the origin of every number, and the scenarios `nominal`,
`worst`, `detumbling` and `rollout`. Values that are not given are typical of the class
(templates/classes.toml, templates/craft/).

Rules, each written beside its number:

- inertia: a homogeneous box of the craft's mass and sides, with its wings and dish;
- drag and radiation: on the faces of the box, wings and dish as each is turned to wind
  and Sun; centre of pressure off by 5 % of each side (surfaces.py);
- residual dipole: 5 mA m2 a kilogram, along (1, -0.5, 0.8);
- wheels: at least the momentum that residual dipole and gravity gradient exchange with
  them each orbit, those of the class with the dipole at its unfavourable end;
- attitude controller: bandwidth 0.1 rad/s, or less where the wheels' torque would not
  turn an error of 5 deg so fast; damping 0.7; integral ten times slower;
- manager: gain equal to the orbit rate; B-dot: BRAKING orbit rates times the mean
  moment of inertia;
- dumps between thresholds: torque half of the wheels' torque, or that of the pairs if
  less. The pulse of a sample, centred in it, turns the craft to one side and the wheels
  turn it back: samples as long, and the torque as large, as keep torque T^2 / (8 J)
  within DEVIATION;
- steps in an orbit of period SLOW or more: up to 10 s, as long as in one step the
  wheels' torque turns the craft by at most LARGEST_TURN and the air at perigee by at
  most DEVIATION against the controller; the run lasts until there have been DUMPS
  dumps.
"""

from __future__ import annotations

import math
import re
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from desat.components.contract.block import Vec4
from desat.components.laws.integrated import null_vector
from desat.components.maths.attitude import matrix, product
from desat.components.physics import atmosphere
from desat.components.physics.orbit import EARTH_RADIUS, MU

from ..files import io
from ..files.hardware import (
    COMPENSATION,
    WHEEL_LAG,
    Figures,
    classes,
    friction,
    quantity,
    walk,
)
from ..system import cyclic
from ..system.errors import DesatError, choices, plain
from ..system.model import AUTO, J2000
from ..system.quantity import Quantity, is_number
from ..system.sampled_loop import (
    SAMPLE_TIMES,
    AttitudeLoop,
    longest_sample,
    worst_momentum,
)
from . import coils
from .body import NewBody, body_of
from .facts import CraftFacts
from .nozzles import Nozzles, count_of, read_layout
from .nozzles import layout_of as layout_of_nozzles
from .orbits import Orbit, epoch_of, orbit_of
from .pointing import NewPointing, limit_slews, pointing_of
from .spread import (
    class_factor,
    format_spread,
    parse_values,
    split_spread,
)
from .surfaces import AROUND, Surfaces, surfaces_of
from .torques import GivenTorque, given_torque
from .wheel_layout import PYRAMID, layout_of
from .windows import Windows, windows_of

Array = NDArray[np.float64]
# the last two only for a craft with rods
SCENARIOS = ("nominal", "worst", "detumbling", "rollout")
HELD = 1.6  # class wheels over the cyclic momentum of a dipole at its end
# B-dot gain divided by mean moment of inertia, in units of the orbit rate. Of gains
# from 0.003 to 0.03 1/s, flown on 24 random crafts of 1U to 150 kg, it is within 1.3 of
# the fastest in 23. Stronger rods are saturated for a shorter time, which does not
# change the best gain. The gain of Avanzini & Giulietti (2012), 2 n (1 + sin xi) J_min,
# is up to ten times slower where J_min is far below the other moments.
BRAKING = 7.0
SLOW = 6.0 * 3600.0  # s: from this orbit period on steps may be longer than a second
LARGEST_TURN = 0.02  # rad: maximum turn by a wheel's torque in a step
# rad: maximum turn by the wheels' torque in a substep; analyses/coverage.py shows that
# the accuracy holds up to it
KICK = 0.0076
ACCURACY = 1e-5  # rad: largest attitude error that the substeps may leave
# Number of dumps of a scenario, and its maximum number of steps.
DUMPS, MOST_STEPS = 3, 2_500_000
# s that `desat run` takes for a step and for each of its substeps, with the report
STEP_COST, SUBSTEP_COST = 6e-6, 7e-6
# initial attitude error of the worst scenario: 10 deg
OFF: Vec4 = (0.05, -0.05, 0.0513, 0.9962)
YAW_ERROR = 1e-3  # rad: lag of the attitude under the acceleration of the steered frame
# 1/s: gain of laws in deep space, where there is no orbit rate to derive it from
QUICKEST = 1e-4
EQUATOR_FIELD = 3.1e-5  # T: on the ground at the geomagnetic equator
SLOW_RATE = math.radians(0.3)  # rad/s: rate at which a craft counts as detumbled
WHEEL_TIME = 30.0  # s: time constant of the wheels' law of detumbling
WHEELS = Quantity("--wheels", "N.m.s", 0.0, 1e5, above=True, bare=False)
RODS = Quantity("--rods", "A.m2", 0.0, 1e5, above=True)
THRUSTERS = Quantity("--thrusters", "N", 0.0, 1e5, above=True, bare=False)
RESIDUAL = Quantity("--residual-dipole", "A.m2", -1e4, 1e4)
DRAG_COEFFICIENT = 2.2  # as spacecraft_rigid has it
PROPELLANT = Quantity("--propellant", "kg", 0.0, 1e5, above=True, bare=False)
ISP = Quantity("--isp", "s", 1.0, 1e4, bare=False)
ARM = Quantity("--arm", "m", 1e-3, 100.0, bare=False)
BIAS = Quantity("--bias", "N.m.s", 0.0, 1e5, above=True, bare=False)
BIAS_SPEED = Quantity("--bias", "rad/s", 0.0, 1e5, above=True, bare=False)
MOST_BIAS = 0.9  # share of a wheel's capacity that it may keep
PAIRS = 4  # number of thrusters that stands for pairs about each axis
SAMPLE = Quantity("--sample", "s", 0.01, 10.0, bare=False)
FILL = Quantity("--dump", "%", 0.0, 95.0)
# What dumps, in words.
DUMPERS = {
    "thrusters": "thrusters",
    "coils": "coils",
    "both": "thrusters, of what the rods leave,",
}
PERIOD = Quantity("--dump every", "s", 600.0, 1e8, bare=False)
MOMENTA = {"Nms": 1.0, "mNms": 1e-3}  # N m s
CALENDAR = (90.0, 1.0)  # %: dumps by the calendar begin at the first at once, and end
# rad: maximum turn by one pulse of a dump, half of the allowed pointing error
DEVIATION = math.radians(0.1)
# s: sample times of thrusters; the longest that keeps DEVIATION is taken, at least a
# step
SAMPLES = (10.0, 5.0, 2.0, 1.0)


@dataclass(frozen=True)
class NewWheels:
    """Wheels of a new craft: texts for its files, and numbers in SI."""

    count: int
    inertia_si: float  # kg m2, of a rotor
    axes_si: list[list[float]]  # (3, n), body; zero where there is no wheel
    axes: list[str]  # rows of axes_si
    layout_why: str
    size_why: str
    null: bool  # whether the wheels have a null space
    capacity: str
    speed: str  # maximum
    class_name: str
    inertia: str  # of each rotor
    torque: str
    torque_si: float  # N m
    capacity_si: float  # N m s, of each
    origin: str  # origin of the torque
    viscous: str
    coulomb: str
    lag: str
    compensation: str
    noise: str  # N m s, of the measured momentum
    spread: float  # of the capacity: times or divided by it, at 90 %


@dataclass(frozen=True)
class NewDumps:
    """Dumps of a new craft between thresholds: texts for its files, numbers in SI."""

    by: str
    percent: tuple[str, str]  # of a wheel's capacity: begin and end of a dump
    begin: str  # N m s
    end: str  # N m s
    torque: str  # N m
    origin: str  # origin of the torque
    sample: float  # s, of thrusters or coils
    large: bool  # print momentum in N m s, not mN m s
    most: str  # %: required maximum fill
    aligned: bool  # whether a dump waits until its momentum lies along an axis
    latest: str  # N m s: from there on it does not wait
    momentum: float  # N m s, between the thresholds
    period: float  # s, of the calendar; 0: there is none
    windows: Windows | None  # in which alone dumps may be
    spread: str  # entry of [dispersions] for a wheel's capacity; "": it is certain
    spread_why: str
    capacity: float  # N m s, of a wheel

    def in_file(self, threshold: str) -> str:
        """Return a threshold (N m s) as a file has it, a share of the capacity if that is sampled."""
        if not self.spread:
            return threshold
        share = float(threshold) / self.capacity
        return f'"{share:.6g} * wheels.inertia_wheel[1] * wheels.speed_limit"'


class Assumption(NamedTuple):
    """A figure of a new craft, and its origin."""

    quantity: str
    value: str
    unit: str
    origin: str  # "given", or the rule


@dataclass(frozen=True)
class NewCraft:
    """A craft that was written."""

    files: tuple[Path, ...]
    assumptions: tuple[Assumption, ...]


def check_folder(folder: Path, force: bool) -> None:
    """Check that the folder of a craft can be written.

    Raises
    ------
    DesatError
        If it exists and `force` is not set, or has no name for a craft.
    """
    if folder.exists() and not force:
        raise DesatError(f"{folder}: it exists; --force writes the craft into it")
    if not re.fullmatch(r"[\w.+ -]+", folder.absolute().name):
        raise DesatError(
            f"{plain(str(folder))}: a name of letters, digits, blanks and . _ + - is "
            "needed"
        )


def write(
    folder: Path,
    facts: CraftFacts,
    command: str,
    force: bool = False,
    dipole_sign: float = 1.0,
) -> NewCraft:
    """Write the folder of a craft.

    `dipole_sign` is that of the residual dipole along its assumed direction.

    Raises
    ------
    DesatError
        If the folder exists and `force` is not set, or a requested property is
        impossible; then nothing is written.
    """
    check_folder(folder, force)
    name = folder.absolute().name
    values = _template_values(facts, name, plain(command), dipole_sign)
    from ..files.templates import text_templates

    environment = text_templates("craft")
    scenarios = SCENARIOS if values["rods"] else SCENARIOS[:2]
    texts = {
        f"{name}.toml": environment.get_template(f"{name}.toml").render(values)
        for name in ("craft", *scenarios)
    }
    fresh = not folder.exists()
    folder.mkdir(parents=True, exist_ok=True)
    try:
        for name, text in texts.items():
            io.replace_text(folder / name, text)
    except (OSError, DesatError):
        if fresh:
            shutil.rmtree(folder, ignore_errors=True)
        raise
    return NewCraft(
        tuple(folder / name for name in texts), tuple(_assumptions(facts, values))
    )


def _assumptions_of_dumps(dump: NewDumps) -> Iterator[Assumption]:
    """Yield the figures of dumps."""
    yield Assumption(
        "a dump begins, ends", f"{dump.begin}, {dump.end}", "N m s", "given: --dump"
    )
    if dump.spread:
        yield Assumption(
            "spread of a wheel", dump.spread.strip("{ }"), "90 %", dump.spread_why
        )
    yield Assumption("torque of a dump", dump.torque, "N m", dump.origin)


def _assumptions_of_thrusters(
    thrusters: Mapping[str, Any] | None,
) -> Iterator[Assumption]:
    """Yield the figures of thrusters, if there are any."""
    if not thrusters:
        return
    number, _, unit = thrusters["force"].partition(" ")
    yield Assumption("thrust of each", number, unit, "given")
    nozzles = thrusters["nozzles"]
    if nozzles is None:
        yield Assumption("arm of a pair", thrusters["arm"], "m", thrusters["arm_why"])
    else:
        count = str(len(nozzles.thrust))
        yield Assumption("nozzles", count, "", nozzles.words)
    number, _, unit = thrusters["impulse"].partition(" ")
    yield Assumption("specific impulse", number, unit, thrusters["impulse_why"])
    if thrusters["power"]:
        origin = f"class: electric, {thrusters['class']}"
        yield Assumption("power of each", thrusters["power_words"], "W", origin)
    if thrusters["tank"]:
        number, _, unit = thrusters["tank"].partition(" ")
        yield Assumption("propellant", number, unit, "given")


def _assumptions_of_surfaces(surfaces: Surfaces) -> Iterator[Assumption]:
    """Yield the figures of faces, wings and dish."""
    if surfaces.faces:
        areas = ", ".join(_text(plate.area) for plate in surfaces.faces[::2])
        yield Assumption("faces across x, y, z", areas, "m2", "its sides")
    for part in surfaces.parts:
        text = f"{part.area:.4g} at {part.arm:.4g} m, {part.mass:.4g} kg"
        yield Assumption(part.name, text, "m2", part.origin)
    if surfaces.plates:
        offset = ", ".join(_text(x) for x in surfaces.offset)
        yield Assumption("centre of pressure", offset, "m", surfaces.offset_from)


def _removing_actuator(dump: NewDumps | None) -> Assumption:
    """Say which actuator of a craft with rods and thrusters removes momentum."""
    title = "momentum is removed by"
    if dump is not None and dump.by == "thrusters":
        origin = "given: --dump; 'both 70:10' lets the rods take what they can"
        return Assumption(title, "thrusters alone", "", origin)
    if dump is not None and dump.by == "both":
        origin = "given: --dump; rods all the time, thrusters from the threshold on"
        return Assumption(title, "rods, then thrusters", "", origin)
    origin = "the thrusters do not fire: --dump 'both 70:10' lets them take the rest"
    return Assumption(title, "rods alone", "", origin)


def _assumptions(facts: CraftFacts, values: Mapping[str, Any]) -> Iterator[Assumption]:
    """Yield the figures of a new craft, given or assumed."""
    body, orbit, wheels = values["body"], values["orbit"], values["wheels"]
    yield Assumption("mass", body["mass"], "kg", body["mass_from"])
    yield Assumption("sides", body["sides"].strip("[]"), "m", body["sides_from"])
    moments = [values["inertia"]["moments"][i] for i in range(3)]
    yield Assumption(
        "moments of inertia", ", ".join(moments), "kg m2", values["inertia"]["why"]
    )
    if not orbit.of_tle:
        for key, value, origin in orbit.rows[: 3 if orbit.eccentricity > 0.0 else 2]:
            number, _, unit = value.strip('"').partition(" ")
            yield Assumption(key.replace("_", " "), number, unit, origin)
    yield Assumption(
        "pointing",
        values["guidance"].words,
        "",
        "given" if facts.pointing else "class",
    )
    yield Assumption(
        "wheels",
        f"{wheels.count} x {wheels.capacity_si:g}",
        "N m s",
        f"{wheels.size_why}; {wheels.layout_why}",
    )
    yield Assumption(
        "torque of a wheel", f"{wheels.torque_si:.3g}", "N m", wheels.origin
    )
    if rods := values["rods"]:
        number, _, _ = rods["dipole"].partition(" ")
        yield Assumption("rods, each axis", number, "A m2", rods["why"])
    sources = values["has"]
    if sources.dipole:
        yield Assumption(
            "residual dipole",
            _text(values["dipole"].size),
            "A m2",
            values["dipole"].origin,
        )
    yield from _assumptions_of_surfaces(values["surfaces"])
    if (torque := sources.torque) is not None:
        yield Assumption(
            "torque, mean size", f"{torque.size:.4g}", "N m", f"given: {torque.option}"
        )
    for name, spread, origin in values["spreads"]:
        if spread:
            title = f"spread of {name.partition('.')[2]}"
            yield Assumption(title, spread.strip("{ }"), "90 %", origin)
    yield from _assumptions_of_thrusters(values["thrusters"])
    if values["rods"] and values["thrusters"]:
        yield _removing_actuator(values["dump"])
    if values["dump"]:
        yield from _assumptions_of_dumps(values["dump"])
    yield Assumption(
        "sample time and step", f"{values['step']:g}", "s", values["step_why"]
    )
    yield _length_of_flight(values)


def _length_of_flight(values: Mapping[str, Any]) -> Assumption:
    """Return how long the nominal scenario is, and what it takes to fly."""
    steps = values["stop"] / values["step"]
    substeps = 2 if values["substeps"] == AUTO else values["substeps"]
    seconds = max(1.0, steps * (STEP_COST + SUBSTEP_COST * substeps))
    reason = f"{steps:,.0f} steps: `desat run` takes about {seconds:.0f} s"
    days = f"{values['stop'] / 86400.0:g}"
    return Assumption("nominal flight", days, "d", reason)


def _of_class(
    requested: Quantity, kind: str, measure: str, text: str
) -> tuple[str, Figures, float]:
    """Return the class that a size belongs to, its figures, and the size.

    A number takes the class of the nearest size.
    """
    class_values, option, unit = classes()[kind], requested.option, requested.unit
    if text in class_values:
        return (
            text,
            class_values[text],
            quantity(option, class_values[text][measure], unit),
        )
    if not is_number(text):
        raise DesatError(
            f"{option} {text}: no class"
            f"{choices(text, class_values, f', or a number in {unit}')}"
        )
    size = requested(text)
    if kind == "wheels" and not re.search(
        "[A-Za-z]", text.replace("e", "").replace("E", "")
    ):
        raise DesatError(
            f"{option} {text}: a unit is needed, as {text}mNms or {text}Nms"
        )
    name = min(
        class_values,
        key=lambda n: abs(
            math.log(size / quantity(option, class_values[n][measure], unit))
        ),
    )
    return name, class_values[name], size


def _text(x: float) -> str:
    """Format a number with six digits."""
    return f"{x:.6g}"


def _list(values: Any) -> str:
    """Format numbers as a TOML list."""
    return "[" + ", ".join(_text(float(x)) for x in values) + "]"


def _template_values(
    facts: CraftFacts, name: str, command: str, dipole_sign: float
) -> dict[str, Any]:
    """Return the values that the templates are filled with."""
    body = body_of(facts)
    mass, sides, inertia = body.mass, body.sides, list(body.inertia)
    epoch = epoch_of(facts)
    since_j2000 = (epoch - J2000).total_seconds()
    orbit = orbit_of(facts, since_j2000)
    guidance = pointing_of(facts.pointing, facts.sun is not None, since_j2000, inertia)
    pointing = guidance.kind
    if pointing in ("nadir", "yaw", "plan") and not orbit.has_centre:
        raise DesatError(
            f"--pointing {guidance.words}: there is no Earth about the Sun; sun and "
            "inertial are left"
        )
    outer = given_torque(facts)
    surfaces = surfaces_of(facts, sides, body.parts, outer is None)
    sources = Sources(
        dipole=orbit.of_earth and (outer is None or facts.residual_dipole is not None),
        air=orbit.air and outer is None,
        light=bool(surfaces.plates),
        torque=outer,
    )
    dipole = _dipole(facts, mass, dipole_sign) if sources.dipole else NO_DIPOLE
    start = _start(guidance, orbit)
    cycle = partial(_cycle, pointing, orbit, inertia, start)
    wheels = _wheels(facts, inertia, _mass_class(mass), cycle, dipole)
    rods = _rods(facts, mass, sides, orbit)
    thrusters = _thrusters(facts, sides)
    if facts.propellant is not None and PROPELLANT(facts.propellant) > 0.9 * mass:
        raise DesatError(
            f"--propellant {facts.propellant}: more than 90 % of {mass:g} kg"
        )
    turns = pointing in ("nadir", "yaw", "plan")
    guidance = limit_slews(guidance, inertia, wheels.torque_si, wheels.capacity_si)
    step = _step(orbit, inertia, wheels.torque_si, surfaces, turns)
    given_sample = None if facts.sample is None else _given_sample(facts.sample)
    step = step if given_sample is None else given_sample
    quick = 0.1 / step
    bandwidth = min(
        quick, math.sqrt(wheels.torque_si / (max(inertia) * math.radians(5.0)))
    )
    rule = None if facts.dump is None else _rule(facts.dump, wheels.capacity_si)
    fullest = 1.0 if rule is None else rule.fullest / 100.0
    loop = _attitude_loop(inertia, wheels, bandwidth, step)
    step = _stable_sample(loop, wheels, fullest, given_sample is not None)
    step_why = (
        "given"
        if given_sample is not None
        else "orbit, torques and full wheels allow it"
    )
    limits = _limits(mass, orbit, thrusters)
    dump = _dump(facts, wheels, thrusters, rods is not None, min(inertia), step)
    bias = _null_bias(facts, wheels)
    enough = bandwidth == quick
    rate = orbit.rate if orbit.has_centre else QUICKEST
    tumble = 5.0 if mass < 50.0 else 1.0
    return {
        "title": name,
        "command": command,
        "pointing": pointing,
        "guidance": guidance,
        "orbit": orbit,
        "start": start,
        "outer": outer,
        "has": sources,
        "worse": ", ".join(_worse(orbit, sources)),
        "epoch": epoch.strftime("%Y-%m-%dT%H:%M:%SZ"),
        "description": f"{mass:.4g} kg, {guidance.words} pointing under "
        + _torques(orbit, sources)
        + "; "
        + (
            "a cross-product law takes the momentum that they leave in the wheels out through the "
            "coils."
            if dump is None
            else f"dumps by {DUMPERS[dump.by]} take the momentum that they "
            f"leave in the wheels out from {dump.percent[0]} % of a wheel's capacity to "
            f"{dump.percent[1]} %."
        ),
        "limits": limits,
        "step": step,
        "step_why": step_why,
        "substeps": _substeps(step, wheels.torque_si / min(inertia), dump),
        "accuracy": f"{_accuracy(limits['pointing']):.3g}",
        "stop": _stop(
            orbit,
            dump,
            _secular(
                orbit, sources, surfaces, dipole.size, _suns(pointing, orbit, start)
            ),
            step,
        ),
        "inertia": {
            "value": "["
            + ", ".join(
                _list([x if i == j else 0.0 for j in range(3)])
                for i, x in enumerate(inertia)
            )
            + "]",
            "why": body.inertia_from,
            "moments": [_text(x) for x in inertia],
        },
        "body": {
            "mass": _text(mass),
            "sides": _list(sides),
            "mass_from": body.mass_from,
            "sides_from": body.sides_from,
        },
        "wheels": wheels,
        "rods": rods,
        "thrusters": thrusters,
        "dump": dump,
        "bias": bias,
        "start_wheels": _list(bias * x for x in _null_of(wheels)) if bias else "",
        "gyro": _gyro(),
        "star_tracker": classes()["star_trackers"]["cubesat"],
        "dipole": dipole,
        "dipole_list": _list(dipole.vector),
        "surfaces": surfaces,
        "plates": [_list(row) for row in surfaces.table],
        "drives": [_list(plate.drive) for plate in surfaces.plates],
        "offset": _list(surfaces.offset),
        "spreads": list(_spreads(body, dipole, surfaces, sources, thrusters)),
        "ends": _ends(orbit, dipole, surfaces, sources),
        "gains": {
            "bandwidth": _text(bandwidth),
            **{
                k: _text(x)
                for k, x in zip(("kp", "kd", "ki"), _gains(bandwidth), strict=True)
            },
            "why": f"fast beside the orbit, slow beside a sample of {0.1 / quick:g} s"
            if enough
            else "what the wheels' torque turns an error of 5 deg with",
            "yaw": _text(YAW_ERROR * bandwidth**2),
            "manager": _text(rate),
            "start": _text(0.1 * wheels.capacity_si),
            "b_dot": _text(BRAKING * rate * sum(inertia) / 3.0),
        },
        "tumbling": {
            "step": min(1.0, step),
            "substeps": max(1, round(8.0 * min(1.0, step))),
            "sample": 1.0,
        },
        "rollout": _rollout(rods, limits["name"], rate, sum(inertia) / 3.0),
        "tumble": _text(tumble),
        "tumble_size": _text(math.radians(tumble) * math.sqrt(3.0)),
    }


def _rollout(
    rods: Mapping[str, str] | None, mass_class: str, rate: float, moment: float
) -> dict[str, str]:
    """Return gains and spreads of the detumbling rollout as texts; none without rods.

    rate (rad/s) is the orbit rate and moment (kg m2) the mean moment of inertia. The
    field of the gain is that of a dipole at the semi-major axis.
    """
    if rods is None:
        return {}
    field = EQUATOR_FIELD * rate**2 * EARTH_RADIUS**3 / MU
    dipole = quantity("--rods", rods["dipole"], "A.m2")
    return {
        "gain": f"{dipole / (field * SLOW_RATE):.3g}",
        "gain_wheel": f"{moment / WHEEL_TIME:.4g}",
        **classes()["spreads"][mass_class],
    }


class Dipole(NamedTuple):
    """Residual dipole of a new craft."""

    vector: tuple[float, float, float]  # A m2, body
    origin: str
    # its entry of [dispersions], and the factor to its unfavourable end
    spread: str = ""
    end: float = 1.0

    @property
    def size(self) -> float:
        """Return its size (A m2)."""
        return math.hypot(*self.vector)


NO_DIPOLE = Dipole((0.0, 0.0, 0.0), "")


def _dipole(facts: CraftFacts, mass: float, sign: float) -> Dipole:
    """Return the residual dipole of a new craft of a mass (kg).

    Where only its size is known, `sign` is that along its assumed direction.
    """
    along = np.array([1.0, -0.5, 0.8])
    along *= sign / np.linalg.norm(along)
    if facts.residual_dipole is None:
        figures = classes()["dipoles"][_mass_class(mass)]
        share = quantity("", figures["share"], "A.m2")
        factor = quantity("", figures["factor"], "1")
        x, y, z = (mass * share * along).tolist()
        return Dipole(
            (x, y, z),
            f"class: {1e3 * share:g} mA m2 a kilogram; its direction is assumed",
            format_spread(factor, direction=mass * share),
            factor,
        )
    dipole = parse_values(RESIDUAL, facts.residual_dipole)
    if len(dipole.values) == 1:
        size = replace(RESIDUAL, least=0.0)(dipole.values[0])
        x, y, z = (size * along).tolist()
        spread = format_spread(dipole.share, direction=size)
        return Dipole(
            (x, y, z), "given; its direction is assumed", spread, dipole.share
        )
    if len(dipole.values) != 3:
        raise DesatError(
            f"--residual-dipole {facts.residual_dipole}: one size, or three numbers x,y,z "
            "are needed"
        )
    x, y, z = dipole.values
    return Dipole(
        (x, y, z),
        "given",
        format_spread(dipole.factor, dipole.plus_minus),
        dipole.share,
    )


def _spreads(
    body: NewBody,
    dipole: Dipole,
    surfaces: Surfaces,
    sources: Sources,
    thrusters: Mapping[str, Any] | None,
) -> Iterator[tuple[str, str, str]]:
    """Yield what is not known for sure: parameter, entry of [dispersions] and its reason."""
    if surfaces.plates:
        cp = surfaces.offset_given
        entry = format_spread(class_factor("offset"))
        reason = "class: dump intervals that flew"
        if cp is not None:
            size = cp.values[0] if len(cp.values) == 1 else 0.0
            entry, reason = format_spread(cp.factor, cp.plus_minus, size), "given"
            if len(cp.values) == 1:
                entry = format_spread(cp.share, direction=size)
        yield "spacecraft.offset_plates_body", entry, reason
    if surfaces.plates:
        reason = "class: areas and reflection of faces and wings"
        yield "spacecraft.plates", format_spread(class_factor("plates")), reason
    if sources.air:
        reason = "class: density and drag coefficient"
        yield "spacecraft.drag_coefficient", format_spread(class_factor("drag")), reason
    if sources.dipole and dipole.size > 0.0:
        yield "spacecraft.residual_dipole_body", dipole.spread, dipole.origin
    yield "spacecraft.inertia", format_spread(body.spread), body.inertia_from
    if thrusters is not None:
        if thrusters["nozzles"] is None and thrusters["arm_why"] != "given":
            reason = "class: where the nozzles are"
            yield "thrusters.arm", format_spread(class_factor("arm")), reason
        reason = "class: short pulses give less"
        spread = format_spread(class_factor("pulses"))
        yield "thrusters.specific_impulse", spread, reason


def _ends(
    orbit: Orbit, dipole: Dipole, surfaces: Surfaces, sources: Sources
) -> dict[str, str]:
    """Return what is uncertain at its unfavourable end, as texts for `worst.toml`."""
    ends = {}
    if surfaces.plates:
        cp = surfaces.offset_given
        factor = class_factor("offset") if cp is None else cp.share
        ends["offset_plates_body"] = _list(factor * x for x in surfaces.offset)
    if sources.air and orbit.of_tle:  # of others the Sun is active
        ends["drag_coefficient"] = _text(DRAG_COEFFICIENT * class_factor("drag"))
    if sources.dipole and dipole.size > 0.0:
        ends["residual_dipole_body"] = _list(dipole.end * x for x in dipole.vector)
    return ends


@dataclass(frozen=True)
class Sources:
    """Torques on a new craft besides gravity gradient."""

    dipole: bool
    air: bool
    light: bool
    torque: GivenTorque | None


def _torques(orbit: Orbit, sources: Sources) -> str:
    """List the torques on the craft as text."""
    names = ["gravity gradient"] * orbit.has_centre
    names += ["drag"] * sources.air + ["radiation"] * sources.light
    names += ["its own dipole"] * sources.dipole
    if sources.torque is not None:
        names.append(f"the torque of {sources.torque.option}")
    return ", ".join(names[:-1]) + (" and " if len(names) > 1 else "") + names[-1]


def _worse(orbit: Orbit, sources: Sources) -> list[str]:
    """List what is worse in the worst scenario, as texts."""
    worse = ["1.3 times the torque"] * (sources.torque is not None)
    worse += ["high solar activity"] * (sources.air and not orbit.of_tle)
    if sources.light or sources.dipole:
        worse.append("what is assumed at its unfavourable end")
    return worse


def _start(pointing: NewPointing, orbit: Orbit) -> dict[str, Any]:
    """Return the reference attitude at t = 0, and one with the error OFF.

    Both are relative to lvlh or to eci.
    """
    if not pointing.values and pointing.kind in ("nadir", "inertial"):
        return {
            "frame": "lvlh" if pointing.kind == "nadir" else "eci",
            "q": None,
            "off": _list(OFF),
            "turned": np.eye(3),
        }
    block = pointing.block()
    (block.r_eci, block.v_eci), block.sun_eci = orbit.state, orbit.sun
    block.check()
    block.start()
    q = block.q_ref_bi
    return {
        "frame": "eci",
        "q": _list(q),
        "off": _list(product(OFF, q)),
        "omega": "[" + ", ".join(f"{x:.4g}" for x in block.omega_ref_body) + "]",
        "turned": np.reshape(matrix(q), (3, 3)),
    }


def _suns(
    pointing: str, orbit: Orbit, start: Mapping[str, Any]
) -> list[Sequence[float]]:
    """Return the directions (unit vectors, body) from which the Sun shines.

    They are all where the craft turns against it.
    """
    if pointing in ("sun", "inertial"):
        return [(start["turned"] @ np.array(orbit.sun)).tolist()]
    return list(AROUND)


def _secular(
    orbit: Orbit,
    sources: Sources,
    surfaces: Surfaces,
    dipole: float,
    suns: Sequence[Sequence[float]],
) -> float:
    """Estimate the secular torque (N m).

    It is the sum of radiation, a tenth of the residual dipole's torque in the field of
    a circular orbit, and the given torque. Light from all around leaves a half.
    """
    light = 0.0
    if sources.light:
        light = orbit.light * surfaces.light(suns) * (1.0 if len(suns) == 1 else 0.5)
    light += 0.0 if sources.torque is None else sources.torque.size
    if not orbit.of_earth or orbit.eccentricity > 0.1:
        return light
    radius = math.sqrt(sum(x * x for x in orbit.state[0]))
    return light + 0.1 * dipole * EQUATOR_FIELD * (EARTH_RADIUS / radius) ** 3


def _step(
    orbit: Orbit,
    inertia: list[float],
    torque: float,
    surfaces: Surfaces,
    turns: bool,
) -> float:
    """Choose the step (s).

    It is a second. In a slow orbit it is as long as neither the wheels' torque (N m)
    nor the air at perigee turns the craft far in it, nor the attitude lags where it
    `turns` with an ellipse.
    """
    if orbit.period < SLOW:
        return 1.0
    r, v = orbit.state
    speed = math.sqrt(sum(x * x for x in v))
    air = (
        atmosphere.table(math.sqrt(sum(x * x for x in r)) - EARTH_RADIUS)
        if orbit.air and surfaces.faces
        else 0.0
    )
    wind = 0.5 * DRAG_COEFFICIENT * air * speed * speed * surfaces.lever if air else 0.0
    # the controller's bandwidth w is a tenth of the sample rate, its stiffness J w^2
    return next(
        (
            x
            for x in SAMPLES
            if 0.5 * torque / min(inertia) * x * x <= LARGEST_TURN
            and wind / min(inertia) * (10.0 * x) ** 2 <= DEVIATION
            and (not turns or _bend(orbit) * (10.0 * x) ** 2 <= 2.5 * DEVIATION)
        ),
        1.0,
    )


def _is_multiple(time: float, step: float) -> bool:
    """Return whether a sample time (s) is a whole number of steps (s), at least one."""
    count = time / step
    return round(count) >= 1 and abs(count - round(count)) <= 1e-9


def _given_sample(text: str) -> float:
    """Parse the sample time (s) of --sample.

    Raises DesatError where 10 s are no multiple of it, because coils and manager sample
    every 10 s.
    """
    sample = SAMPLE(text)
    if not _is_multiple(10.0, sample):
        raise DesatError(
            f"--sample {text}: 10 s over a whole number is needed, as 0.5s, 0.2s"
        )
    return sample


def _attitude_loop(
    inertia: Sequence[float], wheels: NewWheels, bandwidth: float, step: float
) -> AttitudeLoop:
    """Return the attitude loop of a new craft, all sampled at every step (s)."""
    axes, rotor = np.array(wheels.axes_si), wheels.inertia_si
    inertia_matrix = np.diag(inertia)
    kp, kd, ki = _gains(bandwidth)
    return AttitudeLoop(
        inertia=inertia_matrix - rotor * axes @ axes.T,
        gain_matrix=inertia_matrix,
        kp=kp,
        kd=kd,
        ki=ki,
        actuated=np.eye(3),
        motor_lag=quantity("", wheels.lag, "s"),
        gyroscopic=True,
        step=step,
        gyro_sample=step,
        attitude_sample=step,
        controller_sample=step,
        wheel_sample=step,
    )


def _gains(bandwidth: float) -> tuple[float, float, float]:
    """Return kp (1/s2), kd (1/s) and ki (1/s3) of the controller for a damping of 0.7.

    They are multiplied by the inertia; the controller's error e is half the angle, so
    kp is twice the square of the `bandwidth` (rad/s). ki is a tenth of kp times it.
    """
    return 2.0 * bandwidth**2, 1.4 * bandwidth, 0.2 * bandwidth**3


def _stable_sample(
    loop: AttitudeLoop, wheels: NewWheels, fullest: float, is_given: bool
) -> float:
    """Return the sample time (s) at which the attitude loop is well damped.

    Parameters
    ----------
    loop
        The loop with the sample time that orbit and torques allow.
    wheels
        Figures of the wheels.
    fullest
        Share of their capacity to which they fill.
    is_given
        Whether the user set the sample time. It is then not changed: a DesatError says
        which one would do.
    """
    axes = np.array(wheels.axes_si)[:, : wheels.count]
    each = np.full(wheels.count, fullest * wheels.capacity_si)
    sample = loop.sample()
    sample_time = longest_sample(loop, axes, each, (sample, *SAMPLE_TIMES))
    if sample_time == sample:
        return sample
    momentum, _ = worst_momentum(loop, axes, each)
    fast = (
        f"with {100.0 * fullest:.3g} % in the wheels the craft nutates at "
        f"{loop.nutation(momentum):.3g} rad/s"
    )
    if sample_time is None:
        raise DesatError(
            f"--wheels: {fast}: no sample time from {SAMPLE_TIMES[-1]:g} s on holds its attitude"
        )
    if is_given:
        raise DesatError(
            f"--sample {sample:g}s: {fast}, which these samples do not hold; {sample_time:g}s would do"
        )
    return sample_time


def _mass_class(mass: float) -> str:
    """Return the class of a craft of a mass (kg): nano, small or large."""
    lightest = classes()["requirements"].items()
    return [n for n, x in lightest if quantity("", x["mass"], "kg") <= mass][-1]


def _limits(
    mass: float, orbit: Orbit, thrusters: Mapping[str, str] | None
) -> dict[str, str]:
    """Return the limits of the scenarios as texts, by the mass class."""
    name = _mass_class(mass)
    figures = classes()["requirements"][name]
    limits = {
        key: f"{quantity('', figures[key], unit):g}"
        for key, unit in (
            ("fill", "%"),
            ("duty", "%"),
            ("pointing", "deg"),
            ("dumping", "deg"),
            ("detumbling", "h"),
            ("years", "1"),
        )
    }
    if orbit.eccentricity > 0.1:
        limits["duty"] = ""  # coils saturate where the field is too weak to act
    tank = (
        ""
        if thrusters is None or not thrusters["tank"]
        else _text(quantity("", thrusters["tank"], "kg") / float(limits["years"]))
    )
    return {**limits, "name": name, "a_year": tank}


def _bend(orbit: Orbit) -> float:
    """Return the largest angular acceleration of nadir (rad/s2).

    At the true anomaly v it is 2 n^2 e sin v (1 + e cos v)^3 / (1 - e^2)^3.
    """
    e = orbit.eccentricity
    v = np.linspace(0.0, math.pi, 721)
    bend = np.sin(v) * (1.0 + e * np.cos(v)) ** 3
    return float(2.0 * orbit.rate**2 * e * bend.max() / (1.0 - e * e) ** 3)


def _substeps(step: float, acceleration: float, dump: NewDumps | None) -> int | str:
    """Return the number of substeps in a step (s): `auto`, but for dumps by thrusters.

    With pulses no short flight beforehand represents a run. There it is the number that
    `coverage.LIMITS` requires when all wheels turn the craft at their torque (rad/s2
    each).
    """
    if dump is None or dump.by == "coils":
        return AUTO
    return min(8, math.ceil(step * math.sqrt(2.4 * acceleration / KICK)))


def _accuracy(pointing: str) -> float:
    """Return the largest attitude error (rad) that the substeps of a run may leave.

    It is a hundredth of the pointing limit (deg), at most ACCURACY.
    """
    return min(ACCURACY, math.radians(float(pointing)) / 100.0)


def _stop(orbit: Orbit, dump: NewDumps | None, torque: float, step: float) -> float:
    """Return the duration of a scenario (s).

    It is a day, ten orbits of a slow orbit, or until there have been DUMPS dumps; all
    wheels of a pyramid together hold 1.7 times the momentum of one.
    """
    days = 1.0
    if orbit.period >= SLOW:
        days = math.ceil(10.0 * orbit.period / 86400.0) if orbit.has_centre else 10.0
    if dump is not None and dump.by != "coils":
        between = 1.7 * dump.momentum / max(torque, 1e-12)
        if dump.period > 0.0:
            between = min(between, 1.1 * dump.period)
        days = max(days, math.ceil(DUMPS * between / 86400.0))
    return 86400.0 * max(1.0, min(days, math.floor(MOST_STEPS * step / 86400.0)))


def _dump(
    facts: CraftFacts,
    wheels: NewWheels,
    thrusters: Mapping[str, str] | None,
    rods: bool,
    inertia: float,
    step: float,
) -> NewDumps | None:
    """Return the dumps between thresholds; None for a law that dumps all the time."""
    if facts.dump is None:
        if not rods:
            raise DesatError(
                "no rods: --dump says what takes momentum out, as --thrusters '4 1N' "
                "--dump 'thrusters 70:10'"
            )
        return None
    capacity = wheels.capacity_si
    rule = _rule(facts.dump, capacity)
    begin, end, by, aligned, period, windows = rule
    if by != "thrusters" and not rods:
        raise DesatError(f"--dump {facts.dump}: --rods none leaves no coils")
    if by == "coils" and aligned:
        raise DesatError(f"--dump {facts.dump}: aligned is for thrusters only")
    if by != "coils" and thrusters is None:
        raise DesatError(
            f"--dump {facts.dump}: --thrusters says which, as --thrusters '4 1N'"
        )
    torque, sample = 0.5 * wheels.torque_si, 10.0
    origin = "half of what the wheels give"
    if thrusters is not None and by != "coils":
        if float(thrusters["torque_si"]) < torque:
            torque, origin = float(thrusters["torque_si"]), "what a pair gives"
        momentum = 8.0 * inertia * DEVIATION
        longest = (
            x for x in SAMPLES if torque * x * x <= momentum and _is_multiple(x, step)
        )
        sample = next(longest, step)
        if torque * sample * sample > momentum:
            torque, origin = (
                momentum / sample**2,
                "no pulse turns the craft by more than 0.1 deg",
            )
    return NewDumps(
        by=by,
        percent=(f"{begin:.4g}", f"{end:.4g}"),
        begin=_text(begin / 100.0 * capacity),
        end=_text(end / 100.0 * capacity),
        torque=_text(torque),
        origin=origin,
        sample=sample,
        large=capacity >= 1.0,
        most=f"{rule.fullest:g}",
        aligned=aligned,
        latest=_text((begin + 100.0) / 200.0 * capacity),
        momentum=(begin - end) / 100.0 * capacity,
        period=period,
        windows=windows,
        spread=format_spread(wheels.spread),
        spread_why="given" if facts.wheels else "class: wheels",
        capacity=capacity,
    )


class DumpRule(NamedTuple):
    """When dumps of a new craft begin and end."""

    begin: float  # % of a wheel's capacity
    end: float
    by: str
    aligned: bool  # whether they wait until their momentum lies along an axis
    period: float  # s, of the calendar; 0: there is none
    windows: Windows | None = None

    @property
    def fullest(self) -> float:
        """Return the largest fill (%) that a craft with these dumps is allowed."""
        latest = (self.begin + 100.0) / 2.0  # where a dump that waits begins at last
        return min(latest + 3.0 if self.aligned else self.begin + 10.0, 98.0)


def _rule(text: str, capacity: float) -> DumpRule:
    """Parse when dumps begin and end, for wheels of a capacity (N m s).

    Raises DesatError for another form.
    """
    text, windows = windows_of(text)
    if match := re.fullmatch(r"\s*(thrusters|both)\s+every\s+(\S+)\s*", text):
        return DumpRule(*CALENDAR, match[1], False, PERIOD(match[2]), windows)
    match = re.fullmatch(
        r"\s*(\w+)\s+([\d.]+)\s*(m?Nms)?\s*:\s*([\d.]+)\s*(%|m?Nms)?(\s+aligned)?\s*",
        text,
    )
    if match is None or match[1] not in DUMPERS:
        raise DesatError(
            f"--dump {text}: the form is thrusters, coils or both BEGIN:END, in % of a wheel's "
            "capacity, as 'thrusters 70:10', or in momentum, as 'thrusters 1.8Nms:0'; of thrusters "
            "aligned may follow; or 'thrusters every 7d'; of each `within FILE.csv` or "
            "`outside FILE.csv`"
        )
    units = [x for x in (match[3], match[5]) if x not in (None, "%")]
    if units:
        each = [MOMENTA[x or units[0]] / capacity for x in (match[3], match[5])]
        begin, end = (
            100.0 * each[0] * float(match[2]),
            100.0 * each[1] * float(match[4]),
        )
        if begin > FILL.most:
            raise DesatError(
                f"--dump {text}: a wheel holds {capacity:.4g} N m s: at most "
                f"{FILL.most / 100.0 * capacity:.4g} N m s are covered"
            )
    else:
        begin, end = FILL(match[2]), FILL(match[4])
    if end >= begin:
        raise DesatError(
            f"--dump {text}: it ends at {end:.4g} %, which is not below {begin:.4g} %"
        )
    if not units and begin < 1.0 and not match[5]:
        raise DesatError(
            f"--dump {text}: thresholds are in % of a wheel's capacity: "
            f"'{match[1]} {100.0 * begin:g}:{100.0 * end:g}', or {begin:g}:{end:g}%"
        )
    if windows is not None and match[6]:
        raise DesatError(
            f"--dump {text}: aligned waits for an attitude, windows for a time: one of both"
        )
    return DumpRule(begin, end, match[1], bool(match[6]), 0.0, windows)


def _cycle(
    pointing: str,
    orbit: Orbit,
    inertia: list[float],
    start: Mapping[str, Any],
    axes: list[list[float]],
    dipole: Sequence[float],
) -> float:
    """Return an orbit's cyclic momentum in the fullest wheel (N m s).

    0 on an ellipse, and about the Sun.
    """
    if orbit.eccentricity >= 0.1 or not orbit.of_earth:
        return 0.0
    a, b, c = inertia
    to_earth = pointing in ("nadir", "yaw", "plan")
    momentum = cyclic.momentum(
        to_earth,
        orbit.rate,
        orbit.inclination,
        (a, 0.0, 0.0, 0.0, b, 0.0, 0.0, 0.0, c),
        dipole,
        None if to_earth else start["turned"],
    )
    return cyclic.fullest(np.array(axes), momentum)


def _wheels(
    facts: CraftFacts,
    inertia: list[float],
    mass_class: str,
    cycle: Callable[[list[list[float]], Sequence[float]], float],
    dipole: Dipole,
) -> NewWheels:
    """Return the wheels that the facts give, or those of the class.

    Those of the class turn the craft at 1 deg/s three times over, large ones at
    0.5 deg/s, and hold what its dipole exchanges with them if it is at its
    unfavourable end. Larger ones are of sizes that are sold.

    Raises DesatError if the fullest wheel cannot hold an orbit's cyclic momentum.
    """
    size, origin = (
        3.0 * max(inertia) * math.radians(1.0),
        "1 deg/s of the craft, thrice",
    )
    if mass_class == "large":
        size, origin = max(inertia) * math.radians(0.5), "0.5 deg/s of the craft"
    end = HELD * cycle(PYRAMID, [dipole.end * x for x in dipole.vector])
    if end > size:
        size, origin = end, "what the dipole at its end exchanges with them in an orbit"
    if mass_class == "large":
        sold = [
            quantity("", x["capacity"], "N.m.s") for x in classes()["wheels"].values()
        ]
        size = min((x for x in sold if x >= size), default=size)
        origin += ", in a size that is sold"
    text, spread = split_spread(
        f"--wheels {facts.wheels}",
        facts.wheels or f"4 pyramid {max(size, 2e-3):.2g} N.m.s",
    )
    if facts.wheels is None:
        spread = class_factor("wheels")
    layout = layout_of(text)
    count = layout.count
    name, figures, capacity = _of_class(WHEELS, "wheels", "capacity", layout.size)
    speed = quantity("--wheels", figures["speed"], "rad/s")
    share = capacity / quantity("--wheels", figures["capacity"], "N.m.s")
    torque = share * quantity("--wheels", figures["torque"], "N.m")
    axes = layout.axes
    if (needs := cycle(axes, dipole.vector)) > capacity:
        raise DesatError(
            f"--wheels: {cyclic.shortfall(needs, capacity)}: take at least "
            f"{1.3 * needs * 1e3:.2g} mN m s, or a smaller --residual-dipole"
        )
    rotor = capacity / speed
    viscous, coulomb = friction(torque, speed)
    return NewWheels(
        count=count,
        inertia_si=rotor,
        axes_si=axes,
        axes=["[" + ", ".join(f"{x:.16g}" for x in row) + "]" for row in axes],
        layout_why=layout.words,
        size_why="torque" if facts.wheels else f"class: {origin}",
        null=count > 3,
        capacity=f"{capacity * 1e3:g} mN m s",
        speed=figures["speed"],
        class_name=name,
        inertia="["
        + ", ".join([f"{rotor:.9g}"] * count + ["0.0"] * (len(axes[0]) - count))
        + "]",
        torque=f"{torque * 1e3:.4g} mN.m",
        torque_si=torque,
        capacity_si=capacity,
        origin=f"class: {name}"
        + ("" if abs(share - 1.0) < 1e-9 else f" times {share:.3g}"),
        viscous=f"{viscous:.3g}",
        coulomb=f"{coulomb:.3g}",
        lag=WHEEL_LAG,
        compensation=COMPENSATION,
        noise=f"{1e-3 * capacity:.3g}",
        spread=spread,
    )


def _null_of(wheels: NewWheels) -> tuple[float, ...]:
    """Return the direction along which wheels keep momentum against each other."""
    return null_vector(tuple(np.ravel(wheels.axes_si).tolist()))


def _null_bias(facts: CraftFacts, wheels: NewWheels) -> float:
    """Return what each wheel keeps against the others (N m s); 0: nothing."""
    if facts.bias is None:
        return 0.0
    is_speed = re.search(r"rpm|rad/s|deg/s|Hz", facts.bias) is not None
    size = BIAS_SPEED(facts.bias) * wheels.inertia_si if is_speed else BIAS(facts.bias)
    if not any(_null_of(wheels)):
        raise DesatError(
            f"--bias {facts.bias}: {wheels.count} wheels keep nothing against each other: "
            "--wheels '4 pyramid ...' do"
        )
    if size > MOST_BIAS * wheels.capacity_si:
        raise DesatError(
            f"--bias {facts.bias}: {size:.4g} N m s of {wheels.capacity_si:.4g} that a wheel "
            f"holds; at most {MOST_BIAS * wheels.capacity_si:.4g} N m s are taken"
        )
    return size


def _rods(
    facts: CraftFacts, mass: float, sides: tuple[float, float, float], orbit: Orbit
) -> dict[str, str] | None:
    """Return the texts of the rods, or None without rods."""
    if facts.rods == "none" or (facts.rods is None and not orbit.of_earth):
        return None
    if not orbit.of_earth:
        raise DesatError(
            f"--rods {facts.rods}: there is no field to speak of there; thrusters dump "
            "there, as --thrusters '4 10mN' --dump 'thrusters 70:10'"
        )
    share = quantity("", classes()["dipoles"][_mass_class(mass)]["rods"], "A.m2")
    text = facts.rods or f"{share * mass:.2g}"
    if coils.is_made(text):
        found, construction = coils.design_coil(text, 0.1 * mass, max(sides))
        return {
            "dipole": f"{found.dipole:.4g} A.m2",
            "lag": "20 ms",
            "why": construction,
            "resistance": f"{found.resistance:.4g}",
            "resistance_why": "of its wire, at 20 deg C",
            "area_turns": f"{found.area_turns:.4g}",
        }
    name, figures, dipole = _of_class(RODS, "rods", "dipole", text)
    construction = "given" if facts.rods else f"class: {1e3 * share:g} mA m2 a kilogram"
    share = dipole / quantity("--rods", figures["dipole"], "A.m2")
    current = (
        share
        * quantity("--rods", figures["power"], "W")
        / (voltage := quantity("--rods", figures["voltage"], "V"))
    )
    return {
        "dipole": f"{dipole:g} A.m2",
        "lag": figures["lag"],
        "why": f"{construction}; lag as {name}",
        "resistance": f"{voltage / current:.4g}",
        "area_turns": f"{dipole / current:.4g}",
        "resistance_why": f"class {name}: {1e3 * voltage * current:.3g} mW at the full dipole",
    }


def _gyro() -> dict[str, str]:
    """Return the angle random walk (deg) after 1 s, and as the text of its class."""
    figures = classes()["gyros"]["mems"]
    return {"in_1_s": _text(math.degrees(walk(figures))), "in_1_h": figures["walk"]}


def _thrusters(
    facts: CraftFacts, sides: tuple[float, float, float]
) -> Mapping[str, Any] | None:
    """Return the texts of the thrusters, or None without thrusters."""
    if facts.thrusters is None:
        for option, text in (
            ("--propellant", facts.propellant),
            ("--isp", facts.isp),
            ("--arm", facts.arm),
        ):
            if text is not None:
                raise DesatError(
                    f"{option} {text}: --thrusters says which, as --thrusters '4 1N'"
                )
        return None
    arm = sorted(sides)[1] / 2.0 if facts.arm is None else ARM(facts.arm)
    text, is_electric = re.subn(r"\s+electric\b", "", str(facts.thrusters).strip())
    nozzles, size = _nozzles(replace(facts, thrusters=text), sides)
    kind = "electric" if is_electric else "thrusters"
    name, figures, force = _of_class(THRUSTERS, kind, "force", size)
    power = 0.0
    if is_electric:
        share = force / quantity("--thrusters", figures["force"], "N")
        power = share * quantity("--thrusters", figures["power"], "W")
    torque = 2.0 * force * arm if nozzles is None else nozzles.weakest
    isp = None if nozzles is None else nozzles.isp
    impulse, origin = figures["impulse"], f"class: {name}"
    if facts.isp is not None:
        impulse, origin = f"{ISP(facts.isp):g} s", "given"
    elif isp is not None:
        impulse, origin = f"{isp:g} s", "given"
    return {
        "torque": _list([torque] * 3),
        "force": f"{force:g} N",
        "arm": _text(arm),
        "arm_why": "class: half the middle side" if facts.arm is None else "given",
        "torque_si": _text(torque),
        "impulse": impulse,
        "impulse_why": origin,
        "tank": ""
        if facts.propellant is None
        else f"{PROPELLANT(facts.propellant):g} kg",
        "pulse": figures["pulse"],
        "loss": figures["loss"],
        "power": f"{power * (2.0 if nozzles is None else 1.0):.4g}" if power else "",
        "power_words": f"{power:.4g}",
        "class": name,
        "nozzles": nozzles,
    }


def _nozzles(
    facts: CraftFacts, sides: tuple[float, float, float]
) -> tuple[Nozzles | None, str]:
    """Return the nozzles, None of pairs about the axes, and the size of each as text."""
    text = str(facts.thrusters).strip()
    if text.endswith(".csv"):
        if facts.arm is not None:
            raise DesatError(f"--arm {facts.arm}: {text} says where its nozzles are")
        nozzles = read_layout(text, sides)
        return nozzles, f"{float(np.median(nozzles.thrust)):g} N"
    count, size = count_of(text) or (PAIRS, text)
    if count == PAIRS:
        return None, size
    _, _, force = _of_class(THRUSTERS, "thrusters", "force", size)
    half = [x / 2.0 for x in sides]
    arm = 0.0 if facts.arm is None else ARM(facts.arm)
    return layout_of_nozzles(count, force, half, arm), size
