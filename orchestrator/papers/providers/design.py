"""Provide the values of a [design]: gain tables and costates (`papers/designs/`)."""

from __future__ import annotations

from ..designs.making import parameters_for
from ..designs.momentum_tables import problems
from ..designs.origin import warnings

__all__ = ["parameters_for", "problems", "warnings"]
