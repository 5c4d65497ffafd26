"""Basilisk on one of the bench's plants; `benchmarks.run` runs it in its own
environment.

    python basilisk_plant.py PLANT.json STEP rk4|rkf78

prints RESULT {"seconds": …, "rows": [[q1, q2, q3, q0], …]}: CPU seconds of all, set-up
left out, and the attitude (scalar last, body from eci) at every interval of the truth.
"""

import json
import math
import sys
import time
from pathlib import Path

import numpy as np
from Basilisk.architecture import messaging
from Basilisk.simulation import (
    GravityGradientEffector,
    gravityEffector,
    reactionWheelStateEffector,
    spacecraft,
    svIntegrators,
)
from Basilisk.utilities import (
    RigidBodyKinematics,
    SimulationBaseClass,
    macros,
    simIncludeRW,
)


def main() -> None:
    arguments = json.loads(Path(sys.argv[1]).read_text(encoding="utf-8"))
    step, integrator = float(sys.argv[2]), sys.argv[3]
    sim = SimulationBaseClass.SimBaseClass()
    process = sim.CreateNewProcess("process")
    process.addTask(sim.CreateNewTask("task", macros.sec2nano(step)))

    craft = spacecraft.Spacecraft()
    if integrator == "rkf78":
        own_value = svIntegrators.svIntegratorRKF78(craft)
        craft.setIntegrator(own_value)
    craft.hub.mHub = 100.0
    craft.hub.r_BcB_B = [[0.0], [0.0], [0.0]]
    axes, spin = np.array(arguments["axes"]), arguments["inertia_wheel"]
    craft.hub.IHubPntBc_B = arguments[
        "inertia"
    ]  # balanced wheels: the hub has them, locked
    craft.hub.r_CN_NInit = [[x] for x in arguments["r0"]]
    craft.hub.v_CN_NInit = [[x] for x in arguments["v0"]]
    q = np.array(arguments["q0"]) / np.linalg.norm(arguments["q0"])
    craft.hub.sigma_BNInit = [[x] for x in q[:3] / (1.0 + q[3])]
    craft.hub.omega_BN_BInit = [[x] for x in arguments["omega0"]]

    earth = gravityEffector.GravBodyData()
    earth.planetName = "earth_planet_data"
    earth.mu = arguments["mu"]
    earth.isCentralBody = True
    craft.gravField.gravBodies = spacecraft.GravBodyVector([earth])

    wheels = reactionWheelStateEffector.ReactionWheelStateEffector()
    factory = simIncludeRW.rwFactory()
    for i in range(4):
        factory.create(
            "custom",
            axes[:, i].tolist(),
            Omega=arguments["speeds"][i] * 30 / math.pi,
            Js=spin[i],
            Omega_max=1e6,
            u_max=1.0,
            rWB_B=[0.0, 0.0, 0.0],
            useRWfriction=False,
            useMinTorque=False,
            useMaxTorque=False,
            RWModel=messaging.BalancedWheels,
        )
    factory.addToSpacecraft("wheels", wheels, craft)

    gradient = GravityGradientEffector.GravityGradientEffector()
    gradient.addPlanetName(earth.planetName)
    craft.addDynamicEffector(gradient)

    payload = messaging.ArrayMotorTorqueMsgPayload()
    command = messaging.ArrayMotorTorqueMsg().write(payload)
    wheels.rwMotorCmdInMsg.subscribeTo(command)

    sim.AddModelToTask("task", craft, 10)
    sim.AddModelToTask("task", gradient, 9)
    sim.AddModelToTask("task", wheels, 11)
    log = craft.scStateOutMsg.recorder(macros.sec2nano(arguments["every"]))
    sim.AddModelToTask("task", log)
    sim.InitializeSimulation()

    law, hold = arguments["torque"], arguments["hold"]
    seconds = 0.0
    for k in range(round(arguments["seconds"] / hold)):
        payload.motorTorque = [
            law["bias"][i]
            + law["amplitude"][i]
            * math.sin(2 * math.pi * hold * k / law["period"][i] + law["phase"][i])
            for i in range(4)
        ]
        command.write(payload, sim.TotalSim.CurrentNanos)
        sim.ConfigureStopTime(macros.sec2nano(hold * (k + 1)))
        began = time.process_time()
        sim.ExecuteSimulation()
        seconds += time.process_time() - began

    rows = np.array([RigidBodyKinematics.MRP2EP(s) for s in log.sigma_BN])[
        :, [1, 2, 3, 0]
    ]
    print("RESULT " + json.dumps({"seconds": seconds, "rows": rows.tolist()}))


main()
