"""Determine the noise of a system's sensors, for laws that filter it."""

from __future__ import annotations

from math import hypot, sqrt

from .craft import craft_of
from .model import Component, System

# Standard deviations at each sample: name of the manager's parameter -> unit.
KNOWN = {
    "field_noise": "T",
    "h_noise": "N.m.s",
    "rate_noise": "rad/s",
    "attitude_noise": "rad",
}


def noise_of(system: System) -> dict[str, float]:
    """Return the standard deviations of KNOWN, in the units given there.

    They are those of a field component, of a wheel's momentum, of a rate about an axis,
    and of the attitude about an axis including slow errors. A sensor without noise, or one that is not
    ours, has 0.
    """
    gyro = craft_of(system).gyro
    attitude = craft_of(system).determination or craft_of(system).star_tracker
    walk, period = _of(gyro, "angle_random_walk"), _of(gyro, "sample_time")
    white = walk / sqrt(period or system.step)
    across = ("noise", "markov_sigma", "noise_about", "drift_about")
    return {
        "field_noise": _of(craft_of(system).magnetometer, "noise"),
        "h_noise": _of(craft_of(system).tachometers, "noise"),
        "rate_noise": hypot(_of(gyro, "noise"), white),
        "attitude_noise": hypot(*(_of(attitude, name) for name in across)),
    }


def _of(component: Component | None, name: str) -> float:
    """Return a parameter of a component; 0 without component or parameter."""
    return 0.0 if component is None else float(component.values.get(name, 0.0))
