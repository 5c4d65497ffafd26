"""Monitor a rigid body: check the balance of its momentum.

The inertial angular momentum of the craft follows from its attitude and rate and from
the momentum that the *wheels* report. Less its start and the external impulse it should
be zero. The spacecraft's own copy of the wheels' momentum is not used, so that an
exchange that loses momentum is detected.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import lcm
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..numbers.derived import rotate_back
from ..numbers.shapes import shape_of
from ..numbers.text import Value
from ..system.craft import carrier_inertia, craft_of
from ..system.model import Parameter, System
from ..system.wheels import axes_of
from . import Parts, not_checked
from .manifest import Manifest

if TYPE_CHECKING:
    from ..engine.recording.results import Results
    from ..figures.canvas import Figure


Array = NDArray[np.float64]
KEY = "rigid_body"
NUMBERS = ("momentum_residual",)
BOUND_KEYS = ("residual_bound",)
BOUND = 1e-9  # default of residual_bound: residual as a share of the largest momentum
BLOCK = "spacecraft_rigid"
# N m s: output by which a spacecraft declares its total momentum
TOTAL = "momentum_eci"
UNKNOWN = f"is no {BLOCK} of ours and declares no total momentum ({TOTAL})"


@dataclass(frozen=True)
class RigidBodyParts(Parts):
    """Rigid body, and the series of its wheels' momentum."""

    spacecraft: str
    wheels: str


@dataclass(frozen=True)
class MomentumParts(RigidBodyParts):
    """Rigid body, and the source of its total momentum."""

    total: str | None = None  # series of its total momentum, where it declares that
    unknown: str = ""  # reason why its total momentum is not known


PARTS = MomentumParts


def applies(system: System) -> MomentumParts | None:
    """Find the body and the series of its wheels' momentum, or None without one.

    A body that is not ours may have moving parts. An output `momentum_eci` (N m s)
    declares its total momentum; without it that is not known.
    """
    for body, wire in system.by_input["h_wheel"].items():
        if len(system.components[body].interface.elements.get(TOTAL, ())) == 3:
            return MomentumParts(body, wire.series, f"{body}.{TOTAL}")
    parts = rigid_body(system)
    if parts is None:
        return None
    ours = system.components[parts.spacecraft].model == BLOCK
    unknown = "" if ours else f"{parts.spacecraft} {UNKNOWN}"
    return MomentumParts(parts.spacecraft, parts.wheels, unknown=unknown)


def rigid_body(system: System) -> RigidBodyParts | None:
    """Find a component with the parameters of a rigid body with wheels, or None.

    It need not be ours.
    """
    body = craft_of(system).rigid_body
    return (
        None if body is None else RigidBodyParts(body.component.name, body.wheel_series)
    )


class Momentum(NamedTuple):
    """Momentum residual of a run.

    It has the largest momentum of the whole or of the wheels, the largest residual (N m
    s), and the residual over time as a plot shows it: times (s), values (n, 3; N m s,
    eci), and how many rows they stand for.
    """

    largest: float
    most: float
    times: Array
    residual: Array
    rows: int


def momentum(manifest: Manifest, results: Results) -> Momentum | None:
    """Compute the residual of a run, once.

    None where there is no rigid body or its series are not recorded.
    """
    return results.once(KEY, lambda: _momentum(manifest, results))


def _momentum(manifest: Manifest, results: Results) -> Momentum | None:
    """Compute the residual of a run from its series."""
    body = manifest.parts.get(KEY)
    if body is None or body.unknown:
        return None
    series = balanced(body)
    if not set(series) <= set(results.names()):
        return None
    times = results.times(series[0])
    rows_read = [results.series(s) for s in series]
    # a slow component's outputs are held between its steps
    every = lcm(*(manifest.step_ratio[s.partition(".")[0]] for s in series))
    if every > 1:
        number = np.round((times - manifest.start) / manifest.step).astype(int)
        times = times[number % every == 0]
        rows_read = [s.at(number % every == 0) for s in rows_read]
    if len(times) == 0:
        return None
    carrier, axes = None, None
    if not body.total:
        carrier, axes = carrier_of(manifest.parameters[body.spacecraft])
    most, first = np.zeros(2), np.zeros((2, 3))

    def read(rows: slice) -> Array:
        """Compute rows of the residual, and note the largest values."""
        nonlocal most, first
        *values, impulse, h = (s[rows] for s in rows_read)
        in_eci = values[0]
        if carrier is not None and axes is not None:
            in_eci = rotate_back(values[0], values[1] @ carrier.T + h @ axes.T)
        if rows.start == 0:
            first = np.array([in_eci[0], impulse[0]])
        residual = in_eci - first[0] - (impulse - first[1])
        largest = max(float(np.linalg.norm(x, axis=1).max()) for x in (in_eci, h))
        off = float(np.linalg.norm(residual, axis=1).max())
        most = np.maximum(most, [largest, off])
        return np.asarray(residual)

    shape = shape_of(times, read)
    return Momentum(float(most[0]), float(most[1]), *shape)


def carrier_of(parameters: Mapping[str, Parameter]) -> tuple[Array, Array]:
    """Return J_r (3, 3) in kg m2 and the wheels' axes (3, n) of a rigid body.

    J_r is the inertia without the wheels' axial part.
    """
    values = {name: parameter.value for name, parameter in parameters.items()}
    return carrier_inertia(values), axes_of(values)


def balanced(parts: MomentumParts) -> list[str]:
    """Return the series that the residual is computed from."""
    if parts.total:
        return [parts.total, f"{parts.spacecraft}.impulse_eci", parts.wheels]
    return body_series(parts)


def body_series(parts: RigidBodyParts) -> list[str]:
    """Return the series of a body's state, of the impulse on it and of its wheels."""
    series = [
        f"{parts.spacecraft}.{n}" for n in ("q_bi", "omega_bi_body", "impulse_eci")
    ]
    return [*series, parts.wheels]


def warnings(system: System) -> list[str]:
    """Return a line with the reason why runs of a system cannot be checked, if any."""
    parts = applies(system)
    return not_checked({NUMBERS[0]: parts.unknown}) if parts and parts.unknown else []


def numbers(manifest: Manifest, results: Results) -> dict[str, Value]:
    """Compute the largest residual of a run (N m s)."""
    series = momentum(manifest, results)
    if series is None:
        return {}
    title = "Momentum residual, largest"
    return {"momentum_residual": Value(title, series.most, "N.m.s")}


def unchecked(manifest: Manifest, results: Results) -> dict[str, str]:
    """Return the reason why there is no residual, by the number's name."""
    if momentum(manifest, results) is not None:
        return {}
    if reason := manifest.parts[KEY].unknown:
        return {"momentum_residual": reason}
    return {
        "momentum_residual": missing(balanced(manifest.parts[KEY]), results)
        or "there are no rows"
    }


def missing(series: list[str], results: Results) -> str:
    """Return a text that lists which of the series are not recorded; empty if none."""
    lacking = [s for s in dict.fromkeys(series) if s not in set(results.names())]
    return f"not recorded: {', '.join(lacking)}" if lacking else ""


def unmet(manifest: Manifest, results: Results) -> list[str]:
    """Return a line if the residual is above its bound.

    Under jacobi it is not checked, because that exchange is known to lose momentum.
    """
    series = momentum(manifest, results)
    if series is None or manifest.algorithm != "gauss_seidel":
        return []
    number = manifest.numbers["momentum_residual"]
    bound = manifest.about.get("residual_bound", BOUND)
    return beyond("momentum_residual", number, "residual_bound", bound, series.largest)


def beyond(
    name: str, number: Value, key: str, bound: float, largest: float
) -> list[str]:
    """Return a line if a number (N m s) is above its bound.

    The bound is a share of the largest momentum.
    """
    value = number.value
    if value is None or value <= bound * largest:
        return []
    return [
        f"{name} = {value:.2g} N m s: above {key} = {bound:g} of the largest momentum, "
        f"{largest:.3g} N m s"
    ]


def figures(manifest: Manifest, results: Results) -> list[tuple[str, Figure]]:
    """Draw the residual over time."""
    series = momentum(manifest, results)
    caption = "Momentum residual: momentum lost by the exchange between components"
    return (
        []
        if series is None
        else [(caption, plot(series.times, series.residual, series.rows, results))]
    )


def plot(times: Array, residual: Array, rows: int, results: Results) -> Figure:
    """Draw the residual of so many rows over time, above the strips of the run's modes."""
    from ..figures.plots import timeline  # slow import, needed for a report only
    from ..figures.style import COLOURS, SMALL_HEIGHT, figure, time_axis

    fig, ax = figure(SMALL_HEIGHT)
    seconds, unit = time_axis(times)
    for i, axis in enumerate("xyz"):
        ax.plot(times / seconds, residual[:, i], COLOURS[i], label=axis, rows=rows)
    timeline(ax, seconds, unit, results)
    ax.y.label = "residual [N m s], eci"
    return fig
