"""A new craft's folder, from what its owner knows of it: `craft.toml` with every number's origin,
and the scenarios `nominal`, `worst` and `detumbling`. What is not given is typical of its class
(templates/classes.toml, templates/craft/).

Rules, each written beside its number:

- inertia: a homogeneous box of the craft's mass and sides;
- drag and radiation: the mean area of the box as it is seen from all sides, half the sum of its
  three faces; centre of pressure off by 5 % of each side;
- residual dipole: 5 mA m2 a kilogram, along (1, -0.5, 0.8);
- wheels: no less than residual dipole and gravity gradient turn in and out of them each orbit;
- attitude controller: bandwidth 0.1 rad/s, or less where the wheels' torque would not turn an error
  of 5 deg so fast; damping 0.7;
- manager: gain of the orbit's rate; B-dot: BRAKING orbit rates times the mean
  moment of inertia;
- dumps between thresholds: torque half of what the wheels give, or what the pairs give if less; a
  sample's pulse, centred in it, turns the craft to one side and the wheels turn it back: samples as
  long, and the torque as large, as keep torque T^2 / (8 J) within DEVIATION;
- an orbit of SLOW or more is flown at steps of 10 s, until DUMPS dumps of radiation's torque.
"""

from __future__ import annotations

import math
import re
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from desat.components.physics import earth
from desat.components.physics.orbit import (
    EARTH_RADIUS,
    mean_motion,
    sun_synchronous_inclination,
)
from desat.components.physics.tle import teme_state, tle_parameters

from ..files import io
from ..files.hardware import COMPENSATION, WHEEL_LAG, Figures, classes, friction, quantity, walk
from ..system import cyclic
from ..system.errors import DesatError, nearest, plain
from ..system.model import J2000
from ..system.quantity import Quantity, is_number

Array = NDArray[np.float64]
SCENARIOS = ("nominal", "worst", "detumbling")
"""The last one of a craft with rods alone."""
_UNIT = 1.5
"""Mass of a CubeSat's unit (kg)."""
CUBESATS = {
    1: (0.1, 0.1, 0.1135), 2: (0.1, 0.1, 0.227), 3: (0.1, 0.1, 0.3405), 6: (0.1, 0.2263, 0.366),
    8: (0.2263, 0.2263, 0.227), 12: (0.2263, 0.2263, 0.366), 16: (0.2263, 0.2263, 0.454),
    27: (0.34, 0.34, 0.366),
}  # fmt: skip
"""Sides (m) by units: CubeSat Design Specification, and what deployers of the larger ones take."""
LAYOUTS = ("pyramid", "axes")
POINTINGS = ("nadir", "inertial")
BRAKING = 7.0
"""Of B-dot: gain over the mean moment of inertia, in orbit rates. Of gains from 0.003 to 0.03 1/s,
flown on 24 random crafts of 1U to 150 kg, it is within 1.3 of the quickest in 23. Stronger rods are
at their limit for less long, which does not move the best gain; Avanzini & Giulietti (2012), 2 n
(1 + sin xi) J_min, are up to ten times slower where J_min is far below the others."""
ALTITUDES = 150.0, 2000.0
"""Of a circular orbit (km)."""
FARTHEST = 400_000.0
"""The highest apogee (km): beyond, it is no orbit about the Earth alone."""
AIR = 1000.0
"""From this perigee on (km) there is no air."""
ORBITS = {
    "geo": ("35786.03x35786.03km", 0.05, 0.0, "geostationary; class: 0.05 deg"),
    "gto": ("250x35786km", 6.0, 178.0, "class: from Kourou"),
    "molniya": ("504x39863km", 63.4349, 270.0, "class: its perigee stays in the south"),
}
"""By name: heights of perigee and apogee, inclination and argument of perigee (deg), and why."""
SLOW = 6.0 * 3600.0
"""Periods (s) from which on nothing asks for steps of a second."""
DUMPS, MOST_DAYS = 9, 700.0
"""How many a scenario lasts for, and how long (d) it lasts at the most; quicker steps, less."""
SUNLIGHT = 4.56e-6
"""Pressure of the Sun's light at 1 astronomical unit (N/m2)."""
INCLINATION = Quantity("--inclination", "deg", 0.0, 180.0)
MASS = Quantity("--mass", "kg", 0.0, 1e6, above=True)
BOX = Quantity("--box", "m", 0.0, 100.0, above=True, what="sides")
INERTIA = Quantity("--inertia", "kg.m2", 0.0, 1e9, above=True, what="moments")
WHEELS = Quantity("--wheels", "N.m.s", 0.0, 1e5, above=True)
RODS = Quantity("--rods", "A.m2", 0.0, 1e5, above=True)
THRUSTERS = Quantity("--thrusters", "N", 0.0, 1e5, above=True)
RESIDUAL = Quantity("--residual-dipole", "A.m2", 0.0, 1e4)
PANEL = Quantity("--panel", "m2", 0.0, 1e4, above=True)
ARM = Quantity("--panel", "m", 0.0, 100.0)
FILL = Quantity("--dump", "%", 0.0, 95.0)
DUMPERS = ("thrusters", "coils")
DEVIATION = math.radians(0.1)
"""What one pulse of a dump may turn a craft by (rad): half of what pointing may err."""
SAMPLES = (10.0, 5.0, 2.0, 1.0)
"""Of thrusters (s): the longest that keeps within it, at least a step."""
YEARS = 1957, 2056
"""Of an epoch: those that two-line elements can name."""
DOUBTFUL, MEANINGLESS = 7.0, 30.0
"""Age of two-line elements (days): from the first on SGP4 is off by tens of kilometres, from the
second on by hundreds."""


@dataclass(frozen=True)
class CraftFacts:
    """What is known of a craft, as it is typed; None: what its class has."""

    altitude: str | None = None
    inclination: str | None = None
    sso: str | None = None
    ltan: str | None = None
    tle: Path | None = None
    epoch: str | None = None
    mass: str | None = None
    size: str | None = None
    box: str | None = None
    inertia: str | None = None
    wheels: str | None = None
    rods: str | None = None
    thrusters: str | None = None
    pointing: str = "nadir"
    residual_dipole: str | None = None
    orbit: str | None = None
    dump: str | None = None
    panel: str | None = None


def write(folder: Path, wanted: CraftFacts, command: str, force: bool = False) -> list[Path]:
    """Write the folder of a craft; its files. Raises DesatError where it exists already, unless
    `force`, or where something wanted cannot be; then nothing is written."""
    if folder.exists() and not force:
        raise DesatError(f"{folder}: it exists; --force writes the craft into it")
    name = folder.absolute().name
    if not re.fullmatch(r"[\w.+ -]+", name):
        raise DesatError(f"{plain(str(folder))}: a name of letters, digits, blanks and . _ + - is "
                         "needed")  # fmt: skip
    made = _template_values(wanted, name, plain(command))
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("desat", "templates/craft"), undefined=StrictUndefined,
        keep_trailing_newline=True,
    )  # fmt: skip
    scenarios = SCENARIOS if made["rods"] else SCENARIOS[:2]
    texts = {f"{name}.toml": environment.get_template(f"{name}.toml").render(made)
             for name in ("craft", *scenarios)}  # fmt: skip
    fresh = not folder.exists()
    folder.mkdir(parents=True, exist_ok=True)
    try:
        for name, text in texts.items():
            io.replace_text(folder / name, text)
    except (OSError, DesatError):
        if fresh:
            shutil.rmtree(folder, ignore_errors=True)
        raise
    return [folder / name for name in texts]


def _of_class(asked: Quantity, kind: str, measure: str, text: str) -> tuple[str, Figures, float]:
    """The class that a size belongs to, its figures, and the size."""
    known, option, unit = classes()[kind], asked.option, asked.unit
    if text in known:
        return text, known[text], quantity(option, known[text][measure], unit)
    if not is_number(text):
        raise DesatError(f"{option} {text}: no class{nearest(text, known)}; there is "
                         f"{', '.join(known)}, or a number in {unit}")  # fmt: skip
    size = asked(_dotted(text))
    name = min(known, key=lambda n: abs(math.log(size / quantity(option, known[n][measure], unit))))
    return name, known[name], size


def _dotted(text: str) -> str:
    """`30mNms` as `30 mN.m.s`, `0.2Am2` as `0.2 A.m2`."""
    text = re.sub(r"(m?N)ms$", r"\1.m.s", text.strip())
    return re.sub(r"(m?A)m2$", r"\1.m2", text)


def _text(x: float) -> str:
    return f"{x:.6g}"


def _list(values: Any) -> str:
    return "[" + ", ".join(_text(float(x)) for x in values) + "]"


def _template_values(wanted: CraftFacts, name: str, command: str) -> dict[str, Any]:
    """What the templates are filled with."""
    if wanted.pointing not in POINTINGS:
        raise DesatError(f"--pointing {wanted.pointing}: there is {', '.join(POINTINGS)}"
                         f"{nearest(wanted.pointing, POINTINGS)}")  # fmt: skip
    sides, sides_why, units = _sides(wanted)
    mass, mass_why = _mass(wanted, sides, units)
    inertia, inertia_why = _inertia(wanted, mass, sides, f"{mass_why}, {sides_why}")
    epoch = _epoch(wanted)
    orbit = _orbit(wanted, (epoch - J2000).total_seconds())
    wheels = _wheels(wanted, inertia)
    rods = _rods(wanted, mass)
    thrusters = _thrusters(wanted, sides)
    step = 10.0 if orbit["period"] >= SLOW else 1.0
    dump = _dump(wanted, wheels, thrusters, rods is not None, min(inertia), step)
    dipole = 0.005 * mass
    why = "class: 5 mA m2 a kilogram, no magnetic cleanliness"
    if wanted.residual_dipole is not None:
        dipole = RESIDUAL(_dotted(wanted.residual_dipole))
        why = "given"
    along = [x / math.sqrt(1.0 + 0.25 + 0.64) for x in (1.0, -0.5, 0.8)]
    if orbit["eccentricity"] < 0.1:
        _holds(wanted.pointing, orbit, inertia, wheels, [dipole * x for x in along])
    faces = [sides[1] * sides[2], sides[2] * sides[0], sides[0] * sides[1]]
    area = sum(faces) / 2.0
    quick = 0.1 / step
    bandwidth = min(quick, math.sqrt(wheels["torque_si"] / (max(inertia) * math.radians(5.0))))
    enough = bandwidth == quick
    rate = orbit["rate"]
    light, centre, centre_why = _radiation(wanted, area, sides)
    tumble = 5.0 if mass < 50.0 else 1.0
    return {
        "title": name, "command": command, "pointing": wanted.pointing, "orbit": orbit,
        "epoch": epoch.strftime("%Y-%m-%dT%H:%M:%SZ"),
        "description": f"{mass:.4g} kg, {wanted.pointing} pointing under gravity gradient, drag, "
        "radiation and its own dipole; " + (
            "a cross-product law takes the momentum that they leave in the wheels out through the "
            "coils." if dump is None else f"dumps by {dump['by']} take the momentum that they "
            f"leave in the wheels out from {dump['percent'][0]} % of a wheel's capacity to "
            f"{dump['percent'][1]} %."),
        "step": step, "stop": _stop(orbit, dump, light, centre),
        "inertia": {"value": "[" + ", ".join(_list([x if i == j else 0.0 for j in range(3)])
                    for i, x in enumerate(inertia)) + "]", "why": inertia_why},
        "wheels": wheels, "rods": rods, "thrusters": thrusters, "dump": dump,
        "gyro": _gyro(), "star_tracker": classes()["star_trackers"]["cubesat"],
        "dipole": {"value": _list(dipole * x for x in along), "why": f"A m2; {why}",
                   "twice": _list(2.0 * dipole * x for x in along)},
        "area": {"value": _text(area), "why": f"class: mean over all sides of {sides_why}"},
        "light": {"area": _text(light), "centre": _list(centre), "why": centre_why},
        "centre": {"value": _list(0.05 * x for x in sides), "why": "m; class: 5 % of each side"},
        "gains": {
            "bandwidth": _text(bandwidth), "kp": _text(2.0 * bandwidth**2),
            "kd": _text(1.4 * bandwidth), "ki": _text(2e-3 * bandwidth**2),
            "why": f"fast beside the orbit, slow beside a sample of {step:g} s" if enough
            else "what the wheels' torque turns an error of 5 deg with",
            "manager": _text(rate), "start": _text(0.1 * wheels["capacity_si"]),
            "b_dot": _text(BRAKING * rate * sum(inertia) / 3.0),
        },
        "tumble": _text(tumble), "tumble_size": _text(math.radians(tumble) * math.sqrt(3.0)),
    }  # fmt: skip


def _sides(wanted: CraftFacts) -> tuple[tuple[float, float, float], str, int]:
    """The sides (m) of the craft's box, what that is, and how many CubeSat units."""
    if wanted.box is not None:
        if wanted.size is not None:
            raise DesatError(f"--box {wanted.box}: --size {wanted.size} says it, too")
        parts = wanted.box.split(",")
        if len(parts) != 3:
            raise DesatError(f"--box {wanted.box}: three sides are needed, as 0.5,0.5,0.8 in m")
        a, b, c = BOX.many(wanted.box)
        return (a, b, c), f"a box of {a:g} x {b:g} x {c:g} m", 0
    text = (wanted.size or "6U").strip()
    match = re.fullmatch(r"(\d+)[uU]", text)
    if match is None or int(match[1]) not in CUBESATS:
        known = ", ".join(f"{n}U" for n in CUBESATS)
        raise DesatError(f"--size {text}: there is {known}; --box has any other")
    return CUBESATS[int(match[1])], f"a {text.upper()}", int(match[1])


def _mass(wanted: CraftFacts, sides: tuple[float, float, float], units: int) -> tuple[float, str]:
    if wanted.mass is not None:
        mass = MASS(wanted.mass)
        return mass, f"{mass:g} kg"
    if units:
        return _UNIT * units, f"class: {_UNIT:g} kg a unit"
    mass = 250.0 * sides[0] * sides[1] * sides[2]
    return mass, "class: 250 kg a cubic metre"


def _inertia(
    wanted: CraftFacts, mass: float, sides: tuple[float, float, float], why: str
) -> tuple[list[float], str]:
    """Principal moments (kg m2). Raises DesatError for those of no body."""
    if wanted.inertia is None:
        square = [x * x for x in sides]
        return [mass / 12.0 * (sum(square) - x) for x in square], f"a homogeneous body of {why}"
    values = list(INERTIA.many(wanted.inertia))
    if len(values) != 3:
        raise DesatError(f"--inertia {wanted.inertia}: three moments are needed, as 0.2,0.2,0.1")
    if max(values) > sum(values) - max(values):
        raise DesatError(f"--inertia {wanted.inertia}: no body has these moments: each is above 0, "
                         "and none is more than the two others together")  # fmt: skip
    return values, "given"


def _epoch(wanted: CraftFacts) -> datetime:
    """Of t = 0: what is given, else that of two-line elements, to a second."""
    of_tle = None if wanted.tle is None else _of_file(wanted.tle)["epoch_tle_j2000"]
    if wanted.epoch is None:
        if of_tle is None:
            return datetime(2027, 1, 1, tzinfo=UTC)
        return J2000 + timedelta(seconds=round(of_tle))
    try:
        made = datetime.fromisoformat(wanted.epoch)
    except ValueError:
        raise DesatError(
            f"--epoch {wanted.epoch}: a time is needed, as 2027-01-01T00:00:00Z"
        ) from None
    made = made if made.tzinfo else made.replace(tzinfo=UTC)
    if not YEARS[0] <= made.year <= YEARS[1]:
        raise DesatError(f"--epoch {wanted.epoch}: a year from {YEARS[0]} to {YEARS[1]} is needed")
    if of_tle is not None and abs(age := _days(made, of_tle)) > MEANINGLESS:
        raise DesatError(f"--epoch {wanted.epoch}: {_aged(age)} those of --tle {wanted.tle}; SGP4 "
                         f"means nothing beyond {MEANINGLESS:g} days")  # fmt: skip
    return made


def _days(epoch: datetime, elements: float) -> float:
    """From the epoch of two-line elements (s since J2000) to another (days)."""
    return ((epoch - J2000).total_seconds() - elements) / 86400.0


def _aged(days: float) -> str:
    return f"{abs(days):.0f} days {'after' if days > 0.0 else 'before'}"


def doubts(wanted: CraftFacts) -> list[str]:
    """What makes what is wanted doubtful, though it can be. Raises DesatError."""
    if wanted.tle is None:
        return []
    age = _days(_epoch(wanted), _of_file(wanted.tle)["epoch_tle_j2000"])
    if abs(age) <= DOUBTFUL:
        return []
    return [f"--epoch {wanted.epoch}: {_aged(age)} those of --tle {wanted.tle}; beyond "
            f"{DOUBTFUL:g} days SGP4 is off by tens of kilometres"]  # fmt: skip


def _orbit(wanted: CraftFacts, epoch: float) -> dict[str, Any]:
    """Parameters of the environment, each with its origin, the mean motion (rad/s) and the
    inclination (rad)."""
    given = {"--altitude": wanted.altitude, "--sso": wanted.sso, "--tle": wanted.tle,
             "--orbit": wanted.orbit}  # fmt: skip
    names = [name for name, value in given.items() if value is not None]
    if len(names) > 1:
        raise DesatError(f"{names[0]}, {names[1]}: one of them says the orbit")
    if wanted.tle is not None:
        for option, value in (("--inclination", wanted.inclination), ("--ltan", wanted.ltan)):
            if value is not None:
                raise DesatError(f"{option} {value}: --tle {wanted.tle} says the orbit")
        return _of_tle(wanted.tle, epoch)
    if wanted.orbit is not None:
        if wanted.ltan is not None:
            raise DesatError(f"--ltan {wanted.ltan}: it is of a Sun-synchronous orbit (--sso)")
        return _of_ends(wanted.orbit, wanted.inclination)
    text = wanted.sso or wanted.altitude or "500 km"
    height = Quantity((names or ["--altitude"])[0], "km", *ALTITUDES)(text) * 1e3
    axis, raan, raan_why = EARTH_RADIUS + height, 0.0, "class"
    if wanted.altitude is not None and wanted.sso is None:
        if wanted.ltan is not None:
            raise DesatError(f"--ltan {wanted.ltan}: it is of a Sun-synchronous orbit (--sso)")
        inclination = math.radians(INCLINATION(wanted.inclination or "51.6"))
        why = "given" if wanted.inclination else "class: that of the ISS"
    else:
        if wanted.inclination is not None:
            raise DesatError(f"--inclination {wanted.inclination}: --altitude is needed with it; a "
                             "Sun-synchronous orbit has its own")  # fmt: skip
        inclination, why = sun_synchronous_inclination(axis), "Sun-synchronous"
        hours = _hours(wanted.ltan or "10:30")
        raan = earth.raan_of_local_time(hours, epoch)
        raan_why = f"ascending node at {wanted.ltan or '10:30, class'} local time"
    rows = [
        ("semi_major_axis", f'"{axis / 1e3:.9g} km"', f"{height / 1e3:g} km above 6378.137 km"),
        ("inclination", f'"{math.degrees(inclination):.6g} deg"', why),
        ("raan", f'"{math.degrees(raan):.6g} deg"', raan_why),
        ("j2", "true", "its node and perigee drift"),
        ("atmosphere", '"activity"', "by solar activity: moderate"),
    ]
    return {"rows": rows, "rate": mean_motion(axis), "inclination": inclination, "tle": False,
            "period": 2.0 * math.pi / mean_motion(axis), "eccentricity": 0.0,
            "air": True}  # fmt: skip


def _of_ends(text: str, given: str | None) -> dict[str, Any]:
    """As `_orbit`, of an orbit by its name, or by the heights of its perigee and apogee."""
    ends, inclination, perigee, why = ORBITS.get(text.strip().lower(), (text, 51.6, 0.0, "class"))
    match = re.fullmatch(r"\s*([\d.]+)\s*x\s*([\d.]+)\s*km\s*", ends)
    if match is None:
        raise DesatError(f"--orbit {text}: there is {', '.join(ORBITS)}, or heights of perigee and "
                         f"apogee, as 500x39860km{nearest(text, ORBITS)}")  # fmt: skip
    low, high = sorted(
        Quantity("--orbit", "km", ALTITUDES[0], FARTHEST)(f"{height} km")
        for height in match.groups()
    )
    if given is not None:
        inclination, why = INCLINATION(given), "given"
    near, far = (EARTH_RADIUS + 1e3 * height for height in (low, high))
    axis, eccentricity = (near + far) / 2.0, (far - near) / (far + near)
    air = low < AIR
    rows = [
        ("semi_major_axis", f'"{axis / 1e3:.9g} km"', f"{low:g} x {high:g} km above 6378.137 km"),
        ("eccentricity", f"{eccentricity:.9g}", "by these heights"),
        ("inclination", f'"{inclination:.6g} deg"', why),
        ("argument_of_perigee", f'"{perigee:g} deg"', why),
        ("j2", "true", "its node and perigee drift"),
        ("atmosphere", '"activity"' if air else '"none"',
         "by solar activity: moderate" if air else "there is none so high"),
    ]  # fmt: skip
    return {"rows": rows, "rate": mean_motion(axis), "inclination": math.radians(inclination),
            "tle": False, "period": 2.0 * math.pi / mean_motion(axis),
            "eccentricity": eccentricity, "air": air}  # fmt: skip


def _radiation(
    wanted: CraftFacts, area: float, sides: tuple[float, float, float]
) -> tuple[float, list[float], str]:  # fmt: skip
    """The area (m2) and the centre (m, body) of the Sun's light, and why."""
    if wanted.panel is None:
        return 1.5 * area, [0.05 * x for x in sides], "as for drag; half of the light is mirrored"
    match = re.fullmatch(r"\s*([\d.eE+-]+)\s*m2\s+([\d.eE+-]+)\s*m\s*", wanted.panel)
    if match is None:
        raise DesatError(f"--panel {wanted.panel}: area and arm are needed, as '13m2 1.35m'")
    size, arm = PANEL(match[1]), ARM(match[2])
    return size, [0.0, -arm, 0.0], "given: one panel, on -y, which follows the Sun"


def _stop(
    orbit: Mapping[str, Any], dump: Mapping[str, Any] | None, area: float, centre: list[float]
) -> float:  # fmt: skip
    """How long a scenario lasts (s): a day, ten orbits of a slow one, or until there have been
    DUMPS dumps of what light alone leaves; all wheels of a pyramid hold 1.7 times what one does."""
    days = 1.0 if orbit["period"] < SLOW else math.ceil(10.0 * orbit["period"] / 86400.0)
    if dump is not None and dump["by"] == "thrusters":
        torque = SUNLIGHT * area * math.hypot(*centre)
        days = max(days, math.ceil(DUMPS * 1.7 * dump["room"] / max(torque, 1e-12) / 86400.0))
    return 86400.0 * min(days, MOST_DAYS if orbit["period"] >= SLOW else MOST_DAYS / 50.0)


def _dump(
    wanted: CraftFacts, wheels: Mapping[str, Any], thrusters: Mapping[str, str] | None, rods: bool,
    inertia: float, step: float,
) -> dict[str, Any] | None:  # fmt: skip
    """What dumps between thresholds are made with; None: a law that dumps all the time."""
    if wanted.dump is None:
        if not rods:
            raise DesatError("--rods none: --dump says what takes momentum out, as --dump "
                             "'thrusters 70:10'")  # fmt: skip
        return None
    match = re.fullmatch(r"\s*(\w+)\s+([\d.]+)\s*:\s*([\d.]+)\s*%?\s*", wanted.dump)
    if match is None or match[1] not in DUMPERS:
        raise DesatError(f"--dump {wanted.dump}: the form is thrusters BEGIN:END or coils "
                         "BEGIN:END, in % of a wheel's capacity, as 'thrusters 70:10'")  # fmt: skip
    begin, end = FILL(match[2]), FILL(match[3])
    if end >= begin:
        raise DesatError(
            f"--dump {wanted.dump}: it ends at {end:g} %, which is not below {begin:g} %"
        )
    if match[1] == "coils" and not rods:
        raise DesatError(f"--dump {wanted.dump}: --rods none leaves no coils")
    if match[1] == "thrusters" and thrusters is None:
        raise DesatError(f"--dump {wanted.dump}: --thrusters says which, as --thrusters '4 1N'")
    capacity = wheels["capacity_si"]
    torque, sample = 0.5 * wheels["torque_si"], 10.0
    why = "half of what the wheels give"
    if thrusters is not None and match[1] == "thrusters":
        if float(thrusters["torque_si"]) < torque:
            torque, why = float(thrusters["torque_si"]), "what a pair gives"
        room = 8.0 * inertia * DEVIATION
        sample = max(step, next((x for x in SAMPLES if torque * x * x <= room), 0.0))
        if torque * sample * sample > room:
            torque, why = room / sample**2, "no pulse turns the craft by more than 0.1 deg"
    return {"by": match[1], "percent": (f"{begin:g}", f"{end:g}"),
            "begin": _text(begin / 100.0 * capacity), "end": _text(end / 100.0 * capacity),
            "torque": _text(torque), "why": why, "sample": sample, "large": capacity >= 1.0,
            "room": (begin - end) / 100.0 * capacity}  # fmt: skip


def _holds(
    pointing: str, orbit: Mapping[str, Any], inertia: list[float], wheels: Mapping[str, Any],
    dipole: list[float],
) -> None:  # fmt: skip
    """Raises DesatError where the fullest wheel cannot hold what an orbit alone brings."""
    a, b, c = inertia
    momentum = cyclic.momentum(pointing == "nadir", orbit["rate"], orbit["inclination"],
                               (a, 0.0, 0.0, 0.0, b, 0.0, 0.0, 0.0, c), dipole)  # fmt: skip
    needs, has = cyclic.fullest(np.array(wheels["axes_si"]), momentum), wheels["capacity_si"]
    if needs > has:
        raise DesatError(
            f"--wheels: {cyclic.shortfall(needs, has)}: take at least "
            f"{1.3 * needs * 1e3:.2g} mN m s, "
            "or a smaller --residual-dipole"
        )


def _hours(text: str) -> float:
    match = re.fullmatch(r"(\d{1,2}):(\d{2})", text)
    if match is None or int(match[1]) > 23 or int(match[2]) > 59:
        raise DesatError(f"--ltan {text}: a time of day is needed, as 10:30")
    return int(match[1]) + int(match[2]) / 60.0


def _of_file(file: Path) -> dict[str, float]:
    """The parameters of a file with two-line elements. Raises DesatError."""
    text = io.text(file, f"--tle {file}")
    lines = [x for x in text.splitlines() if x[:2] in ("1 ", "2 ")]
    if len(lines) != 2:
        raise DesatError(f"--tle {file}: two lines that begin with 1 and 2 are needed")
    try:
        return tle_parameters(lines[0], lines[1])
    except ValueError as error:  # BlockError is one
        raise DesatError(f"--tle {file}: {plain(str(error))}") from None


def _of_tle(file: Path, epoch: float) -> dict[str, Any]:
    """As `_orbit`. Raises DesatError for elements that SGP4 has no orbit of at the epoch."""
    values = _of_file(file)
    at, bstar, *others = (values[k] for k in (
        "epoch_tle_j2000", "bstar", "eccentricity", "argument_of_perigee", "inclination",
        "mean_anomaly", "mean_motion", "raan"))  # fmt: skip
    try:
        state = teme_state((at, bstar, *others), epoch - at)  # type: ignore[arg-type]
    except ValueError as error:
        raise DesatError(f"--tle {file}: {error}") from None
    if not all(math.isfinite(x) for part in state for x in part):
        raise DesatError(f"--tle {file}: no orbit has these elements")
    rows = [(name, repr(value), f"of {file.name}, SI") for name, value in values.items()
            if name != "epoch_j2000"]  # fmt: skip
    return {"rows": rows, "rate": values["mean_motion"], "inclination": values["inclination"],
            "tle": True, "period": 2.0 * math.pi / values["mean_motion"],
            "eccentricity": values["eccentricity"], "air": True}  # fmt: skip


def _wheels(wanted: CraftFacts, inertia: list[float]) -> dict[str, Any]:
    largest = max(inertia)
    # a class of its own: what turns it at 1 deg/s, thrice
    size = 3.0 * largest * math.radians(1.0)
    text = wanted.wheels or f"4 pyramid {max(size, 2e-3):.2g} N.m.s"
    match = re.fullmatch(r"\s*(\d)\s+(\w+)\s+(.+?)\s*", text)
    if match is None:
        raise DesatError(f"--wheels {text}: the form is COUNT LAYOUT SIZE, as 4 pyramid 30mNms")
    count, layout = int(match[1]), match[2]
    if layout not in LAYOUTS:
        raise DesatError(f"--wheels {text}: no layout {layout}{nearest(layout, LAYOUTS)}; there is "
                         f"{', '.join(LAYOUTS)}")  # fmt: skip
    if count != {"pyramid": 4, "axes": 3}[layout]:
        raise DesatError(f"--wheels {text}: {layout} has {4 if layout == 'pyramid' else 3} wheels")
    name, figures, capacity = _of_class(WHEELS, "wheels", "capacity", match[3])
    speed = quantity("--wheels", figures["speed"], "rad/s")
    share = capacity / quantity("--wheels", figures["capacity"], "N.m.s")
    torque = share * quantity("--wheels", figures["torque"], "N.m")
    s = 1.0 / math.sqrt(3.0)
    axes = [[s, -s, -s, s], [s, s, -s, -s], [s, s, s, s]] if count == 4 else [
        [1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]]  # fmt: skip
    rotor = capacity / speed
    viscous, coulomb = friction(torque, speed)
    held = "a pyramid along (+-1, +-1, 1)" if count == 4 else "one wheel along each axis"
    return {
        "axes_si": axes, "axes": ["[" + ", ".join(f"{x:.16g}" for x in row) + "]" for row in axes],
        "layout_why": held, "null": count == 4,
        "capacity": f"{capacity * 1e3:g} mN m s", "speed": figures["speed"], "class": name,
        "inertia": "[" + ", ".join([f"{rotor:.9g}"] * count + ["0.0"] * (4 - count)) + "]",
        "torque": f"{torque * 1e3:.4g} mN.m", "torque_si": torque, "capacity_si": capacity,
        "why": f"class: {name}" + ("" if abs(share - 1.0) < 1e-9 else f" times {share:.3g}"),
        "viscous": f"{viscous:.3g}", "coulomb": f"{coulomb:.3g}",
        "lag": WHEEL_LAG, "compensation": COMPENSATION,
        "noise": f"{1e-3 * capacity:.3g}",
        "half": _list([0.5 * capacity * (i < count) for i in range(4)]),
    }  # fmt: skip


def _rods(wanted: CraftFacts, mass: float) -> dict[str, str] | None:
    if wanted.rods == "none":
        return None
    text = wanted.rods or f"{0.02 * mass:.2g}"
    name, figures, dipole = _of_class(RODS, "rods", "dipole", text)
    why = "given" if wanted.rods else "class: 20 mA m2 a kilogram"
    return {"dipole": f"{dipole:g} A.m2", "lag": figures["lag"], "why": f"{why}; lag as {name}"}


def _gyro() -> dict[str, str]:
    """Its angle random walk: the angle after 1 s (deg), and after 1 h, as its class has it."""
    figures = classes()["gyros"]["mems"]
    return {"in_1_s": _text(math.degrees(walk(figures))), "in_1_h": figures["walk"]}


def _thrusters(wanted: CraftFacts, sides: tuple[float, float, float]) -> Mapping[str, str] | None:
    if wanted.thrusters is None:
        return None
    match = re.fullmatch(r"\s*(?:4\s+)?([^\s].*?)\s*", wanted.thrusters)
    if match is None or re.match(r"\d+\s+\d", match[1]):
        raise DesatError(f"--thrusters {wanted.thrusters}: the form is 4 SIZE, as 4 1N: pairs both "
                         "ways about each axis")  # fmt: skip
    name, figures, force = _of_class(THRUSTERS, "thrusters", "force", match[1])
    arm = max(sides) / 2.0
    return {"torque": _list([2.0 * force * arm] * 3), "force": f"{force:g} N", "arm": _text(arm),
            "torque_si": _text(2.0 * force * arm),
            "impulse": figures["impulse"], "pulse": figures["pulse"], "class": name}  # fmt: skip
