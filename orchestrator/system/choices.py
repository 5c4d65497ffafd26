"""Define the choices that options of a run have."""

from __future__ import annotations

from typing import Literal

Algorithm = Literal["gauss_seidel", "jacobi"]  # how components exchange values
Loop = Literal["compiled", "python"]  # which loop makes the steps of a run
Fmus = Literal["native", "python"]  # which of our FMUs run
Isolate = Literal["all", "foreign", "none"]  # which FMUs run in processes of their own
FmiVersion = Literal["2", "3"]  # FMI version of an exported FMU

MOST_ACCURACY = 0.1  # rad: above it an estimate of the attitude error means nothing
