"""The same kind of day in Basilisk; `benchmarks.run` runs it in its own environment.

    python basilisk_day.py dipole|IGRF.json STEPS [FILE.npz]

A craft of 80 kg points to nadir for STEPS s with four wheels and three coils: 16
modules of theirs, all at 1 s, each message that has a counterpart among our series
recorded at every step. Prints RESULT {"seconds", "us_per_step", "modules",
"pointing_deg", "momentum"}: wall seconds of stepping, set-up left out, and pointing
error and the wheels' momentum (N m s) at the end, to see that it flies. With a FILE the
recorded series are written there, as a user would keep them.

The field is their dipole, or their spherical harmonics (WMM, degree 12) with the
coefficients of our IGRF-14 table for 2025 to 2030.
"""

import json
import math
import sys
import tempfile
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
    exponentialAtmosphere,
    gravityEffector,
    magneticFieldCenteredDipole,
    magneticFieldWMM,
    magnetometer,
    reactionWheelStateEffector,
    simpleNav,
    spacecraft,
)
from Basilisk.utilities import (
    SimulationBaseClass,
    macros,
    orbitalMotion,
    simIncludeRW,
    simSetPlanetEnvironment,
)

INERTIA = [10.5, 0.3, -0.2, 0.3, 9.0, 0.15, -0.2, 0.15, 6.5]
SPIN = 6.37e-4
H_START = (0.06, -0.04, 0.03, -0.02)
AXES = np.array([(1, 1, 1), (-1, 1, 1), (-1, -1, 1), (1, -1, 1)]) / math.sqrt(3.0)


def coefficients(igrf: Path, into: Path) -> None:
    """Our table as the file that their module reads: g, h of 2025 and their change a
    year (nT)."""
    table = json.loads(igrf.read_text(encoding="utf-8"))
    key = next(k for k, v in table.items() if isinstance(v, list) and k != "years")
    at = {(int(r[0]), int(r[1])): r[2:] for r in table[key]}
    first, last = table["years"].index(2025), table["years"].index(2030)
    lines = ["    2025.0            WMM-2025     11/13/2024"]
    for n in range(1, 13):
        for m in range(n + 1):
            g = at[n, m]
            h = at[n, -m] if m else [0.0] * len(g)
            change = [(x[last] - x[first]) / 5.0 for x in (g, h)]
            lines.append(
                f"{n:3d}{m:3d}{g[first]:11.1f}{h[first]:10.1f}"
                f"{change[0]:12.1f}{change[1]:10.1f}"
            )
    into.write_text("\n".join([*lines, "9" * 48, "9" * 48]) + "\n", encoding="utf-8")


def built(environment: str) -> tuple[Any, dict[str, Any], int]:
    """The simulation, its recorders by name, and how many modules it has.
    `environment`: dipole, or our table of IGRF."""
    sim = SimulationBaseClass.SimBaseClass()
    second = macros.sec2nano(1.0)
    sim.CreateNewProcess("process").addTask(sim.CreateNewTask("task", second))
    modules = 0

    def add(module: object, priority: int) -> None:
        nonlocal modules
        modules += 1
        sim.AddModelToTask("task", module, priority)

    craft = spacecraft.Spacecraft()
    craft.hub.mHub = 80.0
    craft.hub.r_BcB_B = [[0.0], [0.0], [0.0]]
    craft.hub.IHubPntBc_B = np.array(INERTIA).reshape(3, 3).tolist()
    earth = gravityEffector.GravBodyData()
    earth.planetName = "earth_planet_data"
    earth.mu = 3.986004418e14
    earth.isCentralBody = True
    craft.gravField.gravBodies = spacecraft.GravBodyVector([earth])
    orbit = orbitalMotion.ClassicElements()
    orbit.a, orbit.e, orbit.i = 6928137.0, 1e-6, 1.70332
    orbit.Omega, orbit.omega, orbit.f = 3.3, 0.0, 0.0
    r, v = orbitalMotion.elem2rv(earth.mu, orbit)
    craft.hub.r_CN_NInit, craft.hub.v_CN_NInit = r, v
    craft.hub.sigma_BNInit = [[0.1], [0.2], [-0.3]]
    craft.hub.omega_BN_BInit = [[1e-3], [-1e-3], [5e-4]]
    add(craft, 100)

    gradient = GravityGradientEffector.GravityGradientEffector()
    gradient.addPlanetName(earth.planetName)
    craft.addDynamicEffector(gradient)
    add(gradient, 99)

    if environment == "dipole":
        field = magneticFieldCenteredDipole.MagneticFieldCenteredDipole()
        simSetPlanetEnvironment.centeredDipoleMagField(field, "earth")
    else:
        file = Path(tempfile.mkdtemp()) / "WMM.COF"
        coefficients(Path(environment), file)
        field = magneticFieldWMM.MagneticFieldWMM()
        field.configureWMMFile(str(file))
        field.epochDateFractionalYear = 2026.0
    field.addSpacecraftToModel(craft.scStateOutMsg)
    add(field, 98)

    air = exponentialAtmosphere.ExponentialAtmosphere()
    simSetPlanetEnvironment.exponentialAtmosphere(air, "earth")
    air.addSpacecraftToModel(craft.scStateOutMsg)
    add(air, 97)
    drag = dragDynamicEffector.DragDynamicEffector()
    drag.coreParams.projectedArea, drag.coreParams.dragCoeff = 0.5, 2.2
    drag.coreParams.comOffset = [0.02, 0.01, 0.03]
    drag.atmoDensInMsg.subscribeTo(air.envOutMsgs[0])
    craft.addDynamicEffector(drag)
    add(drag, 96)

    wheels = reactionWheelStateEffector.ReactionWheelStateEffector()
    factory = simIncludeRW.rwFactory()
    for axis, h in zip(AXES, H_START, strict=True):
        factory.create(
            "custom",
            axis.tolist(),
            Omega=h / SPIN * 30 / math.pi,
            Js=SPIN,
            Omega_max=600.0 * 30 / math.pi,
            u_max=5e-3,
            fCoulomb=2e-5,
            cViscous=1e-7,
            useRWfriction=True,
            rWB_B=[0.0, 0.0, 0.0],
            RWModel=messaging.BalancedWheels,
        )
    factory.addToSpacecraft("wheels", wheels, craft)
    add(wheels, 95)

    coils = MtbEffector.MtbEffector()
    craft.addDynamicEffector(coils)
    add(coils, 94)

    navigation = simpleNav.SimpleNav()
    navigation.scStateInMsg.subscribeTo(craft.scStateOutMsg)
    noise = np.diag([1.0] * 3 + [0.01] * 3 + [5e-5] * 3 + [1e-5] * 3 + [0.0] * 6)
    navigation.PMatrix = noise.tolist()
    navigation.walkBounds = (
        [100.0] * 3 + [0.1] * 3 + [2e-4] * 3 + [5e-5] * 3 + [0.0] * 6
    )
    add(navigation, 93)
    sensor = magnetometer.Magnetometer()
    sensor.stateInMsg.subscribeTo(craft.scStateOutMsg)
    sensor.magInMsg.subscribeTo(field.envOutMsgs[0])
    sensor.senNoiseStd = [5e-8] * 3
    add(sensor, 92)
    link = tamComm.tamComm()
    link.dcm_BS = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
    link.tamInMsg.subscribeTo(sensor.tamDataOutMsg)
    add(link, 91)

    hill = hillPoint.hillPoint()
    hill.transNavInMsg.subscribeTo(navigation.transOutMsg)
    add(hill, 90)
    error = attTrackingError.attTrackingError()
    error.attRefInMsg.subscribeTo(hill.attRefOutMsg)
    error.attNavInMsg.subscribeTo(navigation.attOutMsg)
    add(error, 89)

    vehicle = messaging.VehicleConfigMsg().write(
        messaging.VehicleConfigMsgPayload(ISCPntB_B=INERTIA)
    )
    layout = factory.getConfigMessage()
    control = mrpFeedback.mrpFeedback()
    control.K, control.P, control.Ki, control.integralLimit = 0.08, 1.4, -1.0, 1.0
    control.guidInMsg.subscribeTo(error.attGuidOutMsg)
    control.vehConfigInMsg.subscribeTo(vehicle)
    control.rwParamsInMsg.subscribeTo(layout)
    control.rwSpeedsInMsg.subscribeTo(wheels.rwSpeedOutMsg)
    add(control, 88)
    mapping = rwMotorTorque.rwMotorTorque()
    mapping.controlAxes_B = [1, 0, 0, 0, 1, 0, 0, 0, 1]
    mapping.vehControlInMsg.subscribeTo(control.cmdTorqueOutMsg)
    mapping.rwParamsInMsg.subscribeTo(layout)
    add(mapping, 87)

    bars = messaging.MTBArrayConfigMsgPayload()
    bars.numMTB = 3
    bars.GtMatrix_B = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
    bars.maxMtbDipoles = [5.0] * 3
    bars = messaging.MTBArrayConfigMsg().write(bars)
    manager = mtbMomentumManagement.mtbMomentumManagement()
    manager.wheelSpeedBiases = [0.0] * 4
    manager.cGain = 1e-3
    manager.rwParamsInMsg.subscribeTo(layout)
    manager.mtbParamsInMsg.subscribeTo(bars)
    manager.tamSensorBodyInMsg.subscribeTo(link.tamOutMsg)
    manager.rwSpeedsInMsg.subscribeTo(wheels.rwSpeedOutMsg)
    manager.rwMotorTorqueInMsg.subscribeTo(mapping.rwMotorTorqueOutMsg)
    add(manager, 86)
    wheels.rwMotorCmdInMsg.subscribeTo(manager.rwMotorTorqueOutMsg)
    coils.mtbCmdInMsg.subscribeTo(manager.mtbCmdOutMsg)
    coils.mtbParamsInMsg.subscribeTo(bars)
    coils.magInMsg.subscribeTo(field.envOutMsgs[0])

    recorded = {
        "craft": craft.scStateOutMsg,
        "field": field.envOutMsgs[0],
        "air": air.envOutMsgs[0],
        "navigation": navigation.attOutMsg,
        "orbit": navigation.transOutMsg,
        "sensor": sensor.tamDataOutMsg,
        "reference": hill.attRefOutMsg,
        "error": error.attGuidOutMsg,
        "control": control.cmdTorqueOutMsg,
        "speeds": wheels.rwSpeedOutMsg,
        "torques": manager.rwMotorTorqueOutMsg,
        "dipole": manager.mtbCmdOutMsg,
    }
    logs = {name: message.recorder(second) for name, message in recorded.items()}
    for log in logs.values():
        sim.AddModelToTask("task", log)
    sim.references = [
        craft,
        earth,
        gradient,
        field,
        air,
        drag,
        wheels,
        factory,
        coils,
        navigation,
        sensor,
        link,
        hill,
        error,
        vehicle,
        layout,
        control,
        mapping,
        bars,
        manager,
    ]
    return sim, logs, modules


def main() -> None:
    steps = int(sys.argv[2])
    sim, logs, modules = built(sys.argv[1])
    sim.InitializeSimulation()
    sim.ConfigureStopTime(steps * macros.sec2nano(1.0))
    began = time.perf_counter()
    sim.ExecuteSimulation()
    seconds = time.perf_counter() - began

    if len(sys.argv) > 3:
        fields = {
            "craft": ("r_BN_N", "v_BN_N", "sigma_BN", "omega_BN_B"),
            "field": ("magField_N",),
            "air": ("neutralDensity",),
            "navigation": ("sigma_BN", "omega_BN_B"),
            "orbit": ("r_BN_N", "v_BN_N"),
            "sensor": ("tam_S",),
            "reference": ("sigma_RN", "omega_RN_N"),
            "error": ("sigma_BR", "omega_BR_B"),
            "control": ("torqueRequestBody",),
            "speeds": ("wheelSpeeds",),
            "torques": ("motorTorque",),
            "dipole": ("mtbDipoleCmds",),
        }
        saved: dict[str, Any] = {
            f"{n}.{f}": np.asarray(getattr(logs[n], f))
            for n, names in fields.items()
            for f in names
        }
        np.savez(sys.argv[3], **saved)
    sigma = float(np.linalg.norm(logs["error"].sigma_BR[-1]))
    momentum = SPIN * np.asarray(logs["speeds"].wheelSpeeds[-1])[:4]
    result = {
        "seconds": seconds,
        "us_per_step": 1e6 * seconds / steps,
        "modules": modules,
        "pointing_deg": math.degrees(4.0 * math.atan(sigma)),
        "momentum": float(np.linalg.norm(AXES.T @ momentum)),
    }
    print("RESULT " + json.dumps(result))


if __name__ == "__main__":
    main()
