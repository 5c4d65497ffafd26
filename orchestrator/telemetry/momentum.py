"""Compute from a log the momentum of a craft that its torques have to explain.

    y(t) = C^T (I omega + A h) - impulse of coils and thrusters

y is that of body and wheels in eci, averaged over BLOCK_TIME. It is known up to a
constant in each segment: gaps of the log, and pulses of thrusters that it does not
have, end a segment.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..analyses import flight as flights
from ..analyses.motion import mu_of, period_of
from ..numbers.derived import coil_impulse, cross, rotate_back
from ..numbers.spline import Spline
from ..system.errors import DesatError
from ..system.model import System
from ..system.wheels import axes_of, existing
from .log import Log, align_signs

Array = NDArray[np.float64]
BLOCK_TIME = 10.0  # s: rows of a log are averaged over it
GRID_TIME = 20.0  # s: distance of the times at which torques are computed
NODE_TIME = 60.0  # s: distance of the times at which the environment is
RATE_TIME = 300.0  # s: attitudes that give a rate are this far apart, for their noise
GAP = 3.0  # a longer interval than this many of the log's median ends a segment
SPARSE = 1.5  # rows are thinner than the coils' samples beyond this many sample times
JUMP = 20.0  # a larger change of the momentum than this many of the median is a pulse


@dataclass(frozen=True)
class MeasuredMomentum:
    """Momentum that the craft's own torques have to explain, and where it flew."""

    flight: flights.Flight  # on the grid
    times: Array  # (n,) s, of the blocks
    segments: NDArray[np.intp]  # (n,) number of each block's segment
    y: Array  # (n, 3) N m s, eci
    h: Array  # (n, 3) N m s, eci: of body and wheels
    dipole: Array  # (rows, 3) A m2, body: of the coils on the grid

    def at_blocks(self, impulse: Array) -> Array:
        """Interpolate an impulse (rows, 3) N m s on the grid to the blocks (n, 3)."""
        grid = self.flight.times
        return np.stack([np.interp(self.times, grid, x) for x in impulse.T], axis=1)


def measure_momentum(system: System, log: Log) -> MeasuredMomentum:
    """Compute the momentum of a craft from a log.

    Raises
    ------
    DesatError
        If the log lacks what is needed, has other wheels than the craft, or is shorter
        than an orbit; or attitude or environment are unknown.
    """
    h_wheel = _wheel_momentum(system, log)
    dipole = _coil_dipole(system, log)
    thrust = log.values.get("thrust", np.zeros((len(log.times), 3)))
    q = log.values.get("attitude")
    complete = np.isfinite(np.hstack([h_wheel, dipole, thrust])).all(axis=1)
    if q is not None:
        complete &= np.isfinite(q).all(axis=1)
    rate = log.values.get("rate")
    if rate is not None:
        complete &= np.isfinite(rate).all(axis=1)
    if complete.sum() < 2:
        raise DesatError(f"{log.place}: no two rows have all columns")
    times = log.times[complete]
    steps = np.diff(times)
    segments = np.cumsum(np.append(0, steps > GAP * np.median(steps)))
    blocks = _Blocks(times, segments)
    nodes, inputs = _environment(system, times, log.place)
    grid = np.linspace(times[0], times[-1], int((times[-1] - times[0]) / GRID_TIME) + 2)
    on_grid = flights.between(inputs, nodes, grid)
    flight = _fly(
        system, None if q is None else q[complete], blocks, on_grid, grid, log
    )
    q = Spline(grid, flight.q)(times) if q is None else q[complete]
    omega = Spline(grid, flight.omega)(times) if rate is None else rate[complete]
    h = rotate_back(q, omega @ _inertia(system, log).T + h_wheel[complete])
    fine = np.union1d(times, grid)
    row_at = _rows_of(system, times, fine)
    b = flights.between(inputs, nodes, fine)["b_eci"]
    q_fine = Spline(grid, flight.q)(fine)
    outer = coil_impulse(fine, b, q_fine, dipole[complete][row_at])
    outer += flights.integral(rotate_back(q_fine, thrust[complete][row_at]), fine)
    y = h - outer[np.searchsorted(fine, times)]
    if "thrusters" in system.roles and "thrust" not in log.values:
        blocks = _Blocks(times, segments + _count_pulses(y))
    return MeasuredMomentum(
        flight,
        blocks.times,
        blocks.segments,
        blocks.mean(y),
        blocks.mean(h),
        dipole[complete][row_at[np.searchsorted(fine, grid)]],
    )


def _rows_of(system: System, times: Array, fine: Array) -> NDArray[np.intp]:
    """Return the row of a log whose dipole holds at each of more times (s).

    It is the last one where the log has each sample of the coils, else the nearest.
    """
    coils = system.roles.get("torquers")
    sample_time = 0.0 if coils is None else float(coils.values.get("sample_time", 0.0))
    step = float(np.median(np.diff(times)))
    shift = 0.5 * step if step > SPARSE * sample_time else 0.0
    rows = np.searchsorted(times, fine + shift, "right") - 1
    return np.clip(rows, 0, len(times) - 1)


def _count_pulses(y: Array) -> NDArray[np.intp]:
    """Count the pulses of thrusters up to each row of a momentum (n, 3) N m s."""
    change = np.linalg.norm(np.diff(y, axis=0), axis=1)
    return np.cumsum(np.append(0, change > JUMP * np.median(change)))


class _Blocks:
    """Blocks of rows of a log, which are averaged."""

    def __init__(self, times: Array, segments: NDArray[np.intp]) -> None:
        """Divide rows at `times` (n,) s into blocks that lie in one segment each."""
        number = np.floor((times - times[0]) / BLOCK_TIME)
        begins = (np.diff(number, prepend=-1.0) > 0.0) | (
            np.diff(segments, prepend=-1) > 0
        )
        self._first = np.flatnonzero(begins)
        self._count = np.diff(self._first, append=len(times))[:, None]
        self.segments = segments[self._first]
        self.times = self.mean(times[:, None])[:, 0]

    def mean(self, values: Array) -> Array:
        """Average values (n, elements) over the rows of each block."""
        return np.asarray(np.add.reduceat(values, self._first, axis=0) / self._count)


def _wheel_momentum(system: System, log: Log) -> Array:
    """Return the momentum of all wheels (n, 3) N m s, body.

    That of speeds is relative to the body.
    """
    craft = flights.values_of(system)["spacecraft"]
    axes, exist = axes_of(craft), existing(craft)
    name = "momentum" if "momentum" in log.values else "speed"
    if name not in log.values:
        raise DesatError(
            f"{log.place}: no column of wheels: speed_1 [rpm] or h_1 [N.m.s] is needed"
        )
    values = log.values[name]
    if name == "speed" and "inertia_wheel" not in craft:
        raise DesatError(
            f"{log.place}: {system.name} has no inertia_wheel: h_1 [N.m.s] is needed"
        )
    if values.shape[1] == len(exist) and not np.nan_to_num(values[:, ~exist]).any():
        values = values[:, exist]
    if values.shape[1] != exist.sum():
        raise DesatError(
            f"{log.place}: columns of {name}: {values.shape[1]} wheels; {system.name} has "
            f"{exist.sum()}"
        )
    if not np.nan_to_num(values - values[:1]).any():
        raise DesatError(f"{log.place}: columns of {name}: no wheel's value changes")
    if name == "speed":
        values = values * np.broadcast_to(craft["inertia_wheel"], exist.shape)[exist]
    return np.asarray(values @ axes[:, exist].T)


def _inertia(system: System, log: Log) -> Array:
    """Return the inertia (3, 3) kg m2 that goes with the momentum of the wheels.

    Absolute momenta leave that of the body without the rotors along their axes.
    """
    hardware = flights.hardware_of(system)
    return hardware.carrier if "momentum" in log.values else hardware.inertia


def _coil_dipole(system: System, log: Log) -> Array:
    """Return the dipole of the coils (n, 3) A m2, body; 0 for a craft without coils."""
    if "torquers" not in system.roles:
        return np.zeros((len(log.times), 3))
    if "coils" in log.values:
        axes = np.reshape(flights.values_of(system)["torquers"]["axes_coil"], (3, -1))
        currents = log.values["coils"]
        if currents.shape[1] > axes.shape[1] or axes[:, currents.shape[1] :].any():
            raise DesatError(
                f"{log.place}: columns m_coil: {currents.shape[1]} coils; {system.name} "
                f"has {np.count_nonzero(axes.any(axis=0))}"
            )
        return np.asarray(currents @ axes[:, : currents.shape[1]].T)
    if "dipole" not in log.values:
        raise DesatError(
            f"{log.place}: no column of the coils that {system.name} has: "
            "m_coil[1] [A.m2] is needed"
        )
    return log.values["dipole"]


def _environment(
    system: System, times: Array, place: str
) -> tuple[Array, dict[str, Array]]:
    """Compute the environment at nodes (s) around the times (s) of a log."""
    count = max(4, int((times[-1] - times[0]) / NODE_TIME) + 2)
    nodes = np.linspace(times[0], times[-1], count)
    try:
        block = flights.environment_block(system.components["environment"])
        inputs = flights.inputs_at(block, nodes.tolist())
    except DesatError as error:
        raise DesatError(f"{place}: {error}") from error
    period = period_of(inputs["r_eci"][0], inputs["v_eci"][0], mu_of(system))
    if times[-1] - times[0] < period:
        raise DesatError(
            f"{place}: it lasts {times[-1] - times[0]:.0f} s, an orbit {period:.0f} s: at "
            "least one is needed"
        )
    return nodes, inputs


def _fly(
    system: System,
    q: Array | None,
    blocks: _Blocks,
    inputs: dict[str, Array],
    grid: Array,
    log: Log,
) -> flights.Flight:
    """Build the flight on a grid (s) at the attitude q (n, 4) of a log.

    None is the attitude that the guidance wants. Raises DesatError if that is unknown.
    """
    if q is None:
        try:
            attitude = flights.wanted_attitude(system)
            flight = flights.flown_at(system, attitude, inputs, grid)
            return replace(flight, q=align_signs(flight.q))
        except DesatError as error:
            raise DesatError(
                f"{log.place}: unknown attitude: no column q_bi; {error}"
            ) from error
    spline = Spline(blocks.times, blocks.mean(q))
    at = spline(grid)
    omega = _mean_rate(spline, grid)
    at = at / np.linalg.norm(at, axis=1, keepdims=True)
    return flights.flight_at(system, at, omega, inputs, grid)


def _mean_rate(attitude: Spline, times: Array) -> Array:
    """Compute the mean rate (n, 3) rad/s, body, over RATE_TIME around times (s).

    It is that of a rotation about a fixed axis between the attitudes at both ends.
    """
    begin = np.maximum(times - RATE_TIME / 2.0, times[0])
    end = np.minimum(times + RATE_TIME / 2.0, times[-1])
    before, after = attitude(begin), attitude(end)
    vector = (
        before[:, 3:] * after[:, :3]
        - after[:, 3:] * before[:, :3]
        + cross(after[:, :3], before[:, :3])
    )
    size = np.linalg.norm(vector, axis=1, keepdims=True)
    half = np.arctan2(size, (before * after).sum(axis=1, keepdims=True))
    scale = np.divide(half, size, out=np.ones_like(size), where=size > 0.0)
    return np.asarray(2.0 * scale * vector / (end - begin)[:, None])
