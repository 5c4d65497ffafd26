"""Paper 003's detumbling simulated again, by arrays of draws at once: none of the
blocks, laws or measures of this repository, of which only the Gauss coefficients and
the values drawn are taken.

    python -m benchmarks.detumbling [same|other|choices|starts [NAME ...]]

writes docs/papers/hausat2/independent.json, from which the page tells how far medians
hang on the draws: the page's own draws flown here, other draws, and choices that the
paper leaves open. Draws are the last axis of every array: (3, draws), (4, draws),
(draws,).
"""

from __future__ import annotations

import json
import math
import platform
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
HERE = Path(__file__).parent.parent
FILE = HERE / "docs" / "papers" / "hausat2" / "independent.json"
COEFFICIENTS = HERE / "components" / "physics" / "igrf14.json"

MU, EARTH, REFERENCE = 3.986004418e14, 7.2921158553e-5, 6371.2e3  # m3/s2, rad/s, m
RADIUS, INCLINATION, DEGREE = 7028137.0, 1.71, 10
YEAR = 2005.0 + 151.0 / 365.0  # 2005-06-01
SIDEREAL = math.radians(
    (280.46061837 + 360.98564736629 * (2453522.5 - 2451545.0)) % 360.0
)
INERTIA = np.array([0.3078, 0.2865, 0.2747])
ROTOR = 3.43774677e-4  # kg m2, about -y
DIPOLE, LIMIT, START = 2.0, 0.003, 0.1  # A m2, rad/s, rad/s
STOP = 18000.0
SEED = 2005
COUNT, CHANGED = 400, 100
"""How many other draws; and under each of the choices."""

GAINS = {"1e5": 1e5, "3e5": 3e5, "5e5": 5e5, "1e6": 1e6, "3e6": 3e6, "1e7": 1e7}
JUDGED = ("gain-k-5e5", "gain-k-3e6", "gain-k-1e7", "gain-kw-1e-6")
TORQUES = {
    "1e-6": 1e-6,
    "5e-6": 5e-6,
    "1e-5": 1e-5,
    "3e-5": 3e-5,
    "5e-5": 5e-5,
    "1e-4": 1e-4,
}


@dataclass(frozen=True)
class Choices:
    """What the paper leaves open; as the scenarios have it."""

    sample_time: float = 1.0
    vector_limit: bool = False
    """The dipole limited in size, not each coil."""
    gravity: bool = True
    relative_to_lvlh: bool = False
    """The rates that have to be small are those relative to lvlh."""
    late: bool = False
    """Commands a sample later."""
    exact_rate: bool = False
    """B' from omega x B and the field's own change, not by eq. 2."""
    turning_wheel: bool = False
    """The wheel turns with the body at first instead of standing still in space."""


VARIANTS = {
    "a dipole limited in size": Choices(vector_limit=True),
    "no gravity gradient": Choices(gravity=False),
    "rates relative to lvlh": Choices(relative_to_lvlh=True),
    "commands a sample late": Choices(late=True),
    "B' without error": Choices(exact_rate=True),
    "a wheel that turns with the body at first": Choices(turning_wheel=True),
    "sampled every 2 s": Choices(sample_time=2.0),
}


# --- the field ------------------------------------------------------------------------


def _gauss() -> dict[tuple[int, int], tuple[float, float]]:
    """(n, m) -> g, h in T at YEAR, Schmidt semi-normalised."""
    data = json.loads(COEFFICIENTS.read_text(encoding="utf-8"))
    years = data["years"]
    found = {
        (n, m): float(np.interp(YEAR, years, v)) for n, m, *v in data["coefficients"]
    }
    return {
        (n, m): (1e-9 * found[n, m], 1e-9 * found.get((n, -m), 0.0) if m else 0.0)
        for n in range(1, DEGREE + 1)
        for m in range(n + 1)
    }


GAUSS = _gauss()


def field(r: Array, angle: float) -> Array:
    """B (T, eci) at r (m, eci), the Earth turned by `angle` (rad): the textbook's sum
    over Schmidt's functions of colatitude, in north, east and down."""
    size = np.linalg.norm(r, axis=0)
    cos_t = r[2] / size
    sin_t = np.sqrt(1.0 - cos_t**2)
    longitude = np.arctan2(r[1], r[0]) - angle
    p: dict[tuple[int, int], Array] = {(0, 0): np.ones_like(size)}
    d: dict[tuple[int, int], Array] = {(0, 0): np.zeros_like(size)}
    zero = np.zeros_like(size)
    out, south, east = zero.copy(), zero.copy(), zero.copy()
    for n in range(1, DEGREE + 1):
        for m in range(n + 1):
            if n == m:
                k = math.sqrt(1.0 - 1.0 / (2.0 * n)) if n > 1 else 1.0
                p[n, n] = k * sin_t * p[n - 1, n - 1]
                d[n, n] = k * (sin_t * d[n - 1, n - 1] + cos_t * p[n - 1, n - 1])
                continue
            a = (2 * n - 1) / math.sqrt(n * n - m * m)
            b = math.sqrt(((n - 1) ** 2 - m * m) / (n * n - m * m))
            p[n, m] = a * cos_t * p[n - 1, m] - b * p.get((n - 2, m), zero)
            d[n, m] = a * (cos_t * d[n - 1, m] - sin_t * p[n - 1, m]) - b * d.get(
                (n - 2, m), zero
            )
    around = [(np.cos(m * longitude), np.sin(m * longitude)) for m in range(DEGREE + 1)]
    for n in range(1, DEGREE + 1):
        falling = (REFERENCE / size) ** (n + 2)
        for m in range(n + 1):
            (g, h), (c, s) = GAUSS[n, m], around[m]
            out += (n + 1) * falling * (g * c + h * s) * p[n, m]
            south -= falling * (g * c + h * s) * d[n, m]
            if m:
                east += m * falling * (g * s - h * c) * p[n, m] / sin_t
    up = r / size
    to_east = np.stack([-np.sin(longitude + angle), np.cos(longitude + angle), zero])
    to_south = np.cross(to_east, up, axis=0)
    return np.asarray(out * up + south * to_south + east * to_east)


# --- the craft ------------------------------------------------------------------------


@dataclass(frozen=True)
class Starts:
    """What is drawn: attitude (4, draws), scalar last; rates (3, draws), rad/s; place
    in the orbit and node (draws,), rad."""

    attitude: Array
    rates: Array
    anomaly: Array
    node: Array


def others(count: int, seed: int = SEED) -> Starts:
    """Draws of our own."""
    rng = np.random.default_rng(seed)
    q = rng.normal(size=(4, count))
    return Starts(
        q / np.linalg.norm(q, axis=0),
        START * rng.choice([-1.0, 1.0], size=(3, count)),
        rng.uniform(0.0, 2.0 * math.pi, count),
        rng.uniform(0.0, 2.0 * math.pi, count),
    )


def _place(starts: Starts, t: float) -> tuple[Array, Array]:
    """Place and speed (m, m/s; eci) on the circular orbit."""
    motion = math.sqrt(MU / RADIUS**3)
    u, node = starts.anomaly + motion * t, starts.node
    c, s, ci, si = np.cos(u), np.sin(u), math.cos(INCLINATION), math.sin(INCLINATION)
    cn, sn = np.cos(node), np.sin(node)
    r = RADIUS * np.stack([cn * c - sn * ci * s, sn * c + cn * ci * s, si * s])
    v = (
        RADIUS
        * motion
        * np.stack([-cn * s - sn * ci * c, -sn * s + cn * ci * c, si * c])
    )
    return r, v


def _to_body(q: Array, v: Array) -> Array:
    """A vector of eci in the body that q (scalar last) takes eci to."""
    t = 2.0 * _cross(v, q[:3])
    return np.asarray(v + q[3] * t + _cross(t, q[:3]))


def _cross(a: Array, b: Array) -> Array:
    return np.stack(
        [
            a[1] * b[2] - a[2] * b[1],
            a[2] * b[0] - a[0] * b[2],
            a[0] * b[1] - a[1] * b[0],
        ]
    )


def _slope(y: Array, b: Array, r: Array | None, m: Array, torque: Array) -> Array:
    """y': of rates, attitude, the wheel's momentum along -y. b, r: eci; m (A m2) and
    the wheel's torque on the body about +y (N m)."""
    w, q, h = y[:3], y[3:7], y[7]
    body = INERTIA.copy()
    body[1] -= ROTOR
    momentum = body[:, None] * w
    momentum[1] -= h
    total = _cross(m, _to_body(q, b)) - _cross(w, momentum)
    if r is not None:
        u = _to_body(q, r) / RADIUS
        total += 3.0 * MU / RADIUS**3 * _cross(u, INERTIA[:, None] * u)
    total[1] += torque
    turn = 0.5 * np.stack(
        [
            w[2] * q[1] - w[1] * q[2] + w[0] * q[3],
            -w[2] * q[0] + w[0] * q[2] + w[1] * q[3],
            w[1] * q[0] - w[0] * q[1] + w[2] * q[3],
            -w[0] * q[0] - w[1] * q[1] - w[2] * q[2],
        ]
    )
    return np.concatenate([total / body[:, None], turn, torque[None]])


def _command(
    b: Array, rate: Array, gains: Array, torques: Array, choices: Choices
) -> tuple[Array, Array]:
    """Eq. 1 where the torque is 0, eqs. 7 and 8 elsewhere: dipole, the wheel's torque."""
    wheel = torques > 0.0
    m = -gains * rate
    m[0][wheel] = m[2][wheel] = 0.0
    if choices.vector_limit:
        m *= np.minimum(1.0, DIPOLE / np.maximum(np.linalg.norm(m, axis=0), 1e-30))
    m = np.clip(m, -DIPOLE, DIPOLE)
    across = b[2] * rate[0] - b[0] * rate[2]
    return m, torques * np.where(across >= 0.0, 1.0, -1.0)


def detumbled(
    starts: Starts, cases: Sequence[tuple[float, float]], choices: Choices
) -> Array:
    """Minutes until all rates are below LIMIT at once, (cases, draws); nan: not within
    STOP. Cases: gain (A m2 s/T) and torque of the wheel (N m), 0: B-dot."""
    count, step = len(starts.anomaly), choices.sample_time
    draw = np.tile(np.arange(count), len(cases))  # which draw and case a lane is
    case = np.repeat(np.arange(len(cases)), count)
    gains, torques = (np.array([c[k] for c in cases])[case] for k in (0, 1))
    y = np.zeros((8, len(draw)))
    y[:3], y[3:7] = starts.rates[:, draw], starts.attitude[:, draw]
    if choices.turning_wheel:
        y[7] = -ROTOR * y[1]
    found = np.full((len(cases), count), np.nan)
    active = np.arange(len(draw))
    held: tuple[Array, Array] = (np.zeros_like(y[:3]), np.zeros_like(y[7]))
    last: Array | None = None
    there, flying = starts, np.arange(count)  # the draws of which a lane still flies
    r, v = _place(there, 0.0)
    b = field(r, SIDEREAL)
    for k in range(round(STOP / step)):
        t = k * step
        lane = np.searchsorted(flying, draw[active])
        seen = _to_body(y[3:7], b[:, lane])
        rates = y[:3]
        if choices.relative_to_lvlh:
            turn = _cross(r, v)[:, lane] / RADIUS**2
            rates = rates - _to_body(y[3:7], turn)
        slow = (np.abs(rates) < LIMIT).all(axis=0)
        found[case[active[slow]], draw[active[slow]]] = t / 60.0
        if slow.any() or k == 0:
            keep = ~slow
            active, y, seen, lane = active[keep], y[:, keep], seen[:, keep], lane[keep]
            held = (held[0][:, keep], held[1][keep])
            last = None if last is None else last[:, keep]
        if not len(active):
            break
        r1, v1 = _place(there, t + step)
        b1 = field(r1, SIDEREAL + EARTH * (t + step))
        command = (np.zeros_like(seen), np.zeros_like(y[7]))
        if choices.exact_rate:
            change = _to_body(y[3:7], ((b1 - b) / step)[:, lane])
            rate: Array | None = _cross(seen, y[:3]) + change
        else:
            rate = None if last is None else (seen - last) / step
        if rate is not None:
            command = _command(seen, rate, gains[active], torques[active], choices)
        last = seen
        m, torque = held if choices.late else command
        held = command
        begin, end = b[:, lane], b1[:, lane]
        gravity = (r[:, lane], r1[:, lane]) if choices.gravity else None
        parts = max(1, round(step))
        for i in range(parts):
            dt, at = step / parts, [(i + x) / parts for x in (0.0, 0.5, 1.0)]
            fields = [begin + x * (end - begin) for x in at]
            places: list[Array | None] = [None] * 3
            if gravity is not None:
                places = [gravity[0] + x * (gravity[1] - gravity[0]) for x in at]
            k1 = _slope(y, fields[0], places[0], m, torque)
            k2 = _slope(y + 0.5 * dt * k1, fields[1], places[1], m, torque)
            k3 = _slope(y + 0.5 * dt * k2, fields[1], places[1], m, torque)
            k4 = _slope(y + dt * k3, fields[2], places[2], m, torque)
            y = y + dt / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
            y[3:7] /= np.linalg.norm(y[3:7], axis=0)
        r, v, b = r1, v1, b1
        if k % 600 == 599:  # fields of draws that no lane flies any more are not needed
            remaining = np.unique(draw[active])
            saved = np.searchsorted(flying, remaining)
            there = Starts(
                there.attitude[:, saved],
                there.rates[:, saved],
                there.anomaly[saved],
                there.node[saved],
            )
            flying, r, v, b = remaining, r[:, saved], v[:, saved], b[:, saved]
    return found


# --- what is written ------------------------------------------------------------------


def cases() -> dict[str, tuple[float, float]]:
    """Scenario -> gain, torque of the wheel."""
    return {f"gain-k-{k}": (x, 0.0) for k, x in GAINS.items()} | {
        f"gain-kw-{k}": (3e7, x) for k, x in TORQUES.items()
    }


def page_s_draws() -> tuple[Starts, dict[str, list[float | None]]]:
    """The values drawn for the page and, of each scenario, its stored minutes."""
    from desat.campaign import sampling
    from desat.papers import stored
    from desat.runs.cases import draft_to_draw
    from desat.runs.prepare import read

    stored_samples = stored.read("hausat2")
    times = {
        name: [
            r.numbers["detumbled"]
            for r in stored_samples["scenarios"][f"hausat2/{name}"]["draws"]
        ]
        for name in cases()
    }
    system = draft_to_draw(read("hausat2/gain-k-1e5"), True)
    count = min(map(len, times.values()))
    drawn = [sampling.draw_of(system, stored_samples["seed"], i) for i in range(count)]
    return Starts(
        *(
            np.array([d[f"spacecraft.{n}"] for d in drawn]).T
            for n in ("q_start_bi", "omega_start_body")
        ),
        *(
            np.array([d[f"environment.{n}"] for d in drawn]).ravel()
            for n in ("mean_anomaly", "raan")
        ),
    ), {name: list(x[:count]) for name, x in times.items()}


def median(times: Array) -> float:
    """Of those that are done (min)."""
    return float(np.nanmedian(times))


def compared(ours: list[float | None], theirs: Array) -> dict[str, Any]:
    """The page's stored minutes and this simulation's of the same draws."""
    mine = np.array([math.nan if x is None else x for x in ours])
    apart = np.abs(mine - theirs)
    return {
        "draws": len(mine),
        "done": int(np.isfinite(mine).sum()),
        "done_here": int(np.isfinite(theirs).sum()),
        "median": median(mine),
        "median_here": median(theirs),
        "median_apart": float(np.nanmedian(apart)),
        "within_1_min": float((apart[np.isfinite(apart)] < 1.0).mean()),
    }


def spread(times: Array) -> dict[str, Any]:
    """Other draws: their median, and what medians of fewer of them are."""
    rng = np.random.default_rng(SEED)
    medians: dict[str, list[float]] = {}
    for many in (20, 200):
        sets = rng.choice(len(times), size=(4000, many))
        with np.errstate(all="ignore"):
            found = np.nanmedian(times[sets], axis=1)
        medians[f"medians_of_{many}"] = [
            float(np.nanquantile(found, x)) for x in (0.05, 0.95)
        ]
    return {
        "draws": len(times),
        "done": int(np.isfinite(times).sum()),
        "median": median(times),
        "least": float(np.nanmin(times)),
        "most": float(np.nanmax(times)),
        "below_40_min": float((times < 40.0).mean()),
        **medians,
    }


def same(names: Sequence[str]) -> dict[str, Any]:
    """The page's own draws."""
    starts, stored = page_s_draws()
    found = detumbled(starts, [cases()[n] for n in names], Choices())
    return {n: compared(stored[n], x) for n, x in zip(names, found, strict=True)}


def other(names: Sequence[str]) -> dict[str, Any]:
    """Other draws."""
    found = detumbled(others(COUNT), [cases()[n] for n in names], Choices())
    return {n: spread(x) for n, x in zip(names, found, strict=True)}


def choices(names: Sequence[str]) -> dict[str, Any]:
    """Other draws under what the paper leaves open, beside the same without."""
    starts, inputs = others(CHANGED), [cases()[n] for n in JUDGED]
    plain = detumbled(starts, inputs, Choices())
    return {
        name: {
            n: {
                "times_the_median": median(x) / median(y),
                "most_apart": float(np.nanmax(np.abs(x - y))),
            }
            for n, x, y in zip(
                JUDGED, detumbled(starts, inputs, VARIANTS[name]), plain, strict=True
            )
        }
        for name in names
    }


def starts(names: Sequence[str]) -> dict[str, Any]:
    """The mean field (uT) where the page's draws and the others begin, and its standard
    error."""
    of = {"page": page_s_draws()[0], "other": others(COUNT)}
    found = {
        n: 1e6 * np.linalg.norm(field(_place(of[n], 0.0)[0], SIDEREAL), axis=0)
        for n in names
    }
    return {
        n: {
            "draws": len(x),
            "field": float(x.mean()),
            "standard_error": float(x.std() / math.sqrt(len(x))),
        }
        for n, x in found.items()
    }


PARTS = {"same": same, "other": other, "choices": choices, "starts": starts}
COUNTS = {"other": COUNT, "choices": CHANGED}


def rounded(value: Any) -> Any:
    """Four digits are enough for minutes."""
    if isinstance(value, dict):
        return {k: rounded(v) for k, v in value.items()}
    if isinstance(value, list):
        return [rounded(v) for v in value]
    return round(value, 4) if isinstance(value, float) else value


def main() -> int:
    """Measure and write a part, of the scenarios or choices that are named, or all."""
    data = json.loads(FILE.read_text(encoding="utf-8")) if FILE.exists() else {}
    known: dict[str, Iterable[str]] = {
        "same": cases(),
        "other": cases(),
        "choices": VARIANTS,
        "starts": ("page", "other"),
    }
    for part in sys.argv[1:2] or PARTS:
        names = sys.argv[2:] or list(known[part])
        result = rounded(PARTS[part](names))
        saved = data.get(part, {}).get("cases", {}) | result
        data[part] = {
            "date": f"{datetime.now(UTC):%Y-%m-%d}",
            "seed": SEED,
            "draws": COUNTS.get(part),
            "versions": {"numpy": np.__version__, "python": platform.python_version()},
            "cases": {n: saved[n] for n in known[part] if n in saved},
        }
        FILE.write_text(json.dumps(data, indent=1) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
