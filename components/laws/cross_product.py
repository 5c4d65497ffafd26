"""Compute cross-product laws for momentum dumping by magnetic torquers alone.

h (N m s) is the excess momentum of the wheels, B (T) the measured field, both in body;
the dipole M (A m2) gives the torque M x B = -k h across B.
"""

from __future__ import annotations

from ..contract.block import Vec3
from ..maths.vector import ZERO, cross, dot, norm, scale


def normalised(h: Vec3, b: Vec3, gain: float) -> Vec3:
    """Compute M = gain (h x B) / |B|^2 (A m2).

    gain (1/s) is the rate at which momentum across B decays. Zero without a field.
    """
    size2 = dot(b, b)
    return scale(gain / size2, cross(h, b)) if size2 > 0.0 else ZERO


def ccpl(h: Vec3, b: Vec3, gain: float) -> Vec3:
    """Compute M = gain (h x B) / |B| (A m2), gain in 1/(T s) (paper 000, eq. 31).

    Zero without a field.
    """
    size = norm(b)
    return scale(gain / size, cross(h, b)) if size > 0.0 else ZERO
