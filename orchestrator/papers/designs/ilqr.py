"""Tune the weight of the ILQR of magnetic dumping: paper 000, eq. 14.

[design]
final_momentum = 0.05         # N m s: the weight F is tuned to this |h_f|
momentum_weight = [1, 1, 1]   # diagonal of F; with final_momentum, its shape only
"""

from __future__ import annotations

from desat.components.maths.vector import norm

from ...files.scenario import Scenario
from ...system.model import System
from ...system.options import Options
from . import MadeDesign, Parameters
from .plant import Plant
from .tuning import flies, shape, with_weight

KEYS = ("final_momentum", "momentum_weight")


def applies(system: System) -> bool:
    """Return whether the manager is `manager_magnetic_ilqr`."""
    return flies(system, "manager_magnetic_ilqr")


def make(scenario: Scenario, options: Options) -> MadeDesign:
    """Compute the weight F, and N_con where it is not zero."""
    plant = Plant(scenario, options)
    n_con = {"n_con_body": list(plant.n_con)} if norm(plant.n_con) > 1e-15 else {}

    def parameters(scale_of_f: float) -> Parameters:
        """Return the manager's parameters for a scale of F."""
        return {"momentum_weight": (scale_of_f * shape(plant)).tolist(), **n_con}

    return with_weight(plant, parameters)
