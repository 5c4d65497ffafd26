"""A day of nadir pointing in Basilisk, what `nadir_day/day-dipole` is with us; `benchmarks.run`
runs it in its own environment.

    python basilisk_day.py DAY.json SECONDS OUT.npz

Seventeen compiled modules at 1 s: craft with four wheels, coils, drag, gravity gradient, radiation
(cannonball), eclipse, dipole field, exponential atmosphere, magnetometer, navigation with noise,
wheels' speeds, hill pointing, attitude error, MRP feedback, wheel torques, magnetic
momentum management. Prints RESULT with `us_per_step` (stepping alone), the pointing error (deg,
rms) and the wheels' momentum at the end, which say that it does the same task. With OUT, series of
attitude, rate, wheel speeds, dipoles and field are recorded at each step and written compressed.
"""

import json
import math
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from Basilisk.architecture import messaging
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
    dragDynamicEffector,
    eclipse,
    exponentialAtmosphere,
    gravityEffector,
    magneticFieldCenteredDipole,
    magnetometer,
    radiationPressure,
    reactionWheelStateEffector,
    simpleNav,
    spacecraft,
)
from Basilisk.utilities import SimulationBaseClass, macros, simIncludeRW


def main() -> None:
    given = json.loads(Path(sys.argv[1]).read_text(encoding="utf-8"))
    seconds, out = float(sys.argv[2]), sys.argv[3] if len(sys.argv) > 3 else ""
    sim = SimulationBaseClass.SimBaseClass()
    process = sim.CreateNewProcess("process")
    process.addTask(sim.CreateNewTask("task", macros.sec2nano(1.0)))

    def add(module: Any, priority: int) -> Any:
        module.ModelTag = type(module).__name__
        sim.AddModelToTask("task", module, priority)
        return module

    craft = spacecraft.Spacecraft()
    craft.hub.mHub = 80.0
    craft.hub.r_BcB_B = [[0.0], [0.0], [0.0]]
    craft.hub.IHubPntBc_B = given["inertia"]
    craft.hub.r_CN_NInit = [[x] for x in given["r0"]]
    craft.hub.v_CN_NInit = [[x] for x in given["v0"]]
    q = np.array(given["q0"])
    craft.hub.sigma_BNInit = [[x] for x in q[:3] / (1.0 + q[3])]
    craft.hub.omega_BN_BInit = [[x] for x in given["omega0"]]

    earth = gravityEffector.GravBodyData()
    earth.planetName = "earth"
    earth.mu, earth.radEquator = given["mu"], 6378137.0
    earth.isCentralBody = True
    craft.gravField.gravBodies = spacecraft.GravBodyVector([earth])
    place = messaging.SpicePlanetStateMsgPayload()
    place.PlanetName = "earth"
    place.J20002Pfix = np.eye(3)
    planet = messaging.SpicePlanetStateMsg().write(place)
    star = messaging.SpicePlanetStateMsgPayload()
    star.PlanetName = "sun"
    star.PositionVector = (1.496e11 * np.array(given["sun"])).tolist()
    sun = messaging.SpicePlanetStateMsg().write(star)

    wheels = reactionWheelStateEffector.ReactionWheelStateEffector()
    factory = simIncludeRW.rwFactory()
    axes, spin = np.array(given["axes"]), given["inertia_wheel"]
    for i in range(4):
        factory.create(
            "custom", axes[:, i].tolist(), Omega=given["speeds"][i] * 30 / math.pi, Js=spin[i],
            Omega_max=6000.0, u_max=given["torque_limit"], useRWfriction=True,
            cViscous=given["viscous"], fCoulomb=given["coulomb"], useMinTorque=False,
            RWModel=messaging.BalancedWheels,
        )  # fmt: skip
    factory.addToSpacecraft("wheels", wheels, craft)

    gradient = GravityGradientEffector.GravityGradientEffector()
    gradient.addPlanetName(earth.planetName)
    coils = MtbEffector.MtbEffector()
    drag = dragDynamicEffector.DragDynamicEffector()
    drag.coreParams.projectedArea = 0.5
    drag.coreParams.dragCoeff = 2.2
    drag.coreParams.comOffset = [0.02, 0.01, 0.03]
    light = radiationPressure.RadiationPressure()
    light.setUseCannonballModel()
    light.area, light.coefficientReflection = 0.75, 1.0
    for effector in (gradient, coils, drag, light):
        craft.addDynamicEffector(effector)

    field = magneticFieldCenteredDipole.MagneticFieldCenteredDipole()
    field.g10, field.g11, field.h11 = (given["dipole"][i] / 6371200.0**3 for i in (2, 0, 1))
    field.planetRadius = 6371200.0
    air = exponentialAtmosphere.ExponentialAtmosphere()
    air.planetRadius, air.baseDensity, air.scaleHeight = 6378137.0, given["density"], 60e3
    air.baseDensity *= math.exp(550.0 / 60.0)
    shade = eclipse.Eclipse()
    for model in (field, air):
        model.addSpacecraftToModel(craft.scStateOutMsg)
        model.planetPosInMsg.subscribeTo(planet)
    shade.addSpacecraftToModel(craft.scStateOutMsg)
    shade.addPlanetToModel(planet)
    shade.sunInMsg.subscribeTo(sun)

    tam = magnetometer.Magnetometer()
    tam.senNoiseStd = [5e-8] * 3
    tam.stateInMsg.subscribeTo(craft.scStateOutMsg)
    tam.magInMsg.subscribeTo(field.envOutMsgs[0])
    nav = simpleNav.SimpleNav()
    nav.scStateInMsg.subscribeTo(craft.scStateOutMsg)
    nav.PMatrix = np.diag([0.0] * 6 + [5e-5] * 3 + [1e-5] * 3 + [0.0] * 6).tolist()
    nav.walkBounds = [[1e6]] * 18

    hill = hillPoint.hillPoint()
    hill.transNavInMsg.subscribeTo(nav.transOutMsg)
    error = attTrackingError.attTrackingError()
    # hill from lvlh: z to nadir, y against the orbit normal
    error.sigma_R0R = [1.0 / 3.0, 1.0 / 3.0, -1.0 / 3.0]
    error.attNavInMsg.subscribeTo(nav.attOutMsg)
    error.attRefInMsg.subscribeTo(hill.attRefOutMsg)

    vehicle = messaging.VehicleConfigMsgPayload()
    vehicle.ISCPntB_B = np.ravel(given["inertia"]).tolist()
    configuration = messaging.VehicleConfigMsg().write(vehicle)
    rotors = factory.getConfigMessage()
    law = mrpFeedback.mrpFeedback()
    # our quaternion's vector is 2 sigma: 0.02 J e, 0.14 J domega
    law.K, law.P, law.Ki, law.integralLimit = 0.4, 1.3, -1.0, 0.0
    law.guidInMsg.subscribeTo(error.attGuidOutMsg)
    law.vehConfigInMsg.subscribeTo(configuration)
    law.rwParamsInMsg.subscribeTo(rotors)
    law.rwSpeedsInMsg.subscribeTo(wheels.rwSpeedOutMsg)
    motors = rwMotorTorque.rwMotorTorque()
    motors.controlAxes_B = [1, 0, 0, 0, 1, 0, 0, 0, 1]
    motors.vehControlInMsg.subscribeTo(law.cmdTorqueOutMsg)
    motors.rwParamsInMsg.subscribeTo(rotors)

    sensed = tamComm.tamComm()
    sensed.dcm_BS = [1, 0, 0, 0, 1, 0, 0, 0, 1]
    sensed.tamInMsg.subscribeTo(tam.tamDataOutMsg)
    bars = messaging.MTBArrayConfigMsgPayload()
    bars.numMTB = 3
    bars.GtMatrix_B = [1, 0, 0, 0, 1, 0, 0, 0, 1]
    bars.maxMtbDipoles = [5.0] * 3
    bar_message = messaging.MTBArrayConfigMsg().write(bars)
    manager = mtbMomentumManagement.mtbMomentumManagement()
    manager.wheelSpeedBiases = [0.0] * 4
    manager.cGain = 0.001
    manager.rwParamsInMsg.subscribeTo(rotors)
    manager.mtbParamsInMsg.subscribeTo(bar_message)
    manager.tamSensorBodyInMsg.subscribeTo(sensed.tamOutMsg)
    manager.rwSpeedsInMsg.subscribeTo(wheels.rwSpeedOutMsg)
    manager.rwMotorTorqueInMsg.subscribeTo(motors.rwMotorTorqueOutMsg)
    wheels.rwMotorCmdInMsg.subscribeTo(manager.rwMotorTorqueOutMsg)
    coils.mtbCmdInMsg.subscribeTo(manager.mtbCmdOutMsg)
    coils.mtbParamsInMsg.subscribeTo(bar_message)
    coils.magInMsg.subscribeTo(field.envOutMsgs[0])
    drag.atmoDensInMsg.subscribeTo(air.envOutMsgs[0])
    light.sunEphmInMsg.subscribeTo(sun)
    light.sunEclipseInMsg.subscribeTo(shade.eclipseOutMsgs[0])

    modules = [
        craft, wheels, gradient, coils, drag, light, field, air, shade, tam, nav, hill, error, law,
        motors, sensed, manager,
    ]  # fmt: skip
    for i, module in enumerate(modules):
        add(module, 100 - i)
    guidance = error.attGuidOutMsg.recorder(macros.sec2nano(1.0 if out else 60.0))
    logs = {"guidance": guidance}
    if out:
        logs |= {
            "state": craft.scStateOutMsg.recorder(),
            "wheels": wheels.rwSpeedOutMsg.recorder(),
            "dipole": manager.mtbCmdOutMsg.recorder(),
            "field": sensed.tamOutMsg.recorder(),
        }
    for log in logs.values():
        sim.AddModelToTask("task", log, 1)
    sim.InitializeSimulation()
    sim.ConfigureStopTime(macros.sec2nano(seconds))
    began = time.perf_counter()
    sim.ExecuteSimulation()
    spent = time.perf_counter() - began

    angle = 4.0 * np.degrees(np.arctan(np.linalg.norm(guidance.sigma_BR, axis=1)))
    late = angle[len(angle) // 2 :]
    speeds = np.array(wheels.rwSpeedOutMsg.read().wheelSpeeds[:4])
    if out:
        np.savez_compressed(
            out, time=logs["state"].times(), sigma=logs["state"].sigma_BN,
            omega=logs["state"].omega_BN_B, speeds=logs["wheels"].wheelSpeeds[:, :4],
            dipole=logs["dipole"].mtbDipoleCmds[:, :3], field=logs["field"].tam_B,
            error=guidance.sigma_BR,
        )  # fmt: skip
    result = {
        "modules": len(modules),
        "us_per_step": 1e6 * spent / seconds,
        "pointing_rms_deg": float(np.sqrt((late**2).mean())),
        "wheel_momentum_end": (np.array(spin) * speeds).tolist(),
    }
    print("RESULT " + json.dumps(result))


main()
