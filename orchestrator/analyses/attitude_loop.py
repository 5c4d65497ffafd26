"""Check whether the sampled attitude control of a craft is stable with wheel momentum.

`system/sampled_loop.py` has the linear loop. It is evaluated with wheels at rest, as
they start, and full: at the threshold of dumps where there is one, otherwise at their
capacity.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from desat.components.contract.roles import Manager

from ..language.content import content_of
from ..system.craft import RigidBody, craft_of
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
from ..system.wheels import axes_of

Array = NDArray[np.float64]

CONTROLLERS = ("controller_pid", "controller_pd")


class LoopCondition(NamedTuple):
    """Wheel momentum at which the loop is evaluated."""

    name: str  # for messages
    momentum: Array  # (3,) N m s, body
    stability: Stability
    full: bool = False  # whether the wheels are fuller than at the start of a run


def loop_of(system: System) -> AttitudeLoop | None:
    """Build the attitude loop of a system, or return None without blocks of ours."""
    craft = craft_of(system)
    body, controller, manager = craft.rigid_body, craft.controller, craft.manager
    if body is None or controller is None or manager is None:
        return None
    if not _is_closed(system, body, controller, manager) or not body.is_possible:
        return None
    step = system.step / system.parts
    settings = manager.values
    return AttitudeLoop(
        inertia=body.carrier,
        gain_matrix=np.reshape(controller.values["gain_matrix"], (3, 3)),
        kp=controller.values["kp"],
        kd=controller.values["kd"],
        ki=controller.values.get("ki", 0.0),
        actuated=(body.axes * body.wheels.exist)
        @ np.linalg.pinv(axes_of(manager.values)),
        motor_lag=body.wheels.component.values.get("motor_lag", 0.0),
        gyroscopic=bool(settings.get("gyroscopic", True)),
        step=step,
        gyro_sample=_sample(craft.gyro, step),
        attitude_sample=max(
            _sample(craft.determination, step), _sample(craft.star_tracker, step)
        ),
        controller_sample=controller.values["sample_time"] or step,
        wheel_sample=settings.get("wheel_sample_time")
        or settings["sample_time"]
        or step,
        controller_delay=controller.values.get("delay", 0.0),
        manager_delay=settings.get("delay", 0.0),
    )


def _is_closed(
    system: System, body: RigidBody, controller: Component, manager: Component
) -> bool:
    """Return whether our controller and manager close the attitude loop by the wheels."""
    if controller.model not in CONTROLLERS or manager.block is None:
        return False
    block = manager.block
    if not issubclass(block, Manager) or not block.passes_torque:
        return False
    wheels = body.wheels.component
    if (
        wheels.name,
        "tau_cmd_wheel",
    ) not in system.fed or "axes_wheel" not in wheels.values:
        return False
    if wheels.values.get("command_mode", 0) != 0:
        return False
    return bool(controller.values.get("enable", True)) and (
        system.fed.get((manager.name, "tau_ctrl_body")) is not None
    )


def _sample(sensor: Component | None, step: float) -> float:
    """Return the sample time (s) of a sensor, or the step where there is none."""
    return step if sensor is None else sensor.values.get("sample_time", 0.0) or step


def conditions(
    system: System, loop: AttitudeLoop, body: RigidBody
) -> Iterator[LoopCondition]:
    """Evaluate a loop with wheels at rest, as they start, and full."""
    yield LoopCondition(
        "with wheels at rest", np.zeros(3), stability(loop, np.zeros(3))
    )
    start = axes_of(body.wheels.component.values) @ body.wheels.h_start
    if start.any():
        yield LoopCondition(
            "with the wheels' momentum at the start", start, stability(loop, start)
        )
    each, name = _full(system, body)
    if np.isfinite(each).all():
        momentum, result = worst_momentum(loop, body.wheels.axes, each)
        yield LoopCondition(name, momentum, result, full=True)


def _full(system: System, body: RigidBody) -> tuple[Array, str]:
    """Return the largest momenta (m,) N m s of the wheels, and what limits them."""
    each, manager = body.wheels.capacities, craft_of(system).manager
    if manager is not None and manager.model == "manager_threshold":
        each = np.minimum(each, manager.values["begin"])
        return each, "with the wheels where dumps begin"
    return each, "with full wheels"


def problems(system: System) -> Iterator[str]:
    """Yield a line for each condition with an unstable loop, at rest and at the start.

    A scenario whose loop is unstable on purpose declares it (`unstable`).
    """
    yield from _unstable(system, full=False)


def problems_when_full(system: System) -> Iterator[str]:
    """Yield a line if the loop is unstable with full wheels.

    A run may never reach that state.
    """
    yield from _unstable(system, full=True)


def _unstable(system: System, full: bool) -> Iterator[str]:
    """Yield a line for each unstable condition, with full wheels or the others."""
    if content_of(system.about).unstable:
        return
    for condition, loop in _looked_at(system):
        if condition.full == full and not condition.stability.stable:
            yield _line(system, loop, condition, "is unstable")


def warnings(system: System) -> Iterator[str]:
    """Yield a line for each condition in which the attitude loop is poorly damped.

    Unstable conditions are among them with full wheels, and where a scenario gives a
    reason.
    """
    reason = content_of(system.about).unstable
    for condition, loop in _looked_at(system):
        stability = condition.stability
        if not stability.stable and (reason or condition.full):
            line = _line(system, loop, condition, "is unstable")
            yield f"{line} ({reason})" if reason else line
        elif stability.stable and not stability.well_damped:
            damping = (
                f"has a damping of {stability.damping:.2g} (below {LEAST_DAMPING:g})"
            )
            yield _line(system, loop, condition, damping)


# conditions of the last systems, by all that matters for them
_KNOWN: dict[
    tuple[object, ...], list[LoopCondition]
] = {}  # of the last systems, by all that counts
MOST_KNOWN = 64


def _looked_at(system: System) -> Iterator[tuple[LoopCondition, AttitudeLoop]]:
    """Yield each condition of a system's loop, if it has one of our blocks.

    The conditions of the last systems are cached.
    """
    loop, body = loop_of(system), craft_of(system).rigid_body
    if loop is None or body is None:
        return
    wheels = body.wheels
    each, name = _full(system, body)
    loops = (
        x.tobytes() if isinstance(x, np.ndarray) else x for x in vars(loop).values()
    )
    key = (
        *loops,
        wheels.axes.tobytes(),
        each.tobytes(),
        wheels.h_start.tobytes(),
        name,
    )
    if key not in _KNOWN:
        if len(_KNOWN) >= MOST_KNOWN:
            _KNOWN.clear()
        _KNOWN[key] = list(conditions(system, loop, body))
    for condition in _KNOWN[key]:
        yield condition, loop


def _line(
    system: System, loop: AttitudeLoop, condition: LoopCondition, finding: str
) -> str:
    """Build the line on a condition, with a sample time that would suffice."""
    controller, body = craft_of(system).controller, craft_of(system).rigid_body
    assert controller is not None
    assert body is not None
    nutation = loop.nutation(condition.momentum)
    turns = f"nutates at {nutation:.3g} rad/s, {nutation * loop.sample():.3g} rad in a sample of "
    at = f", where the craft {turns}{loop.sample():g} s" if nutation > 0.0 else ""
    axes, (each, _) = body.wheels.axes, _full(system, body)
    each = each if np.isfinite(each).all() else np.zeros(len(each))
    enough = longest_sample(loop, axes, each, SAMPLE_TIMES)
    remedy = (
        "no sample time alone helps" if enough is None else f"{enough:g} s would do"
    )
    name = f"{system.place}: {controller.name}"
    return f"{name}: attitude control {finding} {condition.name}{at}: {remedy}"
