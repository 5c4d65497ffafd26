"""What laws need beforehand (`desat design`): a file a kind of design, found by the
folder.

    [design]
    of = "NAME"                       # no design of its own: that of another scenario
    each_draw = true                  # made anew for the values of each draw
    [design.assume.spacecraft]        # what the design takes to be so, against the scenario
    inertia = [1, 0, 0, 0, 1, 0, 0, 0, 1]

and what the kind takes. A module of this folder that has `applies` is a kind of design:

    KEYS                              # which keys of [design] (language/scenario.py) it takes
    def applies(system) -> bool       # whether it is the one for this system
    def make(scenario, options) -> Design

What is computed becomes parameters of one component, in ssp/FAMILY/design/NAME.toml,
which the scenario loader merges below the scenario's own (`origin.py`: what a file was
made from).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from types import ModuleType
from typing import Any

from ...system import discovery

Parameters = Mapping[str, float | int | bool | str | list[Any]]
"""Values of a component's parameters, a choice by its name, an array as a list."""


@dataclass(frozen=True)
class MadeDesign:
    """Parameters of a component, what the run with them reached, the numbers tuned for
    them."""

    component: str
    parameters: Parameters
    reached: dict[str, tuple[Any, str]]
    """name -> value and unit"""
    tuned: dict[str, tuple[float, str]] = field(default_factory=dict)
    """name -> value and unit"""
    notes: tuple[str, ...] = ()


@cache
def kinds() -> tuple[ModuleType, ...]:
    """The kinds of design that there are, by the names of their files."""
    return tuple(m for m in discovery.load("designs") if hasattr(m, "applies"))
