"""Generate seeded noise as a function of (key, index, channel).

The noise does not depend on call patterns. A stream's key is made of the instance's
name, the variable and the seed (`stream`), so that no two variables of a system draw
the same numbers, whatever their seeds. The generator is counter-based (the SplitMix64
finaliser), with the Box-Muller transform. It gives the same bits on every platform that
rounds sqrt, log, cos and sin alike.
"""

from __future__ import annotations

from functools import lru_cache
from math import cos, log, pi, sin, sqrt

from ..contract.block import Vec3

_MASK = (1 << 64) - 1


def _mix(key: int) -> int:
    """Mix the bits of a key (64 bits) by the SplitMix64 step."""
    x = (key + 0x9E3779B97F4A7C15) & _MASK
    x = ((x ^ (x >> 30)) * 0xBF58476D1CE4E5B9) & _MASK
    x = ((x ^ (x >> 27)) * 0x94D049BB133111EB) & _MASK
    return x ^ (x >> 31)


def stream(instance: str, variable: str, seed: int) -> int:
    """Compute the key (64 bits) of the noise of one variable of one instance.

    FNV-1a over `instance.variable` in UTF-8 (Fowler, Noll & Vo; RFC 9923), mixed with
    the seed.
    """
    key = 0xCBF29CE484222325
    for byte in f"{instance}.{variable}".encode():
        key = ((key ^ byte) * 0x100000001B3) & _MASK
    return _mix(key ^ _mix(seed))


@lru_cache(maxsize=256)
def _sample(key: int, index: int) -> int:
    """Compute the state of a sample, from which its channels are drawn."""
    return _mix(_mix(key) ^ index)


def uniform(key: int, index: int, channel: int = 0) -> float:
    """Draw a number from (0, 1), never 0 or 1."""
    x = (
        (_sample(key, index) ^ channel) + 0x9E3779B97F4A7C15
    ) & _MASK  # _mix, written out
    x = ((x ^ (x >> 30)) * 0xBF58476D1CE4E5B9) & _MASK
    x = ((x ^ (x >> 27)) * 0x94D049BB133111EB) & _MASK
    return (((x ^ (x >> 31)) >> 12) + 0.5) / (1 << 52)


def normal_pair(key: int, index: int, channel: int = 0) -> tuple[float, float]:
    """Draw two independent standard normal numbers.

    The channels `channel` and `channel + 1` are used.
    """
    radius = sqrt(-2.0 * log(uniform(key, index, channel)))
    angle = 2.0 * pi * uniform(key, index, channel + 1)
    return radius * cos(angle), radius * sin(angle)


def normal3(key: int, index: int, channel: int = 0) -> Vec3:
    """Draw three independent standard normal numbers.

    Four channels from `channel` on are used.
    """
    a, b = normal_pair(key, index, channel)
    c, _ = normal_pair(key, index, channel + 2)
    return (a, b, c)


def normal6(key: int, index: int, channel: int = 0) -> tuple[Vec3, Vec3]:
    """Draw six independent standard normal numbers.

    Six channels from `channel` on are used.
    """
    a, b = normal_pair(key, index, channel)
    c, d = normal_pair(key, index, channel + 2)
    e, f = normal_pair(key, index, channel + 4)
    return (a, b, c), (d, e, f)
