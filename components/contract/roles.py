"""Define the interface of each role, common to all blocks and foreign FMUs of the role.

A block of a role adds parameters and telemetry, never another connector to the loop, so
that swapping one block for another changes one `source` and its parameters.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator
from math import floor
from typing import Annotated, ClassVar

from .block import (
    Block,
    Input,
    Output,
    Parameter,
    PerWheel,
    Sampled,
    Vec3,
    Vec4,
    WheelColumns,
    WheelFlags,
)
from .fitting import Law, Need

UPRIGHT = (0.0, 0.0, 0.0, 1.0)
# outputs of a guidance: its reference, held between samples, and what it wants at a step
HELD_ATTITUDE, WANTED_ATTITUDE = "q_ref_bi", "q_wanted_bi"
ON_THEIR_WAY = 16  # commands that a computer's delay may hold back at a time


class Computer(Sampled):
    """Flight computer whose commands leave `delay` after the sample they are based on.

    A block implements its decisions in `compute`; `commands` and `command` say which of
    its outputs are commands. Internal decisions, such as modes and integrals, are not
    delayed.
    """

    delay: float = Parameter(
        "s", "from a sample to its commands: any multiple of the step; 0: none", min=0.0
    )

    def start(self) -> None:
        super().start()
        self._last_commands: tuple[float, ...] = ()
        # (time at which it leaves, *commands), in order of time
        self._waiting: Annotated[tuple[tuple[float, ...], ...], ON_THEIR_WAY] = ()

    @abstractmethod
    def compute(self, t: float, dt: float) -> None:
        """Decide and assign the interval outputs, in the step of dt (s) from t (s) on.

        It is called at every step; `if not self.due(t): return` leaves all but samples.
        """

    @abstractmethod
    def commands(self) -> tuple[float, ...]:
        """Return the outputs that are commands, as one flat tuple."""

    @abstractmethod
    def command(self, values: tuple[float, ...]) -> None:
        """Assign the commands from one flat tuple."""

    def advance(self, t: float, dt: float) -> None:
        """Compute new commands and output those whose delay has passed."""
        if self.delay <= 0.0:
            self.compute(t, dt)
            return
        leaving = self.commands()
        before = self._last_commands or leaving
        self.command(before)
        self.compute(t, dt)
        self._last_commands = self.commands()
        if self._last_commands != before:
            self._send(t, dt)
        while self._waiting and self._waiting[0][0] <= t + 1e-6 * dt:
            leaving, self._waiting = self._waiting[0][1:], self._waiting[1:]
        self.command(leaving)

    def _send(self, t: float, dt: float) -> None:
        """Queue the decided commands to leave `delay` after t (s).

        Fail if the delay is not a multiple of the step dt (s) or too many commands
        wait.
        """
        steps = self.delay / dt
        if abs(steps - round(steps)) > 1e-6:
            self.fail(f"delay = {self.delay} s is not a multiple of the step of {dt} s")
        if len(self._waiting) == ON_THEIR_WAY:
            self.fail(
                f"delay = {self.delay} s holds more than {ON_THEIR_WAY} commands back"
            )
        self._waiting = (*self._waiting, (t + self.delay, *self._last_commands))


# The frame of every variable whose name ends in eci.
ECI = (
    "eci: inertial, Earth-centred, of the mean equator and equinox of date: those of t = 0, held "
    "while a system runs; of J2000 where eci_frame says so"
)


class WheelAxes(Block):
    """Parameters of every block that knows the wheels, beside its role."""

    axes_wheel: WheelColumns = Parameter(
        "1",
        "columns: the wheels' axes, body; zero where there is no wheel",
        start=(1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0),
        shared=True,
    )


class WheelInertias(WheelAxes):
    """Parameters of every block that moves the wheels, beside its role."""

    inertia_wheel: PerWheel = Parameter(
        "kg.m2",
        "spin inertia of each wheel",
        start=(0.008, 0.008, 0.008, 0.0),
        min=0.0,
        shared=True,
    )


class Environment(Block):
    """Orbit and surroundings of the spacecraft; never a torque.

    `eci` is the mean equator and equinox of date: those of t = 0, held while a system
    runs; of J2000 where `eci_frame` says so.
    """

    role = "environment"
    role_title = "Environment: orbit, field, Sun and air"
    typical_block = "environment_kepler"

    # Only orbits that thruster firings change read these three. The usual environments
    # read none of them, so a craft does not wire them by default.
    force_mean_thruster_body: Vec3 = Input(
        "N", "force of the thrusters, body, mean over the step", needs=("q_bi",)
    )
    q_bi: Vec4 = Input("1", "attitude: body from eci, scalar last", start=UPRIGHT)
    omega_bi_body: Vec3 = Input(
        "rad/s", "angular rate of the body relative to eci, body"
    )
    r_eci: Vec3 = Output("m", "position, eci")
    v_eci: Vec3 = Output("m/s", "velocity, eci")
    b_eci: Vec3 = Output("T", "geomagnetic field at the spacecraft, eci")
    b_rate_eci: Vec3 = Output(
        "T/s", "its time derivative along the orbit, eci components"
    )
    b_accel_eci: Vec3 = Output("T/s2", "its second time derivative, eci components")
    sun_eci: Vec3 = Output(
        "1", "unit vector to the Sun, eci; zero where no Sun is modelled"
    )
    sunlight: float = Output(
        "1",
        "the Sun's light over that at 1 astronomical unit: 0 in eclipse, near the Earth 0.967 to "
        "1.034 outside",
    )
    density: float = Output("kg/m3", "density of the atmosphere at the spacecraft")


class Spacecraft(Block):
    """Attitude dynamics: the body, with its own copy of the wheels' momentum."""

    role = "spacecraft"
    role_title = "Spacecraft: motion of the body"
    typical_block = "spacecraft_rigid"

    r_eci: Vec3 = Input(
        "m", "position, eci", start=(7.0e6, 0.0, 0.0), source="environment.r_eci"
    )
    v_eci: Vec3 = Input(
        "m/s", "velocity, eci", start=(0.0, 7.5e3, 0.0), source="environment.v_eci"
    )
    b_eci: Vec3 = Input("T", "geomagnetic field, eci", source="environment.b_eci")
    b_rate_eci: Vec3 = Input(
        "T/s", "its time derivative, eci components", source="environment.b_rate_eci"
    )
    b_accel_eci: Vec3 = Input(
        "T/s2",
        "its second time derivative, eci components",
        source="environment.b_accel_eci",
    )
    sun_eci: Vec3 = Input(
        "1", "unit vector to the Sun, eci", source="environment.sun_eci"
    )
    sunlight: float = Input(
        "1",
        "the Sun's light over that at 1 astronomical unit",
        source="environment.sunlight",
    )
    density: float = Input(
        "kg/m3", "density of the atmosphere", source="environment.density"
    )
    h_wheel: PerWheel = Input(
        "N.m.s",
        "axial momentum of each wheel, absolute; read in initialisation mode only",
        source="wheels.h_wheel",
        initial=True,
    )
    tau_mean_wheel: PerWheel = Input(
        "N.m",
        "net torque on each rotor, mean over the step; the body receives the opposite",
        source="wheels.tau_mean_wheel",
        needs=("h_wheel",),
    )
    tau_slope_wheel: PerWheel = Input(
        "N.m",
        "net torque on each rotor, slope over the step",
        source="wheels.tau_slope_wheel",
    )
    m_mean_body: Vec3 = Input(
        "A.m2",
        "magnetic dipole of the torquers, body, mean over the step",
        source="torquers.m_mean_body",
        needs=("b_eci",),
    )
    m_slope_body: Vec3 = Input(
        "A.m2",
        "magnetic dipole of the torquers, body, slope",
        source="torquers.m_slope_body",
    )
    tau_mean_thruster_body: Vec3 = Input(
        "N.m",
        "thruster torque, body, mean over the step",
        source="thrusters.tau_mean_thruster_body",
    )
    tau_slope_thruster_body: Vec3 = Input(
        "N.m",
        "thruster torque, body, slope over the step",
        source="thrusters.tau_slope_thruster_body",
    )
    tau_ext_body: Vec3 = Input(
        "N.m",
        "any other external torque, body, constant over the step",
        source=("disturbance.tau_ext_body", "wheels.tau_jitter_body"),
    )

    q_bi: Vec4 = Output(
        "1", "attitude: body from eci, scalar last", starts_from=("r_eci", "v_eci")
    )
    omega_bi_body: Vec3 = Output(
        "rad/s",
        "angular rate of the body relative to eci, body",
        starts_from=("r_eci", "v_eci"),
    )
    h_copy_wheel: PerWheel = Output(
        "N.m.s",
        "own copy of the axial momentum of each wheel, absolute",
        starts_from=("h_wheel",),
    )
    impulse_eci: Vec3 = Output("N.m.s", "external angular impulse since the start, eci")


class Disturbance(Block):
    """External torque that is known by itself: measured, or computed elsewhere."""

    role = "disturbance"
    role_title = "Disturbance torques"
    typical_block = "disturbance_table"

    q_bi: Vec4 = Input(
        "1",
        "attitude: body from eci, scalar last",
        start=UPRIGHT,
        source="spacecraft.q_bi",
    )
    r_eci: Vec3 = Input(
        "m", "position, eci", start=(7.0e6, 0.0, 0.0), source="environment.r_eci"
    )
    v_eci: Vec3 = Input(
        "m/s", "velocity, eci", start=(0.0, 7.5e3, 0.0), source="environment.v_eci"
    )
    tau_other_body: Vec3 = Input(
        "N.m",
        "any other external torque, body, to which it is added",
        source="wheels.tau_jitter_body",
    )
    tau_ext_body: Vec3 = Output("N.m", "torque, body, mean over the step", mean=True)


class Magnetometer(Sampled):
    """Sensor of the geomagnetic field."""

    role = "magnetometer"
    role_title = "Sensors: magnetic field"
    typical_block = "magnetometer"
    is_sensor = True

    b_eci: Vec3 = Input("T", "geomagnetic field, eci", source="environment.b_eci")
    q_bi: Vec4 = Input(
        "1",
        "attitude: body from eci, scalar last",
        start=UPRIGHT,
        source="spacecraft.q_bi",
    )
    m_body: Vec3 = Input(
        "A.m2", "dipole of the torquers at this time, body", source="torquers.m_body"
    )
    b_body: Vec3 = Output(
        "T",
        "measured field, body",
        interval=True,
        starts_from=("b_eci", "q_bi", "m_body"),
    )
    valid: bool = Output("1", "true: the measurement may be used", interval=True)


class Tachometers(Sampled):
    """Sensors of the wheels' momentum."""

    role = "tachometers"
    role_title = "Sensors: wheel momentum"
    typical_block = "tachometers"
    is_sensor = True

    h_wheel: PerWheel = Input(
        "N.m.s",
        "axial momentum of each wheel, absolute",
        source=("wheels.h_wheel", "spacecraft.h_copy_wheel"),
    )
    h_meas_wheel: PerWheel = Output(
        "N.m.s",
        "measured axial momentum of each wheel",
        interval=True,
        starts_from=("h_wheel",),
    )
    valid: bool = Output("1", "true: the measurement may be used", interval=True)


class RateGyro(Sampled):
    """Sensor of the angular rate."""

    role = "gyro"
    role_title = "Sensors: angular rate"
    typical_block = "rate_gyro"
    is_sensor = True

    omega_bi_body: Vec3 = Input(
        "rad/s",
        "angular rate of the body relative to eci, body",
        source="spacecraft.omega_bi_body",
    )
    omega_meas_body: Vec3 = Output(
        "rad/s",
        "measured angular rate, body",
        interval=True,
        starts_from=("omega_bi_body",),
    )
    valid: bool = Output("1", "true: the measurement may be used", interval=True)


class AttitudeDetermination(Sampled):
    """Estimate of the attitude, independent of its sensors and filters."""

    role = "determination"
    role_title = "Attitude determination"
    typical_block = "attitude_determination"
    is_sensor = True

    q_bi: Vec4 = Input(
        "1",
        "attitude: body from eci, scalar last",
        start=UPRIGHT,
        source="spacecraft.q_bi",
    )
    q_meas_bi: Vec4 = Output(
        "1",
        "estimated attitude: body from eci, scalar last",
        interval=True,
        starts_from=("q_bi",),
    )
    valid: bool = Output("1", "true: the estimate may be used", interval=True)


class SunSensor(Sampled):
    """Sensor of the direction to the Sun."""

    role = "sun_sensor"
    role_title = "Sensors: direction to the Sun"
    typical_block = "sun_sensor"
    is_sensor = True

    sun_eci: Vec3 = Input(
        "1", "unit vector to the Sun, eci", source="environment.sun_eci"
    )
    sunlight: float = Input(
        "1",
        "the Sun's light over that at 1 astronomical unit",
        start=1.0,
        source="environment.sunlight",
    )
    q_bi: Vec4 = Input(
        "1",
        "attitude: body from eci, scalar last",
        start=UPRIGHT,
        source="spacecraft.q_bi",
    )
    sun_meas_body: Vec3 = Output(
        "1",
        "measured unit vector to the Sun, body; zero while invalid",
        interval=True,
        starts_from=("sun_eci", "sunlight", "q_bi"),
    )
    valid: bool = Output(
        "1",
        "true: the Sun is seen",
        interval=True,
        starts_from=("sun_eci", "sunlight", "q_bi"),
    )


class StarTracker(Sampled):
    """Sensor of the attitude by the stars.

    It feeds the laws itself where there is no `determination`.
    """

    role = "star_tracker"
    role_title = "Sensors: star trackers"
    typical_block = "star_tracker"
    is_sensor = True

    q_bi: Vec4 = Input(
        "1",
        "attitude: body from eci, scalar last",
        start=UPRIGHT,
        source="spacecraft.q_bi",
    )
    omega_bi_body: Vec3 = Input(
        "rad/s",
        "angular rate of the body relative to eci, body",
        source="spacecraft.omega_bi_body",
    )
    r_eci: Vec3 = Input(
        "m", "position, eci", start=(7.0e6, 0.0, 0.0), source="environment.r_eci"
    )
    sun_eci: Vec3 = Input(
        "1", "unit vector to the Sun, eci", source="environment.sun_eci"
    )
    sunlight: float = Input(
        "1",
        "the Sun's light over that at 1 astronomical unit",
        start=1.0,
        source="environment.sunlight",
    )
    q_meas_bi: Vec4 = Output(
        "1",
        "measured attitude: body from eci, scalar last",
        interval=True,
        starts_from=("q_bi", "omega_bi_body", "r_eci", "sun_eci", "sunlight"),
    )
    valid: bool = Output(
        "1",
        "true: the measurement may be used",
        interval=True,
        starts_from=("q_bi", "omega_bi_body", "r_eci", "sun_eci", "sunlight"),
    )


class Guidance(Sampled):
    """Reference attitude and rate."""

    role = "guidance"
    role_title = "Reference attitude"
    typical_block = "guidance_nadir"

    r_eci: Vec3 = Input(
        "m", "position, eci", start=(7.0e6, 0.0, 0.0), source="environment.r_eci"
    )
    v_eci: Vec3 = Input(
        "m/s", "velocity, eci", start=(0.0, 7.5e3, 0.0), source="environment.v_eci"
    )
    sun_eci: Vec3 = Input(
        "1",
        "unit vector to the Sun, eci",
        start=(1.0, 0.0, 0.0),
        source="environment.sun_eci",
        only_if_needed=True,
    )
    q_ref_bi: Vec4 = Output(
        "1",
        "reference attitude: body from eci, scalar last",
        interval=True,
        starts_from=("r_eci", "v_eci", "sun_eci"),
    )
    omega_ref_body: Vec3 = Output(
        "rad/s",
        "rate of the reference frame relative to eci, in the reference frame",
        interval=True,
        starts_from=("r_eci", "v_eci", "sun_eci"),
    )


class Controller(Computer):
    """Torque that the body needs to follow its reference.

    There is no torque while a measurement is not valid.
    """

    role = "controller"
    role_title = "Attitude control"
    typical_block = "controller_pid"

    q_bi: Vec4 = Input(
        "1",
        "measured attitude: body from eci, scalar last",
        start=UPRIGHT,
        source=("determination.q_meas_bi", "star_tracker.q_meas_bi", "spacecraft.q_bi"),
    )
    omega_bi_body: Vec3 = Input(
        "rad/s",
        "measured angular rate, body",
        source=("gyro.omega_meas_body", "spacecraft.omega_bi_body"),
    )
    q_ref_bi: Vec4 = Input(
        "1",
        "reference attitude: body from eci, scalar last",
        start=UPRIGHT,
        source="guidance.q_ref_bi",
    )
    omega_ref_body: Vec3 = Input(
        "rad/s",
        "rate of the reference frame, in the reference frame",
        source="guidance.omega_ref_body",
    )
    enable: bool = Input("1", "false: no torque, integral at zero", start=True)
    valid_q: bool = Input(
        "1",
        "false: q_bi is not used",
        start=True,
        source=("determination.valid", "star_tracker.valid"),
    )
    valid_omega: bool = Input(
        "1", "false: omega_bi_body is not used", start=True, source="gyro.valid"
    )
    tau_ctrl_body: Vec3 = Output(
        "N.m", "torque wanted on the body, body", interval=True
    )

    def foresee(
        self, begin: float, end: float, wired_names: frozenset[str]
    ) -> Iterator[str]:
        """Yield the problems known before a run: also a missing reference attitude."""
        if "q_ref_bi" not in wired_names:
            yield "q_ref_bi is neither wired nor given: the axes of eci are held"
        yield from super().foresee(begin, end, wired_names)

    def commands(self) -> tuple[float, ...]:
        """Return the torque command (3,) N m, body."""
        return self.tau_ctrl_body

    def command(self, values: tuple[float, ...]) -> None:
        """Assign the torque command (3,) N m, body."""
        x, y, z = values
        self.tau_ctrl_body = (x, y, z)


class Manager(Computer):
    """Dumping of the wheels' momentum, and choice of the actuator.

    A measurement that is not valid is not used.
    """

    role = "manager"
    role_title = "Momentum management"

    # what a craft must have in addition to the needs of the bases
    craft_needs: ClassVar[tuple[Need, ...]] = ()
    # Laws that bound the wheel momentum, each with its gains by rule from the craft.
    offers: ClassVar[tuple[Law, ...]] = ()
    no_law: ClassVar[str] = ""  # why it has no such law, where it has none
    brakes: ClassVar[bool] = False  # whether it damps the rate of a tumbling craft
    # Whether the wheels apply tau_ctrl_body to the body at each of their commands, and
    # also omega x h unless a parameter `gyroscopic` is false.
    passes_torque: ClassVar[bool] = False

    b_body: Vec3 = Input(
        "T", "measured geomagnetic field, body", source="magnetometer.b_body"
    )
    q_bi: Vec4 = Input(
        "1",
        "measured attitude: body from eci, scalar last",
        start=UPRIGHT,
        source=("determination.q_meas_bi", "star_tracker.q_meas_bi", "spacecraft.q_bi"),
    )
    omega_bi_body: Vec3 = Input(
        "rad/s",
        "measured angular rate, body",
        source=("gyro.omega_meas_body", "spacecraft.omega_bi_body"),
    )
    r_eci: Vec3 = Input(
        "m", "position, eci", start=(7.0e6, 0.0, 0.0), source="environment.r_eci"
    )
    v_eci: Vec3 = Input(
        "m/s", "velocity, eci", start=(0.0, 7.5e3, 0.0), source="environment.v_eci"
    )
    h_wheel: PerWheel = Input(
        "N.m.s",
        "measured axial momentum of each wheel",
        source=(
            "tachometers.h_meas_wheel",
            "wheels.h_wheel",
            "spacecraft.h_copy_wheel",
        ),
    )
    tau_ctrl_body: Vec3 = Input(
        "N.m",
        "torque wanted on the body by the attitude controller",
        source="controller.tau_ctrl_body",
        needs=("tau_cmd_wheel",),
    )
    q_ref_bi: Vec4 = Input(
        "1",
        "reference attitude: body from eci, scalar last",
        start=UPRIGHT,
    )
    omega_ref_body: Vec3 = Input(
        "rad/s",
        "rate of the reference frame, in the reference frame",
    )
    h_target_body: Vec3 = Input(
        "N.m.s", "wanted sum of the wheels' momentum (a bias), body"
    )
    enable: bool = Input("1", "false: no dumping", start=True)
    valid_b: bool = Input(
        "1",
        "false: b_body is not used, no dipole",
        start=True,
        source="magnetometer.valid",
    )
    valid_q: bool = Input(
        "1",
        "false: q_bi is not used",
        start=True,
        source=("determination.valid", "star_tracker.valid"),
    )
    valid_omega: bool = Input(
        "1", "false: omega_bi_body is not used", start=True, source="gyro.valid"
    )
    valid_h: bool = Input(
        "1",
        "false: h_wheel is not used, no dumping",
        start=True,
        source="tachometers.valid",
    )

    tau_cmd_wheel: PerWheel = Output(
        "N.m", "torque command to each rotor", interval=True
    )
    m_cmd_body: Vec3 = Output("A.m2", "dipole command, body", interval=True)
    tau_cmd_thruster_body: Vec3 = Output(
        "N.m", "thruster torque command, body", interval=True
    )
    mode: int = Output(
        "1", "what the manager does; its values are each block's", interval=True
    )

    def commands(self) -> tuple[float, ...]:
        """Return all commands: wheel torques, dipole (3,), thruster torque (3,).

        Units are N m, A m2 and N m; dipole and thruster torque are in the body frame.
        """
        return (*self.tau_cmd_wheel, *self.m_cmd_body, *self.tau_cmd_thruster_body)

    def command(self, values: tuple[float, ...]) -> None:
        """Assign all commands, in the order of `commands`."""
        count = len(self.tau_cmd_wheel)
        mx, my, mz, x, y, z = values[count:]
        self.tau_cmd_wheel = values[:count]
        self.m_cmd_body = (mx, my, mz)
        self.tau_cmd_thruster_body = (x, y, z)


class WheelManager(Manager, WheelAxes):
    """Manager that commands the wheels.

    It may command them at samples of their own, where the attitude control that passes
    through it is faster than the dumping.
    """

    craft_needs: ClassVar[tuple[Need, ...]] = (Need.WHEELS,)

    wheel_sample_time: float = Parameter(
        "s",
        "time between commands to the wheels, sample_time over a whole number; 0: sample_time",
        min=0.0,
    )

    def start(self) -> None:
        """Set the state to its start values and check `wheel_sample_time`."""
        super().start()
        self._wheel_sample = -1
        if self.wheel_sample_time > 0.0:
            ratio = self.sample_time / self.wheel_sample_time
            if ratio < 0.5 or abs(ratio - round(ratio)) > 1e-6:
                self.fail(
                    f"wheel_sample_time = {self.wheel_sample_time} s does not divide "
                    f"sample_time = {self.sample_time} s"
                )

    def wheels_due(self, t: float, is_sample: bool) -> bool:
        """Return whether the wheels get a new command in the step from t (s).

        `is_sample`: the manager takes a sample in this step. Call it once per step.
        """
        if self.wheel_sample_time <= 0.0:
            return is_sample
        sample = floor(t / self.wheel_sample_time + 1e-6)
        if sample <= self._wheel_sample:
            return False
        self._wheel_sample = sample
        return True


class Torquers(Sampled):
    """Magnetic torquers: a dipole, not a torque."""

    role = "torquers"
    role_title = "Actuators: magnetic torquers"
    typical_block = "torquers"

    # only for passive torquers, which have no command
    b_eci: Vec3 = Input(
        "T", "geomagnetic field, eci", source="environment.b_eci", only_if_needed=True
    )
    q_bi: Vec4 = Input(
        "1",
        "attitude: body from eci, scalar last",
        start=UPRIGHT,
        source="spacecraft.q_bi",
        only_if_needed=True,
    )
    m_cmd_body: Vec3 = Input(
        "A.m2", "dipole command, body", source="manager.m_cmd_body"
    )
    m_mean_body: Vec3 = Output(
        "A.m2", "dipole, body, mean over the step", slope="m_slope_body"
    )
    m_slope_body: Vec3 = Output(
        "A.m2", "dipole, body, slope over the step", interval=True
    )
    on_time: float = Output("s", "time that coils were on, summed over the coils")
    dipole_energy: float = Output(
        "A2.m4.s", "half the integral of the squared dipole (paper 000, eq. 32)"
    )
    electric_energy: float = Output("J", "electric energy of all coils")
    m_body: Vec3 = Output("A.m2", "dipole at this time, body")


class Thrusters(Sampled):
    """Thrusters: a torque."""

    role = "thrusters"
    role_title = "Actuators: thrusters"
    typical_block = "thrusters"

    tau_cmd_thruster_body: Vec3 = Input(
        "N.m", "torque command, body", source="manager.tau_cmd_thruster_body"
    )
    tau_mean_thruster_body: Vec3 = Output(
        "N.m", "torque, body, mean over the step", slope="tau_slope_thruster_body"
    )
    tau_slope_thruster_body: Vec3 = Output(
        "N.m", "torque, body, slope over the step", interval=True
    )
    force_mean_thruster_body: Vec3 = Output(
        "N", "force, body, mean over the step", mean=True
    )
    on_time: float = Output("s", "firing time, summed over the nozzles or axes")
    propellant: float = Output("kg", "propellant used")


class Wheels(Block):
    """Reaction wheels: up to four rotors about fixed axes."""

    role = "wheels"
    role_title = "Actuators: reaction wheels"
    typical_block = "wheels"

    tau_cmd_wheel: PerWheel = Input(
        "N.m", "torque command to each rotor", source="manager.tau_cmd_wheel"
    )
    speed_cmd_wheel: PerWheel = Input(
        "rad/s", "speed command to each rotor, relative to the body"
    )
    omega_bi_body: Vec3 = Input(
        "rad/s",
        "angular rate of the body relative to eci, body",
        source="spacecraft.omega_bi_body",
    )
    tau_mean_wheel: PerWheel = Output(
        "N.m",
        "net torque on each rotor, friction included, mean over the step",
        slope="tau_slope_wheel",
    )
    tau_slope_wheel: PerWheel = Output(
        "N.m", "net torque on each rotor, slope", interval=True
    )
    tau_jitter_body: Vec3 = Output(
        "N.m",
        "disturbance of unbalanced rotors on the body, body, mean over the step",
        mean=True,
    )
    h_wheel: PerWheel = Output(
        "N.m.s",
        "axial momentum of each wheel, absolute: J_s (Omega + g.omega)",
        starts_from=("omega_bi_body",),
    )
    speed_wheel: PerWheel = Output(
        "rad/s",
        "speed of each rotor relative to the body, at the step's begin",
        interval=True,
        starts_from=("omega_bi_body",),
    )
    saturated_wheel: WheelFlags = Output(
        "1", "true: the wheel is at its momentum limit"
    )
    failed_wheel: WheelFlags = Output("1", "true: the wheel has failed")
    power: float = Output(
        "W",
        "electric power of all wheels, nothing recovered",
        starts_from=("omega_bi_body",),
    )
