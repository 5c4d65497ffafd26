"""Estimate the rate of the measured field and the body rate that it shows.

b (T) is the geomagnetic field, body; b' (T/s) its derivative as the body sees it, which
is -omega x b plus the field's own rotation along the orbit (up to some 2e-3 rad/s in
low orbits).
"""

from __future__ import annotations

from math import exp

from ..contract.block import Vec3
from ..maths.vector import ZERO, add, cross, dot, scale, sub


def difference(b: Vec3, before: Vec3, elapsed_time: float) -> Vec3:
    """Compute b' (T/s) from two samples `elapsed_time` (s, above 0) apart.

    Paper 003, eq. 2.
    """
    return scale(1.0 / elapsed_time, sub(b, before))


def low_pass(last: Vec3, rate: Vec3, cut_off: float, elapsed_time: float) -> Vec3:
    """Filter b' (T/s) by a first-order low-pass, `elapsed_time` (s) after `last`.

    cut_off in rad/s. With `difference` before it, this is the filtered derivative s /
    (1 + s / cut_off) of b.
    """
    decay = exp(-cut_off * elapsed_time)
    return add(scale(decay, last), scale(1.0 - decay, rate))


def rate_across(b: Vec3, b_rate: Vec3) -> Vec3:
    """Estimate the body's rate across the field (rad/s): -b x b' / |b|^2.

    b' = -omega x b gives b x b' = -(|b|^2 omega - (b.omega) b), hence the sign. The
    part along b is not observed, and the field's own rotation counts as the body's.
    """
    size2 = dot(b, b)
    return scale(-1.0 / size2, cross(b, b_rate)) if size2 > 0.0 else ZERO
