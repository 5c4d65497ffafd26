"""What the sensors of a system measure with, as laws that filter it are told."""

from __future__ import annotations

from math import hypot, sqrt

from .craft import craft_of
from .model import Component, System

KNOWN = {"h_noise": "N.m.s", "rate_noise": "rad/s", "attitude_noise": "rad"}
"""Standard deviations at each sample, by the names that managers' parameters have, and
units."""


def noise_of(system: System) -> dict[str, float]:
    """The standard deviations of KNOWN: of a wheel's momentum, of a rate about an axis
    and of the attitude about an axis, slow errors among the latter; 0 where a sensor
    has none, or is not of ours."""
    gyro = craft_of(system).gyro
    attitude = craft_of(system).determination or craft_of(system).star_tracker
    walk, period = _of(gyro, "angle_random_walk"), _of(gyro, "sample_time")
    white = walk / sqrt(period or system.step)
    across = ("noise", "markov_sigma", "noise_about", "drift_about")
    return {
        "h_noise": _of(craft_of(system).tachometers, "noise"),
        "rate_noise": hypot(_of(gyro, "noise"), white),
        "attitude_noise": hypot(*(_of(attitude, name) for name in across)),
    }


def _of(component: Component | None, name: str) -> float:
    return 0.0 if component is None else float(component.values.get(name, 0.0))
