"""Compute designs that laws need beforehand (`desat design`): a module for each kind.

    [design]
    of = "NAME"                       # no design of its own: another scenario's
    each_draw = true                  # made anew for the values of each sample
    [design.assume.spacecraft]        # assumed instead of the scenario's values
    inertia = [1, 0, 0, 0, 1, 0, 0, 0, 1]

and the keys of the kind. A module of this folder that has `applies` is a kind of
design:

    KEYS                              # keys of [design] (language/scenario.py)
    def applies(system) -> bool       # whether it is the one for this system
    def make(scenario, options) -> MadeDesign

The results become parameters of one component, in ssp/FAMILY/design/NAME.toml, which
the scenario loader merges below the scenario's own (`origin.py` handles what a file was
made from).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from types import ModuleType
from typing import Any

from ...system import discovery

# values of a component's parameters: a choice by its name, an array as a list
Parameters = Mapping[str, float | int | bool | str | list[Any]]


@dataclass(frozen=True)
class MadeDesign:
    """Designed parameters of a component, results of a run with them, tuned numbers."""

    component: str
    parameters: Parameters
    reached: dict[str, tuple[Any, str]]  # name -> value and unit
    # name -> value and unit
    tuned: dict[str, tuple[float, str]] = field(default_factory=dict)
    notes: tuple[str, ...] = ()


@cache
def kinds() -> tuple[ModuleType, ...]:
    """Return the modules of all kinds of design, sorted by file name."""
    return tuple(m for m in discovery.load("designs") if hasattr(m, "applies"))
