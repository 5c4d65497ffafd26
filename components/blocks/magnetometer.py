from __future__ import annotations

from ..bases.sensing import Sensor, digital3
from ..contract.block import Mat33, Parameter, Vec3
from ..contract.roles import Magnetometer as Role
from ..maths.attitude import rotate
from ..maths.noise import normal3, stream
from ..maths.vector import add, mat_vec, scale


class Magnetometer(Role, Sensor):
    """Three-axis magnetometer

        b_body = (1 + E) (C(q_bi) b_eci + K m_body) + bias + noise

    at each sample, held in between; then each axis is rounded to a multiple of
    `resolution` and limited to +-`full_scale`, where these are not 0. A limited value
    stays valid, as its sign is still right. The noise is a function of seed, instance
    name and sample index.

    K m_body is the field of the torquers' dipole at the magnetometer at the time of the
    sample. Coils that are switched off before each sample (paper 004; `quiet_time` of
    the torquers) leave exp(-quiet_time / lag) of it. For a dipole far from its coil, r
    (m) from it in the direction u, K = mu_0 / (4 pi r^3) (3 u u' - 1).

    E holds scale-factor errors on its diagonal; a sensor turned by the small vector a
    reads b - a x b, the antisymmetric E = -[a x]; axes that are not orthogonal are its
    symmetric remainder.
    """

    bias_body: Vec3 = Parameter(
        "T",
        "constant error, body",
        usual=(-1e-4, 1e-4),
    )
    coil_coupling: Mat33 = Parameter(
        "T/(A.m2)",
        "K: field at the magnetometer by the torquers' dipole, body",
        needs=("m_body",),
        usual=(-1e-2, 1e-2),
    )
    response_error: Mat33 = Parameter(
        "1",
        "E: scale-factor errors, misalignment and non-orthogonality of the axes, body",
        usual=(-0.3, 0.3),
    )
    noise: float = Parameter(
        "T",
        "standard deviation of the noise of each axis",
        min=0.0,
        usual=(0.0, 1e-5),
    )
    resolution: float = Parameter(
        "T",
        "quantisation step of each axis; 0: none",
        min=0.0,
        usual=(0.0, 1e-5),
    )
    full_scale: float = Parameter(
        "T",
        "largest magnitude of each axis; 0: no limit",
        min=0.0,
        usual=(0.0, 0.1),
    )

    def start(self) -> None:
        self._noise = stream(self.instance, "b_body", self.seed)
        super().start()

    def measure(self, sample: int, elapsed_time: float) -> None:
        """Measure the field (T, body) with bias, coils, response error and noise."""
        field = rotate(self.q_bi, self.b_eci)
        b = add(field, self.bias_body)
        if any(self.coil_coupling):
            coils = mat_vec(self.coil_coupling, self.m_body)
            b, field = add(b, coils), add(field, coils)
        if any(self.response_error):
            b = add(b, mat_vec(self.response_error, field))
        if self.noise > 0.0:
            b = add(b, scale(self.noise, normal3(self._noise, sample)))
        self.b_body = digital3(b, self.resolution, self.full_scale)
