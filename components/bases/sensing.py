"""Provide the base of sensors: failure, quantisation, saturation, drifting errors.

Every function takes its random numbers as arguments; `noise.py` generates them.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator
from math import pi, sqrt
from typing import ClassVar

from ..contract.block import Parameter, Sampled, Vec3


class Sensor(Sampled):
    """Base of sensors that sample and may fail; a block adds `measure`."""

    fail_time: float = Parameter(
        "s",
        "from this time on invalid, holding the last value; negative: never",
        start=-1.0,
    )
    seed: int = Parameter(
        "1", "seed of the errors; instance name and variable key them as well", start=1
    )

    # Parameters that are the standard deviation of a number drawn at each sample.
    white: ClassVar[tuple[str, ...]] = ("noise",)

    valid: bool

    def foresee(
        self, begin: float, end: float, wired_names: frozenset[str]
    ) -> Iterator[str]:
        """Yield the problems known before a run: also noise without a sample time."""
        noise_names = [name for name in self.white if getattr(self, name) > 0.0]
        if noise_names and self.sample_time <= 0.0:
            yield (
                f"{noise_names[0]} = {getattr(self, noise_names[0]):g} is drawn anew at every step, "
                "without a sample_time: what it does depends on the step"
            )
        yield from super().foresee(begin, end, wired_names)

    def start(self) -> None:
        """Set the state to its start values and take the first sample."""
        super().start()
        self.valid = True
        self.measure(0, 0.0)
        if has_failed(0.0, self.fail_time):
            self.mark_failed()

    def advance(self, t: float, dt: float) -> None:
        """Take a sample where one is due, unless the sensor has failed."""
        before = self._sample
        if not self.due(t):
            return
        if has_failed(t, self.fail_time):
            self.mark_failed()
            return
        self.valid = True
        self.measure(
            self._sample,
            (self._sample - before) * (self.sample_time or dt) if before >= 0 else 0.0,
        )

    def mark_failed(self) -> None:
        """Mark the sensor as failed: its last value stays, invalid."""
        self.valid = False

    @abstractmethod
    def measure(self, sample: int, elapsed_time: float) -> None:
        """Take sample number `sample`, `elapsed_time` (s) after the last one.

        `elapsed_time` is 0 for the first.
        """


def has_failed(t: float, fail_time: float) -> bool:
    """Return whether t is at or after fail_time (s); never where it is negative."""
    # as in Sampled.due, rounding may make t = k h smaller than the exact time
    return 0.0 <= fail_time <= t + 1e-6


def digital(x: float, resolution: float, full_scale: float) -> float:
    """Round x to a multiple of `resolution` and limit it to +-full_scale.

    0 disables either.
    """
    if resolution > 0.0:
        x = resolution * round(x / resolution)
    return min(max(x, -full_scale), full_scale) if full_scale > 0.0 else x


def digital3(a: Vec3, resolution: float, full_scale: float) -> Vec3:
    """Round and limit each component, as `digital` does."""
    if resolution <= 0.0 and full_scale <= 0.0:
        return a
    return (
        digital(a[0], resolution, full_scale),
        digital(a[1], resolution, full_scale),
        digital(a[2], resolution, full_scale),
    )


def gauss_markov(x: Vec3, decay: float, sigma: float, n: Vec3) -> Vec3:
    """Compute the next value of a first-order Gauss-Markov process.

    It is exact whatever the time between. decay = exp(-time / correlation time), sigma:
    stationary standard deviation of each component, n: standard normal numbers. Gelb,
    Applied Optimal Estimation (1974), ch. 3.
    """
    s = sigma * sqrt(1.0 - decay * decay)
    return (decay * x[0] + s * n[0], decay * x[1] + s * n[1], decay * x[2] + s * n[2])


def sigma_of_mean_norm(mean: float) -> float:
    """Compute the standard deviation of each axis from the mean norm of a 3-vector.

    The vector is normal, so its norm is Maxwell distributed with the mean sigma sqrt(8
    / pi).
    """
    return mean * sqrt(pi / 8.0)
