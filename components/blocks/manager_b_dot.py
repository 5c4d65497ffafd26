from __future__ import annotations

from ..contract.block import Output, Parameter, Vec3
from ..contract.roles import Manager
from ..laws import field_rate
from ..maths.vector import ZERO, clip, dot, scale

IDLE, DETUMBLING = range(2)


class ManagerBDot(Manager):
    """B-dot detumbling by magnetic torquers, for any craft

        M = -gain B' / |B|^2

    at each sample, with B the measured field and B' its rate from this sample and the
    one before, each component of M within +-`m_limit`; the wheels get no torque. As B'
    is -omega x B, the torque damps the body's rate across the field at gain / J (1/s).
    With n the orbit rate, J_min the smallest moment of inertia and xi the angle between
    the orbit and the magnetic equator

        gain = 2 n (1 + sin xi) J_min

    is, according to its source, the fastest gain that still lets the field turn
    relative to the craft. In simulations from a tumble, crafts with one small moment
    detumble slowly with it, and up to ten times faster with 7 n times the mean moment.
    The remaining rate is that of the field along the orbit, about 2 n.

    With `plain_gain` k above 0 the law is M = -k B' instead, the form of most other
    sources. For a given field both are the same with k = gain / |B|^2, 1e7 A m2 s/T for
    1e-2 N m s at 31.6 uT.

    There is no dipole at the first sample, nor at a sample for which this or the
    previous field is not valid.

    Source: Stickler & Alfriend, J. Spacecraft 13 (1976) 282; the gain: Avanzini &
    Giulietti, J. Guidance, Control, and Dynamics 35 (2012) 1326.
    """

    no_law = "it brakes a tumbling craft and leaves the wheels as they are"
    brakes = True

    gain: float = Parameter(
        "N.m.s",
        "gain on B' / |B|^2",
        start=1e-2,
        min=0.0,
        needs=("b_body", "m_cmd_body"),
    )
    plain_gain: float = Parameter(
        "A.m2.s/T",
        "gain on B' alone, in the place of `gain`; 0: it is not used",
        min=0.0,
    )
    m_limit: float = Parameter(
        "A.m2",
        "largest dipole of each axis",
        start=1.0,
        min=0.0,
        follows="torquers.m_limit",
    )
    mode: int = Output(
        "1", "what the manager does", interval=True, choices=("idle", "detumbling")
    )

    def start(self) -> None:
        super().start()
        self.tau_cmd_wheel = (0.0,) * len(self.h_wheel)
        self.m_cmd_body = self.tau_cmd_thruster_body = ZERO
        self.mode = IDLE
        self._b: Vec3 | None = None
        self._b_time = 0.0

    def compute(self, t: float, dt: float) -> None:
        """Command M = -gain B' / |B|^2, or -plain_gain B' (A m2, body), at a sample.

        B' (T/s) is the difference of two consecutive valid fields.
        """
        if not self.due(t):
            return
        self.m_cmd_body, self.mode = ZERO, IDLE
        before, b = self._b, self.b_body
        self._b = b if self.valid_b else None
        if self.enable and self.valid_b and before is not None and dot(b, b) > 0.0:
            rate = field_rate.difference(b, before, t - self._b_time)
            gain = self.plain_gain if self.plain_gain > 0.0 else self.gain / dot(b, b)
            self.m_cmd_body = clip(scale(-gain, rate), self.m_limit)
            self.mode = DETUMBLING
        self._b_time = t
