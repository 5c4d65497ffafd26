"""Whether the attitude control of a craft is stable as it is sampled, with momentum in its wheels.

`system/sampled_loop.py` has the linear loop. It is looked at with wheels at rest, as they start,
and full: at the threshold of dumps where there is one, else at their capacity.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from desat.components.contract.roles import Manager
from desat.fmus.registry import block_class, names

from ..language.content import content_of
from ..system.model import Component, System
from ..system.sampled_loop import (
    LEAST_DAMPING,
    SAMPLE_TIMES,
    AttitudeLoop,
    Stability,
    longest_sample,
    stability,
    worst_momentum,
)
from ..system.wheels import axes_of, capacities, existing
from . import residual

Array = NDArray[np.float64]

CONTROLLERS = ("controller_pid", "controller_pd")


class Condition(NamedTuple):
    """A momentum of the wheels at which the loop is looked at."""

    name: str  # for people
    momentum: Array  # (3,) N m s, body
    stability: Stability
    full: bool = False  # of wheels that are fuller than a run begins with


def loop_of(system: System) -> AttitudeLoop | None:
    """Return the attitude loop of a system, or None where it is not of our blocks."""
    body = residual.rigid_body(system)
    controller, manager = system.roles.get("controller"), system.roles.get("manager")
    if body is None or controller is None or manager is None:
        return None
    craft = system.components[body.spacecraft]
    wheels = system.components[body.wheels.partition(".")[0]]
    if not _is_closed(system, craft, wheels, controller, manager):
        return None
    axes, spin = axes_of(craft.values), np.array(craft.values["inertia_wheel"])
    driven = axes * existing(wheels.values)
    inertia = residual.carrier(np.reshape(craft.values["inertia"], (3, 3)), axes, spin)
    if np.linalg.eigvalsh(inertia).min() <= 0.0:
        return None
    step = system.step / system.parts
    own = manager.values
    return AttitudeLoop(
        inertia=inertia,
        gain_matrix=np.reshape(controller.values["gain_matrix"], (3, 3)),
        kp=controller.values["kp"],
        kd=controller.values["kd"],
        ki=controller.values.get("ki", 0.0),
        actuated=driven @ np.linalg.pinv(axes_of(manager.values)),
        motor_lag=wheels.values.get("motor_lag", 0.0),
        gyroscopic=bool(own.get("gyroscopic", True)),
        step=step,
        gyro_sample=_sample(system, "gyro", step),
        attitude_sample=max(
            _sample(system, "determination", step), _sample(system, "star_tracker", step)
        ),
        controller_sample=controller.values["sample_time"] or step,
        wheel_sample=own.get("wheel_sample_time") or own["sample_time"] or step,
        controller_delay=controller.values.get("delay", 0.0),
        manager_delay=own.get("delay", 0.0),
    )


def _is_closed(
    system: System, craft: Component, wheels: Component, controller: Component, manager: Component
) -> bool:
    """Return whether our controller and manager close the attitude loop by the wheels."""
    if controller.interface.model not in CONTROLLERS or manager.interface.model not in names():
        return False
    block = block_class(manager.interface.model)
    if not issubclass(block, Manager) or not block.passes_torque:
        return False
    if (wheels.name, "tau_cmd_wheel") not in system.fed or "axes_wheel" not in wheels.values:
        return False
    if wheels.values.get("command_mode", 0) != 0:
        return False
    return bool(controller.values.get("enable", True)) and (
        system.fed.get((manager.name, "tau_ctrl_body")) is not None
    )


def _sample(system: System, role: str, step: float) -> float:
    """Return the sample time (s) of a sensor, or the step where there is none."""
    sensor = system.roles.get(role)
    return step if sensor is None else sensor.values.get("sample_time", 0.0) or step


def conditions(system: System, loop: AttitudeLoop) -> Iterator[Condition]:
    """Look at a loop with wheels at rest, as they start, and full."""
    body = residual.rigid_body(system)
    assert body is not None
    wheels = system.components[body.wheels.partition(".")[0]]
    yield Condition("with wheels at rest", np.zeros(3), stability(loop, np.zeros(3)))
    start = axes_of(wheels.values) @ np.array(wheels.values.get("h_start_wheel", (0.0,) * 4))
    if start.any():
        yield Condition("with the wheels' momentum at the start", start, stability(loop, start))
    axes, each, name = _full(system, wheels)
    if np.isfinite(each).all():
        momentum, found = worst_momentum(loop, axes, each)
        yield Condition(name, momentum, found, full=True)


def _full(system: System, wheels: Component) -> tuple[Array, Array, str]:
    """Return axes (3, n) and largest momenta (n,) N m s of the wheels, and what bounds these."""
    there = existing(wheels.values)
    axes, each = axes_of(wheels.values)[:, there], capacities(wheels.values)[there]
    manager = system.roles["manager"]
    begin = manager.values.get("begin")
    if begin is not None and manager.interface.model == "manager_threshold":
        return axes, np.minimum(each, begin), "with the wheels where dumps begin"
    return axes, each, "with full wheels"


def problems(system: System) -> Iterator[str]:
    """Find whether the attitude loop is unstable at rest or as the wheels start, a line each.

    A scenario whose loop is unstable on purpose says so (`unstable`).
    """
    yield from _unstable(system, full=False)


def problems_when_full(system: System) -> Iterator[str]:
    """Find whether the attitude loop is unstable with full wheels, which a run may not come to."""
    yield from _unstable(system, full=True)


def _unstable(system: System, full: bool) -> Iterator[str]:
    if content_of(system.about).unstable:
        return
    for condition, loop in _looked_at(system):
        if condition.full == full and not condition.stability.stable:
            yield _line(system, loop, condition, "is unstable")


def warnings(system: System) -> Iterator[str]:
    """Find conditions in which the attitude loop is poorly damped, a line each; those in which it
    is unstable where a scenario says why, and with full wheels."""
    why = content_of(system.about).unstable
    for condition, loop in _looked_at(system):
        found = condition.stability
        if not found.stable and (why or condition.full):
            line = _line(system, loop, condition, "is unstable")
            yield f"{line} ({why})" if why else line
        elif found.stable and not found.well_damped:
            damping = f"has a damping of {found.damping:.2g} (below {LEAST_DAMPING:g})"
            yield _line(system, loop, condition, damping)


_KNOWN: dict[tuple[object, ...], list[Condition]] = {}  # of the last systems, by all that counts
MOST_KNOWN = 64


def _looked_at(system: System) -> Iterator[tuple[Condition, AttitudeLoop]]:
    """Look at each condition of a system's loop, if it has one of our blocks."""
    loop = loop_of(system)
    if loop is None:
        return
    body = residual.rigid_body(system)
    assert body is not None
    wheels = system.components[body.wheels.partition(".")[0]]
    axes, each, name = _full(system, wheels)
    start = np.array(wheels.values.get("h_start_wheel", (0.0,) * 4))
    loops = (x.tobytes() if isinstance(x, np.ndarray) else x for x in vars(loop).values())
    key = (*loops, axes.tobytes(), each.tobytes(), start.tobytes(), name)
    if key not in _KNOWN:
        if len(_KNOWN) >= MOST_KNOWN:
            _KNOWN.clear()
        _KNOWN[key] = list(conditions(system, loop))
    for condition in _KNOWN[key]:
        yield condition, loop


def _line(system: System, loop: AttitudeLoop, condition: Condition, what: str) -> str:
    controller = system.roles["controller"]
    nutation = loop.nutation(condition.momentum)
    turns = f"nutates at {nutation:.3g} rad/s, {nutation * loop.sample():.3g} rad in a sample of "
    at = f", where the craft {turns}{loop.sample():g} s" if nutation > 0.0 else ""
    body = residual.rigid_body(system)
    assert body is not None
    axes, each, _ = _full(system, system.components[body.wheels.partition(".")[0]])
    each = each if np.isfinite(each).all() else np.zeros(len(each))
    enough = longest_sample(loop, axes, each, SAMPLE_TIMES)
    remedy = "no sample time alone helps" if enough is None else f"{enough:g} s would do"
    name = f"{system.where}: {controller.name}"
    return f"{name}: attitude control {what} {condition.name}{at}: {remedy}"
