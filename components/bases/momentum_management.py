"""Provide the bases of paper 001's laws: coils, weighting, tables from the ground."""

from __future__ import annotations

from abc import abstractmethod
from typing import ClassVar

from ..contract.block import Block, Mat33, Mat34, Output, Parameter, Table, Vec3
from ..contract.fitting import Need
from ..laws import momentum_management as laws
from ..laws.blending import Split
from ..maths.attitude import rotate, rotate_back
from ..maths.vector import IDENTITY, ZERO, add, cross, dot, mat_vec, norm, scale
from ..physics.orbit import MU
from ..physics.torques import gravity_gradient
from ..physics.wheel_array import pseudo_inverse, to_coils
from .dumping import DUMPING, FALLBACK, IDLE, MomentumDumping

_, COILS, WHEELS = range(3)
_, TOTAL = range(2)
CAPACITY = 312  # rows of a table
# Smallest over largest eigenvalue of A A' from which on axes count as spanning space.
LEAST_EIGENVALUE_RATIO = 1e-3


class MomentumManagement(MomentumDumping):
    """Base of the laws of paper 001; a block adds `law`.

    `weighting` is A: 1, the coils' axes M (least coil energy) or the wheels' axes W
    (least wheel speed); S = A A'. The dipole is commanded as a vector. It is scaled
    down in its own direction where mu_T = M'(M M')^-1 mu_M exceeds `m_limit` in a coil.
    A coil known to be dead, `dead_coil`, is left out of M. T_GG is the manager's own:
    `inertia_scale` times `inertia`.

    `momentum` selects H of the law: that of the wheels (H_RW, eq. 7), or the total H_T,
    to which inertia times rate is added (the wheels' rotors count twice there, some
    1e-5 of it).

    The paper takes field and gravity gradient at the sample; the dipole is then held
    for `sample_time`. With `mean` they are means over that time: of the field from its
    last four samples, in eci (Adams and Bashforth's weights), of T_GG by Simpson's rule
    from r and v. With values of the sample alone, T_D has an error that accumulates
    along the field.

    Without a valid field or attitude there is no dipole.
    """

    craft_needs: ClassVar[tuple[Need, ...]] = (Need.COILS,)

    axes_coil: Mat34 = Parameter(
        "1",
        "M, columns: the coils' axes, body; zero where there is no coil",
        start=(1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0),
        shared=True,
    )
    m_limit: float = Parameter(
        "A.m2",
        "largest dipole of each coil",
        start=4000.0,
        min=0.0,
        needs=("b_body", "q_bi", "r_eci", "h_wheel", "m_cmd_body"),
        follows="torquers.m_limit",
    )
    dead_coil: int = Parameter(
        "1",
        "which coil is known to be dead",
        choices=("none", "1", "2", "3", "4"),
        start="none",
    )
    weighting: int = Parameter(
        "1",
        "A: what is made least",
        choices=("identity", "coils", "wheels"),
        start="coils",
    )
    inertia: Mat33 = Parameter(
        "kg.m2",
        "inertia of the whole craft, wheels locked, body",
        start=(40.45, 0.0, 0.0, 0.0, 42.09, 0.0, 0.0, 0.0, 40.36),
        shared=True,
    )
    sample_time: float = Parameter(
        "s", "time between samples, a multiple of the step", start=10.0, min=0.0
    )
    inertia_scale: float = Parameter(
        "1",
        "the law's own inertia is the inertia times this; 1: right",
        start=1.0,
        min=0.0,
    )
    momentum: int = Parameter(
        "1", "what counts as momentum", choices=("wheels", "total"), start="wheels"
    )
    mean: bool = Parameter(
        "1",
        "true: field and gravity gradient are means over the time that a dipole is held",
        start=True,
        needs=("v_eci",),
    )
    tau_desired_body: Vec3 = Output(
        "N.m", "T_D, body; of an open-loop law T_M: for the report", interval=True
    )
    mode: int = Output(
        "1",
        "what the manager does; fallback: it has no law now",
        interval=True,
        choices=("idle", "dumping", "-", "fallback"),
    )

    def start(self) -> None:
        """Check the axes and set the state to its start values."""
        super().start()
        live = laws.without(self.axes_coil, self.dead_coil)
        of_coils, of_wheels = laws.weighting(live), laws.weighting(self.axes_wheel)
        for name, s in (("axes_coil", of_coils), ("axes_wheel", of_wheels)):
            if laws.condition(s) > 1.0 / LEAST_EIGENVALUE_RATIO:
                remaining = (
                    " that are left" if name == "axes_coil" and self.dead_coil else ""
                )
                self.fail(
                    f"{name}: the axes{remaining} do not span space: A A' has the condition "
                    f"{laws.condition(s):.3g}, at most {1.0 / LEAST_EIGENVALUE_RATIO:g} may be"
                )
        if self.sample_time <= 0.0:
            self.fail(f"sample_time = {self.sample_time} s: a time above 0 is needed")
        self._to_coils = pseudo_inverse(live)
        self._s = (IDENTITY, of_coils, of_wheels)[self.weighting]
        self._inertia: Mat33 = tuple(self.inertia_scale * x for x in self.inertia)  # type: ignore[assignment]
        self.tau_desired_body = self._b = ZERO
        self._b_1: Vec3 = ZERO
        self._b_2: Vec3 = ZERO
        self._b_3: Vec3 = ZERO

    @abstractmethod
    def law(self, t: float, h: Vec3) -> Vec3 | None:
        """Compute mu_M (A m2, body) at the sample at t (s).

        None where the law has none. It sets `tau_desired_body`, and `mode` where it
        falls back on a dipole. h (N m s, body): the momentum less its target.
        """

    def dump(self, t: float, elapsed_time: float, h: Vec3) -> tuple[Vec3, Split]:
        """Compute the torque of the law's dipole, and its split.

        Idle without valid field or attitude.
        """
        if not (self.valid_b and self.valid_q):
            self.mode, self.tau_desired_body = IDLE, ZERO
            self._forget()
            return ZERO, (ZERO, ZERO)
        b_eci = rotate_back(self.q_bi, self.b_body)
        mean = (
            laws.held_field(b_eci, self._b_1, self._b_2, self._b_3)
            if self.mean
            else b_eci
        )
        self._b = rotate(self.q_bi, mean)
        self._b_1, self._b_2, self._b_3 = b_eci, self._b_1, self._b_2
        if self.momentum == TOTAL:
            h = add(h, mat_vec(self._inertia, self.rate()))
        self.mode = DUMPING
        m = self.law(t, h)
        if m is None:
            self.mode, self.tau_desired_body = FALLBACK, ZERO
            return ZERO, (ZERO, ZERO)
        m = laws.scale_to_limit(m, to_coils(self._to_coils, m), self.m_limit)
        return cross(m, self._b), (m, ZERO)

    def field(self) -> Vec3:
        """Return B (T, body) of the sample, by the measurements."""
        return self._b

    def gravity(self) -> Vec3:
        """Compute T_GG (N m, body) of the sample in the manager's model."""
        now = gravity_gradient(rotate(self.q_bi, self.r_eci), self._inertia)
        if not self.mean:
            return now
        middle, end = (
            self._gravity_in(0.5 * self.sample_time),
            self._gravity_in(self.sample_time),
        )
        return scale(1.0 / 6.0, add(add(now, scale(4.0, middle)), end))

    def _gravity_in(self, ahead: float) -> Vec3:
        """Compute T_GG (N m, body) `ahead` (s) of now.

        The position follows a free fall of third order.
        """
        r, v = self.r_eci, self.v_eci
        size = norm(r)
        pull = MU * ahead * ahead / (size * size * size)
        climb = dot(r, v) / (size * size) * ahead
        along = ahead * (1.0 - pull / 6.0)
        r = add(scale(1.0 - 0.5 * pull + 0.5 * pull * climb, r), scale(along, v))
        return gravity_gradient(rotate(self.q_bi, r), self._inertia)

    def _forget(self) -> None:
        """Discard the field of earlier samples."""
        self._b_1 = self._b_2 = self._b_3 = ZERO


class GroundTables(Block):
    """Tables that the ground computes and uplinks: rows evenly from t = 0 on.

    Beyond the last row there is no law.
    """

    craft_needs: ClassVar[tuple[Need, ...]] = (Need.DESIGN, Need.INERTIAL)

    table_nodes: int = Parameter("1", "rows in use", start=4, min=4, max=CAPACITY)
    table_spacing: float = Parameter("s", "time between rows", start=150.0, min=1.0)
    made_for: float = Parameter(
        "1",
        "what the tables were made for: a number that `desat design` makes of attitude, orbit "
        "and field; 0: nothing",
    )

    def place(self, t: float) -> tuple[int, float] | None:
        """Return the row at t (s) and the fraction to the next; None outside."""
        if t < 0.0 or t > (self.table_nodes - 1) * self.table_spacing * (1.0 + 1e-12):
            return None
        return laws.place(self.table_nodes, self.table_spacing, t)


class NominalProfile(GroundTables):
    """Table of H_NOM, the momentum along half-orbit open-loop solutions."""

    table_period: int = Parameter(
        "1",
        "rows of a desaturation period: the profile's slope jumps there",
        start=19,
        min=3,
        max=CAPACITY,
    )
    profile_table: Table = Parameter(
        "N.m.s", "a row a node: H_NOM, eci", shape=(CAPACITY, 3)
    )

    def nominal(self, t: float) -> Vec3 | None:
        """Interpolate H_NOM (N m s, eci) at t (s); None outside the table."""
        place = self.place(t)
        if place is None:
            return None
        i, share = place
        return laws.profile3(
            self.profile_table, self.table_nodes, self.table_period, i, share
        )
