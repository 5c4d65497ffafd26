from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated

from ..contract.block import Parameter, Table, Vec3
from ..contract.roles import Disturbance
from ..maths.attitude import rotate, rotate_back
from ..maths.vector import ZERO, add, scale
from ..physics.orbit import lvlh_attitude

ROWS = 256
BODY, LVLH, ECI = range(3)
HOLD, LINEAR = range(2)


class DisturbanceTable(Disturbance):
    """A torque by a table over time, added to any other

    Between two rows of `torque` the torque is that of the earlier one (`hold`) or the
    straight line between both (`linear`); a row whose time does not grow ends the
    table. Its mean over each step is exact in the frame of the table. It is transformed
    into the body with attitude and orbit at the beginning of the step:

        tau_ext_body = C tau_mean factor + tau_other_body

    A table of one row is a constant torque. With `repeated` the table restarts at its
    first row when the last one is reached; otherwise a table of several rows must cover
    the whole run.

    Source: a table of the user.
    """

    torque: Table = Parameter(
        "1",
        "a row a time: time s, torque about x, y, z N m",
        shape=(ROWS, 4),
        needs=("tau_ext_body",),
    )
    frame: int = Parameter(
        "1",
        "what the torques are relative to",
        choices=("body", "lvlh", "eci"),
        start="body",
    )
    between: int = Parameter(
        "1", "torque between two rows", choices=("hold", "linear"), start="linear"
    )
    repeated: bool = Parameter(
        "1", "true: the last row's time is the first's of the next round"
    )
    factor: float = Parameter("1", "factor on all torques", start=1.0)

    def start(self) -> None:
        """Count the rows and sum the impulse (N m s) from the first row to each."""
        self.tau_ext_body = ZERO
        count = 1
        while count < ROWS and self.torque[4 * count] > self.torque[4 * count - 4]:
            count += 1
        self._count = count
        if self.repeated and count == 1:
            self.fail("repeated = true: a table of one row has no end to begin anew at")
        # the impulse (N m s) from the first row to each
        self._impulses: Annotated[tuple[Vec3, ...], ROWS] = (ZERO,)
        for i in range(1, count):
            span = self.torque[4 * i] - self.torque[4 * i - 4]
            impulse = add(self._impulses[i - 1], self._within(i - 1, span))
            self._impulses = (*self._impulses, impulse)

    def foresee(
        self, begin: float, end: float, wired_names: frozenset[str]
    ) -> Iterator[str]:
        last = self.torque[4 * self._count - 4]
        if (
            self._count > 1
            and not self.repeated
            and (self.torque[0] > begin or last < end - 1e-6)
        ):
            self.fail(
                f"torque: the table is from {self.torque[0]:g} to {last:g} s, the run from "
                f"{begin:g} to {end:g} s; repeated = true begins it anew"
            )
        yield from super().foresee(begin, end, wired_names)

    def advance(self, t: float, dt: float) -> None:
        after, before = self._until(t + dt), self._until(t)
        x, y, z = (a - b for a, b in zip(after, before, strict=True))
        tau = scale(self.factor / dt, (x, y, z))
        if self.frame == LVLH:
            tau = rotate_back(lvlh_attitude(self.r_eci, self.v_eci), tau)
        if self.frame != BODY:
            tau = rotate(self.q_bi, tau)
        self.tau_ext_body = add(tau, self.tau_other_body)

    def _until(self, t: float) -> Vec3:
        """Return the impulse (N m s) from the first row to t (s)."""
        first, last = self.torque[0], self.torque[4 * self._count - 4]
        rounds = 0
        if self.repeated:
            rounds = int((t - first) // (last - first))
            t -= rounds * (last - first)
        low, high = 0, self._count - 1
        while high - low > 1:
            middle = (low + high) // 2
            if self.torque[4 * middle] <= t:
                low = middle
            else:
                high = middle
        full_rounds = scale(float(rounds), self._impulses[self._count - 1])
        return add(
            full_rounds,
            add(self._impulses[low], self._within(low, t - self.torque[4 * low])),
        )

    def _within(self, i: int, span: float) -> Vec3:
        """Return the impulse (N m s) from row i over a time span (s).

        The span lies within the row's interval of the table.
        """
        x, y, z = self.torque[4 * i + 1 : 4 * i + 4]
        if self.between == HOLD or self._count == 1:
            return (x * span, y * span, z * span)
        bend = 0.5 * span * span / (self.torque[4 * i + 4] - self.torque[4 * i])
        u, v, w = self.torque[4 * i + 5 : 4 * i + 8]
        return (
            x * span + bend * (u - x),
            y * span + bend * (v - y),
            z * span + bend * (w - z),
        )
