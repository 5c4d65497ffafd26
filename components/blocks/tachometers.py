from __future__ import annotations

from ..block import Parameter
from ..noise import normal_pair
from ..roles import Tachometers as Role


class Tachometers(Role):
    """Wheel tachometers

        h_meas_wheel = h_wheel + noise

    at each sample, held in between. The noise is a function of seed and sample index.
    """

    noise: float = Parameter("N.m.s", "standard deviation of the noise of each wheel", min=0.0)
    seed: int = Parameter("1", "seed of the noise", start=1)

    def start(self) -> None:
        super().start()
        self._measure(0)

    def advance(self, t: float, dt: float) -> None:
        if self.due(t):
            self._measure(self._sample)

    def _measure(self, index: int) -> None:
        h = self.h_wheel
        if self.noise > 0.0:
            a, b = normal_pair(self.seed, index)
            c, d = normal_pair(self.seed, index, 2)
            s = self.noise
            h = (h[0] + s * a, h[1] + s * b, h[2] + s * c, h[3] + s * d)
        self.h_meas_wheel, self.valid = h, True
