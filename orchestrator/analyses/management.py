"""Compute the standard numbers of a managed run: wheel momentum and use of the coils.

With wheel axes A (columns) and wheel momenta h, the coils can act on the sum A h alone.
The remainder, h - A^+ A h, is the null-space momentum: it adds up to zero, and no
torque on the body changes it. A mean over wheels cannot separate the two, so each has
its own number. The other numbers say how near wheels and coils are to their limits.

The effect of management is measured against the same run without it: the external
impulse less that of coils and thrusters, at the attitudes that were flown, would be in
the wheels. A law that is to hold the momentum misses its goal if it leaves more
momentum in the second half of a run than there would be without management.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from desat.components.contract.block import BlockError
from desat.components.contract.roles import Manager

from ..language.content import Content, content_of
from ..numbers.derived import (
    blocks,
    by_rows,
    coil_impulse,
    matrices,
    pointing,
    rotate,
    rotate_back,
    wanted_attitude,
)
from ..numbers.shapes import shape_of
from ..numbers.text import Value
from ..system.errors import DesatError
from ..system.model import Component, System, Values
from ..system.wheels import axes_of, capacities, existing, smallest_capacity
from . import Parts, with_titles
from .flight import environment_block, guided, inputs_at, without_field
from .manifest import Manifest
from .motion import mu_of, period_of
from .residual import carrier_of, missing

if TYPE_CHECKING:
    from ..engine.recording.results import Results
    from ..figures.canvas import Figure

KEY = "management"
NUMBERS = (
    "sum_rms",
    "sum_largest",
    "null_rms",
    "coil_duty",
    "coil_limit_share",
    "momentum_margin",
    "limit_time",
    "crossings",
    "left_rms",
    "unmanaged_rms",
    "least_braking",
)
# share of its limit from which a coil counts as saturated; a coil with a lag never
# reaches it fully
AT_LIMIT = 0.999
# Momentum that counts as zero: SMALL as a share of a wheel's capacity (what its
# tachometer resolves), ALIKE as a share of the unmanaged momentum, which is estimated.
SMALL, ALIKE = 1e-3, 0.01
FIELD = 3e-5  # T, typical of a low orbit
# share of a target across the orbit normal above which it turns with the craft
ACROSS = 1e-3
# rad per orbit by which a bias may turn: drift of the node, course of the Sun
MOST_TURN = 0.05
# number of times at which the reference attitude is sampled, over two orbits and over a
# run
TURN_ROWS = 193
# share of the incoming momentum below which a manager counts as doing nothing
NOTHING = 0.01
MOST_BRAKED = 90.0  # deg of rotation within a sample up to which B-dot brakes
SETTLED = 0.5  # deg/s: B-dot leaves a craft turning with the field
LONG_ENOUGH = 1800.0  # s: shortest run in which a law has time to have an effect
ATTITUDE_LOST_DEG = 30.0  # deg: an attitude error above this is no pointing
_WHEEL_SERIES = ("saturated_wheel", "speed_wheel")
Array = NDArray[Any]


@dataclass(frozen=True)
class ManagementParts(Parts):
    """Components and series that take part in momentum management."""

    spacecraft: str
    torquers: str | None = None  # None: no coils manage the momentum
    wheels: str | None = None  # None: the wheels are ideal ones within the craft
    field: str | None = None  # series of the geomagnetic field, eci
    thrusters: str | None = None  # component whose firings all belong to management
    # N m s, body: target of the total wheel momentum; None: it varies, or there is no
    # manager
    target: tuple[float, ...] | None = None
    holds: bool = False  # whether the law has to hold the target for the whole run
    deadband: float = 0.0  # N m s, within which the law does nothing
    brakes: bool = False  # whether the law detumbles the craft
    reference: str | None = None  # series of the reference attitude
    manager: str = ""


PARTS = ManagementParts


def applies(system: System) -> ManagementParts | None:
    """Find the parts that manage wheel momentum, or None for a craft without wheels.

    They follow from the connections. Where only thrusters manage the momentum, or
    nothing does, no law is judged: dumps between thresholds leave momentum until the
    next one.
    """
    for torquers, wire in system.by_input["m_cmd_body"].items():
        body = system.takers.get((torquers, "m_mean_body"))
        if (
            body is not None
            and "h_copy_wheel" in system.components[body].interface.arrays
        ):
            return _by_coils(system, torquers, system.components[wire.source], body)
    for body, wire in system.by_input["h_wheel"].items():
        if "h_copy_wheel" in system.components[body].interface.arrays:
            return _without_coils(system, body, wire.source)
    return None


def _by_coils(
    system: System, torquers: str, law: Component, body: str
) -> ManagementParts:
    """Return the parts of a craft whose manager commands coils."""
    thrusters = system.fed.get((body, "tau_mean_thruster_body"))
    field = system.fed.get((body, "b_eci"))
    return ManagementParts(
        spacecraft=body,
        torquers=torquers,
        wheels=_with_speed(system, system.takers.get((law.name, "tau_cmd_wheel"))),
        field=field.series if field else None,
        thrusters=thrusters.source if thrusters else None,
        target=_target(system, law),
        holds=content_of(system.about).stop_when is None and _holds(law),
        deadband=law.values["h_deadband"]
        if "h_deadband" in law.interface.signals
        else 0.0,
        brakes=is_braking(law),
        reference=_reference(system),
        manager=law.name,
    )


def _without_coils(system: System, body: str, wheels: str) -> ManagementParts:
    """Return the parts of a craft without coils that manage the momentum.

    Only thrusters unload its wheels, or nothing does.
    """
    thrusters = system.fed.get((body, "tau_mean_thruster_body"))
    law = None
    if thrusters is not None:
        command = system.fed.get((thrusters.source, "tau_cmd_thruster_body"))
        law = system.components.get(command.source) if command else None
    return ManagementParts(
        spacecraft=body,
        wheels=_with_speed(system, wheels),
        thrusters=thrusters.source if thrusters else None,
        target=_target(system, law) if law else None,
        reference=_reference(system),
        manager=law.name if law else "",
    )


def _with_speed(system: System, wheels: str | None) -> str | None:
    """Return the wheel component if it outputs speeds and saturation, else None."""
    if wheels is None or not system.components[wheels].interface.arrays.keys() >= {
        *_WHEEL_SERIES
    }:
        return None
    return wheels


def _reference(system: System) -> str | None:
    """Return the series of the attitude that the controller has to follow, or None."""
    controller = system.roles.get("controller")
    wire = None if controller is None else system.fed.get((controller.name, "q_ref_bi"))
    return None if wire is None else wire.series


def _target(system: System, law: Component) -> tuple[float, ...] | None:
    """Return the target momentum of a manager (3,) N m s, body.

    It is None where another component supplies it.
    """
    if (law.name, "h_target_body") in system.fed:
        return None
    return tuple(law.values.get("h_target_body", (0.0, 0.0, 0.0)))


def _holds(law: Component) -> bool:
    """Return whether a manager holds momentum at its target.

    This follows from the laws that its block declares (`Manager.offers`): the choices
    that they have in common have to be the manager's own. A manager that is not a block
    of ours counts as one that holds.
    """
    signals = law.interface.signals
    if "enable" in signals and not law.values["enable"]:
        return False
    if law.block is None:
        return True
    block = law.block
    if not issubclass(block, Manager) or block.no_law or not block.offers:
        return False
    first, *others = (
        {k: v for k, v in x.gains.items() if k in signals and signals[k].choices}
        for x in block.offers
    )
    common = {k: v for k, v in first.items() if all(x.get(k) == v for x in others)}
    return all(law.choice(k) == v for k, v in common.items())


def is_braking(law: Component) -> bool:
    """Return whether a manager block of ours detumbles the craft."""
    block = law.block
    return block is not None and issubclass(block, Manager) and block.brakes


def warnings(system: System) -> Iterator[str]:
    """Yield a line for each law with too large a gain, or with too long a sample.

    A law whose gain removes more in a sample than there is overshoots, and only the
    limit of the coils keeps the momentum from growing. A law that brakes a rotation has
    to sample it often enough.
    """
    yield from _aliased(system)
    for c in system.components.values():
        block = c.block
        if block is None or not issubclass(block, Manager):
            continue
        sample = max(float(c.values.get("sample_time", 0.0)), system.step)
        for law in block.offers:
            rule = str(law.gains.get(law.rate, ""))
            choices = {
                k: v
                for k, v in law.gains.items()
                if k in c.interface.signals and c.interface.signals[k].choices
            }
            chosen = all(c.choice(k) == v for k, v in choices.items())
            if not law.rate or not chosen:
                continue
            rate = c.values[law.rate] * (FIELD if "craft.field" in rule else 1.0)
            if rate * sample > 1.0:
                place = c.origins.get(law.rate, system.place)
                yield (
                    f"{place}: {c.name}.{law.rate} = {c.values[law.rate]:g}: at {rate:.3g} 1/s "
                    f"it takes {rate * sample:.3g} times the momentum out within a sample of "
                    f"{sample:g} s; usual is the orbit's rate, some 1e-3 1/s"
                )


def _aliased(system: System) -> Iterator[str]:
    """Yield a line if a craft turns by over 90 deg in a sample of its braking law.

    The field then seems to turn the other way.
    """
    manager, craft = system.roles.get("manager"), system.roles.get("spacecraft")
    if manager is None or craft is None or not is_braking(manager):
        return
    rate = float(np.linalg.norm(craft.values.get("omega_start_body", 0.0)))
    magnetometer = system.roles.get("magnetometer")
    samples = [system.step, float(manager.values.get("sample_time", 0.0))]
    if magnetometer is not None:
        samples.append(float(magnetometer.values.get("sample_time", 0.0)))
    turn = np.degrees(rate * max(samples))
    if turn > MOST_BRAKED:
        place = craft.origins.get("omega_start_body", system.place)
        yield (
            f"{place}: {craft.name} turns at {np.degrees(rate):.3g} deg/s, by {turn:.3g} deg in a "
            f"sample of {max(samples):g} s: beyond {MOST_BRAKED:g} deg {manager.name} speeds "
            "the rotation up instead of braking it; a sample time of "
            f"{np.radians(MOST_BRAKED / 2.0) / rate:.2g} s would do"
        )


def problems(system: System) -> Iterator[str]:
    """Yield a line for a manager with a bias that the reference attitude turns in eci.

    No law here makes a bias turn.
    """
    guide, manager = system.roles.get("guidance"), system.roles.get("manager")
    if guide is None or manager is None or not _holds(manager):
        return
    target = np.array(_target(system, manager) or (0.0, 0.0, 0.0), float)
    if not target.any() or "environment" not in system.roles:
        return
    nadir = guide.model == "guidance_nadir"
    try:
        is_turned = _turned(system, target)
    except (DesatError, BlockError):
        if not nadir:
            return
        is_turned = 0.0
    normal = np.array([0.0, -1.0, 0.0])
    if nadir:
        offset = guide.values["q_bo"] or [0.0, 0.0, 0.0, 1.0]
        normal = matrices(np.array([offset]))[0] @ normal
        across = target - (target @ normal) * normal
        share = float(np.linalg.norm(across) / np.linalg.norm(target))
        is_turned = 2.0 * float(np.arcsin(min(1.0, share))) if share > ACROSS else 0.0
    if is_turned <= MOST_TURN and not (nadir and is_turned > 0.0):
        return
    target_text = ", ".join(f"{x:g}" for x in target.tolist())
    place = manager.origins.get("h_target_body", system.place)
    only = (
        f"; only one along the orbit's normal, ({', '.join(f'{x:.3g}' for x in normal)}) in body, "
        "stays"
    )
    yield (
        f"{place}: {manager.name}.h_target_body = ({target_text}) N m s: {guide.model} turns "
        f"it by {np.degrees(is_turned):.3g} deg in eci, and no law turns a bias with it"
        f"{only if nadir else ''}"
    )


def _turned(system: System, bias: Array) -> float:
    """Compute the largest turn (rad) of a bias (3,), body, in eci within an orbit.

    The craft is at the reference attitude. Raises DesatError or BlockError where
    guidance and environment are not our blocks.
    """
    component = system.roles["environment"]
    block = environment_block(component, without_field(component))
    first = inputs_at(block, [system.start])
    period = period_of(first["r_eci"][0], first["v_eci"][0], mu_of(system))
    ends = (
        min(system.stop, system.start + 2.0 * period),
        system.stop,
    )  # a slew may come late
    times = np.unique([np.linspace(system.start, end, TURN_ROWS) for end in ends])
    block = environment_block(component, without_field(component))
    q, _ = guided(system.roles["guidance"], inputs_at(block, times.tolist()), times)
    inertial = rotate_back(q, np.broadcast_to(bias / np.linalg.norm(bias), (len(q), 3)))
    near = np.abs(times[:, None] - times) <= period * (1.0 + 1e-9)
    angle = np.arccos(np.clip(inertial @ inertial.T, -1.0, 1.0))
    return float((angle * near).max())


def signals(parts: ManagementParts) -> list[str]:
    """Return the series that the numbers are computed from."""
    names = [f"{parts.spacecraft}.h_copy_wheel"]
    names += [f"{parts.torquers}.m_mean_body"] if parts.torquers else []
    return names + [f"{parts.wheels}.{n}" for n in _WHEEL_SERIES if parts.wheels]


def numbers(manifest: Manifest, results: Results) -> dict[str, Value]:
    """Compute the standard numbers of a completed run, as a manifest has them.

    The result is empty where too little was recorded, and has only those numbers for
    which the parameters are known.
    """
    parts: ManagementParts = manifest.parts[KEY]
    if not manifest.completed or missing(signals(parts), results):
        return {}
    known_wheels = _wheels_of(manifest, parts)
    there = existing(known_wheels)
    h = results.series(f"{parts.spacecraft}.h_copy_wheel", there)
    axes = axes_of(known_wheels)[:, there]
    times = results.times()
    known_values = dict[str, float](
        zip(OF_MOMENTUM, of_momentum(times, h, axes, np.linalg.pinv(axes)), strict=True)
    )
    if parts.torquers:
        dipoles = results.series(f"{parts.torquers}.m_mean_body")
        known_values |= coils_of(parts.torquers, manifest, dipoles)
    if parts.wheels:
        values = manifest.values_of(parts.wheels)
        if "inertia_wheel" in values and "speed_limit" in values and there.any():
            known_values["momentum_margin"] = margin(h, capacities(values)[there])
        saturated = results.values(f"{parts.wheels}.{_WHEEL_SERIES[0]}")
        speed = results.series(f"{parts.wheels}.{_WHEEL_SERIES[1]}", there)
        known_values |= zip(OF_WHEELS, of_wheels(times, saturated, speed), strict=True)
    if (compared := compare(manifest, results)) is not None:
        known_values |= zip(OF_BALANCE, compared, strict=True)
    if (least := _least_braking(manifest, results)) is not None:
        known_values["least_braking"] = least
    return with_titles(
        {n: (TITLES[n][0], x, TITLES[n][1]) for n, x in known_values.items()}
    )


def coils_of(torquers: str, manifest: Manifest, m: Array) -> dict[str, float]:
    """Compute the numbers of the coils from their mean dipole m (rows, 3) A m2, body.

    The result is empty where the coils have no limit, or there are fewer rows than a
    period has.
    """
    coils = manifest.values_of(torquers)
    if (most := most_of_coils(coils)) is None:
        return {}
    axes = np.reshape(coils["axes_coil"], (3, -1))
    inverse = np.linalg.pinv(axes[:, np.linalg.norm(axes, axis=0) > 0.0])
    period = rows_a_period(coils, manifest.step)
    if len(m) < period:
        return {}
    return dict(zip(OF_COILS, of_coils(m, inverse, most, period), strict=True))


# title and unit of each number
TITLES: Mapping[str, tuple[str, str]] = {
    "sum_rms": ("Total wheel momentum (body frame), rms", "N.m.s"),
    "sum_largest": ("Total wheel momentum (body frame), largest", "N.m.s"),
    "null_rms": ("Null-space momentum of the most loaded wheel, rms", "N.m.s"),
    "coil_duty": ("Coil duty: mean dipole of the coils (share of their largest)", "%"),
    "coil_limit_share": ("Time with a coil saturated", "%"),
    "momentum_margin": ("Smallest momentum margin of a wheel", "%"),
    "limit_time": ("Time with a wheel saturated", "s"),
    "crossings": ("Zero crossings of the wheels", "1"),
    "left_rms": (
        "Total wheel momentum less its target in the second half, rms",
        "N.m.s",
    ),
    "unmanaged_rms": (
        "Total wheel momentum without management in the second half, rms (estimated)",
        "N.m.s",
    ),
    "least_braking": ("Shortest detumbling time with saturated coils", "s"),
}
# Names of the results of `of_momentum` and `of_coils`, in their order.
OF_MOMENTUM, OF_COILS = (
    ("sum_rms", "sum_largest", "null_rms"),
    ("coil_duty", "coil_limit_share"),
)
# Names of the results of `of_wheels` and `off_target`, in their order.
OF_WHEELS, OF_BALANCE = ("limit_time", "crossings"), ("left_rms", "unmanaged_rms")


@by_rows(1)
def momentum_sizes(h: Array, axes: Array, inverse: Array) -> Array:
    """Compute the sizes (rows, 2) of total and null-space momentum (N m s).

    Momenta h are (rows, wheels). The null-space momentum is that of the most loaded
    wheel.
    """
    wheel_momentum = h @ axes.T
    size = np.linalg.norm(wheel_momentum, axis=1)
    idle = h - wheel_momentum @ inverse.T
    return np.array([size, np.abs(idle).max(axis=1, initial=0.0)]).T


def of_momentum(
    times: Array, h: Array, axes: Array, inverse: Array
) -> tuple[float, float, float]:
    """Compute rms and peak of total, and rms of null-space momentum (N m s).

    The momenta h (rows, wheels; N m s) are about axes (3, wheels) with the
    pseudoinverse `inverse`. The null-space momentum is that of the most loaded wheel.
    """
    sizes = momentum_sizes(h, axes, inverse)
    return _rms(sizes[:, 0], times), float(sizes[:, 0].max()), _rms(sizes[:, 1], times)


def _least_braking(manifest: Manifest, results: Results) -> float | None:
    """Estimate the shortest time (s) for saturated coils to stop the body's rotation.

    It is the time to absorb the momentum of the body at the start. A rod across the
    field B gives m |B|, and half of that in the mean over the attitudes of a craft that
    tumbles. None where the time is not known, or the run is shorter.
    """
    parts: ManagementParts = manifest.parts[KEY]
    if not parts.brakes or not parts.torquers:
        return None
    values, coils = (
        manifest.parameters.get(parts.spacecraft, {}),
        manifest.values_of(parts.torquers),
    )
    series = f"{parts.spacecraft}.omega_bi_body", str(parts.field)
    if missing(list(series), results) or "inertia" not in values:
        return None
    if (
        coils.get("drive") == "ideal"
        or "m_limit" not in coils
        or "axes_coil" not in coils
    ):
        return None
    omega, b = (results.values(s) for s in series)
    begun = float(
        np.linalg.norm(np.reshape(values["inertia"].value, (3, 3)) @ omega[0])
    )
    axes = np.reshape(coils["axes_coil"], (3, -1))
    most = float(coils["m_limit"]) * int((np.linalg.norm(axes, axis=0) > 0.0).sum())
    times = results.times()[: len(b)]
    given_each = 0.5 * most * np.linalg.norm(b, axis=1)[:-1] * np.diff(times)
    taken = np.concatenate([[0.0], np.cumsum(given_each)])
    if taken[-1] < begun:
        return None
    return float(np.interp(begun, taken, times)) - float(times[0])


def _rms(values: Array, times: Array) -> float:
    """Compute the rms over time of values (rows,) at times (s), linear between rows."""
    times = times[: len(values)]
    if len(values) < 2:
        return float(np.abs(values).mean())
    return float(np.sqrt(np.trapezoid(values**2, times) / (times[-1] - times[0])))


def balanced(parts: ManagementParts) -> list[str]:
    """Return the series that `compare` needs; empty where it cannot be computed."""
    if (parts.torquers and parts.field is None) or not parts.manager:
        return []
    series = [
        f"{parts.spacecraft}.{n}" for n in ("q_bi", "omega_bi_body", "impulse_eci")
    ]
    series.append(f"{parts.spacecraft}.h_copy_wheel")
    if parts.torquers and parts.field:
        series += [f"{parts.torquers}.m_mean_body", parts.field]
    return series + [f"{parts.thrusters}.tau_mean_thruster_body"] * bool(
        parts.thrusters
    )


def compare(manifest: Manifest, results: Results) -> tuple[float, float] | None:
    """Compute rms wheel momentum less its target, with and without management.

    Both are in N m s, over the second half of the run. None where too little is
    recorded or known, or the attitude was lost.
    """
    parts: ManagementParts = manifest.parts[KEY]
    if parts.holds and _largest_late_error(parts, results) is not None:
        return None
    momentum_balance = balance(manifest, results)
    return (
        None
        if momentum_balance is None
        else off_target(
            momentum_balance.times,
            momentum_balance.distance,
            momentum_balance.distance_without,
        )
    )


class MomentumBalance(NamedTuple):
    """Wheel momentum with management, and estimated without it; all in N m s.

    Of each row there are sizes alone, because a long run has many rows.
    """

    times: Array
    distance: Array  # (rows,) of the total momentum from its target
    distance_without: Array  # (rows,) the same without management
    # of the fullest wheel (n, 2), with management and without, as a plot shows it: over
    # these times (s), and for how many rows
    drawn_times: Array
    fullest: Array
    rows: int
    largest_gain: float  # largest change of the total momentum without management
    largest_effect: float  # largest difference that management makes


def balance(manifest: Manifest, results: Results) -> MomentumBalance | None:
    """Compute the wheel momentum with management and without, once for a run.

    None where too little is recorded or known.
    """
    return results.once("managed", lambda: _balance(manifest, results))


def _balance(manifest: Manifest, results: Results) -> MomentumBalance | None:
    """Compute the balance of wheel momentum from the series.

    None without a constant target, with scheduled firings, for another algorithm than
    gauss_seidel, or where too little is recorded.
    """
    parts: ManagementParts = manifest.parts[KEY]
    series_needed = balanced(parts)
    if (
        not series_needed
        or parts.target is None
        or manifest.algorithm != "gauss_seidel"
    ):
        return None
    if missing(series_needed, results):
        return None
    if parts.thrusters and any(
        np.ravel(
            manifest.values_of(parts.thrusters).get("schedule_duration", 0.0)
        ).tolist()
    ):
        return None  # the torque of scheduled firings is a disturbance
    means = {
        f"{parts.torquers}.m_mean_body",
        f"{parts.thrusters}.tau_mean_thruster_body",
    }  # over steps, so that the last row has none
    count = min(results.count(s) + (s in means) for s in series_needed)
    if count < 4:
        return None
    wheels = _wheels_of(manifest, parts)
    there = existing(wheels)
    inverse, target = np.linalg.pinv(axes_of(wheels)[:, there]), np.array(parts.target)
    times = results.times()[:count]
    distance, distance_without = np.empty(count), np.empty(count)
    both, most, first = np.empty((count, 2)), np.zeros(2), np.zeros((1, 3))
    for rows, h, wheel_momentum, without in _momenta(manifest, results, times):
        if rows.start == 0:
            first = without[:1]
        distance[rows], distance_without[rows], *largest = effect(
            wheel_momentum, without, target, first
        )
        most = np.maximum(most, largest)
        for i, x in enumerate((h[:, there], without @ inverse.T)):
            both[rows, i] = np.abs(x).max(axis=1, initial=0.0)
    shape = shape_of(times, both.__getitem__)
    gain, change = most.tolist()
    return MomentumBalance(
        times,
        distance,
        distance_without,
        *shape,
        largest_gain=gain,
        largest_effect=change,
    )


def _momenta(
    manifest: Manifest, results: Results, times: Array
) -> Iterator[tuple[slice, Array, Array, Array]]:
    """Yield blocks of rows: momenta of the wheels, in all, and without management.

    They are (rows, wheels), (rows, 3) and (rows, 3) in N m s, the latter in body.
    Neighbours have a row in common.
    """
    parts: ManagementParts = manifest.parts[KEY]
    values = manifest.parameters.get(parts.spacecraft, {})
    *states, wheels = balanced(parts)[:4]
    dipole, field = f"{parts.torquers}.m_mean_body", parts.field
    axes, carrier = axes_of(_wheels_of(manifest, parts)), np.zeros((3, 3))
    if {"inertia", "inertia_wheel"} <= values.keys():
        carrier = carrier_of(values)[0]
    managed_before, start = np.zeros(3), np.zeros((1, 3))
    for rows in blocks(len(times), 1):
        q, omega, impulse = (results.values(s, rows) for s in states)
        h, steps = results.values(wheels, rows), slice(rows.start, rows.stop - 1)
        managed = np.tile(managed_before, (len(q), 1))
        if parts.torquers and field:
            b, m = results.values(field, rows), results.values(dipole, steps)
            managed = managed + coil_impulse(times[rows], b, q, m)
        if parts.thrusters:
            torque = results.values(balanced(parts)[-1], steps)
            managed = managed + fired_impulse(times[rows], q, torque)
        managed_before = managed[-1]
        body, wheel_momentum = omega @ carrier.T, h @ axes.T
        if rows.start == 0:
            start = momentum_at_start(q, impulse, wheel_momentum, body)
        yield rows, h, wheel_momentum, unmanaged(q, impulse, managed, body, start)


def required_shares(content: Content, wheels: str | None) -> Iterator[float]:
    """Yield the shares (1) of a wheel's capacity that requirements allow."""
    for requirement in content.requirements.values():
        number = content.numbers.get(requirement.number)
        if requirement.max is None or number is None or number.percent_of is None:
            continue
        if tuple(number.signals) == (f"{wheels}.h_wheel",):
            yield requirement.max / 100.0


def figures(manifest: Manifest, results: Results) -> list[tuple[str, Figure]]:
    """Draw the momentum of the fullest wheel over time, with management and without.

    The figure also shows the capacity of a wheel, and the share of it that is required.
    """
    parts: ManagementParts = manifest.parts[KEY]
    if parts.brakes and not parts.holds:
        return []  # a craft that is braked, whose wheels have nothing to hold
    momentum_balance = balance(manifest, results)
    if momentum_balance is None or not existing(_wheels_of(manifest, parts)).any():
        return []
    from ..figures.plots import timeline  # slow import, needed for a report only
    from ..figures.style import COLOURS, DASHED, DOTTED, LIMIT, figure, time_axis
    from ..numbers.text import spell_unit

    times, rows = momentum_balance.drawn_times, momentum_balance.rows
    fullest, without = momentum_balance.fullest.T
    capacity = _capacity(manifest.values_of(parts.wheels or ""))
    factor, unit = (
        (1e3, "mN.m.s") if max(fullest.max(), without.max()) < 1.0 else (1.0, "N.m.s")
    )
    fig, ax = figure()
    seconds, time_unit = time_axis(times)
    x = times / seconds
    label = "with management"
    ax.plot(x, factor * fullest, COLOURS[0], width=1.4, label=label, rows=rows)
    ax.plot(
        x,
        factor * without,
        COLOURS[1],
        width=1.2,
        dash=(4.0, 2.0),
        label="without (estimated)",
        rows=rows,
    )
    if capacity > 0.0:
        most = factor * max(fullest.max(), without.max())
        text = f"{factor * capacity:.4g}  capacity of a wheel"
        if factor * capacity < 10.0 * most:
            ax.level(factor * capacity, LIMIT, width=0.9, dash=DOTTED, label=text)
            for share in required_shares(manifest.content, parts.wheels):
                level = factor * share * capacity
                text = f"{level:.4g}  required: {100.0 * share:g} %"
                ax.level(level, LIMIT, width=0.9, dash=DASHED, label=text)
        else:
            ax.plot(
                [np.nan],
                [np.nan],
                LIMIT,
                width=0.9,
                dash=DOTTED,
                label=f"{text}: far beyond",
            )
    timeline(ax, seconds, time_unit)
    ax.y.label, ax.y.low = f"momentum [{spell_unit(unit)}]", 0.0
    return [("Momentum of the fullest wheel, with management and without", fig)]


def fired_impulse(times: Array, q: Array, torque: Array) -> Array:
    """Compute the impulse (rows, 3) of thrusters since the start (N m s, eci).

    Their mean torque over each step is in N m, body.
    """
    steps = np.diff(times)[:, None]
    impulses = rotate_back(q[:-1], torque[: len(times) - 1]) * steps
    return np.vstack([np.zeros(3), np.cumsum(impulses, axis=0)])


def momentum_at_start(
    q: Array, impulse: Array, wheel_momentum: Array, body: Any
) -> Array:
    """Compute the total momentum (1, 3; N m s, eci) that a run begins with.

    It is that of wheels and body in their first row, less the impulse until then.
    """
    return rotate_back(q[:1], (wheel_momentum + body)[:1]) - impulse[:1]


def unmanaged(
    q: Array, impulse: Array, managed: Array, body: Any, start: Array
) -> Array:
    """Compute the wheel momentum without management (rows, 3; N m s, body).

    It follows from the momentum of the body (`body`), the total one at the start of the
    run (`start`, eci), and the external impulse and the impulse of management since
    then (eci).
    """
    without: Array = rotate(q, start + impulse - managed) - body
    return without


def distances(wheel_momentum: Array, target: Array) -> Array:
    """Compute the distance (rows,) of momenta (rows, 3) from others; N m s."""
    return np.asarray(np.linalg.norm(wheel_momentum - target, axis=1))


def effect(
    wheel_momentum: Array, without: Array, target: Array, first: Array
) -> tuple[Array, Array, float, float]:
    """Compute what management does to wheel momenta (rows, 3; N m s, body).

    These are the distances (rows,) from the target (3,), with management and without,
    the largest change from the `first` one without it, and the largest difference that
    it makes.
    """
    return (
        distances(wheel_momentum, target),
        distances(without, target),
        float(distances(without, first).max()),
        float(distances(wheel_momentum, without).max()),
    )


def off_target(
    times: Array, distance: Array, distance_without: Array
) -> tuple[float, float]:
    """Compute the rms distance of the wheels' momentum from its target, N m s.

    Over the second half of the run: with management, and without it (rows,).
    """
    late = times >= (times[0] + times[-1]) / 2.0
    return _rms(distance[late], times[late]), _rms(distance_without[late], times[late])


def unchecked(manifest: Manifest, results: Results) -> dict[str, str]:
    """Return the reason for each number that could not be computed, by its name."""
    parts: ManagementParts = manifest.parts[KEY]
    if reason := missing(signals(parts), results):
        return dict.fromkeys(NUMBERS, reason)
    if parts.holds and (error := _largest_late_error(parts, results)) is not None:
        return dict.fromkeys(OF_BALANCE, describe_lost(error))
    if parts.holds and (reason := missing(balanced(parts), results)):
        return dict.fromkeys(OF_BALANCE, reason)
    return {}


def unmet(manifest: Manifest, results: Results) -> list[str]:
    """Return a line for each goal of momentum management that the run missed.

    A law that has to hold the momentum misses it if it leaves more than there would be
    without management, or does nothing. A law that brakes a rotation misses it if it
    has made it faster.
    """
    parts: ManagementParts = manifest.parts[KEY]
    if not manifest.completed:
        return []
    lines = _driven(parts, results) if parts.brakes else []
    if not parts.holds:
        return lines
    if _largest_late_error(parts, results) is not None:
        return lines
    momentum_balance = balance(manifest, results)
    if momentum_balance is None:
        return lines
    return lines + describe_effect(
        parts.manager,
        momentum_balance.times,
        momentum_balance.distance,
        momentum_balance.distance_without,
        momentum_balance.largest_gain,
        momentum_balance.largest_effect,
        parts.deadband,
        _capacity(manifest.values_of(parts.wheels or "")),
    )


def _driven(parts: ManagementParts, results: Results) -> list[str]:
    """Return a line if a braking law has made the craft turn faster."""
    series = f"{parts.spacecraft}.omega_bi_body"
    if series not in set(results.names()):
        return []
    return describe_braking(parts.manager, results.values(series))


def _largest_late_error(parts: ManagementParts, results: Results) -> float | None:
    """Return the largest attitude error in the second half (deg) above `ATTITUDE_LOST_DEG`.

    None where it is below, or not known.
    """
    reference = wanted_attitude(str(parts.reference), results.names())
    series = [f"{parts.spacecraft}.q_bi", reference]
    if missing(series, results):
        return None
    return results.once(
        "late error", lambda: largest_late_error(*map(results.series, series))
    )


# --- Lines from series, which a live page makes by the same functions -----------------


def largest_late_error(q: Array, reference: Array) -> float | None:
    """Return the largest attitude error in the second half (deg) of rows (rows, 4).

    None where it is below `ATTITUDE_LOST_DEG`, or there are fewer than four rows.
    """
    count = min(len(q), len(reference))
    if count < 4:
        return None
    error = float(pointing(q[count // 2 : count], reference[count // 2 : count]).max())
    return error if error > ATTITUDE_LOST_DEG else None


def describe_lost(error: float) -> str:
    """Return why there is no balance of a craft with such an attitude error (deg)."""
    return f"the attitude was lost ({error:.3g} deg)"


def describe_braking(manager: str, omega: Array) -> list[str]:
    """Return a line if the rate (rows, 3; rad/s) has grown under a law that brakes."""
    rates = np.degrees(np.linalg.norm(omega, axis=1))
    if len(rates) < 2 or rates[-1] <= (1.0 + ALIKE) * rates[0] + SETTLED:
        return []
    return [
        f"management: {manager} is to brake a rotation, which began at {rates[0]:.3g} "
        f"deg/s and ends at {rates[-1]:.3g} deg/s"
    ]


def describe_effect(
    manager: str,
    times: Array,
    distance: Array,
    distance_without: Array,
    gain: float,
    change: float,
    deadband: float,
    capacity: float,
) -> list[str]:
    """Return a line if management does nothing, or leaves more than there would be.

    Momenta are in N m s: those of a `MomentumBalance`, the deadband of the law and the
    capacity of the smallest wheel.
    """
    incoming = max(float(distance[0]), gain)
    share = removed_share(times, incoming, change, max(deadband, SMALL * capacity))
    if share is not None and share < NOTHING:
        return [
            f"management: {manager} is on and takes out {100.0 * share:.2g} % of "
            "what comes in: it does nothing"
        ]
    deviation, unmanaged_deviation = off_target(times, distance, distance_without)
    if (
        deviation
        <= (1.0 + ALIKE) * max(unmanaged_deviation, deadband) + SMALL * capacity
    ):
        return []
    return [
        f"management: wheel momentum less its target is {deviation:.3g} N m s rms in the "
        f"second half of the run, without management it would be {unmanaged_deviation:.3g}"
    ]


def removed_share(
    times: Array, incoming: float, change: float, negligible: float
) -> float | None:
    """Compute the momentum that management removes over the incoming momentum.

    Both (N m s) are the largest during the run. The incoming momentum is the external
    impulse without that of management, or the initial wheel momentum beyond the target.
    None where it is at most `negligible`, or the run is short.
    """
    if times[-1] - times[0] < LONG_ENOUGH or incoming <= negligible or incoming == 0.0:
        return None
    return change / incoming


def _wheels_of(manifest: Manifest, parts: ManagementParts) -> Values:
    """Return the parameters that define the wheels, from the wheels or the craft."""
    wheels = manifest.values_of(parts.wheels or "")
    return wheels if "axes_wheel" in wheels else manifest.values_of(parts.spacecraft)


def _capacity(wheels: Values) -> float:
    """Return the capacity of the smallest existing wheel (N m s); 0 if unknown."""
    if "inertia_wheel" not in wheels or "speed_limit" not in wheels:
        return 0.0
    return smallest_capacity(wheels)


def most_of_coils(values: Values) -> float | None:
    """Return the largest dipole of a coil (A m2) by the parameters of the torquers.

    For pulsed coils it is the mean over a period. None where it has no limit or is not
    known.
    """
    most = values.get("m_limit", 0.0)
    if values.get("drive") == "ideal" or not most or "axes_coil" not in values:
        return None
    return float(most * values["duty_max"] if values.get("drive") == "pulsed" else most)


def rows_a_period(values: Values, step: float) -> int:
    """Return the number of rows over which the dipole of coils is averaged.

    For pulsed coils these are the rows of a period, otherwise it is one row.
    """
    return (
        max(1, round(values["sample_time"] / step))
        if values.get("drive") == "pulsed"
        else 1
    )


@by_rows(1)
def coil_dipoles(m: Array, inverse: Array) -> Array:
    """Compute the size of each coil's dipole (rows, coils; A m2) from their sum."""
    return np.asarray(np.abs(m @ inverse.T))


def of_coils(m: Array, inverse: Array, most: float, period: int) -> tuple[float, float]:
    """Compute the coil duty and the share of time with a coil saturated (both in %).

    The dipole m is (rows, 3) A m2, body, and `inverse` the pseudoinverse (coils, 3) of
    the coil axes. The dipole is averaged over `period` rows, and `most` is the largest
    average (A m2) of each coil.
    """
    coils = coil_dipoles(m, inverse)
    coils = coils[: len(coils) // period * period]
    coils = coils.reshape(-1, period, coils.shape[1]).mean(axis=1)
    at_limit = (coils >= AT_LIMIT * most).any(axis=1)
    return 100.0 * float(coils.mean()) / most, 100.0 * float(at_limit.mean())


def fill(manifest: Manifest, results: Results) -> Array | None:
    """Compute the momentum of the fullest wheel as a share of its capacity (rows,), %.

    None where the wheels' capacity is not known, or their momentum not recorded.
    """
    parts: ManagementParts | None = manifest.parts.get(KEY)
    if parts is None or not parts.wheels or missing(signals(parts)[:1], results):
        return None
    wheels = _wheels_of(manifest, parts)
    there = existing(wheels)
    if not there.any() or not {"inertia_wheel", "speed_limit"} <= wheels.keys():
        return None
    h = results.series(signals(parts)[0], there)
    return 100.0 * share_of_capacity(h, capacities(wheels)[there])


def stored(manifest: Manifest, results: Results) -> Array | None:
    """Compute the total momentum of the wheels (rows, 3) N m s, body.

    None where it is not recorded.
    """
    parts: ManagementParts | None = manifest.parts.get(KEY)
    if parts is None or missing(signals(parts)[:1], results):
        return None
    wheels = _wheels_of(manifest, parts)
    there = existing(wheels)
    h = results.values(signals(parts)[0])[:, there]
    return np.asarray(h @ axes_of(wheels)[:, there].T)


@by_rows(1)
def share_of_capacity(h: Array, capacity: Array) -> Array:
    """Compute the share of its capacity (rows,) that the fullest wheel holds."""
    return np.asarray((np.abs(h) / capacity).max(axis=1))


@by_rows(1)
def is_negative(speed: Array) -> Array:
    """Return whether speeds (rows, wheels) are negative."""
    return np.signbit(speed)


def margin(h: Array, capacity: Array) -> float:
    """Compute the smallest momentum margin (%) of the wheels.

    Momenta are (rows, wheels) and capacities (wheels,), both in N m s.
    """
    return 100.0 * (1.0 - float(share_of_capacity(h, capacity).max()))


def of_wheels(times: Array, saturated: Array, speed: Array) -> tuple[float, float]:
    """Compute the time with a wheel saturated (s) and the number of zero crossings."""
    steps = np.diff(times, append=times[-1])
    at_limit = np.asarray(saturated.reshape(len(saturated), -1).any(axis=1))
    crossings = np.diff(is_negative(speed), axis=0).sum()
    return float(steps[: len(at_limit)] @ at_limit), float(crossings)
