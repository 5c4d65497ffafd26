"""`desat size`: which wheels and rods a craft needs, from its momentum alone.

One run at the wanted attitude gives what no law changes: the field B(t), the attitude C(t), and the
impulse J(t) of the disturbances, which is the body's external impulse less that of its coils. On
these alone stand

- the secular torque s = (J(T) - J(0)) / T over whole orbits, and the cyclic rest J - s t, which the
  wheels have to hold whatever the coils do;
- the least rod. Rods of 1 A m2 at their limit work against s with kappa, the mean over time of
  sum_i |(a_i x B) . n|, n = s / |s|; so no law does with less than |s| / kappa. That the rest must
  come to nothing, too, makes it the larger  max over y of (y . s) / mean sum_i |(a_i x B) . y|,  a
  linear programme (its dual) whose answer any law can have that knows the whole time before;
- a model of three states, the momentum H of wheels and body in eci: H' = disturbances + coils,
  coils by the equation of the law, the rods' limits and the law's samples. It flies many sizes of
  rods side by side. It knows neither pointing errors, detumbling and slews, nor the noise of
  tachometers, which raises the duty where rods are large for their craft, nor the saturation of one
  wheel by momentum in the null space: for these there is the closed loop.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from math import inf, pi, sqrt
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from desat.components.physics.gyrostat import carrier_inertia
from desat.components.physics.orbit import MU

from ..numbers.derived import coil_impulse, in_body, rotate_back
from ..runs.prepare import Case, Source, prepare, read
from ..runs.run import simulate
from ..system.errors import DesatError
from ..system.model import System
from ..system.options import Options
from ..system.parameters import table

Array = NDArray[Any]
LAWS = ("manager_cross_product",)
"""Managers whose law the model has."""
WHOLE = 1.15
"""From this multiple of the least rod on the model is within 5 % of the closed loop."""
SIZES = (0.8, 1.0, WHOLE, 1.3, 1.6, 2.0, 3.0, 5.0, 8.0)
"""Rods of the curve, as multiples of the least."""
FLOWN = (1.0, 1.3)
"""Rods that fly in the closed loop beside the recommended one, as multiples of the least."""
PROGRAMME = 1440
"""Times that the linear programme has at most: as many minutes as a day has."""
ROLES = ("environment", "spacecraft", "wheels", "torquers", "manager")
_SERIES = ("spacecraft.q_bi", "spacecraft.omega_bi_body", "spacecraft.impulse_eci",
           "environment.b_eci", "environment.r_eci", "environment.v_eci",
           "torquers.m_mean_body", "wheels.h_wheel")  # fmt: skip


@dataclass(frozen=True)
class Flight:
    """What no law changes of a run, at its steps t_k (n + 1), and the hardware."""

    times: Array
    """(n + 1,) s"""
    period: float
    """of the orbit, s"""
    disturbance: Array
    """(n + 1, 3) N m s, eci: impulse since the start of all torques but the coils'"""
    q: Array
    """(n + 1, 4) attitude"""
    b: Array
    """(n + 1, 3) T, eci"""
    body: Array
    """(n + 1, 3) N m s, body: momentum of the body without the wheels'"""
    h_start: Array
    """(4,) N m s, of each wheel at the start"""
    axes_wheel: Array
    """(3, 4)"""
    capacity: Array
    """(4,) N m s; 0 where there is no wheel"""
    axes_coil: Array
    """(3, c)"""
    m_limit: float
    """A m2"""


class Course(NamedTuple):
    """The model with rods of some sizes: rms and largest size of the wheels' momentum in body
    (N m s) and the coils' duty (1), each (sizes,)."""

    rms: Array
    largest: Array
    duty: Array


class Law(NamedTuple):
    """A cross-product law as its block has it."""

    gain: float
    ccpl: bool
    """M = gain (h x B) / |B|, else over |B|^2"""
    deadband: float
    """N m s"""
    target: Array
    """(3,) N m s, body"""
    sample_time: float
    """s; what it commands is held for so long"""
    saturation: bool


def values_of(system: System) -> dict[str, dict[str, Any]]:
    """`role` -> parameter -> value. Raises DesatError for a role that the system has not."""
    if lacking := [r for r in ROLES if r not in system.components]:
        raise DesatError(f"{system.name}: no {lacking[0]}: a craft with {', '.join(ROLES)} is "
                         "needed")  # fmt: skip
    every = table(system.components[r] for r in ROLES)
    return {role: {k: p.value for k, p in every[role].items()} for role in ROLES}


def flight_of(system: System, results: Any) -> Flight:
    """The flight of a run that has recorded each step. Raises DesatError where it has not, or is
    shorter than an orbit."""
    given = values_of(system)
    for name in ("axes_wheel", "inertia_wheel", "inertia"):
        if name not in given["spacecraft"]:
            raise DesatError(f"{system.name}: spacecraft has no {name}: a rigid body with wheels "
                             "is needed")  # fmt: skip
    q, omega, impulse, b, r, v, dipole, h = (results.values(s) for s in _SERIES)
    times = results.times()
    n = min(len(times), len(q), len(dipole) + 1)
    times, q, omega, impulse, b = (x[:n] for x in (times, q, omega, impulse, b))
    size, speed = np.linalg.norm(r[0]), np.linalg.norm(v[0])
    axis = 1.0 / (2.0 / size - speed**2 / MU)
    period = 2.0 * pi * sqrt(axis**3 / MU)
    if times[-1] - times[0] < period:
        raise DesatError(f"{system.name}: the run lasts {times[-1] - times[0]:g} s, an orbit "
                         f"{period:.0f} s: at least one is needed (--stop)")  # fmt: skip
    craft, wheels, coils = given["spacecraft"], given["wheels"], given["torquers"]
    axes = np.reshape(craft["axes_wheel"], (3, 4))
    carrier = np.reshape(carrier_inertia(*(tuple(np.ravel(craft[x]).tolist()) for x in
                         ("inertia", "axes_wheel", "inertia_wheel"))), (3, 3))  # fmt: skip
    there = np.linalg.norm(axes, axis=0) > 0.0
    capacity = there * np.array(craft["inertia_wheel"]) * wheels.get("speed_limit", inf)
    axes_coil = np.reshape(coils["axes_coil"], (3, -1))
    return Flight(
        times, period, impulse - coil_impulse(times, b, q, dipole[: n - 1]), q, b,
        omega @ carrier.T, h[0], axes, np.nan_to_num(capacity, posinf=inf),
        axes_coil[:, np.linalg.norm(axes_coil, axis=0) > 0.0], float(coils["m_limit"]),
    )  # fmt: skip


def law_of(system: System) -> Law | None:
    """The law of the system's manager; None for one that the model does not have."""
    manager = system.components["manager"]
    if manager.source.rpartition("/")[2].removesuffix(".fmu") not in LAWS:
        return None
    given = values_of(system)["manager"]
    return Law(
        float(given["gain"]), given.get("law") in (1, "ccpl"), float(given.get("h_deadband", 0.0)),
        np.array(given.get("h_target_body", (0.0, 0.0, 0.0)), float),
        float(given.get("sample_time", 0.0)), bool(given.get("saturation", True)),
    )  # fmt: skip


def secular(flight: Flight) -> tuple[Array, Array]:
    """The secular torque (3,) N m, eci, over as many whole orbits as there are, and the cyclic
    impulse (rows, 3) N m s of these."""
    since = flight.times - flight.times[0]
    whole = flight.period * int(since[-1] / flight.period)
    rows = since <= whole
    end = np.array([np.interp(whole, since, x) for x in flight.disturbance.T])
    torque = (end - flight.disturbance[0]) / whole
    return torque, flight.disturbance[rows] - flight.disturbance[0] - np.outer(since[rows], torque)


def reach(flight: Flight) -> Array:
    """What each rod of 1 A m2 can do, as torque in eci: (rows, c, 3) N m."""
    rods = flight.axes_coil.T
    each = [rotate_back(flight.q, np.broadcast_to(a, (len(flight.q), 3))) for a in rods]
    return np.stack([np.cross(axis, flight.b) for axis in each], axis=1)


def least_rod(flight: Flight, torque: Array) -> tuple[float, float]:
    """The least dipole (A m2) of equal rods that take the secular torque out: by the formula, and
    by the linear programme; inf where none does."""
    size = float(np.linalg.norm(torque))
    if size == 0.0:
        return 0.0, 0.0
    since = flight.times - flight.times[0]
    rows = since <= flight.period * int(since[-1] / flight.period)
    able = reach(flight)[rows]
    work = np.abs(able @ (torque / size)).sum(axis=1).mean()
    some = able[:: -(-len(able) // PROGRAMME)]
    programme = _programme(some.reshape(-1, 3) / len(some), torque)
    return size / work if work > 0.0 else inf, programme


def _programme(able: Array, torque: Array) -> float:
    """min m,  sum u_i able_i = torque,  |u_i| <= m: (rods, 3) N m to A m2."""
    from scipy.optimize import linprog  # takes a while to load

    scale = float(np.abs(able).sum(axis=0).max())
    if scale == 0.0:
        return inf
    # u = m (2 x - 1) is not linear in (m, x); with u = p - q, p + q <= m it is
    count, columns = len(able), able.T / scale
    rows = np.concatenate([columns, -columns, np.zeros((3, 1))], axis=1)
    from scipy.sparse import eye_array, hstack

    within = hstack([eye_array(count), eye_array(count), -np.ones((count, 1))]).tocsr()
    unit = float(np.linalg.norm(torque))
    found = linprog(
        np.append(np.zeros(2 * count), 1.0), A_ub=within, b_ub=np.zeros(count),
        A_eq=rows, b_eq=torque / unit, bounds=(0.0, None), method="highs",
    )  # fmt: skip
    return float(found.fun) * unit / scale if found.status == 0 else inf


def fly(flight: Flight, law: Law, rods: Sequence[float]) -> Course:
    """The model with rods of these sizes (A m2), side by side, from the run's start on."""
    m = np.asarray(rods, float)[:, None]
    step = float(flight.times[1] - flight.times[0])
    hold = max(1, round(law.sample_time / step)) if law.sample_time > 0.0 else 1
    rows = np.arange(0, len(flight.times), hold)
    spare = np.linalg.pinv(flight.axes_coil)
    q, times = flight.q[rows], flight.times[rows]
    b_body = rotate_back(_conjugate(q), flight.b[rows])
    body = flight.body[rows]
    given = np.diff(flight.disturbance[rows], axis=0)
    mean_b = (flight.b[rows][:-1] + flight.b[rows][1:]) / 2.0
    halfway = q[:-1] + q[1:]
    halfway /= np.linalg.norm(halfway, axis=1, keepdims=True)
    # the matrix of each row: body to eci
    to_eci = np.stack([rotate_back(q, np.broadcast_to(e, (len(q), 3))) for e in np.eye(3)], axis=2)
    held = np.stack([rotate_back(halfway, np.broadcast_to(e, (len(halfway), 3)))
                     for e in np.eye(3)], axis=2)  # fmt: skip
    start = in_body(flight.h_start[None], flight.axes_wheel.ravel().tolist())[0] + body[0]
    total = np.broadcast_to(to_eci[0] @ start, (len(m), 3)).copy()
    squares, largest, duty = np.zeros(len(m)), np.zeros(len(m)), np.zeros(len(m))
    for k in range(len(rows)):
        h = total @ to_eci[k] - body[k]
        size = np.sqrt((h * h).sum(axis=1))
        squares += size**2
        np.maximum(largest, size, out=largest)
        if k == len(rows) - 1:
            break
        excess, field = h - law.target, b_body[k]
        strength = float(field @ field)
        factor = law.gain / (sqrt(strength) if law.ccpl else strength) if strength else 0.0
        wanted = factor * np.cross(excess, field)
        wanted[np.sqrt((excess * excess).sum(axis=1)) <= law.deadband] = 0.0
        if law.saturation:
            wanted = np.clip(wanted, -m, m)
        coils = np.clip(wanted @ spare.T, -m, m)
        duty += np.abs(coils).mean(axis=1) / m[:, 0]
        dipole = coils @ flight.axes_coil.T @ held[k].T
        total += given[k] + np.cross(dipole, mean_b[k]) * (times[k + 1] - times[k])
    return Course(np.sqrt(squares / len(rows)), largest, duty / max(1, len(rows) - 1))


def _conjugate(q: Array) -> Array:
    return np.asarray(q * np.array([-1.0, -1.0, -1.0, 1.0]))


@dataclass(frozen=True)
class Flown:
    """A size of rods (A m2): the model, and the closed loop where it flew."""

    rod: float
    multiple: float
    """of the least rod"""
    rms: float
    largest: float
    duty: float
    """1"""
    loop_rms: float | None = None
    loop_largest: float | None = None
    loop_duty: float | None = None


@dataclass(frozen=True)
class Sizing:
    """What a craft needs, beside what it has. Momenta N m s, torques N m, dipoles A m2, times s."""

    target: str
    orbits: int
    period: float
    secular: tuple[float, ...]
    """eci"""
    per_orbit: float
    """secular momentum of an orbit"""
    cyclic: float
    """largest size of the cyclic momentum about its middle"""
    wheel_needed: float
    """of the fullest wheel, to hold cyclic and body momentum as the attitude turns"""
    wheel_capacity: float
    """of the smallest wheel; inf where it has no limit"""
    hours_without: float
    """until a wheel that starts at rest is full without dumping; inf: never"""
    least_formula: float
    least: float
    """by the linear programme"""
    rod: float
    """that the craft has"""
    recommended: float | None
    """the smallest with the duty asked for, at least 1.3 times the least; None: the model has no
    such law, or none of up to 8 times the least"""
    duty: float
    """asked for (1)"""
    curve: tuple[Flown, ...]
    problems: tuple[str, ...]
    notes: tuple[str, ...]

    def as_json(self) -> dict[str, Any]:
        """What `--json` prints; what is without end is null."""
        return {name: _finite(value) for name, value in asdict(self).items()}


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {k: _finite(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(v) for v in value]
    return None if isinstance(value, float) and not np.isfinite(value) else value


def size(
    target: str, options: Options, duty: float = 0.5, flown: bool = True,
    progress: Callable[[str], None] = lambda text: None,
) -> Sizing:  # fmt: skip
    """Size the wheels and rods of a craft for the attitude, orbit and law of a scenario. `flown`:
    whether the closed loop flies with the sizes that count. Raises DesatError for a craft without
    what it takes, or a run that does not complete."""
    if not 0.0 < duty < 1.0:
        raise DesatError(f"--duty {100.0 * duty:g}: a share between 0 and 100 % is needed")
    source = read(target)
    case = prepare(source, options)
    system, _ = case.or_raise()
    values_of(system)
    progress("the run at the wanted attitude")
    run = simulate(_recording(case)).or_raise(target)
    with run.results as results:
        flight = flight_of(system, results)
    law = law_of(system)
    torque, cyclic = secular(flight)
    formula, least = least_rod(flight, torque)
    wheel, hours = _wheels(flight, torque, cyclic)
    curve, recommended = _curve(flight, law, least, duty)
    if flown and curve:
        closed = [*(k * least for k in FLOWN), *([recommended] if recommended else [])]
        curve = tuple(
            _in_the_loop(row, source, options, progress)
            if any(abs(row.rod - x) < 1e-9 * x for x in closed) else row
            for row in curve
        )  # fmt: skip
    working = flight.capacity[flight.capacity > 0.0]
    capacity = float(working.min()) if len(working) else 0.0
    whole = int((flight.times[-1] - flight.times[0]) / flight.period)
    made = Sizing(
        target, whole, flight.period, tuple(torque.tolist()),
        float(np.linalg.norm(torque)) * flight.period, _span(cyclic), wheel, capacity, hours,
        formula, least, flight.m_limit, recommended, duty, curve, (), (),
    )  # fmt: skip
    return replace(made, problems=tuple(_problems(made)), notes=tuple(_notes(made, law, system)))


def _recording(case: Case) -> Case:
    return replace(case, options=replace(case.options, record=_SERIES, every=1))


def _span(cyclic: Array) -> float:
    """The largest distance from the middle of the box that holds the cyclic momentum."""
    middle = (cyclic.max(axis=0) + cyclic.min(axis=0)) / 2.0
    return float(np.linalg.norm(cyclic - middle, axis=1).max())


def _wheels(flight: Flight, torque: Array, cyclic: Array) -> tuple[float, float]:
    """What the fullest wheel has to hold of the cyclic momentum, shared with the least squares, and
    how long wheels that begin at rest last without dumping (s)."""
    spread = np.linalg.pinv(flight.axes_wheel)
    n = len(cyclic)
    middle = (cyclic.max(axis=0) + cyclic.min(axis=0)) / 2.0
    inside = rotate_back(_conjugate(flight.q[:n]), cyclic - middle)
    bent = flight.body[:n] - flight.body[:n].mean(axis=0)
    each = np.abs((inside - bent) @ spread.T)
    needed = float(each.max())
    room = flight.capacity > 0.0
    gained = flight.disturbance - flight.disturbance[0]
    stored = np.abs(rotate_back(_conjugate(flight.q), gained) @ spread.T)[:, room]
    full = (stored >= flight.capacity[room]).any(axis=1)
    since = flight.times - flight.times[0]
    if full.any():
        return needed, float(since[np.argmax(full)])
    rate = float(np.linalg.norm(torque)) * float(np.linalg.norm(spread, axis=1)[room].max())
    left = float((flight.capacity[room] - stored.max(axis=0)).min())
    return needed, inf if rate == 0.0 else float(since[-1]) + left / rate


def _curve(
    flight: Flight, law: Law | None, least: float, duty: float
) -> tuple[tuple[Flown, ...], float | None]:  # fmt: skip
    """The model over the sizes of SIZES, and the recommended one among them."""
    if law is None or not 0.0 < least < inf:
        return (), None
    fine = np.geomspace(1.3, SIZES[-1], 40) * least
    found = fly(flight, law, fine.tolist())
    enough = found.duty <= duty
    recommended = float(fine[np.argmax(enough)]) if enough.any() else None
    rods = sorted({*(k * least for k in SIZES), *([recommended] if recommended else [])})
    made = fly(flight, law, rods)
    rows = zip(rods, made.rms, made.largest, made.duty, strict=True)
    return tuple(
        Flown(rod, rod / least, float(a), float(b), float(c)) for rod, a, b, c in rows
    ), recommended


def _in_the_loop(
    row: Flown, source: Source, options: Options, progress: Callable[[str], None]
) -> Flown:
    """A size of rods with what the closed loop makes of it."""
    progress(f"the closed loop with rods of {row.rod:.4g} A m2")
    values = {**options.values, "torquers.m_limit": row.rod, "manager.m_limit": row.rod}
    case = prepare(source, replace(options, values=values))
    run = simulate(_recording(case)).or_raise(source.target)
    system, _ = case.or_raise()
    given = values_of(system)
    with run.results as results:
        h, m = results.values("wheels.h_wheel"), results.values("torquers.m_mean_body")
    sizes = np.linalg.norm(in_body(h, given["spacecraft"]["axes_wheel"]), axis=1)
    axes = np.reshape(given["torquers"]["axes_coil"], (3, -1))
    coils = m @ np.linalg.pinv(axes[:, np.linalg.norm(axes, axis=0) > 0.0]).T
    return replace(
        row, loop_rms=float(np.sqrt((sizes**2).mean())), loop_largest=float(sizes.max()),
        loop_duty=float(np.abs(coils).mean()) / row.rod,
    )  # fmt: skip


def _problems(made: Sizing) -> list[str]:
    """Why the craft cannot hold its momentum, a line each."""
    lines = []
    if made.least == inf:
        lines.append("no rod takes the secular torque out: the field is along it all the time")
    elif made.rod < made.least:
        lines.append(f"rods of {made.rod:.4g} A m2: the secular torque needs at least "
                     f"{made.least:.4g} A m2 with any law")  # fmt: skip
    if made.wheel_needed > made.wheel_capacity:
        lines.append(f"wheels of {made.wheel_capacity:.4g} N m s: the cyclic momentum alone needs "
                     f"{made.wheel_needed:.4g} N m s of the fullest one")  # fmt: skip
    return lines


def _notes(made: Sizing, law: Law | None, system: System) -> list[str]:
    """What the numbers do not say, a line each."""
    lines = []
    if law is None:
        name = system.components["manager"].source.rpartition("/")[2].removesuffix(".fmu")
        lines.append(f"{name}: closed loop only; the model has the law of {', '.join(LAWS)}")
    if made.orbits < 14:
        lines.append(f"{made.orbits} whole orbits: a day (--stop 86400) sees the field turn once")
    if abs(made.least - made.least_formula) > 0.01 * made.least_formula:
        lines.append("formula and linear programme differ by more than 1 %: the latter counts")
    return lines
