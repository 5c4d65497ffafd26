"""Environments of an orbit for the tests of physics, checked and started."""

from __future__ import annotations

from datetime import datetime

from desat.components.blocks.environment_kepler import EnvironmentKepler
from desat.components.contract.block import Block


def epoch(*date: int) -> float:
    """Seconds from J2000 to a date."""
    return (datetime(*date) - datetime(2000, 1, 1, 12)).total_seconds()


def begin(block: Block, **parameters: object) -> Block:
    """The block, checked and started; a choice by its name."""
    variables = {v.name: v for v in block.variables}
    for name, value in parameters.items():
        variable = variables[name]
        setattr(
            block, name, variable.choices.index(value) if variable.choices else value
        )
    block.check()
    block.start()
    return block


def kepler(**parameters: object) -> EnvironmentKepler:
    """An environment on a Kepler orbit."""
    return begin(EnvironmentKepler(), **parameters)


def at(block: Block, t: float) -> Block:
    """The block with its outputs at t (s)."""
    block.output(t)
    return block
