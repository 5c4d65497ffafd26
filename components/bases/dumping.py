"""Provide the bases of managers that dump momentum at samples.

They command the wheels; the dumping is by torquers alone or by thrusters and torquers.
"""

from __future__ import annotations

from abc import abstractmethod

from ..contract.block import Output, Parameter, Vec3, group_of
from ..contract.fitting import Need
from ..contract.roles import WheelManager
from ..laws.blending import Split
from ..laws.integrated import null_vector
from ..maths.vector import ZERO, clip, cross, sub
from ..physics.wheel_array import body_momentum, null_part, pseudo_inverse, wheel_torque

IDLE, DUMPING, RECEDING_HORIZON, FALLBACK = range(4)
NO_AXIS = 0


class MomentumDumping(WheelManager):
    """Base of managers whose law gives a dumping torque and its split.

    A block adds `dump`. The wheels are commanded to give the body the controller's
    torque and to absorb, with `feedforward`, the dumping torque and, with `gyroscopic`,
    omega x h:

        tau_cmd_wheel = A^+ (N - tau_ctrl_body - omega x A h)        (paper 004, eq. 16)

    at each sample, or every `wheel_sample_time`, held in between. With `null_gain` the
    momentum that the wheels hold against each other, h - A^+ A h, which no dumping
    reaches, decays at that rate to h_null n: a bias, which keeps wheels from standstill,
    along n of the null space (`null_vector`).

    Wheels that are known to have failed (`wheels_out`) get no command, and the others
    all of it; what turns in them still counts as momentum.

    A measurement that is not valid is not used. At a sample without `valid_h` nothing
    is dumped. omega x h is left out while `valid_h` or `valid_omega` is false, and a
    law takes `rate`, which is then zero. Without `valid_b` there is no dipole; the
    blocks see to that.
    """

    passes_torque = True

    feedforward: bool = Parameter(
        "1", "true: the wheels absorb the dumping torque at once", start=True
    )
    gyroscopic: bool = Parameter(
        "1",
        "true: the wheels absorb the gyroscopic torque of their momentum",
        start=True,
        needs=("omega_bi_body", "h_wheel"),
    )
    null_gain: float = Parameter(
        "1/s",
        "rate at which momentum in the wheels' null space decays; 0: it stays",
        min=0.0,
        needs=("h_wheel", "tau_cmd_wheel"),
    )
    h_null: float = Parameter(
        "N.m.s",
        "momentum that the wheels keep against each other: of the wheel whose share is 1",
        needs=("h_wheel", "tau_cmd_wheel"),
    )
    wheels_out: int = Parameter(
        "1",
        "which wheels are known to have failed, and get no command from out_from on",
        groups=True,
        needs=("tau_cmd_wheel",),
    )
    out_from: float = Parameter("s", "when they have")
    mode: int = Output(
        "1",
        "what the manager does",
        interval=True,
        choices=("idle", "dumping"),
    )

    def start(self) -> None:
        """Set allocation, bias and commands to their start values."""
        super().start()
        self._out = group_of(self.wheels_out, len(self.h_wheel))
        self._is_out = False
        self._live_axes = self.axes_wheel
        self._to_wheels = pseudo_inverse(self._live_axes)
        self._first_sample_time: float | None = None
        self._no_momentum = (0.0,) * len(self.h_wheel)
        n = null_vector(self.axes_wheel)
        if self.h_null != 0.0 and not any(n):
            self.fail(
                f"h_null = {self.h_null} N m s: these wheels hold nothing against each other"
            )
        self._bias = tuple(self.h_null * x for x in n)
        self.tau_cmd_wheel = self._no_momentum
        self.m_cmd_body = self.tau_cmd_thruster_body = self._n = ZERO
        self.mode = IDLE

    @abstractmethod
    def dump(self, t: float, elapsed_time: float, h: Vec3) -> tuple[Vec3, Split]:
        """Compute the dumping torque N (N m) and its split, body, at t (s); set `mode`.

        `elapsed_time` (s) counts from the first sample with `enable` and `valid_h`; h (N m
        s, body) is the wheels' momentum less its target.
        """

    def compute(self, t: float, dt: float) -> None:
        """Compute the dump at a sample and command the wheels where they are due."""
        is_sample = self.due(t)
        if is_sample:
            if self.enable and self.valid_h:
                if self._first_sample_time is None:
                    self._first_sample_time = t
                h = sub(
                    body_momentum(self.axes_wheel, self.h_wheel), self.h_target_body
                )
                self._n, split = self.dump(t, t - self._first_sample_time, h)
                self.m_cmd_body, self.tau_cmd_thruster_body = split
            else:
                self._n = self.m_cmd_body = self.tau_cmd_thruster_body = ZERO
                self.mode = IDLE
        if self.wheels_due(t, is_sample):
            self._leave_out(t)
            self.tau_cmd_wheel = wheel_torque(
                self._to_wheels,
                self.axes_wheel,
                self._n if self.feedforward else ZERO,
                self.control_by_wheels(),
                self.rate() if self.gyroscopic else ZERO,
                self.h_wheel if self.valid_h else self._no_momentum,
            )
            if self.valid_h:
                self.empty_null_space()
            if self._is_out:
                self.tau_cmd_wheel = tuple(
                    0.0 if self._out[i] else x for i, x in enumerate(self.tau_cmd_wheel)
                )

    def empty_null_space(self) -> None:
        """Add the torques that make the wheels' null-space momentum decay."""
        rate = self.null_rate()
        if rate <= 0.0:
            return
        against = null_part(self._live_axes, self._to_wheels, self.h_wheel)
        self.tau_cmd_wheel = tuple(
            x - rate * (y - z)
            for x, y, z in zip(self.tau_cmd_wheel, against, self._bias, strict=True)
        )

    def null_rate(self) -> float:
        """Return the rate (1/s) at which the null space is brought to its bias."""
        return self.null_gain

    def _leave_out(self, t: float) -> None:
        """Allocate to the wheels that are left once some are known to have failed."""
        if self._is_out or self.wheels_out == 0 or t < self.out_from:
            return
        count = len(self.h_wheel)
        self._is_out = True
        self._live_axes = tuple(
            0.0 if self._out[i % count] else x for i, x in enumerate(self.axes_wheel)
        )
        self._to_wheels = pseudo_inverse(self._live_axes)

    def control_by_wheels(self) -> Vec3:
        """Return the controller's torque (N m, body) that the wheels are to give."""
        return self.tau_ctrl_body

    def rate(self) -> Vec3:
        """Return the measured rate (rad/s, body); zero while it is not valid."""
        return self.omega_bi_body if self.valid_omega else ZERO


class TorquerDumping(MomentumDumping):
    """Base of managers that dump by magnetic torquers alone; a block adds `dipole`.

    N = M x B; with `saturation` each component of M stays within `m_limit`. There is no
    dipole at a sample whose field or momentum is not valid.
    """

    craft_needs = (Need.COILS,)

    saturation: bool = Parameter(
        "1", "true: the dipole is limited to m_limit", start=True
    )
    m_limit: float = Parameter(
        "A.m2",
        "largest dipole of each axis",
        start=20.0,
        min=0.0,
        needs=("b_body", "m_cmd_body"),
        follows="torquers.m_limit",
    )

    @abstractmethod
    def dipole(self, elapsed_time: float, h: Vec3) -> Vec3 | None:
        """Compute the dipole (A m2, body) at a sample; None where the law has none.

        Arguments as of `dump`.
        """

    def dump(self, t: float, elapsed_time: float, h: Vec3) -> tuple[Vec3, Split]:
        """Compute the torque of the law's dipole; idle without a valid field."""
        if not self.valid_b:
            self.mode = IDLE
            return ZERO, (ZERO, ZERO)
        m = self.dipole(elapsed_time, h)
        self.mode = IDLE if m is None else DUMPING
        m = ZERO if m is None else m
        m = clip(m, self.m_limit) if self.saturation else m
        return cross(m, self.b_body), (m, ZERO)


class ThrusterDumping(MomentumDumping):
    """Base of managers that dump by thrusters and magnetic torquers together."""

    craft_needs = (Need.THRUSTERS,)

    m_limit: float = Parameter(
        "A.m2",
        "largest dipole of each coil",
        start=40.0,
        min=0.0,
        follows="torquers.m_limit",
    )
    duty: float = Parameter(
        "1",
        "share of the period that coils may be on",
        start=0.9,
        min=0.0,
        max=1.0,
        follows="torquers.duty_max",
    )
    dead_axis: int = Parameter(
        "1",
        "axis whose coil is known to be dead",
        choices=("none", "x", "y", "z"),
        start="none",
    )
    n_con_body: Vec3 = Parameter(
        "N.m", "known constant torque of an off-nadir attitude, body"
    )

    def limits(self) -> Vec3:
        """Return the largest mean dipole of each axis over a sample (A m2)."""
        most = self.duty * self.m_limit
        x, y, z = (0.0 if self.dead_axis == axis else most for axis in (1, 2, 3))
        return (x, y, z)
