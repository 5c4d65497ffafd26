"""The closed loop of a `nadir_day/witness-*` scenario in Basilisk; `benchmarks.witness` runs it.

    python basilisk_loop.py CASE.json STEP FILE.npz

Spacecraft, wheels, gravity, gravity gradient, field and coils are Basilisk's modules, by its RK4
with STEP (s). Controller and manager are written here from their equations (paper 004, eqs. 7 to
11, 16 and 19), once more and in numpy, so that nothing of what is compared is shared. They sample
at 1 s what the dynamics have then, and their commands act from then on: the modules that hand
commands on stand before the spacecraft in the task. (Behind it, which is the usual order, they act
one step late: 2e-3 rad at 0.1 s.) The field is held over each step, which makes an error of
first order in STEP.

FILE has q_bi (rows, 4; scalar last), omega (rows, 3; rad/s, body) and h (rows, 4; N m s, axial,
absolute) at every CASE.every s.
"""

import json
import math
import sys
from pathlib import Path
from typing import Any

import numpy as np
from Basilisk.architecture import messaging, sysModel
from Basilisk.simulation import (
    GravityGradientEffector,
    MtbEffector,
    gravityEffector,
    magneticFieldCenteredDipole,
    reactionWheelStateEffector,
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
RADIUS = 6371.2e3


class Earth(sysModel.SysModel):
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


class Flight(sysModel.SysModel):
    """Nadir guidance, attitude controller and momentum manager, each at 1 s, by perfect sensors."""

    def __init__(self, case: dict[str, Any], craft: Any, field: Any, wheels: Any) -> None:
        super().__init__()
        self.case, self.craft, self.field, self.wheels = case, craft, field, wheels
        self.torque, self.dipole = messaging.ArrayMotorTorqueMsg(), messaging.MTBCmdMsg()
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

        body = RigidBodyKinematics.MRP2C(sigma)
        r, v = np.array(state.r_BN_N), np.array(state.v_BN_N)
        z, y = -r / np.linalg.norm(r), -np.cross(r, v) / np.linalg.norm(np.cross(r, v))
        wanted = np.array([np.cross(y, z), y, z])
        error = body @ wanted.T
        beta = RigidBodyKinematics.C2EP(error)  # scalar first, not negative
        e = np.array(beta[1:]) * math.copysign(1.0, beta[0])
        rate = np.array([0.0, -np.linalg.norm(np.cross(r, v)) / (r @ r), 0.0])
        too_fast = omega - error @ rate
        self.integral = self.integral + SAMPLE * e
        control = -self.inertia @ (
            case["kp"] * e + case["kd"] * too_fast + case["ki"] * self.integral
        )

        b = body @ np.array(self.field.envOutMsgs[0].read().magField_N)
        total = self.axes @ h
        dipole = case["gain"] * np.cross(total, b) / (b @ b)
        dipole = np.clip(dipole, -case["m_limit"], case["m_limit"])
        torque = self.to_wheels @ (np.cross(dipole, b) - control - np.cross(omega, total))

        coils = messaging.MTBCmdMsgPayload()
        coils.mtbDipoleCmds = dipole.tolist()
        self.dipole.write(coils, now, self.moduleID)
        motors = messaging.ArrayMotorTorqueMsgPayload()
        motors.motorTorque = torque.tolist()
        self.torque.write(motors, now, self.moduleID)


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
    for g, h, inertia in zip(axes.T, case["h_wheel"], case["inertia_wheel"], strict=True):
        speed = h / inertia - g @ np.array(omega)
        factory.create(
            "custom", g.tolist(), Omega=speed * 30 / math.pi, Js=inertia, Omega_max=1e6, u_max=1e3,
            rWB_B=[0.0, 0.0, 0.0], useRWfriction=rubs, fCoulomb=case["coulomb"],
            fStatic=case["coulomb"], betaStatic=-1.0, cViscous=case["viscous"],
            useMinTorque=False, useMaxTorque=False, RWModel=messaging.BalancedWheels,
        )  # fmt: skip
    factory.addToSpacecraft("wheels", wheels, craft)

    flight = Flight(case, craft, field, wheels)
    bars = messaging.MTBArrayConfigMsgPayload()
    bars.numMTB = 3
    bars.GtMatrix_B = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
    bars.maxMtbDipoles = [case["m_limit"]] * 3
    bars = messaging.MTBArrayConfigMsg().write(bars)
    coils = MtbEffector.MtbEffector()
    coils.mtbParamsInMsg.subscribeTo(bars)
    coils.mtbCmdInMsg.subscribeTo(flight.dipole)
    coils.magInMsg.subscribeTo(field.envOutMsgs[0])
    craft.addDynamicEffector(coils)
    wheels.rwMotorCmdInMsg.subscribeTo(flight.torque)

    for priority, module in enumerate((field, turning, craft, gradient, coils, wheels)):
        sim.AddModelToTask("dynamics", module, priority)  # the last is the first
    sim.AddModelToTask("flight", flight)
    sim.InitializeSimulation()
    sim.ConfigureStopTime(macros.sec2nano(case["stop"]))
    sim.ExecuteSimulation()

    rows = np.array(flight.rows)[:: case["every"]]
    q_bi = np.array([RigidBodyKinematics.MRP2EP(s) for s in rows[:, 1:4]])[:, [1, 2, 3, 0]]
    np.savez(sys.argv[3], t=rows[:, 0] * 1e-9, q_bi=q_bi, omega=rows[:, 4:7], h=rows[:, 7:])


if __name__ == "__main__":
    main()
