"""What the monolithic reference knows: blocks, parameters, wires; all else it refuses by name.

A parameter that is neither used, nor fixed, nor without effect on the motion must stand at the
start value of its declaration, so what a block learns later is refused until it is known here.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from ..system.errors import DesatError
from ..system.interface import base_name
from ..system.model import System
from ..system.parameters import value_of


@dataclass(frozen=True)
class Known:
    """A role: its block, the parameters (and given inputs) used, fixed ones, those without effect
    on the motion, and how its inputs must be wired."""

    block: str
    used: str
    fixed: dict[str, Any]
    idle: str = ""
    wires: str = ""


KNOWN = {
    "environment": Known(
        "environment_kepler",
        "semi_major_axis eccentricity inclination raan argument_of_perigee mean_anomaly mu field "
        "dipole_earth earth_rate earth_angle earth_angle_start epoch_j2000",
        {"j2": False},
        "atmosphere density_base altitude_base scale_height atmosphere_radius igrf_degree",
    ),
    "spacecraft": Known(
        "spacecraft_rigid",
        "inertia axes_wheel inertia_wheel q_start_bi omega_start_body gravity_gradient "
        "residual_dipole_body tau_disturbance_body",
        {"aerodynamics": 0, "radiation": 0, "start_frame": 0},
        "drag_coefficient area_drag centre_drag_body area_radiation centre_radiation_body plates",
        "environment.r_eci environment.v_eci environment.b_eci environment.b_rate_eci "
        "environment.b_accel_eci wheels.h_wheel wheels.tau_mean_wheel wheels.tau_slope_wheel "
        "torquers.m_mean_body torquers.m_slope_body",
    ),
    "wheels": Known(
        "wheels",
        "axes_wheel inertia_wheel h_start_wheel torque_limit speed_limit motor_lag viscous coulomb "
        "friction_speed compensation stiction failed failed_from",
        {"command_mode": 0, "unbalance": 0.0},
        "speed_gain seed idle_power motor_constant",
        "manager.tau_cmd_wheel spacecraft.omega_bi_body",
    ),
    "guidance": Known("guidance_inertial", "q_target_bi", {}, "sample_time"),
    "controller": Known(
        "controller_pid",
        "sample_time delay kp kd ki gain_matrix integral_limit torque_limit anti_windup",
        {},
        "",
        "spacecraft.q_bi spacecraft.omega_bi_body guidance.q_ref_bi guidance.omega_ref_body",
    ),
    "magnetometer": Known(
        "magnetometer",
        "sample_time bias_body",
        {"noise": 0.0},
        "seed",
        "environment.b_eci spacecraft.q_bi",
    ),
    "manager": Known(
        "manager_cross_product",
        "sample_time wheel_sample_time delay axes_wheel feedforward gyroscopic saturation m_limit "
        "law gain h_deadband enable h_target_body",
        {},
        "",
        "magnetometer.b_body wheels.h_wheel controller.tau_ctrl_body",
    ),
    "torquers": Known(
        "torquers",
        "sample_time drive m_limit lag least_pulse duty_max pulse_delay",
        {},
        "resistance area_turns failed_from failure_known",
        "manager.m_cmd_body",
    ),
}
THRUSTERS = Known(
    "thrusters",
    "schedule_start schedule_duration schedule_tau_body",
    {},
    "tau_level arm sample_time least_pulse least_on_time placement specific_impulse",
)
"""May be missing. The manager of torquers alone never commands them: they fire by schedule."""
THRUSTER_WIRES = " thrusters.tau_mean_thruster_body thrusters.tau_slope_thruster_body"

NO_FIELD, DIPOLE = range(2)


class Values:
    """The parameters of a system that the reference knows.

    Raises DesatError, a line for each thing that it does not know.
    """

    def __init__(self, system: System) -> None:
        self._system = system
        self.known = KNOWN | ({"thrusters": THRUSTERS} if "thrusters" in system.components else {})
        problems = [*self._components()] or [*self._parameters(), *self._wires()]
        problems = problems or [*self._choices()]
        if problems:
            raise DesatError("\n".join(f"{system.where}: the reference {p}" for p in problems))

    def many(self, role: str, name: str) -> Any:
        """The values of a parameter, or of an input's start, as floats in a tuple."""
        component = self._system.components[role]
        assert component.interface is not None
        values: list[Any] = [
            value_of(component, s.name) for s in component.interface.elements(name)
        ]
        return tuple(float(x) for x in values)

    def has(self, role: str, name: str) -> bool:
        """True when a role's block declares a variable."""
        component = self._system.components[role]
        return component.interface is not None and bool(component.interface.elements(name))

    def one(self, role: str, name: str) -> float:
        """The value of a scalar parameter; of a choice its number."""
        value: float = self.many(role, name)[0]
        return value

    def _components(self) -> Iterator[str]:
        components = self._system.components
        for role, known in self.known.items():
            component = components.get(role)
            model = component.interface.model if component and component.interface else None
            if model != known.block:
                yield f"needs {role} = {known.block}, there is {model or 'none'}"
        for name in components.keys() - self.known.keys():
            yield f"does not know the component {name}"

    def _parameters(self) -> Iterator[str]:
        for role, known in self.known.items():
            component = self._system.components[role]
            assert component.interface is not None
            free = {*known.used.split(), *known.idle.split()}
            for signal in component.interface.signals.values():
                name = base_name(signal.name)
                given = signal.causality == "parameter" or signal.name in component.parameters
                if not given or name in free:
                    continue
                wanted, value = (
                    known.fixed.get(name, signal.start),
                    value_of(component, signal.name),
                )
                if value != wanted:
                    yield f"needs {role}.{signal.name} = {wanted}, it is {value}"

    def _wires(self) -> Iterator[str]:
        connections = self._system.connections
        wired = {(c.target, f"{c.source}.{base_name(c.output)}") for c in connections}
        for role, known in self.known.items():
            wires = known.wires + (
                THRUSTER_WIRES if role == "spacecraft" and "thrusters" in self.known else ""
            )
            for wire in wires.split():
                if (role, wire) not in wired:
                    yield f"needs {wire} wired to {role}"
        if self.one("manager", "gyroscopic") and (
            ("manager", "spacecraft.omega_bi_body") not in wired
        ):
            yield "needs spacecraft.omega_bi_body wired to manager, for gyroscopic = true"
        for c in connections:
            if (c.factor, c.offset) != (1.0, 0.0):
                yield f"needs {c} as it is, not scaled"

    def _choices(self) -> Iterator[str]:
        if self.one("environment", "field") not in (NO_FIELD, DIPOLE):
            yield "needs environment.field = none or dipole"
        for role in ("controller", "manager"):
            if self.one(role, "sample_time") <= 0.0:
                yield f"needs {role}.sample_time above 0 s: it has no step of its own"
