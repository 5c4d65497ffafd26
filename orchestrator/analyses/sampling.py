"""Check sample times against the run, and the coils' own field at a magnetometer's samples."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from typing import NamedTuple

import numpy as np

from desat.components.contract.block import BlockError

from ..system.craft import craft_of
from ..system.errors import DesatError
from ..system.model import Component, System
from ..system.parameters import bare_block
from .flight import environment_block, inputs_at
from .motion import mu_of, period_of

LARGEST_ORBIT_SHARE = 0.1  # of an orbit, for a sample time
SHORTEST_ORBIT = 5000.0  # s: at the ground it takes 5,060 s
LARGEST_FIELD_SHARE = 0.05  # of the field, for the coils' own field
ROWS = 37  # field samples of an orbit
MOST_STEPS = 5000  # of the torquers, for their dipole at the samples
PERIODS = 3  # sample periods until the coils repeat themselves


class OwnField(NamedTuple):
    """Field of the coils at the samples of a magnetometer."""

    magnetometer: Component
    torquers: Component
    field: float  # T, the largest with full dipoles
    share: float  # of the Earth's field, mean over an orbit


def warnings(system: System) -> Iterator[str]:
    """Yield a line for each sample time that is too long, and for a disturbed field."""
    yield from _long_samples(system)
    for coils in _own_fields(system):
        if coils.share > LARGEST_FIELD_SHARE:
            place = coils.magnetometer.origins.get("coil_coupling", system.place)
            yield (
                f"{place}: {_described(coils)}: a longer {coils.torquers.name}.quiet_time, "
                "or samples at the times of the torquers'"
            )


def notes(system: System) -> Iterator[str]:
    """Yield the coils' own field at the samples of each magnetometer that has one."""
    for coils in _own_fields(system):
        if coils.share <= LARGEST_FIELD_SHARE:
            yield _described(coils)


def _described(coils: OwnField) -> str:
    """Describe the coils' own field in a magnetometer's samples."""
    return (
        f"{coils.magnetometer.name}: at its samples full dipoles of "
        f"{coils.torquers.name} add up to {coils.field:.2g} T, "
        f"{100.0 * coils.share:.2g} % of the field"
    )


def _long_samples(system: System) -> Iterator[str]:
    """Yield a line for each sample time longer than the run or a tenth of an orbit."""
    length = system.stop - system.start
    for c in system.components.values():
        for signal in c.interface.parameters:
            if not signal.name.endswith("sample_time"):
                continue
            time = c.values[signal.name]
            if time <= min(length, SHORTEST_ORBIT * LARGEST_ORBIT_SHARE):
                continue
            line = (
                f"{c.origins.get(signal.name, system.place)}: {c.name}.{signal.name} = "
                f"{time:g} s is longer than"
            )
            if time > length:
                yield f"{line} the run of {length:g} s: it samples once"
                continue
            orbit = orbit_period(system)
            if orbit is not None and time > LARGEST_ORBIT_SHARE * orbit:
                yield f"{line} a tenth of the orbit of {orbit:.4g} s"


def orbit_period(system: System) -> float | None:
    """Return the period of the orbit at the start (s), or None where it is not known."""
    environment = craft_of(system).environment
    if environment is None or environment.block is None:
        return None
    block = bare_block(environment)
    try:
        block.start()
        block.output(system.start)
    except BlockError:
        return None
    return period_of(block.r_eci, block.v_eci, mu_of(system))


def _own_fields(system: System) -> Iterator[OwnField]:
    """Yield the coils' own field at each of our magnetometers with our torquers.

    There is none where the environment's field is not known before a run.
    """
    for name, wire in system.by_input["m_body"].items():
        magnetometer = system.components[name]
        torquers = system.components[wire.source]
        coupling = np.array(magnetometer.values.get("coil_coupling", ()))
        is_known = coupling.any() and "axes_coil" in torquers.values
        if not is_known or torquers.block is None:
            continue
        if (earth := mean_field(system)) is None:
            continue
        field = _largest_field(
            system, magnetometer, torquers, np.reshape(coupling, (3, 3))
        )
        yield OwnField(magnetometer, torquers, field, field / earth)


def mean_field(system: System) -> float | None:
    """Return the mean field (T) over an orbit, or None where it is none or not known."""
    environment, period = craft_of(system).environment, orbit_period(system)
    if environment is None or period is None:
        return None
    times = (system.start + np.linspace(0.0, period, ROWS)).tolist()
    try:
        field = inputs_at(environment_block(environment), times)["b_eci"]
    except (BlockError, DesatError):
        return None
    return float(np.linalg.norm(field, axis=1).mean()) or None


def _largest_field(
    system: System, magnetometer: Component, torquers: Component, coupling: np.ndarray
) -> float:
    """Compute the largest field (T) of the coils at a magnetometer's samples.

    The coils are driven to their limits, in the block itself, with its drive, lag,
    supply and core.
    """
    block = bare_block(torquers)
    block.start()
    axes = np.reshape(block.axes_coil, (3, -1))
    block.m_cmd_body = tuple((block.m_limit * axes.sum(axis=1)).tolist())
    step = system.step * torquers.step_ratio
    period = magnetometer.values.get("sample_time", 0.0) or step
    # a value that nobody samples does not count
    readers = [
        system.components[c.target].values.get("sample_time", 0.0)
        for c in system.connections
        if c.source == magnetometer.name and c.output_array == "b_body"
    ]
    period = max(period, min(readers, default=0.0))
    longest = max(period, block.sample_time)
    steps = min(MOST_STEPS, round(PERIODS * longest / step) + 1)
    dipoles = np.zeros(axes.shape[1])
    for k in range(1, steps + 1):
        block.advance((k - 1) * step, step)
        block.output(k * step)
        if abs(k * step / period - round(k * step / period)) < 1e-6:
            dipoles = np.maximum(dipoles, np.abs(block.m_coil))
    signs = np.array(list(product((-1.0, 1.0), repeat=len(dipoles))))
    fields = (signs * dipoles) @ axes.T @ coupling.T
    return float(np.linalg.norm(fields, axis=1).max())
