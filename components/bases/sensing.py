"""What sensors have in common: failure, quantisation, saturation, drifting errors.

Every function takes its random numbers as arguments; `noise.py` makes them.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator
from math import pi, sqrt
from typing import ClassVar

from ..contract.block import Parameter, Sampled, Vec3


class Sensor(Sampled):
    """What a sensor does at its samples; a block adds `measure`."""

    fail_time: float = Parameter(
        "s",
        "from this time on invalid, holding the last value; negative: never",
        start=-1.0,
    )
    seed: int = Parameter(
        "1", "seed of the errors; instance name and variable key them as well", start=1
    )

    white: ClassVar[tuple[str, ...]] = ("noise",)
    """Parameters that are the deviation of a number drawn anew at each sample."""

    valid: bool

    def foresee(self, begin: float, end: float, wired: frozenset[str]) -> Iterator[str]:
        drawn = [name for name in self.white if getattr(self, name) > 0.0]
        if drawn and self.sample_time <= 0.0:
            yield (
                f"{drawn[0]} = {getattr(self, drawn[0]):g} is drawn anew at every step, "
                "without a sample_time: what it does depends on the step"
            )
        yield from super().foresee(begin, end, wired)

    def start(self) -> None:
        super().start()
        self.valid = True
        self.measure(0, 0.0)
        if failed(0.0, self.fail_time):
            self.lost()

    def advance(self, t: float, dt: float) -> None:
        before = self._sample
        if not self.due(t):
            return
        if failed(t, self.fail_time):
            self.lost()
            return
        self.valid = True
        self.measure(
            self._sample,
            (self._sample - before) * (self.sample_time or dt) if before >= 0 else 0.0,
        )

    def lost(self) -> None:
        """The sensor has failed: its last value stays, invalid."""
        self.valid = False

    @abstractmethod
    def measure(self, sample: int, elapsed: float) -> None:
        """Take sample number `sample`, `elapsed` (s) after the one before; 0 for the
        first."""


def failed(t: float, fail_time: float) -> bool:
    """True from fail_time (s) on; never where it is negative."""
    # as in Sampled.due, t = k h may fall short of the time it stands for by rounding
    return 0.0 <= fail_time <= t + 1e-6


def digital(x: float, resolution: float, full_scale: float) -> float:
    """x rounded to a multiple of `resolution`, then within +-full_scale; 0 leaves
    either out."""
    if resolution > 0.0:
        x = resolution * round(x / resolution)
    return min(max(x, -full_scale), full_scale) if full_scale > 0.0 else x


def digital3(a: Vec3, resolution: float, full_scale: float) -> Vec3:
    """Each component as `digital` makes it."""
    if resolution <= 0.0 and full_scale <= 0.0:
        return a
    return (
        digital(a[0], resolution, full_scale),
        digital(a[1], resolution, full_scale),
        digital(a[2], resolution, full_scale),
    )


def gauss_markov(x: Vec3, decay: float, sigma: float, n: Vec3) -> Vec3:
    """The next value of a first-order Gauss-Markov process, exact whatever the time
    between.

    decay = exp(-time / correlation time), sigma: stationary deviation of each
    component, n: standard normal numbers. Gelb, Applied Optimal Estimation (1974), ch.
    3.
    """
    s = sigma * sqrt(1.0 - decay * decay)
    return (decay * x[0] + s * n[0], decay * x[1] + s * n[1], decay * x[2] + s * n[2])


def sigma_of_mean_norm(mean: float) -> float:
    """The deviation of each axis that gives a normal 3-vector this mean norm.

    The norm is Maxwell distributed, its mean sigma sqrt(8 / pi).
    """
    return mean * sqrt(pi / 8.0)
