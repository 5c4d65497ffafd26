from __future__ import annotations

from functools import cache

from ..bases.momentum_management import CAPACITY
from ..contract.block import Output, Parameter, Table, Variable, Vec3, Vec4
from ..contract.fitting import Law
from ..laws import momentum_learning as learning
from ..laws import momentum_management as laws
from ..laws.blending import Split
from ..maths.attitude import rotate, rotate_back
from ..maths.vector import ZERO, add, cross, mat_vec, scale, sub
from ..physics.wheel_array import body_momentum, to_coils
from .manager_preview import ManagerPreview

# 1 - |q'q| of two attitudes a milliradian apart; beyond it the craft turns, and nothing
# is learnt.
TURNED = 1.25e-7


class ManagerPreviewLearning(ManagerPreview):
    """A preview that learns what its coils do and how large gravity gradient is

    P = -(K(t) H + s g(t)). The `gravity_scale` s and the `effectiveness` e_j of each
    coil are estimated from the momentum change of every update
    (`laws/momentum_learning.py`). Course and costate are proportional to gravity
    gradient, so that s g is the table that the ground would have computed with the
    right gravity gradient. Where a coil is found to be lost, g is the ground's table
    for that case, from `lost_table`. Nothing else changes, as mu_T = M'(M M')^-1 mu_M
    gives the remaining coils M'(B x P) in any case. Zeros in the first row of the table
    mean that there is none for that coil. The wheels absorb the torque that the coils
    really give.

    The estimates do not change while the craft turns, nor over a sample that was left
    out.
    """

    offers = (Law("preview that learns"),)

    lost_table: Table = Parameter(
        "A.m2/T",
        "a row a node: g with coil 1, 2, 3 or 4 lost, eci",
        shape=(CAPACITY, learning.COSTATES),
    )
    learn: bool = Parameter("1", "true: what is learnt is used", start=True)
    learn_noise: float = Parameter(
        "N.m.s",
        "of the momentum's change over an update, standard deviation",
        start=0.1,
        min=1e-6,
    )
    learn_drift: float = Parameter(
        "1",
        "what scale and effectiveness may change by from one update to the next, standard "
        "deviation",
        start=0.01,
        min=0.0,
    )
    effectiveness: Vec4 = Output(
        "1",
        "e, the share of its commanded dipole that each coil is seen to have",
        interval=True,
    )
    gravity_scale: float = Output(
        "1", "s, gravity gradient as it is seen over what the law knows", interval=True
    )
    lost_coil: int = Output(
        "1",
        "the coil that is found lost",
        interval=True,
        choices=("none", "1", "2", "3", "4"),
    )

    @classmethod
    @cache  # 6,700 scalars, needed for each parameter that is set in a bare block
    def scalars(cls) -> list[tuple[Variable, int | None]]:
        return super().scalars()

    def start(self) -> None:
        """Begin the filter at its prior: coils and gravity torque as modelled."""
        super().start()
        self._x = learning.FIRST
        self._p = learning.first_covariance()
        self._then: float | None = None
        self._h_eci = self._gravity = ZERO
        self._q: Vec4 = (0.0, 0.0, 0.0, 1.0)
        self.effectiveness = learning.shares(self._x)
        self.gravity_scale = 1.0
        self.lost_coil = 0

    def dump(self, t: float, elapsed_time: float, h: Vec3) -> tuple[Vec3, Split]:
        n, split = super().dump(t, elapsed_time, h)
        if not self.learn:
            return n, split
        a, b, c, d = to_coils(self._to_coils, split[0])
        e, f, g, i = self.effectiveness
        dipole = body_momentum(self.axes_coil, (e * a, f * b, g * c, i * d))
        return cross(dipole, self._b), split

    def law(self, t: float, h: Vec3) -> Vec3 | None:
        self._observe(t)
        m = super().law(t, h)
        self._gravity = self.gravity()
        return m

    def offset(self, i: int, share: float) -> Vec3:
        if not self.learn:
            return super().offset(i, share)
        s = learning.used_scale(self._x)
        j = 3 * (self.lost_coil - 1)
        if self.lost_coil == 0 or self.lost_table[j : j + 3] == ZERO:
            return scale(s, super().offset(i, share))
        return scale(s, laws.between3(self.lost_table, i, share, j, learning.COSTATES))

    def _observe(self, t: float) -> None:
        """Learn from the change of the momentum since the last sample."""
        wheels = body_momentum(self.axes_wheel, self.h_wheel)
        h = add(wheels, mat_vec(self._inertia, self.rate()))
        if self._then is not None and self._still(t - self._then) and self._b_2 != ZERO:
            coils = to_coils(self._to_coils, self.m_cmd_body)
            b = rotate(
                self.q_bi, learning.passed_field(self._b_1, self._b_2, self._b_3)
            )
            change = sub(h, rotate(self.q_bi, self._h_eci))
            rows = learning.effects(
                self.sample_time, self._gravity, self.axes_coil, coils, b
            )
            self._x, self._p = learning.update(
                self._x, self._p, change, rows, self.learn_noise, self.learn_drift
            )
            self.effectiveness = learning.shares(self._x)
            self.gravity_scale = self._x[0]
            self.lost_coil = learning.find_lost_coil(self._x, self._p, self.lost_coil)
        self._then, self._q, self._h_eci = t, self.q_bi, rotate_back(self.q_bi, h)

    def _still(self, elapsed_time: float) -> bool:
        """Return whether no sample was left out and the attitude has not changed."""
        a, b = self.q_bi, self._q
        alike = abs(a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3])
        return (
            abs(elapsed_time - self.sample_time) <= 1e-6 * self.sample_time
            and 1.0 - alike <= TURNED
        )
