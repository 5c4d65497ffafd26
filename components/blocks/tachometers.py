from __future__ import annotations

from ..bases.sensing import Sensor, digital
from ..contract.block import Parameter, PerWheel
from ..contract.roles import Tachometers as Role
from ..maths.noise import normal_pair, stream


class Tachometers(Role, Sensor):
    """Wheel tachometers

        h_meas_wheel = h_wheel + bias + noise

    at each sample, held in between; then each wheel's value is rounded to a multiple of
    `resolution` and limited to +-`full_scale`, where these are not 0. The noise is a
    function of seed, instance name and sample index.
    """

    bias_wheel: PerWheel = Parameter(
        "N.m.s",
        "constant error of each wheel",
        usual=(-10.0, 10.0),
    )
    noise: float = Parameter(
        "N.m.s",
        "standard deviation of the noise of each wheel",
        min=0.0,
        usual=(0.0, 1.0),
    )
    resolution: float = Parameter(
        "N.m.s",
        "quantisation step of each wheel's momentum; 0: none",
        min=0.0,
        usual=(0.0, 1.0),
    )
    full_scale: float = Parameter(
        "N.m.s",
        "largest magnitude of each wheel's momentum; 0: no limit",
        min=0.0,
        usual=(0.0, 1e4),
    )

    def start(self) -> None:
        self._noise = stream(self.instance, "h_meas_wheel", self.seed)
        super().start()

    def measure(self, sample: int, elapsed_time: float) -> None:
        """Measure each wheel's momentum (N m s) with bias, noise and quantisation."""
        h, b = self.h_wheel, self.bias_wheel
        if any(b):
            h = tuple(x + y for x, y in zip(h, b, strict=True))
        if self.noise > 0.0:
            h = tuple(
                x + self.noise * normal_pair(self._noise, sample, i - i % 2)[i % 2]
                for i, x in enumerate(h)
            )
        if self.resolution > 0.0 or self.full_scale > 0.0:
            step, full = self.resolution, self.full_scale
            h = tuple(digital(x, step, full) for x in h)
        self.h_meas_wheel = h
