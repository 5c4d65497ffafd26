from __future__ import annotations

from collections.abc import Iterator

from ..contract.block import Parameter, Table
from ..physics.driven_rotor import ENTRIES, Curve, limit_motor_torque, step
from ..physics.rotor import Motor, Rotor
from ..physics.rotor import step as plain_step
from .wheels import Wheels


class WheelsMotor(Wheels):
    """Reaction wheels with their motor's torque-speed curve and a table of their drag

    As `wheels`, and the drive of a motor on `supply_voltage` V with the torque constant
    k and the motor constant K_m (torque by the root of the copper loss: k^2 /
    resistance = K_m^2) is within

        K_m^2 (-V / k - Omega) <= drive <= K_m^2 (V / k - Omega)

    beside +-torque_limit: full torque up to the speed V / k - torque_limit / K_m^2,
    none at V / k. A failed motor gives no torque. With a drag table, which replaces
    viscous and Coulomb friction,

        friction = tanh(Omega / friction_speed) d(|Omega|)

    with d linear between the entries `drag_torque` at `drag_speed`, and extrapolated
    from the last two beyond them. The speed is integrated to 1e-8 rad/s in each piece,
    wherever curve and table have corners.

    Source: the equations of a permanent-magnet motor, e.g. Hughes, Electric Motors and
    Drives, ch. 3; else that of `wheels`.
    """

    supply_voltage: float = Parameter(
        "V",
        "voltage on the motors; 0: any torque at any speed",
        min=0.0,
        needs=("omega_bi_body",),
        usual=(0.0, 200.0),
    )
    torque_constant: float = Parameter(
        "N.m/A",
        "torque by current, which is voltage by speed (V s/rad), with a supply_voltage",
        start=0.01,
        min=1e-6,
        usual=(1e-4, 10.0),
    )
    drag_speed: Table = Parameter(
        "rad/s",
        "table of the drag: speeds, rising from 0; all 0: no table",
        shape=(ENTRIES,),
        min=0.0,
        needs=("omega_bi_body",),
        usual=(0.0, 2000.0),
    )
    drag_torque: Table = Parameter(
        "N.m",
        "table of the drag: the torque against the rotation at each speed",
        shape=(ENTRIES,),
        min=0.0,
        usual=(0.0, 0.1),
    )

    def start(self) -> None:
        """Build the motor's curve: no-load speed (rad/s), slope, table of the drag."""
        entries = self._entries()
        no_load = 0.0
        if self.supply_voltage > 0.0:
            no_load = self.supply_voltage / self.torque_constant
            if self.motor_constant == 0.0:
                self.fail(
                    "motor_constant = 0 N m: with a supply_voltage it is needed, above 0"
                )
        if (entries > 0 or no_load > 0.0) and self.stiction > 0.0:
            self.fail(
                f"stiction = {self.stiction} N m: not with supply_voltage or a table of the drag; "
                "give 0, or take the block wheels"
            )
        self._curve: Curve = (
            no_load,
            self.motor_constant * self.motor_constant,
            entries,
            _row(self.drag_speed),
            _row(self.drag_torque),
        )
        super().start()

    def _entries(self) -> int:
        """Count the entries of the drag table; refuse an invalid table."""
        speeds, entries = self.drag_speed, ENTRIES
        while entries > 0 and speeds[entries - 1] == 0.0:
            entries -= 1
        if entries == 0:
            if any(x > 0.0 for x in self.drag_torque):
                self.fail("drag_torque is given, but no drag_speed")
            return 0
        for k in range(1, entries):
            if speeds[k] <= speeds[k - 1]:
                self.fail(
                    f"drag_speed[{k + 1}] = {speeds[k]} rad/s is not above "
                    f"drag_speed[{k}] = {speeds[k - 1]} rad/s"
                )
        if speeds[0] > 0.0:
            self.fail(f"drag_speed[1] = {speeds[0]} rad/s: the table begins at 0")
        if self.viscous > 0.0 or self.coulomb > 0.0:
            self.fail(
                f"viscous = {self.viscous} N m s/rad, coulomb = {self.coulomb} N m: the table of "
                "the drag stands for both; give 0"
            )
        return entries

    def foresee(
        self, begin: float, end: float, wired_names: frozenset[str]
    ) -> Iterator[str]:
        no_load, _, entries, speeds, _ = self._curve
        if 0.0 < no_load < self.speed_limit:
            yield (
                f"supply_voltage = {self.supply_voltage:g} V turns the wheels at {no_load:.3g} "
                f"rad/s at most: speed_limit = {self.speed_limit:g} rad/s is never reached, and "
                "what takes it for their capacity errs"
            )
        if entries > 0 and speeds[entries - 1] < self.speed_limit:
            yield (
                f"drag_speed ends at {speeds[entries - 1]:g} rad/s, below speed_limit = "
                f"{self.speed_limit:g} rad/s: beyond it the drag goes on as between the last two"
            )
        yield from super().foresee(begin, end, wired_names)

    def propagate_rotor(
        self,
        motor: Motor,
        rotor: Rotor,
        command: float,
        rate0: float,
        rate1: float,
        dt: float,
        fastest: float,
    ) -> tuple[Rotor, float]:
        if self._curve[0] == 0.0 and self._curve[2] == 0:
            return plain_step(motor, rotor, command, rate0, rate1, dt, fastest)
        return step(motor, self._curve, rotor, command, rate0, rate1, dt, fastest)

    def driven(self, torque: float, speed: float) -> float:
        return limit_motor_torque(self._motors[0], self._curve, torque, speed)


def _row(x: Table) -> tuple[float, float, float, float, float, float, float, float]:
    """Convert a table to a tuple of eight."""
    a, b, c, d, e, f, g, h = x
    return (a, b, c, d, e, f, g, h)
