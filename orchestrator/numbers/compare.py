"""A number of one run in relation to that of another."""

from __future__ import annotations

from . import numbers


def related(form: str, value: float | None, reference: float | None) -> float | None:
    """`difference`: value less reference; `paired_ratio`: value over reference; else as
    `numbers.relative`. None where one of them was not reached. Raises DesatError for another
    form."""
    form = "ratio" if form == "paired_ratio" else form
    if form != "difference":
        return numbers.relative(form, value, reference)
    return None if value is None or reference is None else value - reference
