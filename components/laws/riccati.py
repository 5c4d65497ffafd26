"""Compute the infinite-horizon gain of a linear system of three states.

For x' = W x + N_con + B u with the cost 1/2 int x'F x + u'R u dt, S = B R^-1 B', the
best u is -R^-1 B' (K x - g). Units are those of the caller; S and F scale the problem
inside.
"""

from __future__ import annotations

from functools import lru_cache
from math import sqrt

from ..contract.block import Mat33, Vec3
from ..maths.matrix import add, multiply, scale, subtract, transpose
from ..maths.vector import IDENTITY, inverse, mat_vec

# Decay of the slowest closed-loop mode, relative to sqrt(|S| |F|), below which the
# system counts as one that cannot be stabilised.
LEAST_DECAY = 1e-6
_SHIFT = 0.5
_DOUBLINGS = 30  # as many as LEAST_DECAY needs; eight are usual


@lru_cache(maxsize=1)  # It depends on field and rate alone, not on the momentum.
def infinite_gain(w: Mat33, s: Mat33, f: Mat33) -> Mat33 | None:
    """Solve W'K + K W - K S K + F = 0 for the K that makes W - S K stable.

    None where there is none. S and F are symmetric without negative eigenvalues. By the
    doubling algorithm, scaled so that S and F are of size 1: after k doublings the
    Cayley transform of the closed loop is at the power 2^k.

    Source: Chu, Fan, Lin, A structure-preserving doubling algorithm for continuous-time
    algebraic Riccati equations, Linear Algebra and its Applications 396 (2005) 55;
    paper 000, section III.A.
    """
    largest_s, largest_f = _size(s), _size(f)
    rate = sqrt(largest_s * largest_f)
    if rate == 0.0:
        return None
    a, g, h = scale(1.0 / rate, w), scale(1.0 / largest_s, s), scale(1.0 / largest_f, f)
    shifted_inverse = inverse(subtract(a, scale(_SHIFT, IDENTITY)))
    shifted_g = multiply(shifted_inverse, g)
    left_factor = inverse(
        add(transpose(inverse(shifted_inverse)), multiply(h, shifted_g))
    )
    power = add(IDENTITY, scale(2.0 * _SHIFT, transpose(left_factor)))
    reach = scale(2.0 * _SHIFT, multiply(shifted_g, left_factor))
    gain = scale(2.0 * _SHIFT, multiply(left_factor, multiply(h, shifted_inverse)))
    has_converged = False
    for _ in range(_DOUBLINGS):
        middle = inverse(add(IDENTITY, multiply(reach, gain)))
        ahead = multiply(power, middle)
        more = multiply(multiply(transpose(power), gain), multiply(middle, power))
        reach = add(reach, multiply(multiply(ahead, reach), transpose(power)))
        gain = add(gain, more)
        power = multiply(ahead, power)
        if _size(more) <= 1e-17 * _size(gain):
            has_converged = True
            break
    gain = scale(0.5, add(gain, transpose(gain)))
    if not has_converged or not _decays(subtract(a, multiply(g, gain)), LEAST_DECAY):
        return None
    return scale(sqrt(largest_f / largest_s), gain)


def infinite_offset(k: Mat33, w: Mat33, s: Mat33, n_con: Vec3) -> Vec3:
    """Compute g = (W - S K)^-T K N_con for a constant N_con.

    This is eq. 11 of paper 000 at rest.
    """
    closed_loop = subtract(w, multiply(s, k))
    return mat_vec(inverse(transpose(closed_loop)), mat_vec(k, n_con))


def _size(m: Mat33) -> float:
    """Compute the Frobenius norm |m|."""
    a, b, c, d, e, f, g, h, i = m
    return sqrt(a * a + b * b + c * c + d * d + e * e + f * f + g * g + h * h + i * i)


def _decays(m: Mat33, least: float) -> bool:
    """Return whether all eigenvalues of m have real parts below -least.

    Routh's criterion for those of m + least.
    """
    a, b, c, d, e, f, g, h, i = add(m, scale(least, IDENTITY))
    second = -(a + e + i)
    first = (a * e - b * d) + (a * i - c * g) + (e * i - f * h)
    last = -(a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g))
    return second > 0.0 and last > 0.0 and second * first > last
