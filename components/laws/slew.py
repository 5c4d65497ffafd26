"""Foresee the attitude of a known slew, rest to rest about one axis (`rest_to_rest`)."""

from __future__ import annotations

from typing import NamedTuple

from ..contract.block import Vec3, Vec4
from ..maths.attitude import propagate
from ..maths.vector import scale
from .attitude_control import rest_to_rest


class Slew(NamedTuple):
    """A slew; its rotation vector has the same components in every frame meanwhile."""

    rotation: Vec3  # rad, body; zero: there is none
    begin: float  # s
    end: float  # s, after `begin`


def attitude_at(slew: Slew, q: Vec4, since: float, at: float) -> Vec4:
    """Return the attitude at time `at` (s) of a craft that has q at time `since` (s).

    q is relative to the frame in which the craft is at rest before and after, scalar last.
    """
    duration = slew.end - slew.begin
    before, _ = rest_to_rest((since - slew.begin) / duration)
    after, _ = rest_to_rest((at - slew.begin) / duration)
    if before == after:
        return q
    return propagate(q, slew.rotation, after - before)


def rate_at(slew: Slew, t: float) -> Vec3:
    """Return the rate of the slew at t (rad/s, body)."""
    duration = slew.end - slew.begin
    _, rate = rest_to_rest((t - slew.begin) / duration)
    return scale(rate / duration, slew.rotation)
