"""What is computed of a run beyond its numbers: a file an analysis, found by the folder.

A module of this folder that has `applies` is an analysis:

    KEY = "rigid_body"                              # its place in the manifest
    NUMBERS = ("momentum_residual",)                # the names of all numbers that it may give
    def applies(system) -> parts or None            # which component is what; None: not this system
    def signals(parts) -> list of series            # what a run of which little is kept must record
    def numbers(manifest, results) -> numbers       # as a manifest has them, {} where there is none
    def figures(manifest, results) -> [(caption, svg)]
"""

from __future__ import annotations

import importlib
import pkgutil
from functools import cache
from types import ModuleType


@cache
def analyses() -> tuple[ModuleType, ...]:
    """The analyses that there are, by the names of their files."""
    names = sorted(m.name for m in pkgutil.iter_modules(__path__))
    modules = (importlib.import_module(f"{__name__}.{name}") for name in names)
    return tuple(m for m in modules if hasattr(m, "applies"))
