from __future__ import annotations

from ..bases.sensing import Sensor, digital3
from ..contract.block import Parameter, Vec3
from ..contract.roles import Magnetometer as Role
from ..maths.attitude import rotate
from ..maths.noise import normal3, stream
from ..maths.vector import add, scale


class Magnetometer(Role, Sensor):
    """Three-axis magnetometer

        b_body = C(q_bi) b_eci + bias + noise

    at each sample, held in between; then each axis is rounded to a multiple of `resolution` and
    limited to +-`full_scale`, where these are not 0. A limited value stays valid: it still has
    the sign. The noise is a function of seed, instance name and sample index.
    """

    bias_body: Vec3 = Parameter("T", "constant error, body")
    noise: float = Parameter("T", "standard deviation of the noise of each axis", min=0.0)
    resolution: float = Parameter("T", "quantisation step of each axis; 0: none", min=0.0)
    full_scale: float = Parameter("T", "largest magnitude of each axis; 0: no limit", min=0.0)

    def start(self) -> None:
        self._noise = stream(self.instance, "b_body", self.seed)
        super().start()

    def measure(self, sample: int, elapsed: float) -> None:
        b = add(rotate(self.q_bi, self.b_eci), self.bias_body)
        if self.noise > 0.0:
            b = add(b, scale(self.noise, normal3(self._noise, sample)))
        self.b_body = digital3(b, self.resolution, self.full_scale)
