"""Collect what a page's model of dumps needs (`modelled` of engine.js).

The model takes the momentum that a flight's wheels would hold without dumps, and
follows the dumps of other thresholds and thrusters in it. Where a parameter of the
disturbances is moved in which their torque is affine, as an offset of the centre of
pressure, it adds what that parameter adds.
"""

from __future__ import annotations

import base64
import math
from collections.abc import Collection

import numpy as np

from desat.components.blocks.manager_threshold import LAST, SAMPLES

from ..analyses.flight import (
    environment_block,
    flown_at,
    inputs_at,
    wanted_attitude,
)
from ..analyses.motion import mu_of, period_of
from ..sizing.dumps import applies
from ..sizing.intervals import AFFINE, ImpulseBases
from ..system.errors import DesatError
from ..system.model import System
from ..system.typed import JsonObject

DUMP_PARAMETERS = ("begin", "end", "torque", "pulse", "sample")
NODES_AN_ORBIT = 48  # linear between them: 0.2 % of what an orbit adds and takes away
ROWS_A_NODE = 10  # that are integrated
MOST_NODES = 10_000  # 40 bytes each in the page for each element of a parameter


def dumps_of(system: System, targets: Collection[str]) -> JsonObject | None:
    """Return the data for a model of the dumps between thresholds; sliders move the `targets`.

    None where dumps wait, come by the calendar or leave something in the wheels.
    """
    if not applies(system):
        return None
    manager = system.components["manager"]
    values = manager.values
    others = ("aligned", "period", "latest", "h_null")
    lists = (*values["windows"], *values["h_target_body"])
    if manager.choice("by") != "thrusters" or any((*lists, *map(values.get, others))):
        return None
    try:
        disturbances = _disturbances(system, targets)
    except DesatError:  # of a craft whose disturbances need a flight
        disturbances = {"parameters": {}}
    return {
        "begin": f"{manager.name}.begin",
        "end": f"{manager.name}.end",
        "torque": f"{manager.name}.torque",
        "pulse": f"{manager.name}.pulse_body",
        "sample": f"{manager.name}.sample_time",
        "last": LAST,
        "samples": SAMPLES,
        "of_wheels": manager.choice("fill") == "wheels",
        "thrusters": system.roles["thrusters"].name,
        "start": "wheels.h_start_wheel",
        "measured": measured_of(system),
        "disturbances": disturbances,
    }


def measured_of(system: System) -> str | None:
    """Return the series of the wheels' momentum that the manager is given."""
    wire = system.fed.get((system.components["manager"].name, "h_wheel"))
    return None if wire is None else wire.series


def _disturbances(system: System, targets: Collection[str]) -> JsonObject:
    """Return what a unit of each element of moved parameters adds to the momentum.

    It is in N m s, eci, at nodes `spacing` (s) apart: (elements, nodes, 3) as the bytes
    of float32.

    Raises
    ------
    DesatError
        If the craft's attitude or environment is known by a flight alone.
    """
    names = sorted({x for x in AFFINE.values() if f"spacecraft.{x}" in targets})
    if not names:
        return {"parameters": {}}
    environment = system.components["environment"]
    first = inputs_at(environment_block(environment), [system.start])
    period = period_of(first["r_eci"][0], first["v_eci"][0], mu_of(system))
    duration = system.stop - system.start
    nodes = math.ceil(NODES_AN_ORBIT * duration / period)
    if nodes >= MOST_NODES:
        return {"parameters": {}}
    times = np.linspace(system.start, system.stop, ROWS_A_NODE * nodes + 1)
    inputs = inputs_at(environment_block(environment), times.tolist())
    flight = flown_at(system, wanted_attitude(system), inputs, times)
    bases = ImpulseBases(system, flight, names)
    momenta = {
        name: np.zeros(
            (np.size(system.components["spacecraft"].values[name]), nodes + 1, 3)
        )
        for name in names
    }
    for (name, element, _), rows in zip(bases.terms, bases.rows, strict=True):
        if name:
            momenta[name][element] += rows[::ROWS_A_NODE]
    return {
        "spacing": duration / nodes,
        "parameters": {
            f"spacecraft.{name}": base64.b64encode(x.astype("<f4").tobytes()).decode()
            for name, x in momenta.items()
        },
    }
