"""Every number and plot of all families is what its title says.

Each number is computed a second time, from the words of its title, in numpy from the
recorded series, and not by desat's measures: one table, TITLES, of title -> how. A
number that has no entry fails, so a new one gets one. Of each definition (title,
measure, signal, options, window, ...) one scenario flies.
"""

from __future__ import annotations

import functools
import json
import math
import re
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest
from scipy import integrate
from scipy.spatial.transform import Rotation

from desat.analyses import management
from desat.figures.plots import lines_of
from desat.files.scenario import scenarios
from desat.language.scenario import Plot
from desat.runs.run import Options, execute

RPM = 30.0 / math.pi
NADIR_PERIOD = 6128.457503878951


@dataclass
class Flight:
    """Series and parameters of a run, and what words in titles stand for."""

    run: Any
    cache: dict[str, Any] = field(default_factory=dict)

    def __getitem__(self, name: str) -> np.ndarray:
        values = np.asarray(self.run.results.values(name), dtype=float)
        return values if values.ndim > 1 else values[:, None]

    @property
    def t(self) -> np.ndarray:
        return np.asarray(self.run.results.times())

    def p(self, name: str) -> Any:
        owner, _, key = name.partition(".")
        value = self.run.manifest["parameters"][owner][key]["value"]
        return np.array(value) if isinstance(value, list) else value

    def has(self, name: str) -> bool:
        return name in self.run.results.names()

    def at(self, name: str, time: float) -> np.ndarray:
        return self[name][np.flatnonzero(np.abs(self.t - time) < 1e-6)[0]]

    def between(
        self, values: np.ndarray, begin: float, end: float = math.inf
    ) -> np.ndarray:
        t = self.t[: len(values)]
        return values[(t > begin - 1e-6) & (t < end + 1e-6)]

    # --- what words stand for

    def momentum(self, wheels: str = "wheels.h_wheel") -> np.ndarray:
        """The wheels' momentum as a vector: along each wheel's axis, summed."""
        if not self.has(wheels):
            wheels = "spacecraft.h_copy_wheel"
        return np.einsum("ij,tj->ti", self.axes(wheels.partition(".")[0]), self[wheels])

    def axes(self, owner: str) -> np.ndarray:
        """The wheels' axes, (3, 4), columns; of ideal wheels within a craft those of
        the body."""
        parameters = self.run.manifest["parameters"][owner]
        return (
            np.reshape(parameters["axes_wheel"]["value"], (3, 4))
            if "axes_wheel" in parameters
            else (np.eye(3, 4))
        )

    def there(self) -> np.ndarray:
        """Which wheels there are."""
        return np.abs(np.reshape(self.p("wheels.axes_wheel"), (3, 4))).sum(axis=0) > 0.0

    def wheels(self) -> np.ndarray:
        """The size of each wheel's momentum, those that there are."""
        return np.abs(self["wheels.h_wheel"])[:, self.there()]

    def capacity(self) -> np.ndarray:
        return (self.p("wheels.inertia_wheel") * self.p("wheels.speed_limit"))[
            self.there()
        ]

    def fill(self) -> np.ndarray:
        """Mean wheel, per cent of its capacity."""
        return 100.0 * (self.wheels() / self.capacity()).mean(axis=1)

    def null(self, row: int) -> float:
        """What momentum along (1, -1, 1, -1), which no torque on the body changes,
        makes of each wheel: the part of h along it, per cent of capacity."""
        h = self["wheels.h_wheel"][row]
        part = (h[0] - h[1] + h[2] - h[3]) / 4.0
        return 100.0 * abs(part) / self.capacity()[0]

    def craft(self) -> np.ndarray:
        """The craft's momentum in eci: of the body with its wheels, and of what they
        turn."""
        inertia = np.reshape(self.p("spacecraft.inertia"), (3, 3))
        axes = np.reshape(self.p("spacecraft.axes_wheel"), (3, 4))
        spin = self.p("spacecraft.inertia_wheel")
        omega = self["spacecraft.omega_bi_body"]
        body = (
            inertia - axes @ np.diag(spin) @ axes.T
        )  # wheels' own spin is in h, absolute
        total = omega @ body.T + self["spacecraft.h_copy_wheel"] @ axes.T
        return np.einsum("tij,ti->tj", compute_matrices(self["spacecraft.q_bi"]), total)

    def pointing(self, of: str = "spacecraft.q_bi") -> np.ndarray:
        """The angle from the reference, deg."""
        q, r = self[of], self["guidance.q_ref_bi"]
        n = min(len(q), len(r))
        return angle(q[:n], r[:n])

    def pieces(self) -> np.ndarray:
        """The error's rotation vectors, deg."""
        q, r = self["spacecraft.q_bi"], self["guidance.q_ref_bi"]
        n = min(len(q), len(r))
        return rotation(q[:n], r[:n])

    def lvlh(self) -> dict[str, np.ndarray]:
        """Pitch, roll and yaw from lvlh, deg, turned in this order."""
        r, v = self["environment.r_eci"], self["environment.v_eci"]
        z = -r / np.linalg.norm(r, axis=1)[:, None]
        y = np.cross(v, r)
        y /= np.linalg.norm(y, axis=1)[:, None]
        frame = np.stack([np.cross(y, z), y, z], axis=1)  # rows: its axes in eci
        c = compute_matrices(self["spacecraft.q_bi"]) @ frame.transpose(0, 2, 1)
        return {
            "roll": np.degrees(np.arcsin(np.clip(-c[:, 2, 1], -1.0, 1.0))),
            "pitch": np.degrees(np.arctan2(c[:, 2, 0], c[:, 2, 2])),
            "yaw": np.degrees(np.arctan2(c[:, 0, 1], c[:, 1, 1])),
        }

    def tilt(self) -> np.ndarray:
        """Cosine of the angle of the body's z axis to nadir."""
        r = self["environment.r_eci"]
        z = compute_matrices(self["spacecraft.q_bi"])[:, 2]
        return -(z * r).sum(axis=1) / np.linalg.norm(r, axis=1)

    def rate(self) -> np.ndarray:
        """Size of the rate, deg/s."""
        return np.degrees(np.linalg.norm(self["spacecraft.omega_bi_body"], axis=1))

    def while_phase(self, number: int) -> np.ndarray:
        """The rates, rad/s, at samples in a phase of the manager."""
        phase = self["manager.phase"][:, 0]
        omega = self["spacecraft.omega_bi_body"]
        n = min(len(phase), len(omega))
        return omega[:n][phase[:n] == number]

    def load(self) -> np.ndarray:
        """The most loaded coil, per cent."""
        most = np.abs(self["torquers.m_mean_body"]).max(axis=1)
        return 100.0 * most / self.p("torquers.m_limit")

    def seconds(self, values: np.ndarray) -> np.ndarray:
        """How long each row of an interval series lasts."""
        return np.diff(self.t)[: len(values)]

    def on_time(self) -> float:
        """How long coils were on, summed: of pulses by their mean, else while there is
        a dipole."""
        mean = np.abs(self["torquers.m_mean_body"])
        is_pulsed = self.p("torquers.drive") == "pulsed"
        each = mean / self.p("torquers.m_limit") if is_pulsed else mean > 0.0
        return float(each.sum(axis=1) @ self.seconds(mean))

    def joule(self) -> float:
        """W for a squared dipole of 1 A2 m4."""
        return float(self.p("torquers.resistance") / self.p("torquers.area_turns") ** 2)

    def coil_energy(self) -> float:
        return float(self.joule() * self.squared_dipole().sum())

    def squared_dipole(self) -> np.ndarray:
        """The integral of the squared dipole over each step, A2 m4 s: of coils that are
        on or off by their time, of others linear over a step."""
        mean, slope = self["torquers.m_mean_body"], self["torquers.m_slope_body"]
        if self.p("torquers.drive") == "pulsed":
            limit = self.p("torquers.m_limit")
            each = limit * np.abs(mean)
        else:
            each = mean**2 + slope**2 / 12.0
        coils = np.reshape(self.p("torquers.axes_coil"), (3, -1))
        if (
            np.abs(coils).sum(axis=0) > 0.0
        ).sum() > 3:  # of four coils by what they do themselves
            back = np.linalg.pinv(coils)
            each = (mean @ back.T) ** 2 + (slope @ back.T) ** 2 / 12.0
        return each.sum(axis=1) * self.seconds(mean)


def compute_matrices(q: np.ndarray) -> np.ndarray:
    """Body from eci, (rows, 3, 3), of quaternions with the scalar last."""
    x, y, z, w = q.T
    rows = [
        [w * w + x * x - y * y - z * z, 2 * (x * y + w * z), 2 * (x * z - w * y)],
        [2 * (x * y - w * z), w * w - x * x + y * y - z * z, 2 * (y * z + w * x)],
        [2 * (x * z + w * y), 2 * (y * z - w * x), w * w - x * x - y * y + z * z],
    ]
    return np.array(rows).transpose(2, 0, 1)


def rotation(q: np.ndarray, r: np.ndarray) -> np.ndarray:
    """Rotation vectors (deg) of the turn from attitude r to q, by their matrices."""
    c = compute_matrices(q) @ compute_matrices(r).transpose(0, 2, 1)
    across = np.stack(
        [c[:, 1, 2] - c[:, 2, 1], c[:, 2, 0] - c[:, 0, 2], c[:, 0, 1] - c[:, 1, 0]]
    )
    sine = np.linalg.norm(across, axis=0) / 2.0
    size = np.arctan2(sine, (np.trace(c, axis1=1, axis2=2) - 1.0) / 2.0)
    return np.degrees(size * across / np.where(sine > 0.0, 2.0 * sine, 1.0)).T


def angle(q: np.ndarray, r: np.ndarray) -> np.ndarray:
    return np.linalg.norm(rotation(q, r), axis=1)


def stays(t: np.ndarray, good: np.ndarray) -> float | None:
    """From when on it is good to the end of these rows."""
    if not good[-1]:
        return None
    first = len(good) - int(np.argmin(good[::-1])) if not good.all() else 0
    return float(t[first])


def first(t: np.ndarray, good: np.ndarray) -> float | None:
    return float(t[int(np.argmax(good))]) if good.any() else None


def find_hold_time(t: np.ndarray, good: np.ndarray, seconds: float) -> float | None:
    """The first time from which it is good for so long."""
    for i in np.flatnonzero(good):
        until = t[i] + seconds
        inside = good[(t >= t[i]) & (t <= until + 1e-9)]
        if t[-1] >= until - 1e-9 and inside.all():
            return float(t[i])
    return None


def times(value: float | None, factor: float) -> float | None:
    return None if value is None else value * factor


def last(values: np.ndarray) -> float:
    return float(np.atleast_1d(values[-1])[0])


def changes(values: np.ndarray) -> float:
    """How often the columns cross zero: what is 0 has the sign of before."""
    count = 0
    for column in values.T:
        signs = np.sign(column[column != 0.0])
        count += int((signs[1:] != signs[:-1]).sum())
    return float(count)


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def size(values: np.ndarray) -> np.ndarray:
    return np.sqrt(np.square(values).sum(axis=1))


def share(values: np.ndarray) -> float:
    return 100.0 * float(np.mean(values))


def rpe(f: Flight, begin: float, end: float = math.inf) -> np.ndarray:
    """Relative error over 10 s: of each error vector from the mean of its 10 s."""
    error = f.between(f.pieces(), begin, end)
    n = round(10.0 / (f.t[1] - f.t[0]))
    parts = [error[i : i + n] for i in range(0, len(error) - n + 1, n)]
    return np.concatenate([np.linalg.norm(p - p.mean(axis=0), axis=1) for p in parts])


def largest_angle(
    name: str, begin: float = 0.0, end: float = math.inf
) -> Callable[[Flight], Any]:
    return lambda f: np.abs(f.between(f.lvlh()[name], begin, end)).max()


def measure_settling(since: float, end: float = math.inf) -> Callable[[Flight], Any]:
    """Orbits after `since` until within 2.5, 2.5 and 8 deg to stay; 0 where never
    outside."""

    def orbits(f: Flight) -> float | None:
        a = f.lvlh()
        good = (
            (abs(a["roll"]) <= 2.5) & (abs(a["pitch"]) <= 2.5) & (abs(a["yaw"]) <= 8.0)
        )
        t, good = f.between(f.t, since, end), f.between(good, since, end)
        return (
            0.0
            if good.all()
            else times((x := stays(t, good)) and x - since, 1 / NADIR_PERIOD)
        )

    return orbits


def slow(limit: float) -> Callable[[Flight], Any]:
    return lambda f: stays(f.t, f.rate() < limit)


def points(
    limit: float, unit: float = 1.0, end: float = math.inf
) -> Callable[[Flight], Any]:
    def time_of(f: Flight) -> float | None:
        error = f.pointing()
        t = f.t[: len(error)]
        return times(stays(t[t <= end], error[t <= end] < limit), unit)

    return time_of


def find_detumbling_time(f: Flight, seconds: float = 0.0) -> float | None:
    below = (np.abs(f["spacecraft.omega_bi_body"]) < 0.003).all(axis=1)
    return times(find_hold_time(f.t, below, seconds), 1 / 60)


def full(number: int) -> Callable[[Flight], Any]:
    return lambda f: first(f.t, f.wheels()[:, number - 1] >= f.capacity()[number - 1])


def while_limited(f: Flight, level: float) -> float:
    command = size(f["manager.tau_des_body"])
    rate = size(f["spacecraft.omega_bi_body"])[: len(command)]
    limit = f.p("manager.torque_limit")
    t = f.t[: len(command)]
    rates_at_limit = rate[(t >= 400.0) & (t <= 7200.0) & (command >= 0.9996 * limit)]
    return (
        100.0
        * np.percentile(rates_at_limit, level)
        / (limit / f.p("manager.gain_rate"))
    )


def coil(number: int) -> Callable[[Flight], Any]:
    return lambda f: rms(f["torquers.m_mean_body"][:, number])


def period_end(f: Flight) -> float:
    end = f.p("manager.update_period")
    return RPM * np.abs(f.between(f["wheels.speed_wheel"], end - 5.0, end)).max()


def flag(values: np.ndarray) -> float:
    return float(values.any())


def samples(f: Flight, name: str, by: str) -> np.ndarray:
    """Rows at the samples of a component."""
    every = round(f.p(f"{by}.sample_time") / (f.t[1] - f.t[0])) or 1
    return f[name][::every]


def load_until_below(f: Flight) -> float:
    fill, t = f.between(f.fill(), 0.0, 10800.0), f.between(f.t, 0.0, 10800.0)
    end = stays(t, fill < 11.0)
    load = f.load()
    begins = f.t[: len(load)]
    loads_before = load[begins < (t[-1] if end is None else end) - 1e-6]
    return loads_before.mean() if len(loads_before) else load[0]


def orbit_of(f: Flight) -> float:
    return (
        2.0
        * math.pi
        * math.sqrt(f.p("environment.semi_major_axis") ** 3 / 3.986004418e14)
    )


def after_two(values: np.ndarray, f: Flight) -> np.ndarray:
    return f.between(values, 11400.0)


def along_field(f: Flight) -> float:
    command, b = (
        after_two(f[n], f) for n in ("manager.tau_desired_body", "magnetometer.b_body")
    )
    n = min(len(command), len(b))
    unit = b[:n] / size(b[:n])[:, None]
    return 100.0 * rms((command[:n] * unit).sum(axis=1)) / rms(size(command[:n]))


def find_filling_time(f: Flight) -> float | None:
    """When the wheel has 90 % of its nominal momentum to stay."""
    h = f["wheels.h_wheel"][:, 0]
    return times(stays(f.t, h >= 0.9 * f.p("manager.h_nominal")), 1 / 60)


MIN15, HOUR = 900.0, 3600.0
CLOSE = 1e-6
"""Relative difference that is allowed; beside a title, one of its own."""

TITLES: dict[str, Callable[[Flight], Any] | tuple[Callable[[Flight], Any], float]] = {
    # alsat1
    "Largest roll": largest_angle("roll"),
    "Largest pitch": largest_angle("pitch"),
    "Largest yaw": largest_angle("yaw"),
    "Largest roll, first firing": largest_angle("roll", 40000.0, 80000.0),
    "Largest pitch, first firing": largest_angle("pitch", 40000.0, 80000.0),
    "Largest yaw, first firing": largest_angle("yaw", 40000.0, 80000.0),
    "Largest roll, second firing": largest_angle("roll", 80000.0),
    "Largest pitch, second firing": largest_angle("pitch", 80000.0),
    "Largest yaw, second firing": largest_angle("yaw", 80000.0),
    "Mean size of the roll": lambda f: np.abs(f.lvlh()["roll"]).mean(),
    "Yaw at the end, size": lambda f: abs(f.lvlh()["yaw"][-1]),
    "Yaw rate at the end, size": lambda f: math.degrees(
        abs(f["spacecraft.omega_bi_body"][-1, 2])
    ),
    "Yaw rate after the firing, size": lambda f: math.degrees(
        abs(f.at("spacecraft.omega_bi_body", 32.0)[2])
    ),
    "Largest yaw rate": lambda f: math.degrees(
        np.abs(f["spacecraft.omega_bi_body"][:, 2]).max()
    ),
    "Orbits after the first firing until within 2.5 (roll, pitch) and 8 deg (yaw) to stay": measure_settling(
        40000.0, 80000.0
    ),
    "Orbits after the second firing until within 2.5 (roll, pitch) and 8 deg (yaw) to stay": measure_settling(
        80000.0
    ),
    "Orbits after the fifth until within 2.5 (roll, pitch) and 8 deg (yaw) to stay": measure_settling(
        30642.0
    ),
    "Mean power of the wheels: 0.1 W each and what their torque takes, ours": lambda f: (
        f["wheels.power"].mean()
    ),
    "How often a wheel's speed changes its sign": lambda f: changes(
        f["wheels.speed_wheel"]
    ),
    "Largest torque of the wheel": lambda f: (
        1e3 * np.abs(np.diff(f["wheels.h_wheel"][:, 0]) / np.diff(f.t)).max()
    ),
    "Cosine of the tilt at the end: 1 upright, -1 upside down": lambda f: f.tilt()[-1],
    "Time until the cosine of the tilt is above 0.5 to stay, in ten orbits of 6128.46 s": lambda f: (
        times(stays(f.t, f.tilt() >= 0.5), 100.0 / (10.0 * NADIR_PERIOD))
    ),
    "Coils on, summed over the three": lambda f: f.on_time(),
    "Mean power of the coils": lambda f: f.coil_energy() / f.t[-1],
    "Largest momentum of a wheel": lambda f: np.abs(f["wheels.h_wheel"]).max(),
    "A wheel saturated (1: yes)": lambda f: flag(
        f.wheels() >= f.capacity() * (1.0 - 1e-12)
    ),
    "Momentum of the wheel an orbit after the first firing": lambda f: (
        1e3 * size(f.momentum())[int(np.searchsorted(f.t, 40030.0 + NADIR_PERIOD)) - 1]
    ),
    "External impulse at the end of the orbit": lambda f: (
        1e3 * np.linalg.norm(f["spacecraft.impulse_eci"][-1])
    ),
    "External impulse, largest in the orbit": lambda f: (
        1e3 * size(f["spacecraft.impulse_eci"]).max()
    ),
    "Root mean square dipole of the coil along x, mean over each step": coil(0),
    "Root mean square dipole of the coil along y, mean over each step": coil(1),
    "Root mean square dipole of the coil along z, mean over each step": coil(2),
    # gyrostat, nadir_day, plant
    "Attitude error at the end": lambda f: f.pointing()[-1],
    "Wheel momentum at the end": lambda f: size(f.momentum())[-1],
    "Wheel momentum in body at the end": lambda f: size(f.momentum())[-1],
    "Largest momentum of the wheels together after orbit 2": lambda f: size(
        after_two(f.momentum(), f)
    ).max(),
    "Momentum of the wheels together after orbit 2, root mean square": lambda f: rms(
        size(after_two(f.momentum(), f))
    ),
    "Largest momentum of a wheel after orbit 2": lambda f: np.abs(
        after_two(f["wheels.h_wheel"], f)
    ).max(),
    "Pointing error, rms": lambda f: rms(f.pointing()),
    "Largest wheel speed": lambda f: np.abs(f["wheels.speed_wheel"]).max(),
    # hausat2
    "Angle between rate and field from 30 to 90 min, mean": lambda f: np.mean(
        [
            math.degrees(
                math.acos(min(1.0, abs(w @ b) / np.linalg.norm(w) / np.linalg.norm(b)))
            )
            for w, b, t in zip(
                f["spacecraft.omega_bi_body"],
                f["magnetometer.b_body"],
                f.t,
                strict=False,
            )
            if 1800.0 <= t <= 5400.0
        ]
    ),
    "Largest pointing error in the first second": lambda f: f.between(
        f.pointing(), 0.0, 1.0
    ).max(),
    "Pointing error at the end": lambda f: f.pointing()[-1],
    "All rates below 0.003 rad/s at once": find_detumbling_time,
    "All rates below 0.003 rad/s at once, for 60 s": lambda f: find_detumbling_time(
        f, 60.0
    ),
    "Wheel speed at the end, size": lambda f: RPM * abs(f["wheels.speed_wheel"][-1, 0]),
    "Energy of the coils": lambda f: f.coil_energy() / 3600.0,
    "On-time of the coils, summed: times 1 W the energy of coils that are on or off": lambda f: (
        f.on_time() / 3600.0
    ),
    "Energy of the wheel: 2 W at 2500 rpm, in proportion to its speed": lambda f: (
        2.0
        / 3600.0
        * np.trapezoid(
            RPM * np.abs(f["wheels.speed_wheel"][:, 0]) / 2500.0,
            f.t[: len(f["wheels.speed_wheel"])],
        )
    ),
    "A coil was commanded to its limit (1: yes)": lambda f: flag(
        np.abs(f["manager.m_cmd_body"]) >= f.p("torquers.m_limit") * (1.0 - 1e-12)
    ),
    "The wheel saturated (1: yes)": lambda f: flag(
        f.wheels() >= f.capacity() * (1.0 - 1e-12)
    ),
    "Pitch spin reached": lambda f: times(
        first(f.t, f["manager.phase"][:, 0] == 2), 1 / 60
    ),
    "Sign changes of the wheel's torque from 10 to 15 min": lambda f: changes(
        f.between(f["manager.tau_cmd_wheel"][:, :1], 600.0, 900.0)
    ),
    "Pointing error below 10 deg to stay": points(10.0),
    "Pointing error below 5 deg to stay": points(5.0),
    "Largest rate of an axis while the wheel is filled by the coils": lambda f: (
        math.degrees(np.abs(f.while_phase(3)).max())
    ),
    "Largest rate of an axis from then on, until three-axis": lambda f: math.degrees(
        np.abs(f.while_phase(4)).max()
    ),
    "Largest rate of an axis after that": lambda f: math.degrees(
        np.abs(f.while_phase(5)).max()
    ),
    "Largest roll rate during the pitch spin": lambda f: np.abs(
        f.while_phase(1)[:, 0]
    ).max(),
    "Wheel at 90 % of its nominal momentum to stay": find_filling_time,
    "Wheel at its nominal momentum": lambda f: times(
        first(f.t, f["manager.phase"][:, 0] == 4), 1 / 60
    ),
    # integrated
    "Mean wheel at the end, share of its capacity": lambda f: f.fill()[-1],
    "Mean wheel at the end, by null-space momentum alone, share of its capacity": lambda f: (
        f.null(-1)
    ),
    "Largest wheel momentum (share of capacity)": lambda f: (
        100.0 * (f.wheels() / f.capacity()).max()
    ),
    "Mean wheel at the start, share of its capacity": lambda f: f.fill()[0],
    "Mean wheel at the start, by null-space momentum alone, share of its capacity": lambda f: (
        f.null(0)
    ),
    "Mean wheel at 3 h, share of its capacity": lambda f: (
        f.fill()[np.abs(f.t - 10800.0).argmin()] if f.t[-1] >= 10800.0 else None
    ),
    "Mean wheel at 3 h by null-space momentum alone, share of its capacity": lambda f: (
        f.null(np.abs(f.t - 10800.0).argmin()) if f.t[-1] >= 10800.0 else None
    ),
    "Mean wheel from 2 h on, share of its capacity": lambda f: f.between(
        f.fill(), 7200.0
    ).mean(),
    "Build-up dumped: mean wheel below 11 % to stay": lambda f: stays(
        f.t, f.fill() < 11.0
    ),
    "Last mean wheel above the larger of 6 % and what null-space momentum makes": lambda f: (
        f.fill()[-1] - max(6.0, f.null(-1))
    ),
    "Load of the most loaded coil, mean": lambda f: f.load().mean(),
    "Load of the most loaded coil from 2 h on, mean": lambda f: (
        f.between(f.load(), 7200.0).mean() if f.t[-1] > 7200.0 else None
    ),
    "Load of the most loaded coil until the mean wheel is below 11 % (at most 3 h), mean": load_until_below,
    "Pointing error (APE) from 15 min on, mean": lambda f: f.between(
        f.pointing(), MIN15
    ).mean(),
    "APE, 95 % of the time below": lambda f: np.percentile(
        f.between(f.pointing(), MIN15), 95.0
    ),
    "Pointing error (APE) in the last hour, mean": lambda f: f.between(
        f.pointing(), f.t[-1] - HOUR
    ).mean(),
    "Relative pointing error (RPE) over 10 s, mean": lambda f: rpe(f, MIN15).mean(),
    "RPE over 10 s, 95 % of the time below": lambda f: np.percentile(
        rpe(f, MIN15), 95.0
    ),
    "RPE over 10 s from 15 to 100 min, mean": lambda f: rpe(f, MIN15, 6000.0).mean(),
    "Pointing error without the determination's: estimate against reference from 15 min on, mean": lambda f: (
        f.between(f.pointing("determination.q_meas_bi"), MIN15).mean()
    ),
    "Pointing error below 5 deg for the rest of the first hour": points(5.0, end=HOUR),
    "Pointing error from 15 min on, largest": lambda f: f.between(
        f.pointing(), MIN15
    ).max(),
    "Pointing error from 1 h on, largest": lambda f: f.between(
        f.pointing(), HOUR
    ).max(),
    "Pointing error while the reference turns, from 15 min to 1.5 h, largest": lambda f: (
        f.between(f.pointing(), MIN15, 1.5 * HOUR).max()
    ),
    "Pointing error in the last 10 min, largest": lambda f: f.between(
        f.pointing(), f.t[-1] - 600.0
    ).max(),
    "Time that wheels spend within 2 % of standing still": lambda f: (
        share(
            f.between(np.abs(f["wheels.speed_wheel"]), 7200.0)
            < 0.02 * f.p("wheels.speed_limit")
        )
        if f.t[-1] > 7200.0
        else None
    ),
    "Zero crossings of the wheels from 2 h on": lambda f: (
        changes(f.between(f["wheels.speed_wheel"], 7200.0))
        if f.t[-1] > 7200.0
        else None
    ),
    "Dipole of a coil when the magnetometer samples, largest": lambda f: (
        100.0
        * np.abs(samples(f, "torquers.m_body", "magnetometer")).max()
        / f.p("torquers.m_limit")
    ),
    "Control torque from 15 min on, mean size, of which coils give k": lambda f: (
        1e6 * size(f.between(f["controller.tau_ctrl_body"], MIN15)).mean()
    ),
    "First saturation of a wheel": lambda f: first(
        f.t, (f.wheels() >= f.capacity()).any(axis=1)
    ),
    "Two wheels at their limit at once, from": lambda f: first(
        f.t, (f.wheels() >= f.capacity()).sum(axis=1) >= 2
    ),
    "First saturation of wheel 1": full(1),
    "First saturation of wheel 2": full(2),
    "First saturation of wheel 3": full(3),
    "Electric power of the wheels from 15 to 100 min, mean": lambda f: (
        1e3 * f.between(f["wheels.power"], MIN15, 6000.0).mean()
    ),
    "Electric power of the coils from 15 to 100 min, mean": lambda f: (
        1e3 * f.joule() * rms(f.between(size(f["torquers.m_body"]), MIN15, 6000.0)) ** 2
    ),
    "Fall of the wheels' momentum per second, share of torque_limit": (
        lambda f: (
            100.0
            * (size(f.momentum())[0] - size(f.momentum())[-1])
            / f.t[-1]
            / f.p("manager.torque_limit")
        ),
        1e-3,
    ),
    "Rate below 1 deg/s to stay": slow(1.0),
    "Rate below 0.1 deg/s to stay": slow(0.1),
    "Rate from 25 to 30 min, mean": (
        lambda f: f.between(f.rate(), 1500.0, 1800.0).mean(),
        1e-3,
    ),
    "Rate in the last 5 min, mean": lambda f: f.between(
        f.rate(), f.t[-1] - 300.0
    ).mean(),
    "Rate while t_DES is saturated, from 400 s on, 95 % of the time below, per torque_limit / "
    "gain_rate": lambda f: while_limited(f, 95.0),
    "Rate while t_DES is saturated, from 400 s on, half of the time below, per torque_limit / "
    "gain_rate": lambda f: while_limited(f, 50.0),
    # space_telescope
    "Momentum of the craft after orbit 2, root mean square of its size": lambda f: rms(
        size(after_two(f.craft(), f))
    ),
    "Momentum of the craft at the end": lambda f: size(f.craft())[-1],
    "Largest momentum of the craft from the slew on": lambda f: size(
        f.between(f.craft(), 6600.0)
    ).max(),
    "Wheel speed after orbit 2, root mean square over time and wheels": lambda f: (
        RPM * rms(after_two(f["wheels.speed_wheel"], f))
    ),
    "Largest wheel speed after orbit 2": lambda f: (
        RPM * np.abs(after_two(f["wheels.speed_wheel"], f)).max()
    ),
    "Largest wheel speed of the slew": lambda f: (
        RPM * np.abs(f.between(f["wheels.speed_wheel"], 6600.0, 9300.0)).max()
    ),
    "Integral of the squared coil dipoles per orbit, after orbit 2": (
        lambda f: (
            after_two(f.squared_dipole(), f).sum() * orbit_of(f) / (f.t[-1] - 11400.0)
        ),
        1e-3,
    ),
    "Integral of the squared coil dipoles over slew, lead and lag time": (
        lambda f: f.between(f.squared_dipole(), 6600.0, 9300.0 - 1e-3).sum(),
        1e-3,
    ),
    "Share of the desired torque along the field after orbit 2, root mean squares": along_field,
    "Share of time with a valid attitude": (
        lambda f: 100.0 * f["star_tracker.valid"][:-1].mean(),
        1e-4,
    ),
    "Largest pointing error after the first 30 min": lambda f: f.between(
        f.pointing(), 1800.0
    ).max(),
    "Largest condition of the costate's matrix after orbit 2": lambda f: after_two(
        f["manager.condition"], f
    ).max(),
    "The coil that is found lost; 0: none ever": lambda f: f["manager.lost_coil"].max(),
    "Gravity gradient over what the law knows, as learnt by the end": lambda f: last(
        f["manager.gravity_scale"]
    ),
    "When the dead coil is found": lambda f: times(
        first(f.t, f["manager.lost_coil"][:, 0] != 0), 1 / 60
    ),
    "Fastest wheel in the last 5 s of the first update period": period_end,
    # uosat12
    "Thruster firing time": (
        lambda f: (
            (
                np.abs(f["thrusters.tau_mean_thruster_body"])
                / f.p("thrusters.tau_level")
            ).sum(axis=1)
            @ f.seconds(f["thrusters.tau_mean_thruster_body"])
        ),
        1e-9,
    ),
    "Dipole energy, half the integral of the squared dipole": lambda f: (
        0.5 * f.squared_dipole().sum()
    ),
    "Largest dipole of an axis, mean over each step": lambda f: np.abs(
        f["torquers.m_mean_body"]
    ).max(),
    "Pointing error, largest during the dump": lambda f: f.pointing().max(),
    "Thruster torque commanded, rms": lambda f: rms(
        size(f["manager.tau_cmd_thruster_body"])
    ),
}

TO = {"min": 1 / 60, "rpm": RPM, "mN.m.s": 1e3}
"""Titles that several families have in units of their own: what their functions give is
in SI."""
IN_SI = {
    "Pointing error below 10 deg to stay",
    "Pointing error below 5 deg to stay",
    "Largest wheel speed",
    "Largest momentum of a wheel",
}
PLENTY = 300_000
"""Steps; a definition whose shortest scenario has more would be flown with an earlier
stop."""


def definitions() -> dict[str, tuple[dict[str, Any], list[tuple[str, str]]]]:
    """Each definition of a number, and the scenarios (with its name there) that have
    it."""
    definitions_by_key: dict[str, tuple[dict[str, Any], list[tuple[str, str]]]] = {}
    for scenario, content in scenarios().items():
        for name, number in content.content.written.get("numbers", {}).items():
            if "reference" not in number:
                key = json.dumps(number, sort_keys=True)
                definitions_by_key.setdefault(key, (number, []))[1].append(
                    (scenario, name)
                )
    return definitions_by_key


def steps(scenario: str) -> float:
    content = scenarios()[scenario].content
    return content.stop / content.step


def flights() -> dict[str, list[tuple[str, dict[str, Any]]]]:
    """Scenario -> the numbers to look at in its run: few runs, short ones."""
    todo = definitions()
    numbers_by_scenario: dict[str, list[tuple[str, dict[str, Any]]]] = {}
    for number, place in sorted(
        todo.values(), key=lambda x: min(steps(s) for s, _ in x[1])
    ):
        until = number.get("window", (0.0, 0.0))[1] % 1e9
        full = [w for w in place if scenarios()[w[0]].content.stop >= until]
        place = full or place
        there = [w for w in place if w[0] in numbers_by_scenario]
        preferred_scenario = PREFERRED.get(number["title"])
        if preferred_scenario in dict(place):
            there = [w for w in place if w[0] == preferred_scenario]
        scenario, name = min(there or place, key=lambda w: steps(w[0]))
        numbers_by_scenario.setdefault(scenario, []).append((name, number))
    return numbers_by_scenario


PREFERRED = {
    **dict.fromkeys(
        (
            "First saturation of a wheel",
            "Two wheels at their limit at once, from",
            *(f"First saturation of wheel {k}" for k in (1, 2, 3)),
            "A wheel saturated (1: yes)",
        ),
        "integrated/mil-unmanaged-extra",
    ),
    "Electric power of the coils from 15 to 100 min, mean": "integrated/mil-unmanaged-extra-managed",
    "Coils on, summed over the three": "alsat1/noise-y-wheel",
    "Mean power of the coils": "alsat1/noise-y-wheel",
    "The coil that is found lost; 0: none ever": "space_telescope/ours-dead-unknown",
    "Time that wheels spend within 2 % of standing still": "integrated/mil-null-space",
    "Zero crossings of the wheels from 2 h on": "integrated/mil-null-space",
}
"""Where a number has something to show."""


@functools.lru_cache(maxsize=1)
def fly(scenario: str) -> Flight:
    assert steps(scenario) <= PLENTY
    return Flight(execute(scenario, Options()))


CASES = [
    (s, name, number) for s, numbers in flights().items() for name, number in numbers
]


def test_every_number_has_a_second_computation():
    titles = {number["title"] for number, _ in definitions().values()}
    assert titles - TITLES.keys() == set(), (
        "compute them here, from their titles' words"
    )
    assert TITLES.keys() - titles == set(), "no number has these titles any more"


@pytest.mark.parametrize(
    ("scenario", "name", "number"), CASES, ids=[f"{s}-{n}" for s, n, _ in CASES]
)
def test_a_number_is_what_its_title_says(scenario, name, number):
    flight = fly(scenario)
    title = number["title"]
    assert title in TITLES, f"{title}: its formula is missing in TITLES of this file"
    way = TITLES[title]
    compute, tolerance = way if isinstance(way, tuple) else (way, CLOSE)
    message = flight.run.manifest["numbers"][name]["value"]
    try:
        own_value = compute(flight)
    except (IndexError, ValueError):  # no row of its window: nothing there
        own_value = None
    own_value = None if own_value is None or math.isnan(own_value) else float(own_value)
    if own_value is not None and number["title"] in IN_SI:
        own_value *= TO.get(number["unit"], 1.0)
    assert (message is None) == (own_value is None), (message, own_value)
    if message is not None:
        assert message == pytest.approx(own_value, rel=tolerance, abs=1e-9)


def test_a_number_at_a_time_is_of_that_time_alone():
    """Of a run that ends before it there is none."""
    for number, place in definitions().values():
        if re.search(r"\bat (the start|[\d.]+ (min|h))\b", number["title"]):
            begin, end = number["window"]
            assert begin == end, f"{place[0][0]}: {number['title']}"


def over_time(values: np.ndarray, t: np.ndarray) -> float:
    """The rms over time: between rows the square changes linearly."""
    return float(np.sqrt(integrate.trapezoid(values**2, t) / (t[-1] - t[0])))


def left_without(f: Flight) -> tuple[float, float]:
    """What management leaves in the wheels, and what would be in them had the coils
    done nothing, over the second half: rms. By scipy's rotations, coils' torque at both
    ends of each step."""
    turn, late = (
        Rotation.from_quat(f["spacecraft.q_bi"]),
        f.t >= 0.5 * (f.t[0] + f.t[-1]),
    )
    m, b = f["torquers.m_mean_body"], f["environment.b_eci"]
    ends = [
        np.cross(r.apply(m), x) for r, x in ((turn[:-1], b[:-1]), (turn[1:], b[1:]))
    ]
    coils = np.vstack(
        [np.zeros(3), np.cumsum(sum(ends) / 2.0 * np.diff(f.t)[:, None], axis=0)]
    )
    momentum = f.momentum("spacecraft.h_copy_wheel")
    without = momentum - turn.inv().apply(coils)
    return tuple(over_time(size(x)[late], f.t[late]) for x in (momentum, without))


def standard(f: Flight) -> dict[str, Any]:
    """The standard numbers of a managed run (analyses/management.py), from their
    titles."""
    remaining, without = left_without(f)
    momentum, h = (
        size(f.momentum("spacecraft.h_copy_wheel")),
        f["spacecraft.h_copy_wheel"],
    )
    axes, there = f.axes("spacecraft"), f.there()
    # what adds up to nothing: h less the least h of the same sum
    idle = [
        x - np.linalg.lstsq(axes[:, there], axes[:, there] @ x, rcond=None)[0]
        for x in h[:, there]
    ]
    coils = np.abs(f["torquers.m_mean_body"])  # three, along the body's axes
    most = float(f.p("torquers.m_limit"))
    speed, steps_ = f["wheels.speed_wheel"][:, there], np.diff(f.t)
    # speeds are recorded with the body's rate of a step's begin, and limited with that
    # within
    at_limit = [
        np.abs(speed) >= f.p("wheels.speed_limit") * (1.0 - x) for x in (0.0, 1e-4)
    ]
    return {
        "sum_rms": over_time(momentum, f.t),
        "sum_largest": momentum.max(),
        "null_rms": over_time(np.abs(idle).max(axis=1), f.t),
        "coil_duty": 100.0 * coils.mean() / most,
        "coil_limit_share": share((coils >= 0.999 * most).any(axis=1)),
        "momentum_margin": 100.0 - 100.0 * (np.abs(h[:, there]) / f.capacity()).max(),
        "limit_time": tuple(steps_ @ x.any(axis=1) for x in at_limit),
        "crossings": changes(speed),
        "left_rms": remaining,
        "unmanaged_rms": (0.9999 * without, 1.0001 * without),
    }


@pytest.mark.parametrize(
    "scenario", ["integrated/mil-unmanaged-extra", "nadir_day/day-dipole"]
)
def test_the_standard_numbers_are_what_their_titles_say(scenario):
    f = fly(scenario)
    numbers = standard(f)
    assert numbers.keys() == set(management.NUMBERS) - {
        "least_braking"
    }  # of laws that brake
    for name, value in numbers.items():
        message = f.run.manifest["numbers"][name]["value"]
        low, high = value if isinstance(value, tuple) else (value, value)
        assert (
            low - 1e-9 * abs(low) - 1e-12 <= message <= high + 1e-9 * abs(high) + 1e-12
        ), name


FORMS = {
    "saving": r"\bsaved\b",
    "ratio": r"= 1\b|\bover that\b",
    "paired_ratio": r"= 1\b",
    "difference": r"\bless that\b",
}


def test_a_number_that_compares_says_how():
    """A ratio is over something, or that is 1; a difference is less it; a saving saves."""
    for scenario, content in scenarios().items():
        for name, number in content.content.written.get("numbers", {}).items():
            if "reference" in number:
                text, form = number["title"], number["form"]
                assert re.search(FORMS[form], text), (
                    f"{scenario}: {name}: {form}: {text}"
                )
                others = [x for k, x in FORMS.items() if FORMS[k] != FORMS[form]]
                if form == "difference":
                    assert not re.search(FORMS["ratio"], text), f"{scenario}: {text}"
                if form in ("ratio", "paired_ratio"):
                    assert not re.search(r"\bless\b", text), f"{scenario}: {text}"
                assert others


# --- plots ----------------------------------------------------------------------------

PER = {
    ("rad/s", "deg/s"): 180.0 / math.pi,
    ("rad/s", "rpm"): RPM,
    ("N.m.s", "mN.m.s"): 1e3,
    ("N.m", "mN.m"): 1e3,
    ("N.m", "uN.m"): 1e6,
    ("T", "uT"): 1e6,
    ("s", "h"): 1 / 3600,
}
"""What a value in the first unit is multiplied by to be in the second."""

SHOWN = {
    # word of a title -> what it must be drawn of
    "angular rate": {"spacecraft.omega_bi_body"},
    "wheel momentum": {"wheels.h_wheel", "spacecraft.h_copy_wheel"},
    "momentum of the wheels": {"wheels.h_wheel"},
    "momentum of each wheel": {"wheels.h_wheel"},
    "momentum of the craft": {"spacecraft.impulse_eci"},
    "momentum in and out": {"spacecraft.impulse_eci"},
    "external impulse": {"spacecraft.impulse_eci"},
    "speed": {"wheels.speed_wheel"},
    "torque on the rotors": {"wheels.tau_mean_wheel"},
    "dipole energy": {"torquers.dipole_energy"},
    "dipole": {"torquers.m_mean_body", "torquers.m_coil"},
    "on-time of the coils": {"torquers.on_time"},
    "power of the coils": {"torquers.power"},
    "phase of the manager": {"manager.phase"},
    "what the manager lacks": {"manager.reason"},
    "desaturation torque": {"manager.tau_des_body"},
    "thruster pulses": {"thrusters.tau_mean_thruster_body"},
    "thruster firing time": {"thrusters.on_time"},
    "geomagnetic field": {"magnetometer.b_body"},
    "angle between rate and field": {"spacecraft.omega_bi_body", "magnetometer.b_body"},
    "pointing error": {"spacecraft.q_bi", "guidance.q_ref_bi"},
    "attitude": {"spacecraft.q_bi"},
    "yaw": {"spacecraft.q_bi"},
    "roll and pitch": {"spacecraft.q_bi"},
}


def budget(f: Flight) -> list[np.ndarray]:
    """Sizes of the momentum since the start by disturbances, by coils and by both, at
    each row: the coils' torque with field and attitude of the middle of each step."""
    q, b, m = f["spacecraft.q_bi"], f["environment.b_eci"], f["torquers.m_mean_body"]
    middle = q[:-1] + q[1:]
    middle /= np.linalg.norm(middle, axis=1)[:, None]
    dipole = np.einsum("tij,ti->tj", compute_matrices(middle), m)
    torque = np.cross(dipole, (b[:-1] + b[1:]) / 2.0)
    coils = np.vstack([np.zeros(3), np.cumsum(torque * np.diff(f.t)[:, None], axis=0)])
    full = f["spacecraft.impulse_eci"]
    return [size(full - coils), size(coils), size(full)]


def euler_of(f: Flight) -> list[np.ndarray]:
    """Pitch, roll and yaw from the reference, turned in this order."""
    q, r = f["spacecraft.q_bi"], f["guidance.q_ref_bi"]
    n = min(len(q), len(r))
    c = compute_matrices(q[:n]) @ compute_matrices(r[:n]).transpose(0, 2, 1)
    angles = (
        np.arctan2(c[:, 2, 0], c[:, 2, 2]),
        np.arcsin(np.clip(-c[:, 2, 1], -1, 1)),
        np.arctan2(c[:, 0, 1], c[:, 1, 1]),
    )
    return [np.degrees(a) for a in angles]


def between_lines(f: Flight) -> list[np.ndarray]:
    a, b = f["spacecraft.omega_bi_body"], f["magnetometer.b_body"]
    n = min(len(a), len(b))
    cosine = np.abs((a[:n] * b[:n]).sum(axis=1)) / size(a[:n]) / size(b[:n])
    return [np.degrees(np.arccos(np.minimum(cosine, 1.0)))]


DERIVED: dict[str, Callable[[Flight], list[np.ndarray]]] = {
    "pointing": lambda f: [f.pointing()],
    "error_vector": lambda f: list(f.pieces().T),
    "euler": euler_of,
    "euler_lvlh": lambda f: [f.lvlh()[a] for a in ("pitch", "roll", "yaw")],
    "angle_between": between_lines,
    "momentum_budget": budget,
}


def plots() -> list[tuple[str, str, dict[str, Any]]]:
    """Each definition of a plot, in the shortest scenario that has it."""
    plots_by_definition: dict[str, list[tuple[str, str, dict[str, Any]]]] = {}
    for scenario, content in scenarios().items():
        for name, plot in content.content.written.get("plots", {}).items():
            about = {
                k: v
                for k, v in plot.items()
                if k
                in (
                    "title",
                    "signals",
                    "components",
                    "derive",
                    "sequence",
                    "unit",
                    "norm",
                )
            }
            plots_by_definition.setdefault(
                json.dumps(about, sort_keys=True), []
            ).append((scenario, name, about))
    shortest = (
        min(place, key=lambda w: steps(w[0])) for place in plots_by_definition.values()
    )
    return sorted(shortest, key=lambda w: w[0])


PLOTS = plots()


@pytest.mark.parametrize(
    ("scenario", "name", "plot"), PLOTS, ids=[f"{s}-{n}" for s, n, _ in PLOTS]
)
def test_a_plot_is_what_its_title_says(scenario, name, plot):
    f, title = fly(scenario), plot["title"].lower()
    word = next((w for w in SHOWN if w in title), None)
    assert word is not None, f"{title}: what is it drawn of?"
    assert SHOWN[word] & set(plot["signals"]), plot["signals"]
    unit = plot.get("unit", "1")
    lines = lines_of(Plot(**plot), f.run.results, unit)
    if "derive" in plot:
        curves = DERIVED[plot["derive"]](f)
        names, scale = (
            plot.get("components", ["all"] * len(curves)),
            PER.get(("N.m.s", unit), 1.0),
        )
        curves = [scale * w for w, n in zip(curves, names, strict=False) if n]
    else:
        (signal,) = plot["signals"]
        own_value = f.run.results.attribute(signal, "unit") or "1"
        values = f[signal] * (1.0 if own_value == unit else PER[own_value, unit])
        names = plot.get("components") or [str(i) for i in range(values.shape[1])]
        curves = [v for v, n in zip(values.T, names, strict=False) if n]
        if plot.get("norm"):
            assert "size" in title
            curves = [size(values)]
        else:
            assert "size" not in title
        if names == ["x", "y", "z"] and "wheel" in signal:
            # a wheel is named by an axis that it lies along
            axes = f.axes(signal.partition(".")[0])
            assert np.array_equal(axes[:, :3], np.eye(3)), (
                f"{title}: x, y, z are no wheels' axes"
            )
    assert len(lines) == len(curves)
    for line, values in zip(lines, curves, strict=True):
        scale = np.abs(values).max() or 1.0
        n = min(len(values), len(line.values))
        assert n > len(values) - 2
        np.testing.assert_allclose(
            line.values[:n], values[:n], rtol=0.0, atol=2e-6 * scale
        )


@pytest.mark.parametrize(
    ("text", "line"),
    [
        (
            '[plots.momentum]\nsignals = ["wheels.h_wheel"]\nderive = "in_body"',
            "plots.momentum.derive: in_body is of numbers only",
        ),
        (
            '[numbers.momentum]\nsignal = "torquers.m_coil"\nunit = "A.m2"',
            "numbers.momentum: torquers has no parameter axes_wheel",
        ),
    ],
)
def test_a_vector_of_the_wheels_needs_their_axes(desat, tmp_path, text, line):
    file = tmp_path / "own.toml"
    file.write_text(f'extends = "nadir_day/day-dipole"\nstop = 10.0\n{text}\n')
    outcome = desat("check", str(file))
    assert outcome.returncode == 1
    assert line in " ".join((outcome.stdout + outcome.stderr).split())
