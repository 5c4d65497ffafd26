"""Compute the orbit of a new craft from the facts that its owner knows.

It is circular or Sun-synchronous, given by the heights of its ends or by name, by
two-line elements, or an orbit about the Sun.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

from desat.components.blocks import environment_planet
from desat.components.blocks.environment_sun import SUN_MU
from desat.components.contract.block import Vec3
from desat.components.physics import earth
from desat.components.physics.orbit import (
    EARTH_RADIUS,
    MU,
    ellipse_state,
    mean_motion,
    perifocal_axes,
    sun_synchronous_inclination,
)
from desat.components.physics.tle import teme_state, tle_parameters

from ..files import io
from ..system.errors import DesatError, choices, plain
from ..system.model import J2000
from ..system.quantity import Quantity
from .facts import CraftFacts
from .two_line import check_layout

ALTITUDES = 150.0, 300_000.0  # km, of a circular orbit
FARTHEST = 400_000.0  # km: highest apogee; beyond it is no orbit about the Earth alone
MOST_ECCENTRIC = 0.95  # as environment_kepler has it
AIR = 1000.0  # km: there is no air from this perigee on
# Heights of perigee and apogee, inclination and argument of perigee (deg), and their
# origin, by name.
ORBITS = {
    "geo": ("35786.03x35786.03km", 0.05, 0.0, "geostationary; class: 0.05 deg"),
    "gto": ("250x35786km", 6.0, 178.0, "class: from Kourou"),
    "molniya": ("504x39863km", 63.4349, 270.0, "class: its perigee stays in the south"),
}
INCLINATION = Quantity("--inclination", "deg", 0.0, 180.0, bare=False)
HIGHEST_AIR = 2e6  # m: height of a circular orbit up to which air is modelled
# An orbit about the Moon or Mars, and the heights (km) that are taken
_PLANET = re.compile(r"\s*(moon|mars)\s+([\d.]+)(?:\s*x\s*([\d.]+))?\s*km\s*", re.I)
PLANET_ENDS = 10.0, 100_000.0
# Distance from the Sun (AU) of places where the craft moves with the Earth.
PLACES = {"l1": 0.99, "l2": 1.01}
DISTANCES = 0.1, 40.0  # astronomical units from the Sun
YEARS = 1957, 2056  # of an epoch: years that two-line elements can express


@dataclass(frozen=True)
class Orbit:
    """Orbit of a new craft, from which other figures follow."""

    block: str  # environment that has this orbit
    # parameters of the environment: name, value as written, origin
    rows: tuple[tuple[str, str, str], ...]
    rate: float  # rad/s, mean motion
    inclination: float  # rad
    eccentricity: float
    state: tuple[Vec3, Vec3]  # position (m) and velocity (m/s) at t = 0, eci
    sun: Vec3  # unit vector to the Sun at t = 0, eci
    light: float = 1.0  # sunlight over that at 1 astronomical unit
    air: bool = True
    mu: float = MU  # m3/s2, of what it is about

    @property
    def period(self) -> float:
        """Return the period (s)."""
        return 2.0 * math.pi / self.rate

    @property
    def of_earth(self) -> bool:
        """Return whether it is about the Earth, with its field and air."""
        return self.block not in ("environment_sun", "environment_planet")

    @property
    def has_centre(self) -> bool:
        """Return whether there are a nadir, a shadow and a gravity gradient."""
        return self.block != "environment_sun"

    @property
    def of_tle(self) -> bool:
        """Return whether it is given by two-line elements."""
        return self.block == "environment_tle"


def epoch_of(facts: CraftFacts) -> datetime:
    """Return the epoch of t = 0: as given, else of the two-line elements, to a second.

    Raises
    ------
    DesatError
        If it is no time, or out of range.
    """
    of_tle = None if facts.tle is None else _of_file(facts.tle)["epoch_tle_j2000"]
    if facts.epoch is None:
        if of_tle is None:
            return datetime(2027, 1, 1, tzinfo=UTC)
        return J2000 + timedelta(seconds=round(of_tle))
    try:
        epoch = datetime.fromisoformat(facts.epoch)
    except ValueError:
        raise DesatError(
            f"--epoch {facts.epoch}: a time is needed, as 2027-01-01T00:00:00Z"
        ) from None
    epoch = epoch if epoch.tzinfo else epoch.replace(tzinfo=UTC)
    if not YEARS[0] <= epoch.year <= YEARS[1]:
        raise DesatError(
            f"--epoch {facts.epoch}: a year from {YEARS[0]} to {YEARS[1]} is needed"
        )
    return epoch


def orbit_of(facts: CraftFacts, epoch: float) -> Orbit:
    """Return the orbit of a craft at an epoch (s since J2000).

    Raises
    ------
    DesatError
        If the options contradict each other or one is invalid.
    """
    options = {
        "--altitude": facts.altitude,
        "--sso": facts.sso,
        "--tle": facts.tle,
        "--orbit": facts.orbit,
        "--sun": facts.sun,
    }
    names = [name for name, value in options.items() if value is not None]
    if len(names) > 1:
        raise DesatError(
            f"{names[0]}, {names[1]}: only one of them may define the orbit"
        )
    if facts.tle is not None or facts.sun is not None:
        first = f"{names[0]} {options[names[0]]} says the orbit"
        for option, value in (
            ("--inclination", facts.inclination),
            ("--ltan", facts.ltan),
        ):
            if value is not None:
                raise DesatError(f"{option} {value}: {first}")
    if facts.ltan is not None and facts.sso is None and names:
        raise DesatError(
            f"--ltan {facts.ltan}: only with a Sun-synchronous orbit (--sso)"
        )
    if facts.tle is not None:
        return _of_tle(facts.tle, epoch)
    if facts.sun is not None:
        return _about_the_sun(facts.sun)
    if facts.orbit is not None and (match := _PLANET.fullmatch(facts.orbit)):
        return _about_a_planet(match, facts, epoch)
    if facts.orbit is not None:
        return _of_ends(facts.orbit, facts.inclination, epoch)
    return _circular(facts, (names or ["--altitude"])[0], epoch)


def _circular(facts: CraftFacts, option: str, epoch: float) -> Orbit:
    """Return a circular or Sun-synchronous orbit at an epoch (s since J2000)."""
    text = facts.sso or facts.altitude or "500 km"
    height = Quantity(option, "km", *ALTITUDES, bare=False)(text) * 1e3
    axis, raan, raan_why = EARTH_RADIUS + height, 0.0, "class"
    if facts.altitude is not None and facts.sso is None:
        inclination = math.radians(INCLINATION(facts.inclination or "51.6deg"))
        origin = "given" if facts.inclination else "class: that of the ISS"
    else:
        if facts.inclination is not None:
            raise DesatError(
                f"--inclination {facts.inclination}: --altitude is needed with it; a "
                "Sun-synchronous orbit has its own"
            )
        inclination, origin = sun_synchronous_inclination(axis), "Sun-synchronous"
        hours = _hours(facts.ltan or "10:30")
        raan = earth.raan_of_local_time(hours, epoch)
        raan_why = f"ascending node at {facts.ltan or '10:30, class'} local time"
    air = height < 1e3 * AIR or height <= HIGHEST_AIR
    rows = (
        (
            "semi_major_axis",
            f'"{axis / 1e3:.9g} km"',
            f"{height / 1e3:g} km above 6378.137 km",
        ),
        ("inclination", f'"{math.degrees(inclination):.6g} deg"', origin),
        ("raan", f'"{math.degrees(raan):.6g} deg"', raan_why),
        ("j2", "true", "its node and perigee drift"),
        (
            "atmosphere",
            '"activity"' if air else '"none"',
            "by solar activity: moderate" if air else "there is none so high",
        ),
    )
    return _kepler(rows, axis, 0.0, inclination, raan, 0.0, epoch, air)


def _kepler(
    rows: tuple[tuple[str, str, str], ...],
    axis: float,
    eccentricity: float,
    inclination: float,
    raan: float,
    perigee: float,
    epoch: float,
    air: bool = True,
) -> Orbit:
    """Return an orbit of `environment_kepler`, at perigee at the epoch.

    `axis` is in m, angles in rad, `epoch` in s since J2000.
    """
    to, ahead = perifocal_axes(inclination, raan, perigee)
    rate = mean_motion(axis)
    state = ellipse_state(axis, eccentricity, 0.0, rate, to, ahead)
    return Orbit(
        "environment_kepler",
        rows,
        rate,
        inclination,
        eccentricity,
        state,
        earth.sun(epoch)[0],
        air=air,
    )


def _of_ends(text: str, name: str | None, epoch: float) -> Orbit:
    """Return an orbit given by its name, or by the heights of perigee and apogee."""
    ends, inclination, perigee, origin = ORBITS.get(
        text.strip().lower(), (text, 51.6, 0.0, "class")
    )
    match = re.fullmatch(r"\s*([\d.]+)\s*x\s*([\d.]+)\s*km\s*", ends)
    if match is None:
        raise DesatError(
            f"--orbit {text}: no such orbit"
            f"{choices(text, ORBITS, ', or heights of perigee and apogee, as 500x39860km')}"
        )
    low, high = sorted(
        Quantity("--orbit", "km", ALTITUDES[0], FARTHEST)(f"{height} km")
        for height in match.groups()
    )
    if name is not None:
        inclination, origin = INCLINATION(name), "given"
    near, far = (EARTH_RADIUS + 1e3 * height for height in (low, high))
    axis, eccentricity = (near + far) / 2.0, (far - near) / (far + near)
    if eccentricity > MOST_ECCENTRIC:
        most = near * (1.0 + MOST_ECCENTRIC) / (1.0 - MOST_ECCENTRIC) - EARTH_RADIUS
        raise DesatError(
            f"--orbit {text}: an eccentricity of {eccentricity:.3g}; the environment has up to "
            f"{MOST_ECCENTRIC:g}, an apogee of {most / 1e3:.0f} km over this perigee"
        )
    air = low < AIR
    rows = (
        (
            "semi_major_axis",
            f'"{axis / 1e3:.9g} km"',
            f"{low:g} x {high:g} km above 6378.137 km",
        ),
        ("eccentricity", f"{eccentricity:.9g}", "by these heights"),
        ("inclination", f'"{inclination:.6g} deg"', origin),
        ("argument_of_perigee", f'"{perigee:g} deg"', origin),
        ("j2", "true", "its node and perigee drift"),
        (
            "atmosphere",
            '"activity"' if air else '"none"',
            "by solar activity: moderate" if air else "there is none so high",
        ),
    )
    return _kepler(
        rows,
        axis,
        eccentricity,
        math.radians(inclination),
        0.0,
        math.radians(perigee),
        epoch,
        air,
    )


def _about_the_sun(text: str) -> Orbit:
    """Return a circular orbit about the Sun in the ecliptic, at a distance."""
    match = re.fullmatch(r"\s*([\d.]+)\s*(?:AU|au)\s*", text)
    place = PLACES.get(text.strip().lower())
    if match is None and place is None:
        raise DesatError(
            f"--sun {text}: a distance in astronomical units is needed, as 1.52AU, or L1, L2"
        )
    distance = place or Quantity("--sun", "1", *DISTANCES)(match[1] if match else "")
    axis = distance * earth.ASTRONOMICAL_UNIT
    rate = mean_motion(axis, SUN_MU)
    s, c = math.sin(earth.OBLIQUITY), math.cos(earth.OBLIQUITY)
    state = (axis, 0.0, 0.0), (0.0, axis * rate * c, axis * rate * s)
    rows = (
        (
            "semi_major_axis",
            f'"{axis / 1e3:.9g} km"',
            f"{distance:g} astronomical units"
            + ("" if place is None else f": {text.strip().upper()} of Sun and Earth"),
        ),
    )
    return Orbit(
        "environment_sun",
        rows,
        rate,
        0.0,
        0.0,
        state,
        (-1.0, 0.0, 0.0),
        1.0 / distance**2,
        False,
    )


def _about_a_planet(match: re.Match[str], facts: CraftFacts, epoch: float) -> Orbit:
    """Return an orbit about the Moon or Mars, given by heights of its ends."""
    name = match[1].lower()
    mu, radius, *_ = environment_planet.BODIES[("moon", "mars").index(name)]
    form = Quantity(f"--orbit {name}", "km", *PLANET_ENDS)
    low, high = sorted(form(f"{x} km") for x in (match[2], match[3] or match[2]))
    near, far = (radius + 1e3 * height for height in (low, high))
    axis, eccentricity = (near + far) / 2.0, (far - near) / (far + near)
    degrees = 90.0 if facts.inclination is None else INCLINATION(facts.inclination)
    origin = "class: polar" if facts.inclination is None else "given"
    rows = (
        (
            "semi_major_axis",
            f'"{axis / 1e3:.9g} km"',
            f"{low:g} x {high:g} km above {radius / 1e3:g} km",
        ),
        ("body", f'"{name}"', "about what it orbits"),
        ("eccentricity", f"{eccentricity:.9g}", "by these heights"),
        ("inclination", f'"{degrees:.6g} deg"', f"to its equator; {origin}"),
        ("j2", "true", "its node and periapsis drift"),
    )
    block = environment_planet.EnvironmentPlanet()
    block.body, block.epoch_j2000 = ("moon", "mars").index(name), epoch
    block.semi_major_axis, block.eccentricity = axis, eccentricity
    block.inclination = math.radians(degrees)
    block.check()
    block.start()
    block.output(0.0)
    return Orbit(
        "environment_planet",
        rows,
        mean_motion(axis, mu),
        block.inclination,
        eccentricity,
        (block.r_eci, block.v_eci),
        block.sun_eci,
        block.sunlight or 1.0,
        False,
        mu,
    )


def _hours(text: str) -> float:
    """Parse a local time to hours."""
    match = re.fullmatch(r"(\d{1,2}):(\d{2})", text)
    if match is None or int(match[1]) > 23 or int(match[2]) > 59:
        raise DesatError(f"--ltan {text}: a time of day is needed, as 10:30")
    return int(match[1]) + int(match[2]) / 60.0


def _of_file(file: Path) -> dict[str, float]:
    """Read the parameters of a file with two-line elements.

    Raises DesatError if it is no such file.
    """
    text = io.text(file, f"--tle {file}")
    lines = [x for x in text.splitlines() if x[:2] in ("1 ", "2 ")]
    if len(lines) != 2:
        raise DesatError(f"--tle {file}: two lines that begin with 1 and 2 are needed")
    check_layout(lines, f"--tle {file}")
    try:
        return tle_parameters(lines[0], lines[1])
    except ValueError as error:  # BlockError is one
        raise DesatError(f"--tle {file}: {plain(str(error))}") from None


def _of_tle(file: Path, epoch: float) -> Orbit:
    """Return the orbit of two-line elements at an epoch (s since J2000).

    Raises DesatError for elements of which SGP4 has no orbit at the epoch.
    """
    values = _of_file(file)
    at, bstar, *others = (
        values[k]
        for k in (
            "epoch_tle_j2000",
            "bstar",
            "eccentricity",
            "argument_of_perigee",
            "inclination",
            "mean_anomaly",
            "mean_motion",
            "raan",
        )
    )
    try:
        state = teme_state((at, bstar, *others), epoch - at)  # type: ignore[arg-type]
    except ValueError as error:
        raise DesatError(f"--tle {file}: {error}") from None
    if not all(math.isfinite(x) for part in state for x in part):
        raise DesatError(f"--tle {file}: no orbit has these elements")
    rows = tuple(
        (name, repr(value), f"of {file.name}, SI")
        for name, value in values.items()
        if name != "epoch_j2000"
    )
    return Orbit(
        "environment_tle",
        rows,
        values["mean_motion"],
        values["inclination"],
        values["eccentricity"],
        state,
        earth.sun(epoch)[0],
    )
