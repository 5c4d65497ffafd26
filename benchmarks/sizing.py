"""`make sizing`: what `desat size` says, held against closed loops and others:
docs/sizing.md.

- Ten crafts that nobody chose (`drawn`: mass, box, orbit, attitude, dipole, surfaces, wheels and
  law by a seed): the model beside the closed loop at sizes of rods above 1.15 times the least.
- Thirty crafts of `desat new craft`: what is recommended, accepted and flown in their worst
  scenario, and B-dot's gain beside a sweep.
- The five papers' crafts: what it says beside what the paper chose.
- Two crafts whose secular torque is estimated anew (`estimated`): another orbit, another field
  (ppigrf), torques written down from the textbook, none of our code.
- The linear programme against its dual, by another solver.
- How long it takes.
"""

from __future__ import annotations

import argparse
import math
import random
import resource
import tempfile
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from math import inf, log10, pi, sqrt
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.progress import track

from desat.analyses import flight as flights
from desat.analyses.flight import secular
from desat.analyses.management import is_braking
from desat.begin import craft as new_craft
from desat.begin.body import CUBESATS
from desat.begin.facts import CraftFacts
from desat.numbers.text import number
from desat.runs.prepare import prepare, read
from desat.runs.run import execute
from desat.sizing import map as sizing_map
from desat.sizing import page as sizing_page
from desat.sizing import sizing
from desat.sizing.compatibility import ALL
from desat.sizing.law import law_of
from desat.sizing.least_rod import (
    PROGRAMME_TIMES,
    least_by_formula,
    least_by_programme,
    reach,
)
from desat.sizing.model import fly, track_of
from desat.sizing.requirements import SizingRequirements
from desat.sizing.result import Sizing
from desat.sizing.rods import SizingPoint, in_the_loop
from desat.sizing.scenarios import WORST, fly_case
from desat.studies import criteria, ranking
from desat.system.options import Options

Array = NDArray[Any]
DOCS = Path(__file__).parent.parent / "docs"
BASE = "nadir_day/day-igrf"
MULTIPLES = (1.2, 1.6, 2.5, 5.0)
"""Of the least rod, in the closed loop beside the model."""
BAR = 0.05
ENOUGH = 8
PAPERS = (
    (
        "uosat12/flight-dct-3",
        86400.0,
        "000",
        "three rods of 40 A m2, wheels of 4.2 N m s",
    ),
    (
        "space_telescope/closed-me-nominal",
        None,
        "001",
        "four coils of 4000 A m2, four wheels",
    ),
    ("alsat1/ours-case-a", 86400.0, "002", "three coils of 3.6 A m2 and a boom"),
    ("hausat2/start-up-ours", 86400.0, "003", "three coils of 2 A m2, one wheel"),
    (
        "integrated/mil-cross-product",
        86400.0,
        "004",
        "three coils of 0.3 A m2, 20 mN m s a wheel",
    ),
)
"""Scenario, how long it flies (s), paper, what it has."""
LAWS = ("normalised", "ccpl", "manager_closed_loop", "manager_magnetic_ilqr")


@dataclass(frozen=True)
class Craft:
    """A craft on the ground of `nadir_day`: a box with its hardware, in SI units."""

    name: str
    mass: float
    box: tuple[float, float, float]
    altitude: float
    inclination: float
    raan: float
    dipole: tuple[float, float, float]
    centre: tuple[float, float, float]
    """of drag and radiation from the centre of mass, body"""
    capacity: float
    """of each wheel, N m s"""
    rods: float
    products: tuple[float, float, float]
    """xy, xz, yz of the inertia, shares of its mean moment"""
    law: str = "normalised"
    rate: float = 1e-3
    """1/s, at which momentum across the field decays"""
    inertial: bool = False

    def inertia(self) -> Array:
        """(3, 3) kg m2."""
        x, y, z = self.box
        j = self.mass / 12.0 * np.diag([y * y + z * z, x * x + z * z, x * x + y * y])
        xy, xz, yz = np.array(self.products) * np.trace(j) / 3.0
        return np.asarray(j + np.array([[0.0, xy, xz], [xy, 0.0, yz], [xz, yz, 0.0]]))

    def area(self) -> float:
        """m2, of its largest side."""
        _, y, z = sorted(self.box)
        return y * z

    def options(self, stop: float | None = None) -> Options:
        """The options that make `nadir_day` this craft."""
        scale = float(np.trace(self.inertia())) / 26.0  # of nadir_day's own
        law = {"normalised": "normalised", "ccpl": "ccpl"}.get(self.law)
        values: dict[str, Any] = {
            "shared.inertia": self.inertia(),
            "shared.inertia_wheel": [self.capacity / 600.0] * 4,
            "environment.semi_major_axis": 6378137.0 + self.altitude,
            "environment.inclination": self.inclination,
            "environment.raan": self.raan,
            "spacecraft.residual_dipole_body": self.dipole,
            "spacecraft.omega_start_body": [0.0] * 3,
            "spacecraft.area_drag": self.area(),
            "spacecraft.area_radiation": 1.5 * self.area(),
            "spacecraft.centre_drag_body": self.centre,
            "spacecraft.centre_radiation_body": self.centre,
            "wheels.h_start_wheel": [0.0] * 4,
            "wheels.torque_limit": 5e-3 * scale,
            "controller.torque_limit": 5e-3 * scale,
            "wheels.coulomb": 2e-5 * scale,
            "wheels.viscous": 1e-7 * scale,
            "tachometers.noise": 1e-4 * self.capacity / 0.38,
            "torquers.m_limit": self.rods,
        }
        sources = []
        if law is None:
            sources.append(f"manager={self.law}")
        if law is not None:
            values |= {"manager.law": law}
            values |= {"manager.gain": self.rate / (3.3e-5 if law == "ccpl" else 1.0)}
        elif self.law == "manager_closed_loop":
            values |= {"manager.gain": self.rate}
        else:
            values |= {"manager.momentum_weight": [(self.rate / 3.3e-5) ** 2] * 3}
        if self.inertial:
            sources.append("guidance=guidance_inertial")
            values |= {
                "guidance.q_target_bi": [0.1, 0.3, -0.2, 0.9273618],
                "spacecraft.start_frame": "eci",
                "spacecraft.q_start_bi": [0.1, 0.3, -0.2, 0.9273618],
            }
        return Options(
            sets=[f"{k}={_text(v)}" for k, v in values.items()],
            sources=sources,
            stop=stop,
        )


def _text(value: Any) -> str:
    if isinstance(value, str):
        return value
    return ",".join(f"{x:.12g}" for x in np.ravel(value))


TWELVE = Craft(
    "12U",
    20.0,
    (0.23, 0.23, 0.36),
    400e3,
    0.9006,
    1.0,
    (0.03, -0.03, 0.026),
    (0.005, 0.005, 0.02),
    0.03,
    0.2,
    (0.02, -0.015, 0.01),
)
AGILE = Craft(
    "150 kg",
    150.0,
    (0.6, 0.6, 0.9),
    600e3,
    1.7066,
    3.3,
    (0.2, -0.15, 0.1),
    (0.02, 0.01, 0.05),
    4.0,
    30.0,
    (0.015, -0.01, 0.02),
)


def drawn(count: int, seed: int = 27) -> list[Craft]:
    """Crafts by a seed."""
    rng = np.random.default_rng(seed)
    crafts = []
    for k in range(count):
        mass = float(np.exp(rng.uniform(np.log(6.0), np.log(400.0))))
        side = (mass / 300.0) ** (1.0 / 3.0)
        x, y, z = side * rng.uniform(0.7, 1.5, 3)
        dipole = rng.normal(size=3)
        dipole *= 2.5e-3 * mass * rng.uniform(0.3, 1.5) / np.linalg.norm(dipole)
        a, b, c = rng.uniform(-0.05, 0.05, 3) * side
        p, q, r = rng.uniform(-0.03, 0.03, 3)
        crafts.append(
            Craft(
                f"craft {k + 1}",
                mass,
                (float(x), float(y), float(z)),
                float(rng.uniform(420e3, 800e3)),
                float(rng.uniform(0.5, 1.75)),
                float(rng.uniform(0.0, 2.0 * pi)),
                tuple(dipole.tolist()),
                (a, b, c),
                2e-3 * mass,
                0.02 * mass,
                (p, q, r),
                LAWS[k % len(LAWS)],
                float(np.exp(rng.uniform(np.log(3e-4), np.log(2e-3)))),
                bool(k % 5 == 4),
            )
        )
    return crafts


@dataclass(frozen=True)
class Row:
    """A craft with rods of one size: the model over the closed loop, less 1, and the
    duties."""

    multiple: float
    rms: float
    largest: float
    duty: float
    loop_duty: float


def compare_model_with_loop(
    craft: Craft, multiples: Sequence[float], stop: float | None
) -> tuple[float, list[Row]]:
    """The least rod (A m2), and the model beside the closed loop at multiples of it."""
    options = craft.options(stop)
    source = read(BASE)
    case = prepare(source, options)
    system, _ = case.or_raise()
    hardware, flight = flights.hardware_of(system), fly_case(case, system)
    torque, _ = secular(flight)
    least = least_by_programme(reach(flight, hardware), torque)
    law = law_of(system.components["manager"])
    rods = [k * least for k in multiples]
    model_map = fly([track_of(flight, law, hardware)], law, hardware, rods)
    rows = []
    for k, rod in enumerate(rods):
        model = SizingPoint(law.name, rod, multiples[k], None, None, None, None)
        loop_point = in_the_loop(model, source, options, system)
        assert loop_point.loop_duty is not None
        rows.append(
            Row(
                multiples[k],
                float(model_map.rms[0, 0, k] / (loop_point.loop_rms or inf)) - 1.0,
                float(model_map.largest[0, 0, k] / (loop_point.loop_largest or inf))
                - 1.0,
                float(model_map.duty[0, 0, k]),
                loop_point.loop_duty,
            )
        )
    return least, rows


def held(rows: Sequence[Row]) -> bool:
    """Whether the estimate is within the bar at each size of rods."""
    return all(abs(r.rms) <= BAR and abs(r.largest) <= BAR for r in rows)


# --- an estimate that uses nothing of ours --------------------------------------------


def estimated(craft: Craft) -> Array:
    """The secular torque (3,) N m, eci, of a craft that points to nadir, over whole
    orbits of a day from 2026-01-01 on: a circular orbit whose node J2 turns, IGRF by
    ppigrf, Vallado's air."""
    import ppigrf  # of the tests

    mu, radius, turn = 3.986004418e14, 6378137.0, 7.292115e-5
    a = radius + craft.altitude
    n = sqrt(mu / a**3)
    drift = -1.5 * 1.0826e-3 * n * (radius / a) ** 2 * np.cos(craft.inclination)
    k = (
        0.75
        * n
        * 1.0826e-3
        * (radius / a) ** 2
        * (3.0 * np.cos(craft.inclination) ** 2 - 1.0)
    )
    w = (
        0.75
        * n
        * 1.0826e-3
        * (radius / a) ** 2
        * (5.0 * np.cos(craft.inclination) ** 2 - 1.0)
    )
    period = 2.0 * pi / n
    span = period * int(86400.0 / period)
    t = np.linspace(0.0, span, 3000, endpoint=False)
    u, node = (n + k + w) * t, craft.raan + drift * t
    ci, si = np.cos(craft.inclination), np.sin(craft.inclination)
    up = np.stack(
        [
            np.cos(node) * np.cos(u) - np.sin(node) * np.sin(u) * ci,
            np.sin(node) * np.cos(u) + np.cos(node) * np.sin(u) * ci,
            np.sin(u) * si,
        ],
        axis=1,
    )
    normal = np.stack(
        [np.sin(node) * si, -np.cos(node) * si, np.full_like(t, ci)], axis=1
    )
    along = np.cross(normal, up)
    axes = np.stack([along, -normal, -up], axis=2)  # body to eci, at nadir

    # the field, in a frame that turns with the Earth
    sidereal = (
        np.radians(100.4606184 + 0.9856473662862 * 9496.5) + turn * t
    )  # 2026-01-01 0 h
    c, s = np.cos(sidereal), np.sin(sidereal)
    x, y, z = c * up[:, 0] + s * up[:, 1], c * up[:, 1] - s * up[:, 0], up[:, 2]
    theta, phi = np.arccos(z), np.arctan2(y, x)
    br, bt, bp = (
        np.ravel(v) * 1e-9
        for v in ppigrf.igrf_gc(
            a / 1e3, np.degrees(theta), np.degrees(phi), datetime(2026, 1, 1)
        )
    )
    south = np.stack(
        [np.cos(theta) * np.cos(phi), np.cos(theta) * np.sin(phi), -np.sin(theta)]
    )
    east = np.stack([-np.sin(phi), np.cos(phi), np.zeros_like(phi)])
    fixed = br * np.stack([x, y, z]) + bt * south + bp * east
    b = np.stack(
        [c * fixed[0] - s * fixed[1], s * fixed[0] + c * fixed[1], fixed[2]], axis=1
    )

    # torques, eci
    down = np.array([0.0, 0.0, 1.0])
    gravity = 3.0 * mu / a**3 * np.cross(down, craft.inertia() @ down)
    flat = (1.0 - 1.0 / 298.257) / np.sqrt(
        1.0 - (1.0 - (1.0 - 1.0 / 298.257) ** 2) * (1.0 - up[:, 2] ** 2)
    )
    height = a - radius * flat
    table = np.array(
        [
            (350e3, 9.518e-12, 53298.0),
            (400e3, 3.725e-12, 58515.0),
            (450e3, 1.585e-12, 60828.0),
            (500e3, 6.967e-13, 63822.0),
            (600e3, 1.454e-13, 71835.0),
            (700e3, 3.614e-14, 88667.0),
        ]
    )
    row = table[np.searchsorted(table[:, 0], height) - 1]
    density = row[:, 1] * np.exp((row[:, 0] - height) / row[:, 2])
    wind = n * a * along - np.cross([0.0, 0.0, turn], a * up)
    arms = axes @ np.array(craft.centre)
    force = (
        -0.5
        * 2.2
        * craft.area()
        * (density * np.linalg.norm(wind, axis=1))[:, None]
        * wind
    )
    day = 9496.5 + t / 86400.0
    g = np.radians(357.528 + 0.9856003 * day)
    lon = np.radians(
        280.460 + 0.9856474 * day + 1.915 * np.sin(g) + 0.02 * np.sin(2.0 * g)
    )
    tilt = np.radians(23.439)
    sun = np.stack(
        [np.cos(lon), np.cos(tilt) * np.sin(lon), np.sin(tilt) * np.sin(lon)], axis=1
    )
    toward = (sun * up).sum(axis=1)
    dark = (toward < 0.0) & (a * np.sqrt(1.0 - toward**2) < radius)
    push = (
        -4.56e-6 * 1.033 * 1.5 * craft.area() * (~dark)[:, None] * sun
    )  # 1.033: near perihelion
    total = (
        axes @ gravity
        + np.cross(axes @ np.array(craft.dipole), b)
        + np.cross(arms, force + push)
    )
    return np.asarray(total.mean(axis=0))


# --- all of it ------------------------------------------------------------------------


def unseen(count: int) -> Iterator[dict[str, Any]]:
    """The crafts by the seed, each beside its closed loops."""
    for craft in track(drawn(count), "unseen crafts"):
        least, rows = compare_model_with_loop(craft, MULTIPLES, None)
        yield {"craft": craft, "least": least, "rows": rows, "held": held(rows)}


def dual(craft: Craft) -> tuple[float, float, float]:
    """The least rod (A m2) of a craft by the formula, by the linear programme, and by
    its dual, which is convex in two unknowns: Nelder and Mead's method."""
    from scipy.optimize import minimize

    case = prepare(BASE, craft.options())
    system, _ = case.or_raise()
    hardware, flight = flights.hardware_of(system), fly_case(case, system)
    torque, _ = secular(flight)
    able = reach(flight, hardware)
    some = able[:: -(-len(able) // PROGRAMME_TIMES)].reshape(-1, 3)
    some = some / len(some) * hardware.axes_coil.shape[1]
    size = float(np.linalg.norm(torque))
    across = np.linalg.svd((torque / size)[None])[2][1:]
    scale = 1.0 / np.abs(some @ (torque / size)).sum()
    found = [
        minimize(
            lambda u: np.abs(some @ (torque / size + u @ across)).sum() * scale,
            start,
            method="Nelder-Mead",
            options={"xatol": 1e-12, "fatol": 1e-15, "maxiter": 20000},
        ).fun
        for start in ((0.0, 0.0), (0.5, -0.5))
    ]
    return (
        least_by_formula(able, torque),
        least_by_programme(able, torque),
        size * scale / min(found),
    )


def secular_of(craft: Craft) -> tuple[Array, float]:
    """The secular torque (3,) N m, eci, by `desat size`, and the angle (rad) of the
    attitude's wandering."""
    case = prepare(BASE, craft.options())
    system, _ = case.or_raise()
    flight = fly_case(case, system)
    return secular(flight)[0], flights.attitude_of(
        system, flight.q, flight.r, flight.v
    ).wanders


def chosen() -> Iterator[ranking.Ranking]:
    """The papers' crafts whose law holds their wheels, each flown with every law that
    fits it."""
    for name, stop, *_ in track(PAPERS, "papers' crafts, law by law"):
        system, _ = prepare(name, Options(stop=stop)).or_raise()
        if not is_braking(system.roles["manager"]):
            yield ranking.choose(name, Options(stop=stop), (), [ALL])


def papers() -> Iterator[tuple[tuple[Any, ...], Sizing]]:
    """The five papers' crafts through `desat size`."""
    for row in track(PAPERS, "papers"):
        yield row, sizing.size(row[0], Options(stop=row[1]), SizingRequirements())


def speed() -> dict[str, float]:
    """Seconds of a map of 600 crafts on two cores, of their work, and of one rod of the
    model."""
    begin, worked = time.perf_counter(), _worked()
    craft_map = sizing_map.map_of(
        BASE, TWELVE.options(20000.0), sizing_map.MapAxes(), SizingRequirements(), 2
    )
    elapsed, work = time.perf_counter() - begin, _worked() - worked
    (DOCS / "sizing.svg").write_text(
        sizing_page.heat_map(craft_map, 0).svg() + "\n", encoding="utf-8"
    )
    case = prepare(BASE, TWELVE.options())
    system, _ = case.or_raise()
    hardware, flight = flights.hardware_of(system), fly_case(case, system)
    law = law_of(system.components["manager"])
    times = {}
    for count in (1, 60, 600):
        begin = time.perf_counter()
        fly(
            [track_of(flight, law, hardware)],
            law,
            hardware,
            np.geomspace(0.01, 1.0, count).tolist(),
        )
        times[str(count)] = time.perf_counter() - begin
    return {"map": elapsed, "work": work, **times}


def _worked() -> float:
    """Seconds of CPU of this process and of those that it has ended."""
    return sum(
        u.ru_utime + u.ru_stime
        for u in map(
            resource.getrusage, (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
        )
    )


# --- crafts of `desat new craft`: what is recommended, and how they are braked --------


@dataclass(frozen=True)
class DrawnCraft:
    """A craft of `desat new craft`, drawn by a seed, and what became of what `size`
    said of it."""

    facts: CraftFacts
    rod: float
    """its own, A m2"""
    least: float
    """for any law on the worst day, A m2"""
    recommended: float | None
    accepted: list[str]
    """what `size` has against the recommended rods"""
    worst: list[str]
    """which requirements `worst.toml` misses with them"""
    refused: list[str]
    """what `size` has against 0.7 of the least rods"""


def draw_craft_facts(seed: int) -> CraftFacts:
    """1U to 200 kg, 350 to 900 km, Sun-synchronous or of any inclination, nadir or
    inertial."""
    draw = random.Random(seed)
    options: dict[str, str] = {}
    if draw.random() < 2.0 / 3.0:
        options["size"] = f"{draw.choice(tuple(CUBESATS))}U"
    else:
        mass = 10.0 ** draw.uniform(log10(30.0), log10(200.0))
        side = (mass / 250.0) ** (1.0 / 3.0)
        options["mass"] = f"{mass:.1f}kg"
        options["box"] = ",".join(
            f"{side * draw.uniform(0.7, 1.4):.3f}" for _ in range(3)
        )
    if draw.random() < 0.4:
        options["sso"] = f"{draw.uniform(400.0, 900.0):.3f}km"
    else:
        options["altitude"] = f"{draw.uniform(350.0, 900.0):.3f}km"
        options["inclination"] = f"{draw.uniform(5.0, 98.0):.2f}deg"
    if draw.random() < 0.3:
        options["pointing"] = "inertial"
    return CraftFacts(**options)  # type: ignore[arg-type]


def drawn_craft(seed: int, into: Path) -> DrawnCraft:
    """What `size` recommends for a drawn craft, tried."""
    folder, facts = into / f"craft{seed}", draw_craft_facts(seed)
    new_craft.write(folder, facts, "desat new craft")
    wishes = SizingRequirements(laws=False)

    def sized(rod: float) -> list[str]:
        options = Options(values={"torquers.m_limit": rod})
        return list(sizing.size(str(folder), options, wishes).problems)

    result = sizing.size(str(folder), Options(), wishes)
    least, rod = max(result.least, result.least_year), result.recommended
    accepted: list[str] = []
    worst: list[str] = []
    if rod is not None:
        accepted = sized(rod)
        recommended_rods = Options(values={"torquers.m_limit": rod})
        worst = execute(str(folder / WORST), recommended_rods).manifest.not_met
    return DrawnCraft(
        facts, result.rod, least, rod, accepted, worst, sized(0.7 * least)
    )


BRAKES = (0.003, 0.0045, 0.006, 0.0075, 0.009, 0.011, 0.014, 0.02, 0.03)
"""Gains of B-dot over the mean moment of inertia (1/s) that a sweep has."""


def braked(seed: int, into: Path) -> tuple[float, float]:
    """Time (h) in which a drawn craft is detumbled as `new craft` writes it, and the
    least of a sweep of gains."""
    folder = into / f"craft{seed}"
    if not folder.exists():
        new_craft.write(folder, draw_craft_facts(seed), "desat new craft")
    target = str(folder / "detumbling.toml")
    system, _ = prepare(target, Options()).or_raise()
    body = system.components["spacecraft"]
    mean = sum(body.values[f"inertia[{i},{i}]"] for i in (1, 2, 3)) / 3.0
    written_gain = system.components["manager"].values["gain"]

    def takes(gain: float) -> float:
        options = Options(
            values={"manager.gain": gain},
            stop=40000.0,
            record=("spacecraft.omega_bi_body",),
        )
        found = execute(target, options).manifest.numbers["detumbled"].value
        return inf if found is None else found

    own_time = takes(written_gain)
    return own_time, min(own_time, *(takes(k * mean) for k in BRAKES))


def new_crafts(count: int) -> tuple[list[DrawnCraft], list[tuple[float, float]]]:
    """So many drawn crafts, and how they are braked, side by side."""
    with (
        tempfile.TemporaryDirectory() as folder,
        ProcessPoolExecutor(mp_context=get_context("spawn")) as pool,
    ):
        there = [Path(folder)] * count
        crafts = list(pool.map(drawn_craft, range(count), there))
        return crafts, list(pool.map(braked, range(count), there))


def _of_drawn(
    crafts: Sequence[DrawnCraft], brakes: Sequence[tuple[float, float]]
) -> Iterator[str]:
    have = [c for c in crafts if c.recommended is not None]
    good = [c for c in have if not c.accepted and not c.worst]
    quick = [written_time / best for written_time, best in brakes if best < inf]
    yield "## Crafts of `desat new craft`"
    yield ""
    yield (
        f"{len(crafts)} crafts of 1U to 200 kg are drawn by a seed, each with what its class "
        f"has. `size` recommends rods for {len(have)}; with them it accepts the craft, and the "
        f"craft's own `worst.toml` meets its requirements, in {len(good)} of these. With 0.7 of "
        "the least rods for any law on the worst day it refuses "
        f"{sum(bool(c.refused) for c in crafts)} of {len(crafts)}."
    )
    yield ""
    yield "| craft | orbit | rods, A m2 | least, worst day | recommended | accepted, worst met |"
    yield "|---|---|---|---|---|---|"
    for c in crafts:
        w = c.facts
        orbit = (
            f"{w.sso}, Sun-synchronous" if w.sso else f"{w.altitude}, {w.inclination}"
        )
        rod = "none" if c.recommended is None else f"{c.recommended:.3g}"
        held = "; ".join([*c.accepted, *c.worst]) or ("yes" if c.recommended else "")
        yield (
            f"| {w.size or w.mass}, {w.pointing} | {orbit} | {c.rod:.3g} | {c.least:.3g} "
            f"| {rod} | {held} |"
        )
    yield ""
    yield (
        "B-dot's gain that `new craft` writes, beside the quickest of "
        f"{len(BRAKES)} gains from {BRAKES[0]:g} to {BRAKES[-1]:g} 1/s times the mean moment of "
        f"inertia: within 1.3 of it for {sum(x <= 1.3 for x in quick)} of {len(quick)}, at the "
        f"most {max(quick):.2f} times as long."
    )
    yield ""


def main(arguments: Sequence[str] | None = None) -> int:
    """All of it, into docs/sizing.md; 1 where the bar is not held."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--crafts", type=int, default=10)
    parser.add_argument(
        "--drawn", type=int, default=30, help="crafts of `desat new craft`"
    )
    options = parser.parse_args(arguments)
    found = list(unseen(options.crafts))
    good = sum(x["held"] for x in found)
    others = [(c, secular_of(c), estimated(c), dual(c)) for c in (TWELVE, AGILE)]
    text = _page(
        found,
        list(papers()),
        list(chosen()),
        others,
        speed(),
        new_crafts(options.drawn),
    )
    (DOCS / "sizing.md").write_text(text, encoding="utf-8")
    print(
        f"{good} of {len(found)} crafts within {100.0 * BAR:g} %: {DOCS / 'sizing.md'}"
    )
    return 0 if good >= ENOUGH * len(found) / 10.0 else 1


def _page(
    found: Sequence[dict[str, Any]],
    paper_results: Sequence[Any],
    laws: Sequence[ranking.Ranking],
    others: Sequence[Any],
    took: dict[str, float],
    of_new: tuple[list[DrawnCraft], list[tuple[float, float]]],
) -> str:
    today = datetime.now(UTC).date().isoformat()
    good = sum(x["held"] for x in found)
    lines = [
        _HEAD.format(
            today=today,
            desat=version("desat"),
            numpy=version("numpy"),
            scipy=version("scipy"),
            good=good,
            count=len(found),
            bar=100.0 * BAR,
        )
    ]
    lines += [
        "| | kg | km | deg | law, attitude | least, A m² | rms, % | largest, % | duty, points |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for x in found:
        c, rows = x["craft"], x["rows"]
        lines.append(
            f"| {c.name} | {c.mass:.0f} | {c.altitude / 1e3:.0f} | {np.degrees(c.inclination):.0f} "
            f"| {c.law.removeprefix('manager_')}, {'inertial' if c.inertial else 'nadir'} | "
            f"{x['least']:.3g} | {_three(100.0 * r.rms for r in rows)} | "
            f"{_three(100.0 * r.largest for r in rows)} | "
            f"{_three(100.0 * (r.duty - r.loop_duty) for r in rows)} |"
        )
    lines += ["", *_of_drawn(*of_new)]
    lines += [
        _PAPERS,
        "| scenario | paper has | secular, µN m | least rod, any law | "
        "recommended | wheels need / have, mN m s | dump of the start, detumbling |",
        "|---|---|---|---|---|---|---|",
    ]
    for (name, _, paper, has), m in paper_results:
        rod = "none" if m.recommended is None else f"{m.recommended:.3g} ({m.law})"
        capacity_text = (
            "no limit" if m.wheel_capacity == inf else f"{1e3 * m.wheel_capacity:.4g}"
        )
        lines.append(
            f"| `{name}` ({paper}) | {has} | {1e6 * float(np.linalg.norm(m.secular)):.3g} | "
            f"{m.least:.3g} | {rod} | {1e3 * m.wheel_needed:.3g} / {capacity_text} | "
            f"{m.start_dump / 60.0:.3g} min, {m.detumbling / 3600.0:.3g} h |"
        )
    lines += [
        "",
        *(
            f"- `{name}`: {m.answer.removeprefix(name + ': ')} {_explain_hardware(name, m)}".rstrip()
            for (name, *_), m in paper_results
        ),
    ]
    lines += ["", *_law_by_law(laws)]
    lines += [
        "",
        _OTHERS,
        "| craft | secular torque by `size`, µN m, eci | estimated anew | "
        "difference | formula, A m² | programme | its dual, another solver |",
        "|---|---|---|---|---|---|---|",
    ]
    for craft, (torque, _), anew, (formula, programme, other) in others:
        off = float(np.linalg.norm(torque - anew) / np.linalg.norm(torque))
        lines.append(
            f"| {craft.name} | {_vector(torque)} | {_vector(anew)} | {100.0 * off:.1f} % "
            f"| {formula:.6g} | {programme:.6g} | {other:.6g} |"
        )
    lines += ["", _SPEED.format(**{f"t{k}": v for k, v in took.items()})]
    return "\n".join(lines)


def _criterion_text(value: float) -> str:
    """A criterion's value; empty where it is not known."""
    if math.isnan(value):
        return ""
    return "not reached" if math.isinf(value) else number(value)


def _law_by_law(laws: Sequence[ranking.Ranking]) -> Iterator[str]:
    """What `compare --laws all` says of the papers' crafts."""
    names = [c.title for c in criteria.CRITERIA.values() if c.name in criteria.STANDARD]
    units = [
        c.heading for c in criteria.CRITERIA.values() if c.name in criteria.STANDARD
    ]
    yield _LAWS
    yield f"| scenario | law | {' | '.join(units)} | not dominated | requirements |"
    yield "|---" * (len(names) + 4) + "|"
    for law_ranking in laws:
        for k, e in enumerate(law_ranking.ranked):
            values_by_title = dict(
                zip(
                    (c.title for c in law_ranking.by),
                    map(_criterion_text, e.values),
                    strict=True,
                )
            )
            cells = " | ".join(values_by_title.get(name, "") for name in names)
            name = f"`{law_ranking.target}`" if not k else ""
            yield (
                f"| {name} | {e.label} | {cells} | {'yes' if e.front else ''} | "
                f"{'not met' if e.not_met else 'met'} |"
            )
    yield ""
    for law_ranking in laws:
        (own_law,) = [e for e in law_ranking.ranked if e.law.is_own]
        c, first = law_ranking.by[0], law_ranking.ranked[0]
        rest = "" if own_law is first else f", {first.name} {number(first.values[0])}"
        better = [
            e.name
            for e in law_ranking.ranked
            if e is not own_law and criteria.beats(e.values, own_law.values)
        ]
        beaten = f"; better in all: {', '.join(better)}" if better else ""
        alone = ": no other law of ours fits it" if len(law_ranking.ranked) == 1 else ""
        reason = _CHOSEN[law_ranking.target.partition("/")[0]]
        yield (
            f"- `{law_ranking.target}`: {c.title} by {own_law.name}, its own, {number(own_law.values[0])} "
            f"{c.unit}{rest}{beaten}{alone}. {reason}"
        )


def _explain_hardware(name: str, result: Sizing) -> str:
    """Why a paper's craft has what it has, where its disturbances ask for less."""
    manager_values = flights.values_of(prepare(name, Options()).or_raise()[0])[
        "manager"
    ]
    family = name.partition("/")[0]
    if family == "uosat12":
        alone = flights.values_of(
            prepare("uosat12/fig2-lqr-1", Options()).or_raise()[0]
        )
        return (
            "Nadir pointing without disturbances but gravity: the rods are for dumping. At their "
            f"limits they take the start's {1e3 * result.start_momentum:.0f} mN m s out in "
            f"{result.start_dump:.0f} s at least in the worst direction; the paper gives coils alone "
            f"{alone['manager']['horizon']:.0f} s."
        )
    if family == "hausat2":
        return (
            f"The wheel is a bias of {1e3 * manager_values['h_nominal']:.0f} mN m s, "
            f"{100.0 * manager_values['h_nominal'] / result.wheel_capacity:.0f} % of it; disturbances add "
            "little, and the rods are for detumbling and start-up."
        )
    return {
        "space_telescope": "The paper's craft must hold at any inertial attitude; this is one.",
        "alsat1": "Wheels and rods are for the torque of firings, which `size` leaves out.",
        "integrated": "The rods also give a share of the control torque and empty wheels that "
        "start more than half full.",
    }[family]


def _three(values: Iterator[float]) -> str:
    return ", ".join(f"{v:+.1f}" for v in values)


def _vector(v: Array) -> str:
    return ", ".join(f"{1e6 * x:.4f}" for x in v)


_HEAD = """# Sizing

`desat size CRAFT` computes the wheels, rods and propellant that a craft needs, from one run at the
attitude of the craft. The result contains the momentum by source and over a year, the lower bound
of the rod dipole for any law, the duty and the momentum of each law as a function of the rod
dipole, slews, and detumbling. `--map` evaluates rods over inclinations, altitudes and residual
dipoles.
This page is made by `make sizing` (`benchmarks/sizing.py`): {today}, desat {desat}, numpy {numpy},
scipy {scipy}.

## What it computes

With J(t) the impulse of the disturbances, s = J(T) / T over whole orbits, a_i the rods' axes:

- The minimum rod dipole is computed in two ways. The formula is |s| / mean sum |(a_i x B) . n| with
  n = s / |s|. The linear programme over the day gives the minimum that a law can reach if it knows
  the day in advance. Both values are shown. Where they differ by more than 1 %, the value of the
  linear programme is used.
- The model integrates the momentum H of wheels and body, H' = disturbance torque + coil torque. Its
  step is the sample time of the law, or several sample times where the law is slow. It computes
  many rod dipoles in parallel. The model contains no copy of a law: it calls the manager's own
  block at each sample, at the target momentum of the block and at a momentum along each axis. The
  model excludes laws with memory, nonlinear laws and laws that use thrusters ("closed loop only");
  `compare --laws` simulates them.
- The year and the map use the environment's own block at other dates and orbits, at the attitude of
  the run. They are not computed for an attitude that moves.

The momentum input of the law contains the noise of the craft's tachometers. This noise reduces the
effect of coils at their limits and increases the load of the other coils. The model does not
include pointing errors, detumbling, slews, or the saturation of one wheel by null-space momentum.
The times of dumping and detumbling are lower bounds: they assume rods at their dipole limits.

## Crafts that nobody chose

Mass, box, orbit, dipole, surfaces, wheels, law and its gain are drawn by a seed; the model against
the closed loop with all its sensors, noise and friction, over a day. Each cell has 1.2, 1.6, 2.5
and 5 times the least rod. **{good} of {count} are within {bar:g} %** at all four.
"""
_PAPERS = """## The papers' crafts

What `size` says beside what the paper chose.
"""
_LAWS = """## The papers' crafts, law by law

`desat compare CRAFT --laws all`: each flown with every law of ours that fits it, gains by rule.
HAUSAT-2 is not among them: its law starts the craft up, and the laws to compare hold wheels.
"""
_CHOSEN = {
    "uosat12": "The paper dumps within 600 s, which takes thrusters; over a day coils alone hold "
    "the momentum, too, without propellant.",
    "space_telescope": "The paper's open-loop and mixed-mode laws need tables from the ground.",
    "alsat1": "One wheel about pitch and a boom: momentum and attitude are one law.",
    "integrated": "`integrated` also gives part of the control torque by coils, which costs "
    "pointing here.",
}
_OTHERS = """## Against others

The secular torque by `size`, of a run with all sensors and wheels that err, beside an estimate that
uses none of our code (circular orbit with the drift of J2, IGRF by ppigrf, density and torques from
the textbook); and the linear programme beside its dual by Nelder and Mead's method.
"""
_SPEED = """## How long it takes

A map of 6 rods x 5 inclinations x 5 altitudes x 4 dipoles, one law, a day each, and the run before
it: {twork:.1f} s of CPU in two processes, {tmap:.1f} s by the clock of a machine that others use,
too. The model of a day: {t1:.2f} s for one rod, {t60:.2f} s for 60, {t600:.2f} s for 600 side by
side, most of it to ask the law's block.

![the smallest rod that holds, of a 12U](sizing.svg)
"""


if __name__ == "__main__":
    raise SystemExit(main())
