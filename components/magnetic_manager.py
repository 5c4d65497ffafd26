"""What managers that dump by magnetic torquers alone have in common."""

from __future__ import annotations

from abc import abstractmethod

from .block import Mat34, Parameter, Vec3
from .roles import Manager
from .vector import ZERO, clip, cross, sub
from .wheel_array import body_momentum, pseudo_inverse, wheel_torque

IDLE, DUMPING = range(2)


class MagneticManager(Manager):
    """Base of managers whose law says a dipole: a block adds `dipole`.

    With `saturation` each component of the dipole stays within `m_limit`. The wheels are commanded
    to give the body what the controller wants and to absorb, with `feedforward`, the magnetic
    torque and, with `gyroscopic`, omega x h:

        tau_cmd_wheel = A^+ (M x B - tau_ctrl_body - omega x A h)        (paper 004, eq. 16)
    """

    saturation: bool = Parameter("1", "true: the dipole is limited to m_limit", start=True)
    m_limit: float = Parameter("A.m2", "largest dipole of each axis", start=20.0, min=0.0)
    axes_wheel: Mat34 = Parameter(
        "1",
        "columns: the wheels' axes, body; zero where there is no wheel",
        start=(1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0),
        shared=True,
    )
    feedforward: bool = Parameter(
        "1", "true: the wheels absorb the magnetic torque at once", start=True
    )
    gyroscopic: bool = Parameter(
        "1", "true: the wheels absorb the gyroscopic torque of their momentum", start=True
    )

    def start(self) -> None:
        super().start()
        self._to_wheels = pseudo_inverse(self.axes_wheel)
        self.tau_cmd_wheel = (0.0, 0.0, 0.0, 0.0)
        self.m_cmd_body = self.tau_cmd_thruster_body = self._torque = ZERO
        self.mode = IDLE

    @abstractmethod
    def dipole(self, t: float, h: Vec3) -> Vec3 | None:
        """The dipole (A m2, body) at the sample at t (s) for the excess momentum h (N m s, body);
        None where the law has none. Called at samples while enabled."""

    def advance(self, t: float, dt: float) -> None:
        if self.due(t):
            h = sub(body_momentum(self.axes_wheel, self.h_wheel), self.h_target_body)
            m = self.dipole(t, h) if self.enable else None
            self.mode = IDLE if m is None else DUMPING
            m = ZERO if m is None else m
            self.m_cmd_body = clip(m, self.m_limit) if self.saturation else m
            self._torque = cross(self.m_cmd_body, self.b_body) if self.feedforward else ZERO
        self.tau_cmd_wheel = wheel_torque(
            self._to_wheels,
            self.axes_wheel,
            self._torque,
            self.tau_ctrl_body,
            self.omega_bi_body if self.gyroscopic else ZERO,
            self.h_wheel,
        )
