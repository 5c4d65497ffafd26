"""Basilisk's own Monte Carlo over the day of basilisk_day.py; `benchmarks.campaign`
runs it in its own environment.

    python basilisk_campaign.py CASES PROCESSES STEPS

Each case starts at another attitude, at other rates. Kept of each: pointing error and
wheel speeds, as a user would. Prints RESULT {"seconds"}: wall seconds of all cases,
set-up of the controller left out.
"""

import json
import sys
import tempfile
import time
from typing import Any

import basilisk_day  # type: ignore[import-not-found]
from Basilisk.utilities import macros
from Basilisk.utilities.MonteCarlo.Controller import Controller
from Basilisk.utilities.MonteCarlo.Dispersions import (
    NormalVectorCartDispersion,
    UniformEulerAngleMRPDispersion,
)
from Basilisk.utilities.MonteCarlo.RetentionPolicy import RetentionPolicy

STEPS = int(sys.argv[3])


def create() -> Any:
    """A simulation, its recorders named for the retention policy."""
    sim, logs, _ = basilisk_day.built("dipole")
    sim.msgRecList = logs
    sim.craft = sim.references[0]
    return sim


def execute(sim: Any) -> None:
    """A case."""
    sim.InitializeSimulation()
    sim.ConfigureStopTime(STEPS * macros.sec2nano(1.0))
    sim.ExecuteSimulation()


def main() -> None:
    control = Controller()
    control.setSimulationFunction(create)
    control.setExecutionFunction(execute)
    control.setExecutionCount(int(sys.argv[1]))
    control.setThreadCount(int(sys.argv[2]))
    control.setShouldDisperseSeeds(True)
    control.setShowProgressBar(False)
    control.setArchiveDir(tempfile.mkdtemp() + "/cases")
    control.addDispersion(UniformEulerAngleMRPDispersion("craft.hub.sigma_BNInit"))
    control.addDispersion(
        NormalVectorCartDispersion("craft.hub.omega_BN_BInit", 0.0, 1.7e-3)
    )
    keep = RetentionPolicy()
    keep.addMessageLog("error", ["sigma_BR"])
    keep.addMessageLog("speeds", ["wheelSpeeds"])
    control.addRetentionPolicy(keep)
    began = time.perf_counter()
    failed = control.executeSimulations()
    seconds = time.perf_counter() - began
    assert not failed, failed
    print("RESULT " + json.dumps({"seconds": seconds}))


if __name__ == "__main__":
    main()
