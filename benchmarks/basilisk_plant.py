"""Basilisk on the plant's reference trajectory; `benchmarks.run` runs it in its own environment.

    python basilisk_plant.py PARAMETERS.json REFERENCE.csv STEP

prints RESULT {"seconds": …, "attitude_error": …}: wall seconds of the 6000 s, set-up left out, and
the largest quaternion error against the reference at every 10 s.
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
)
from Basilisk.utilities import RigidBodyKinematics, SimulationBaseClass, macros, simIncludeRW


def main() -> None:
    given = json.loads(Path(sys.argv[1]).read_text(encoding="utf-8"))
    truth = np.loadtxt(sys.argv[2], delimiter=",", skiprows=1)
    step = float(sys.argv[3])
    sim = SimulationBaseClass.SimBaseClass()
    process = sim.CreateNewProcess("process")
    process.addTask(sim.CreateNewTask("task", macros.sec2nano(step)))

    craft = spacecraft.Spacecraft()
    craft.hub.mHub = given["mass"]
    craft.hub.r_BcB_B = [[0.0], [0.0], [0.0]]
    axes, spin = np.array(given["Gs_B_columns_are_axes"]), given["Js"]
    craft.hub.IHubPntBc_B = given["I_total_B"]  # balanced wheels: the hub has them, locked
    craft.hub.r_CN_NInit = given["r0_N"]
    craft.hub.v_CN_NInit = given["v0_N"]
    craft.hub.sigma_BNInit = [[x] for x in given["sigma_BN0"]]
    craft.hub.omega_BN_BInit = [[x] for x in given["omega0"]]

    earth = gravityEffector.GravBodyData()
    earth.planetName = "earth_planet_data"
    earth.mu = given["mu"]
    earth.isCentralBody = True
    craft.gravField.gravBodies = spacecraft.GravBodyVector([earth])

    wheels = reactionWheelStateEffector.ReactionWheelStateEffector()
    factory = simIncludeRW.rwFactory()
    for i in range(4):
        factory.create(
            "custom", axes[:, i].tolist(), Omega=given["Omega0"][i] * 30 / math.pi, Js=spin,
            Omega_max=1e5, u_max=1.0, rWB_B=[0.0, 0.0, 0.0], useRWfriction=False,
            useMinTorque=False, useMaxTorque=False, RWModel=messaging.BalancedWheels,
        )  # fmt: skip
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
    log = craft.scStateOutMsg.recorder(macros.sec2nano(10.0))
    sim.AddModelToTask("task", log)
    sim.InitializeSimulation()

    law = given["torque"]
    seconds = 0.0
    for k in range(600):
        torque = [
            law["BIAS"][i]
            + law["AMP"][i] * math.sin(2 * math.pi * 10 * k / law["PER"][i] + law["PH"][i])
            for i in range(4)
        ]
        payload.motorTorque = torque
        command.write(payload, sim.TotalSim.CurrentNanos)
        sim.ConfigureStopTime(macros.sec2nano(10.0 * (k + 1)))
        began = time.perf_counter()
        sim.ExecuteSimulation()
        seconds += time.perf_counter() - began

    found = np.array([RigidBodyKinematics.MRP2EP(s) for s in log.sigma_BN])
    rows = min(len(found), len(truth))
    sign = np.sign((found[:rows] * truth[:rows, 1:5]).sum(axis=1, keepdims=True))
    error = np.abs(found[:rows] - sign * truth[:rows, 1:5]).max()
    result = {"seconds": seconds, "attitude_error": float(error), "rows": rows}
    print("RESULT " + json.dumps(result))


main()
