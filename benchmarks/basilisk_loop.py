"""The closed loop of a `nadir_day/witness-*` scenario in Basilisk; `benchmarks.witness`
runs it.

    python basilisk_loop.py CASE.json STEP FILE.npz

Spacecraft, wheels, gravity, gravity gradient, field and coils are Basilisk's modules,
by its RK4 with STEP (s). Controller and manager are written here from their equations
(paper 004, eqs. 7 to 11, 16 and 19), once more and in numpy, so that nothing of what is
compared is shared. They sample at 1 s what the dynamics have then, and their commands
act from then on: the modules that hand commands on stand before the spacecraft in the
task. (Behind it, which is the usual order, they act one step late; with CASE.late true
it flies so.) The field is held over each step, which makes an error of first order in
STEP.

CASE.laws "modules" flies Basilisk's own flight software instead: hillPoint,
attTrackingError, mrpFeedback, rwMotorTorque and mtbMomentumManagement (Hogan & Schaub,
2015). A list flies the equations here with its terms in place of ours, by name:

    mrp          K sigma, K = 2 kp, where ours is kp e
    gyroscopic   omega_r x (J omega + A h) - J (omega x omega_r), where ours is omega x A h
    null_space   the wheels' momentum is driven to nothing in the null space, too
    relative     the momentum to dump is J_s Omega, where ours is J_s (Omega + g . omega)

FILE has q_bi (rows, 4; scalar last), omega (rows, 3; rad/s, body) and h (rows, 4; N m
s, axial, absolute) at every CASE.every s.
"""

import json
import math
import sys
from pathlib import Path
from typing import Any

import numpy as np
from Basilisk.architecture import messaging, sysModel
from Basilisk.fswAlgorithms import (
    attTrackingError,
    hillPoint,
    mrpFeedback,
    mtbMomentumManagement,
    rwMotorTorque,
    tamComm,
)
from Basilisk.simulation import (
    GravityGradientEffector,
    MtbEffector,
    gravityEffector,
    magneticFieldCenteredDipole,
    magnetometer,
    reactionWheelStateEffector,
    simpleNav,
    spacecraft,
)
from Basilisk.utilities import (
    RigidBodyKinematics,
    SimulationBaseClass,
    macros,
    orbitalMotion,
    simIncludeRW,
)

SAMPLE = 1.0
MODULES = "modules"
RADIUS = 6371.2e3


class Earth(sysModel.SysModel):  # type: ignore[misc]
    """Where the Earth-fixed axes are: they turn about the z axis of the inertial ones."""

    def __init__(self, angle: float, rate: float) -> None:
        super().__init__()
        self.angle, self.rate = angle, rate
        self.out = messaging.SpicePlanetStateMsg()

    def Reset(self, now: int) -> None:
        self.UpdateState(now)

    def UpdateState(self, now: int) -> None:
        turned = self.angle + self.rate * now * 1e-9
        c, s = math.cos(turned), math.sin(turned)
        state = messaging.SpicePlanetStateMsgPayload()
        state.J20002Pfix = [[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]
        self.out.write(state, now, self.moduleID)


class Flight(sysModel.SysModel):  # type: ignore[misc]
    """Nadir guidance, attitude controller and momentum manager, each at 1 s, by perfect
    sensors."""

    def __init__(
        self, case: dict[str, Any], craft: Any, field: Any, wheels: Any
    ) -> None:
        super().__init__()
        self.case, self.craft, self.field, self.wheels = case, craft, field, wheels
        self.torque, self.dipole = (
            messaging.ArrayMotorTorqueMsg(),
            messaging.MTBCmdMsg(),
        )
        self.axes = np.array(case["axes_wheel"])
        self.to_wheels = np.linalg.pinv(self.axes)
        self.inertia = np.array(case["inertia"])
        self.integral = np.zeros(3)
        self.rows: list[Any] = []

    def Reset(self, now: int) -> None:
        self.torque.write(messaging.ArrayMotorTorqueMsgPayload(), now, self.moduleID)
        self.dipole.write(messaging.MTBCmdMsgPayload(), now, self.moduleID)

    def UpdateState(self, now: int) -> None:
        state, case = self.craft.scStateOutMsg.read(), self.case
        omega = np.array(state.omega_BN_B)
        speeds = np.array(self.wheels.rwSpeedOutMsg.read().wheelSpeeds[:4])
        h = np.array(case["inertia_wheel"]) * (speeds + omega @ self.axes)
        sigma = np.array(state.sigma_BN)
        self.rows.append((now, *sigma, *omega, *h))

        if case["laws"] == MODULES:
            return
        terms = case["laws"]
        body = RigidBodyKinematics.MRP2C(sigma)
        r, v = np.array(state.r_BN_N), np.array(state.v_BN_N)
        z, y = -r / np.linalg.norm(r), -np.cross(r, v) / np.linalg.norm(np.cross(r, v))
        expected = np.array([np.cross(y, z), y, z])
        error = body @ expected.T
        beta = RigidBodyKinematics.C2EP(error)  # scalar first, not negative
        e = np.array(beta[1:]) * math.copysign(1.0, beta[0])
        omega_r = error @ np.array(
            [0.0, -np.linalg.norm(np.cross(r, v)) / (r @ r), 0.0]
        )
        too_fast = omega - omega_r
        self.integral = self.integral + SAMPLE * e
        proportional = 2.0 * e / (1.0 + abs(beta[0])) if "mrp" in terms else e
        control = -np.array(case["gain_matrix"]) @ (
            case["kp"] * proportional
            + case["kd"] * too_fast
            + case["ki"] * self.integral
        )

        b = body @ np.array(self.field.envOutMsgs[0].read().magField_N)
        stored = self.axes @ h
        dumped = np.array(case["inertia_wheel"]) * speeds if "relative" in terms else h
        dipole = case["gain"] * np.cross(self.axes @ dumped, b) / (b @ b)
        dipole = np.clip(dipole, -case["m_limit"], case["m_limit"])
        gyroscopic = np.cross(omega, stored)
        if "gyroscopic" in terms:
            full = self.inertia @ omega + stored
            gyroscopic = np.cross(omega_r, full) - self.inertia @ np.cross(
                omega, omega_r
            )
        torque = self.to_wheels @ (np.cross(dipole, b) - control - gyroscopic)
        if "null_space" in terms:
            torque -= case["gain"] * (dumped - self.to_wheels @ (self.axes @ dumped))

        coils = messaging.MTBCmdMsgPayload()
        coils.mtbDipoleCmds = dipole.tolist()
        self.dipole.write(coils, now, self.moduleID)
        motors = messaging.ArrayMotorTorqueMsgPayload()
        motors.motorTorque = torque.tolist()
        self.torque.write(motors, now, self.moduleID)


def modules(
    case: dict[str, Any], craft: Any, field: Any, wheels: Any, layout: Any, bars: Any
) -> Any:
    """Basilisk's own flight software, first to last, and the messages of its last:
    torques of the wheels and dipoles."""
    navigation = simpleNav.SimpleNav()
    navigation.scStateInMsg.subscribeTo(craft.scStateOutMsg)
    sensor = magnetometer.Magnetometer()
    sensor.stateInMsg.subscribeTo(craft.scStateOutMsg)
    sensor.magInMsg.subscribeTo(field.envOutMsgs[0])
    link = tamComm.tamComm()
    link.dcm_BS = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
    link.tamInMsg.subscribeTo(sensor.tamDataOutMsg)
    hill = hillPoint.hillPoint()
    hill.transNavInMsg.subscribeTo(navigation.transOutMsg)
    to_lvlh = np.array(
        [[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]]
    )  # from Hill's axes
    error = attTrackingError.attTrackingError()
    error.sigma_R0R = RigidBodyKinematics.C2MRP(to_lvlh.T).tolist()
    error.attRefInMsg.subscribeTo(hill.attRefOutMsg)
    error.attNavInMsg.subscribeTo(navigation.attOutMsg)
    control = mrpFeedback.mrpFeedback()
    control.K, control.P, control.Ki, control.integralLimit = (
        2.0 * case["kp"],
        case["kd"],
        -1.0,
        1.0,
    )
    vehicle = messaging.VehicleConfigMsg().write(
        messaging.VehicleConfigMsgPayload(ISCPntB_B=np.ravel(case["inertia"]).tolist())
    )
    control.guidInMsg.subscribeTo(error.attGuidOutMsg)
    control.vehConfigInMsg.subscribeTo(vehicle)
    control.rwParamsInMsg.subscribeTo(layout)
    control.rwSpeedsInMsg.subscribeTo(wheels.rwSpeedOutMsg)
    mapping = rwMotorTorque.rwMotorTorque()
    mapping.controlAxes_B = [1, 0, 0, 0, 1, 0, 0, 0, 1]
    mapping.vehControlInMsg.subscribeTo(control.cmdTorqueOutMsg)
    mapping.rwParamsInMsg.subscribeTo(layout)
    manager = mtbMomentumManagement.mtbMomentumManagement()
    manager.wheelSpeedBiases = [0.0] * 4
    manager.cGain = case["gain"]
    manager.rwParamsInMsg.subscribeTo(layout)
    manager.mtbParamsInMsg.subscribeTo(bars)
    manager.tamSensorBodyInMsg.subscribeTo(link.tamOutMsg)
    manager.rwSpeedsInMsg.subscribeTo(wheels.rwSpeedOutMsg)
    manager.rwMotorTorqueInMsg.subscribeTo(mapping.rwMotorTorqueOutMsg)
    chain = navigation, sensor, link, hill, error, control, mapping, manager
    return chain, manager.rwMotorTorqueOutMsg, manager.mtbCmdOutMsg, vehicle


def main() -> None:
    case = json.loads(Path(sys.argv[1]).read_text(encoding="utf-8"))
    step = macros.sec2nano(float(sys.argv[2]))
    sim = SimulationBaseClass.SimBaseClass()
    process = sim.CreateNewProcess("process")
    process.addTask(sim.CreateNewTask("dynamics", step), 2)
    process.addTask(sim.CreateNewTask("flight", macros.sec2nano(SAMPLE)), 1)

    craft = spacecraft.Spacecraft()
    craft.hub.mHub = 100.0
    craft.hub.r_BcB_B = [[0.0], [0.0], [0.0]]
    craft.hub.IHubPntBc_B = case["inertia"]  # balanced wheels: the hub has them, locked
    orbit = orbitalMotion.ClassicElements()
    orbit.a, orbit.e, orbit.i = case["semi_major_axis"], 0.0, case["inclination"]
    orbit.Omega, orbit.omega, orbit.f = case["raan"], 0.0, 0.0
    r, v = orbitalMotion.elem2rv(case["mu"], orbit)
    craft.hub.r_CN_NInit, craft.hub.v_CN_NInit = r, v
    q, omega = case["q_bi"], case["omega"]
    craft.hub.sigma_BNInit = [[x / (1.0 + q[3])] for x in q[:3]]
    craft.hub.omega_BN_BInit = [[x] for x in omega]

    earth = gravityEffector.GravBodyData()
    earth.planetName = "earth_planet_data"
    earth.mu = case["mu"]
    earth.isCentralBody = True
    craft.gravField.gravBodies = spacecraft.GravBodyVector([earth])
    gradient = GravityGradientEffector.GravityGradientEffector()
    gradient.addPlanetName(earth.planetName)
    craft.addDynamicEffector(gradient)

    turning = Earth(case["earth_angle"], case["earth_rate"])
    field = magneticFieldCenteredDipole.MagneticFieldCenteredDipole()
    field.g11, field.h11, field.g10 = (x / RADIUS**3 for x in case["dipole_earth"])
    field.planetRadius = RADIUS
    field.planetPosInMsg.subscribeTo(turning.out)
    field.addSpacecraftToModel(craft.scStateOutMsg)

    wheels = reactionWheelStateEffector.ReactionWheelStateEffector()
    factory = simIncludeRW.rwFactory()
    axes = np.array(case["axes_wheel"])
    rubs = case["viscous"] > 0.0 or case["coulomb"] > 0.0
    for g, h, inertia in zip(
        axes.T, case["h_wheel"], case["inertia_wheel"], strict=True
    ):
        speed = h / inertia - g @ np.array(omega)
        factory.create(
            "custom",
            g.tolist(),
            Omega=speed * 30 / math.pi,
            Js=inertia,
            Omega_max=1e6,
            u_max=1e3,
            rWB_B=[0.0, 0.0, 0.0],
            useRWfriction=rubs,
            fCoulomb=case["coulomb"],
            fStatic=case["coulomb"],
            betaStatic=-1.0,
            cViscous=case["viscous"],
            useMinTorque=False,
            useMaxTorque=False,
            RWModel=messaging.BalancedWheels,
        )
    factory.addToSpacecraft("wheels", wheels, craft)

    flight = Flight(case, craft, field, wheels)
    bars = messaging.MTBArrayConfigMsgPayload()
    bars.numMTB = 3
    bars.GtMatrix_B = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
    bars.maxMtbDipoles = [case["m_limit"]] * 3
    bars = messaging.MTBArrayConfigMsg().write(bars)
    coils = MtbEffector.MtbEffector()
    coils.mtbParamsInMsg.subscribeTo(bars)
    coils.magInMsg.subscribeTo(field.envOutMsgs[0])
    craft.addDynamicEffector(coils)
    torque, dipole, chain = flight.torque, flight.dipole, ()
    if case["laws"] == MODULES:
        chain, torque, dipole, _ = modules(
            case, craft, field, wheels, factory.getConfigMessage(), bars
        )
    wheels.rwMotorCmdInMsg.subscribeTo(torque)
    coils.mtbCmdInMsg.subscribeTo(dipole)

    order = [wheels, coils, gradient, craft, turning, field]
    if case["late"]:
        order = [craft, turning, field, wheels, coils, gradient]
    for priority, module in enumerate(reversed(order)):
        sim.AddModelToTask("dynamics", module, priority)  # the highest is first
    for priority, module in enumerate(reversed((flight, *chain))):
        sim.AddModelToTask("flight", module, priority)
    sim.InitializeSimulation()
    sim.ConfigureStopTime(macros.sec2nano(case["stop"]))
    sim.ExecuteSimulation()

    rows = np.array(flight.rows)[:: case["every"]]
    q_bi = np.array([RigidBodyKinematics.MRP2EP(s) for s in rows[:, 1:4]])[
        :, [1, 2, 3, 0]
    ]
    np.savez(
        sys.argv[3], t=rows[:, 0] * 1e-9, q_bi=q_bi, omega=rows[:, 4:7], h=rows[:, 7:]
    )


if __name__ == "__main__":
    main()
