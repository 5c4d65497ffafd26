"""The standard numbers of a managed run: what the wheels hold, and what the coils do about it.

Of wheels with axes A (columns) and momenta h the coils can act on the sum A h alone. What is left,
h - A^+ A h, adds up to nothing: no torque on the body changes it. A mean over wheels cannot tell
the two apart, so each has its number; the others say how near wheels and coils are to their limits.

What management takes out is said against the same run without it: the external impulse less that of
coils and thrusters, at the attitudes that were flown, would be in the wheels. A law that is to hold
the momentum and leaves more of it in the second half of a run than none would has its goal not met.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from desat.components.contract.roles import Manager
from desat.fmus.registry import block_class, names

from ..language.content import content_of
from ..numbers.derived import coil_impulse, matrices, rotate, rotate_back
from ..numbers.text import Value
from ..system.model import Component, System
from . import Parts, with_titles
from .manifest import Manifest
from .residual import carrier_of, missing

if TYPE_CHECKING:
    from ..engine.recording.results import Results

KEY = "management"
NUMBERS = (
    "sum_rms", "sum_largest", "null_rms", "coil_duty", "coil_limit_share", "momentum_margin",
    "limit_time", "crossings", "left_rms", "unmanaged_rms",
    "least_braking",
)  # fmt: skip
AT_LIMIT = 0.999
"""Share of its limit from which on a coil counts as at it: one with a lag never is quite."""
SMALL, ALIKE = 1e-3, 0.01
"""Momentum that counts as nothing, as a share of a wheel's capacity: what its tachometer sees; and
as a share of what there would be without management, which is estimated."""
FIELD = 3e-5
"""Of a low orbit (T)."""
ACROSS = 1e-3
"""A target across the orbit's normal by more than this share of its size turns with the craft."""
_OF_WHEELS = ("saturated_wheel", "speed_wheel")
Array = NDArray[Any]


@dataclass(frozen=True)
class ManagementParts(Parts):
    """Which component is what; no `wheels` where they are ideal ones within the craft."""

    spacecraft: str
    torquers: str
    wheels: str | None = None
    field: str | None = None
    """the series of the geomagnetic field, eci"""
    thrusters: str | None = None
    """whose firings are all management's"""
    target: tuple[float, ...] | None = None
    """N m s, body: the sum of the wheels' momentum that is wanted; None: it changes"""
    holds: bool = False
    """whether the law is to hold the momentum there as long as the run lasts"""
    deadband: float = 0.0
    """N m s, within which it does nothing"""
    brakes: bool = False
    """whether the law takes the rate out of a craft that tumbles"""


PARTS = ManagementParts


def applies(system: System) -> ManagementParts | None:
    """By the connections; None where no manager commands coils of a craft with wheels."""
    for torquers, wire in system.by_input["m_cmd_body"].items():
        manager, body = wire.source, system.takers.get((torquers, "m_mean_body"))
        if body is None or "h_copy_wheel" not in system.components[body].interface.arrays:
            continue
        wheels = system.takers.get((manager, "tau_cmd_wheel"))
        if wheels and not (
            system.components[wheels].interface.arrays.keys() >= set(_OF_WHEELS)
        ):  # fmt: skip
            wheels = None
        law = system.components[manager]
        thrusters = system.fed.get((body, "tau_mean_thruster_body"))
        field = system.fed.get((body, "b_eci"))
        return ManagementParts(
            body, torquers, wheels, field.series if field else None,
            thrusters.source if thrusters else None,
            _target(system, law), content_of(system.about).stop_when is None and _holds(law),
            law.values["h_deadband"] if "h_deadband" in law.interface.signals else 0.0,
            _brakes(law),
        )  # fmt: skip
    return None


def _target(system: System, law: Component) -> tuple[float, ...] | None:
    """The momentum that a manager is to keep (3,) N m s, body; None where another component says
    it."""
    if (law.name, "h_target_body") in system.fed:
        return None
    return tuple(law.values.get("h_target_body", (0.0, 0.0, 0.0)))


def _holds(law: Component) -> bool:
    """Whether a manager holds momentum, by what its block says of its laws (`Manager.offers`):
    the choices that these have in common are its own. One that is not ours does."""
    signals = law.interface.signals
    if "enable" in signals and not law.values["enable"]:
        return False
    if law.interface.model not in names():
        return True
    block = block_class(law.interface.model)
    if not issubclass(block, Manager) or block.no_law or not block.offers:
        return False
    first, *others = ({k: v for k, v in x.gains.items() if k in signals and signals[k].choices}
                      for x in block.offers)  # fmt: skip
    common = {k: v for k, v in first.items() if all(x.get(k) == v for x in others)}
    return all(law.choice(k) == v for k, v in common.items())


def _brakes(law: Component) -> bool:
    """Whether a manager of ours takes the rate out of a craft that tumbles."""
    block = block_class(law.interface.model) if law.interface.model in names() else None
    return block is not None and issubclass(block, Manager) and block.brakes


def warnings(system: System) -> Iterator[str]:
    """A line for a law whose gain takes more out in a sample than there is: it overshoots, and
    only the coils' limit keeps it from growing."""
    for c in system.components.values():
        block = block_class(c.interface.model) if c.interface.model in names() else None
        if block is None or not issubclass(block, Manager):
            continue
        sample = max(float(c.values.get("sample_time", 0.0)), system.step)
        for law in block.offers:
            rule = str(law.gains.get(law.rate, ""))
            choices = {k: v for k, v in law.gains.items()
                       if k in c.interface.signals and c.interface.signals[k].choices}  # fmt: skip
            chosen = all(c.choice(k) == v for k, v in choices.items())
            if not law.rate or not chosen:
                continue
            rate = c.values[law.rate] * (FIELD if "craft.field" in rule else 1.0)
            if rate * sample > 1.0:
                where = c.given.get(law.rate, system.where)
                yield (f"{where}: {c.name}.{law.rate} = {c.values[law.rate]:g}: at {rate:.3g} 1/s "
                       f"it takes {rate * sample:.3g} times the momentum out within a sample of "
                       f"{sample:g} s; usual is the orbit's rate, some 1e-3 1/s")  # fmt: skip


def problems(system: System) -> Iterator[str]:
    """A line where a manager is to keep a bias across the orbit's normal, in a craft that turns
    with its orbit: the bias would have to turn in eci, which no law here makes it do."""
    guides = (c for c in system.components.values() if c.interface.model == "guidance_nadir")
    managers = [c for c in system.components.values()
                if c.interface.role == "manager" and _holds(c)]  # fmt: skip
    for guide in guides:
        for manager in managers:
            wanted = np.array(_target(system, manager) or (0.0, 0.0, 0.0))
            offset = guide.values["q_bo"]
            normal = matrices(np.array([offset or [0.0, 0.0, 0.0, 1.0]]))[0] @ [0.0, -1.0, 0.0]
            across = wanted - (wanted @ normal) * normal
            if np.linalg.norm(across) > ACROSS * np.linalg.norm(wanted):
                shown = ", ".join(f"{x:g}" for x in wanted.tolist())
                where = manager.given.get("h_target_body", system.where)
                yield (f"{where}: {manager.name}.h_target_body = ({shown}) N m s: the craft turns "
                       "with its orbit, and no law turns a bias with it; only one along the "
                       f"orbit's normal, ({', '.join(f'{x:.3g}' for x in normal)}) in body, stays"
                       )  # fmt: skip


def signals(parts: ManagementParts) -> list[str]:
    """The series that the numbers are made of."""
    names = [f"{parts.spacecraft}.h_copy_wheel", f"{parts.torquers}.m_mean_body"]
    return names + [f"{parts.wheels}.{n}" for n in _OF_WHEELS if parts.wheels]


def numbers(manifest: Manifest, results: Results) -> dict[str, Value]:
    """The standard numbers of a completed run, as a manifest has them; none where too little was
    recorded, and only those for which the parameters are known."""
    parts: ManagementParts = manifest.parts[KEY]
    if not manifest.completed or missing(signals(parts), results):
        return {}
    h = results.values(f"{parts.spacecraft}.h_copy_wheel")
    axes = np.reshape(manifest.values_of(parts.spacecraft).get("axes_wheel", np.eye(3, 4)), (3, 4))
    there = np.linalg.norm(axes, axis=0) > 0.0
    h, axes = h[:, there], axes[:, there]
    stored = h @ axes.T
    size = np.linalg.norm(stored, axis=1)
    idle = h - stored @ np.linalg.pinv(axes).T
    times = results.times()
    rows: dict[str, tuple[str, float | None, str]] = {
        "sum_rms": ("Total wheel momentum (body frame), rms", _rms(size, times),
                    "N.m.s"),
        "sum_largest": ("Total wheel momentum (body frame), largest", float(size.max()),
                        "N.m.s"),
        "null_rms": ("Null-space momentum of the most loaded wheel, rms",
                     _rms(np.abs(idle).max(axis=1), times), "N.m.s"),
    }  # fmt: skip
    m = results.values(f"{parts.torquers}.m_mean_body")
    rows |= _of_coils(m, manifest.values_of(parts.torquers), manifest.step)
    if parts.wheels:
        own = manifest.values_of(parts.wheels)
        rows |= _of_wheels(parts.wheels, own, results, np.abs(h), there)
    if (compared := compare(manifest, results)) is not None:
        left, without = compared
        rows["left_rms"] = (
            "Total wheel momentum less its target in the second half, rms",
            left,
            "N.m.s",
        )
        rows["unmanaged_rms"] = (
            "Total wheel momentum without management in the second half, rms (estimated)",
            without,
            "N.m.s",
        )
    if (least := _least_braking(manifest, results)) is not None:
        title = "Shortest detumbling time with saturated coils"
        rows["least_braking"] = (title, least, "s")
    return with_titles(rows)


def _least_braking(manifest: Manifest, results: Results) -> float | None:
    """How long (s) coils at their limit take at least for the momentum that the body has at the
    start: a rod across the field B gives m |B|, and half of that in the mean over the attitudes of
    a craft that tumbles. None where it is not known, or the run is shorter."""
    parts: ManagementParts = manifest.parts[KEY]
    given, coils = manifest.parameters.get(parts.spacecraft, {}), manifest.values_of(parts.torquers)
    series = f"{parts.spacecraft}.omega_bi_body", str(parts.field)
    if not parts.brakes or missing(list(series), results) or "inertia" not in given:
        return None
    if coils.get("drive") == "ideal" or "m_limit" not in coils or "axes_coil" not in coils:
        return None
    omega, b = (results.values(s) for s in series)
    begun = float(np.linalg.norm(np.reshape(given["inertia"].value, (3, 3)) @ omega[0]))
    axes = np.reshape(coils["axes_coil"], (3, -1))
    most = float(coils["m_limit"]) * int((np.linalg.norm(axes, axis=0) > 0.0).sum())
    times = results.times()[: len(b)]
    given_each = 0.5 * most * np.linalg.norm(b, axis=1)[:-1] * np.diff(times)
    taken = np.concatenate([[0.0], np.cumsum(given_each)])
    if taken[-1] < begun:
        return None
    return float(np.interp(begun, taken, times)) - float(times[0])


def _rms(values: Array, times: Array) -> float:
    """The root of the mean over time of the square, linear between rows (rows,) at times (s)."""
    times = times[: len(values)]
    if len(values) < 2:
        return float(np.abs(values).mean())
    return float(np.sqrt(np.trapezoid(values**2, times) / (times[-1] - times[0])))


def balanced(parts: ManagementParts) -> list[str]:
    """The series that `compare` is made of; none where it cannot be made."""
    if parts.field is None:
        return []
    own = [f"{parts.spacecraft}.{n}" for n in ("q_bi", "omega_bi_body", "impulse_eci")]
    fired = [f"{parts.thrusters}.tau_mean_thruster_body"] if parts.thrusters else []
    return [*own, f"{parts.spacecraft}.h_copy_wheel", f"{parts.torquers}.m_mean_body",
            parts.field, *fired]  # fmt: skip


def compare(manifest: Manifest, results: Results) -> tuple[float, float] | None:
    """The wheels' momentum less its target over the second half, and what it would have been
    without management: rms (N m s). None where too little is recorded or known."""
    return results.once("managed", lambda: _compare(manifest, results))


def _compare(manifest: Manifest, results: Results) -> tuple[float, float] | None:
    parts: ManagementParts = manifest.parts[KEY]
    given = manifest.parameters.get(parts.spacecraft, {})
    if (
        parts.field is None or parts.target is None or manifest.algorithm != "gauss_seidel"
        or missing(balanced(parts), results)
    ):  # fmt: skip
        return None
    if parts.thrusters and any(np.ravel(manifest.values_of(parts.thrusters).get(
            "schedule_duration", 0.0)).tolist()):  # fmt: skip
        return None  # the torque of what is scheduled is a disturbance
    q, omega, impulse, h, dipole, b, *fired = (results.values(s) for s in balanced(parts))
    count = min(len(q), len(b), len(dipole) + 1)
    times, q, omega, impulse, h = (x[:count] for x in (results.times(), q, omega, impulse, h))
    if count < 4:
        return None
    axes = np.reshape(manifest.values_of(parts.spacecraft).get("axes_wheel", np.eye(3, 4)), (3, 4))
    body = omega @ carrier_of(given)[0].T if {"inertia", "inertia_wheel"} <= given.keys() else 0.0
    managed = coil_impulse(times, b[:count], q, dipole[: count - 1])
    for torque in fired:
        steps = np.diff(times)[:, None]
        managed[1:] += np.cumsum(rotate_back(q[:-1], torque[: count - 1]) * steps, axis=0)
    stored = h @ axes.T
    first = rotate_back(q[:1], (stored + body)[:1])
    without = rotate(q, first + impulse - impulse[:1] - managed) - body
    late = times >= (times[0] + times[-1]) / 2.0
    left, other = (
        _rms(np.linalg.norm(x[late] - np.array(parts.target), axis=1), times[late])
        for x in (stored, without)
    )
    return left, other


def unchecked(manifest: Manifest, results: Results) -> dict[str, str]:
    """Which numbers could not be made, and why, by their names."""
    parts: ManagementParts = manifest.parts[KEY]
    if why := missing(signals(parts), results):
        return dict.fromkeys(NUMBERS, why)
    if parts.holds and (why := missing(balanced(parts), results)):
        return dict.fromkeys(("left_rms", "unmanaged_rms"), why)
    return {}


def unmet(manifest: Manifest, results: Results) -> list[str]:
    """A line where a law that is to hold the momentum leaves more than none would."""
    parts: ManagementParts = manifest.parts[KEY]
    compared = compare(manifest, results) if manifest.completed else None
    if not parts.holds or compared is None:
        return []
    left, without = compared
    capacity = _capacity(manifest.values_of(parts.wheels or ""))
    if left <= (1.0 + ALIKE) * max(without, parts.deadband) + SMALL * capacity:
        return []
    return [f"management: wheel momentum less its target is {left:.3g} N m s rms in the second "
            f"half of the run, without management it would be {without:.3g}"]  # fmt: skip


def _capacity(wheels: Mapping[str, Any]) -> float:
    """The capacity of the smallest wheel that is there (N m s); 0 where it is not known."""
    if "inertia_wheel" not in wheels or "speed_limit" not in wheels:
        return 0.0
    there = [j for j in np.ravel(wheels["inertia_wheel"]).tolist() if j > 0.0]
    return float(min(there, default=0.0) * wheels["speed_limit"])


def _of_coils(m: Any, given: Mapping[str, Any], step: float) -> dict[str, tuple[str, float, str]]:
    """Duty of the coils, as a share of what they can do: in the mean of a step, or of a period
    where they are pulsed."""
    most = given.get("m_limit", 0.0)
    if given.get("drive") == "ideal" or not most or "axes_coil" not in given:
        return {}
    axes = np.reshape(given["axes_coil"], (3, -1))
    coils = np.abs(m @ np.linalg.pinv(axes[:, np.linalg.norm(axes, axis=0) > 0.0]).T)
    if given.get("drive") == "pulsed":
        most *= given["duty_max"]
        count = max(1, round(given["sample_time"] / step))
        coils = coils[: len(coils) // count * count].reshape(-1, count, coils.shape[1]).mean(axis=1)
    if not len(coils):
        return {}
    return {
        "coil_duty": ("Coil duty: mean dipole of the most loaded coil (share of its largest)",
                      100.0 * float(coils.mean()) / most, "%"),
        "coil_limit_share": ("Time with a coil saturated",
                             100.0 * float((coils >= AT_LIMIT * most).any(axis=1).mean()), "%"),
    }  # fmt: skip


def _of_wheels(
    wheels: str, given: Mapping[str, Any], results: Results, h: Any, there: Any
) -> dict[str, tuple[str, float, str]]:  # fmt: skip
    """How near the wheels come to their limits, and how often they pass zero speed."""
    rows = {}
    if "inertia_wheel" in given and "speed_limit" in given:
        capacity = (np.array(given["inertia_wheel"]) * given["speed_limit"])[there]
        margin = 100.0 * (1.0 - float((h / capacity).max()))
        rows["momentum_margin"] = ("Smallest momentum margin of a wheel",
                                    margin, "%")  # fmt: skip
    saturated, speed = (results.values(f"{wheels}.{n}") for n in _OF_WHEELS)
    steps = np.diff(results.times(), append=results.times()[-1])
    at_limit = np.asarray(saturated.reshape(len(saturated), -1).any(axis=1))
    crossings = (np.diff(np.signbit(speed[:, there]), axis=0)).sum()
    rows["limit_time"] = ("Time with a wheel saturated",
                           float(steps[: len(at_limit)] @ at_limit), "s")  # fmt: skip
    rows["crossings"] = ("Zero crossings of the wheels", float(crossings), "1")
    return rows
