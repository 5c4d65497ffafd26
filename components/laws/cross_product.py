"""Cross-product laws for momentum dumping by magnetic torquers alone.

h (N m s) is the excess momentum of the wheels, B (T) the measured field, both in body;
the dipole M (A m2) gives the torque M x B = -k h across B.
"""

from __future__ import annotations

from ..contract.block import Vec3
from ..maths.vector import ZERO, cross, dot, norm, scale


def normalised(h: Vec3, b: Vec3, gain: float) -> Vec3:
    """M = gain (h x B) / |B|^2, gain in 1/s: the rate at which momentum across B
    decays."""
    size2 = dot(b, b)
    return scale(gain / size2, cross(h, b)) if size2 > 0.0 else ZERO


def ccpl(h: Vec3, b: Vec3, gain: float) -> Vec3:
    """M = gain (h x B) / |B|, gain in 1/(T s) (paper 000, eq. 31)."""
    size = norm(b)
    return scale(gain / size, cross(h, b)) if size > 0.0 else ZERO
