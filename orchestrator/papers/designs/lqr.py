"""Compute the gain tables of the LQR of magnetic dumping: paper 000, eq. 13.

[design]
final_momentum = 0.05         # N m s: the weight F is tuned to this |h_f|
momentum_weight = [1, 1, 1]   # diagonal of F; with final_momentum, its shape only
nodes = 61                    # rows of the tables
"""

from __future__ import annotations

import numpy as np

from desat.components.blocks.manager_magnetic import CAPACITY
from desat.components.laws import magnetic_offline as offline

from ...files.scenario import Scenario
from ...system.errors import DesatError
from ...system.model import System
from ...system.options import Options
from . import MadeDesign, Parameters
from .plant import Array, Plant
from .tuning import flies, shape, with_weight

NODES = 61

KEYS = ("final_momentum", "momentum_weight", "nodes")


def applies(system: System) -> bool:
    """Return whether the manager is `manager_magnetic` with the law lqr."""
    return flies(system, "manager_magnetic", "lqr")


def make(scenario: Scenario, options: Options) -> MadeDesign:
    """Compute gain and offset tables over the time to go."""
    plant = Plant(scenario, options)
    nodes = plant.settings.nodes or NODES
    if nodes > CAPACITY:
        raise DesatError(
            f"{scenario.name}: design: nodes = {nodes}: at most {CAPACITY} are held"
        )
    times = np.linspace(0.0, plant.horizon, nodes)

    def parameters(scale_of_f: float) -> Parameters:
        """Return the manager's parameters for a scale of F."""
        gain, offset = offline.gains(
            plant.field,
            plant.omega,
            scale_of_f * shape(plant),
            plant.manager_value("dipole_weight"),
            plant.n_con,
            times,
        )
        return {
            "horizon": plant.horizon,
            "table_nodes": nodes,
            "gain_table": _padded(gain),
            "offset_table": _padded(offset),
        }

    return with_weight(plant, parameters)


def _padded(table: Array) -> list[list[float]]:
    """Pad a table with zeros to CAPACITY rows."""
    rows = np.zeros((CAPACITY, table.shape[1]))
    rows[: len(table)] = table
    return [[float(x) for x in row] for row in rows]
