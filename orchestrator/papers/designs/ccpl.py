"""Tune the gain of the cross-product law of magnetic dumping.

[design]
final_momentum = 0.05         # N m s: the gain is tuned to this |h_f|
"""

from __future__ import annotations

from ...files.scenario import Scenario
from ...system.model import System
from ...system.options import Options
from . import MadeDesign
from .plant import Plant
from .tuning import GAIN_UNIT, flies, tune

KEYS = ("final_momentum",)


def applies(system: System) -> bool:
    """Return whether the manager is `manager_cross_product` with the law ccpl."""
    return flies(system, "manager_cross_product", "ccpl")


def make(scenario: Scenario, options: Options) -> MadeDesign:
    """Tune the gain (1/(T s))."""
    plant = Plant(scenario, options)
    return tune(plant, lambda gain: {"gain": gain}, "gain", GAIN_UNIT)
