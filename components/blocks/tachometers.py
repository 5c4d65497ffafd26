from __future__ import annotations

from ..bases.sensing import Sensor, digital
from ..contract.block import Parameter, Vec4
from ..contract.roles import Tachometers as Role
from ..maths.noise import normal_pair, stream


class Tachometers(Role, Sensor):
    """Wheel tachometers

        h_meas_wheel = h_wheel + bias + noise

    at each sample, held in between; then each wheel's value is rounded to a multiple of
    `resolution` and limited to +-`full_scale`, where these are not 0. The noise is a
    function of seed, instance name and sample index.
    """

    bias_wheel: Vec4 = Parameter(
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
            h = (h[0] + b[0], h[1] + b[1], h[2] + b[2], h[3] + b[3])
        if self.noise > 0.0:
            x, y = normal_pair(self._noise, sample)
            z, w = normal_pair(self._noise, sample, 2)
            s = self.noise
            h = (h[0] + s * x, h[1] + s * y, h[2] + s * z, h[3] + s * w)
        if self.resolution > 0.0 or self.full_scale > 0.0:
            step, full = self.resolution, self.full_scale
            h = (
                digital(h[0], step, full),
                digital(h[1], step, full),
                digital(h[2], step, full),
                digital(h[3], step, full),
            )
        self.h_meas_wheel = h
