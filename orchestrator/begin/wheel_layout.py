"""Read how many wheels a new craft has, and along which axes."""

from __future__ import annotations

import re
from dataclasses import dataclass
from math import cos, pi, sin, sqrt
from pathlib import Path

import numpy as np

from desat.components.contract.block import MOST_WHEELS, WHEELS

from ..files.columns import read_columns
from ..system.errors import DesatError, choices
from ..system.wheels import FLAT

LAYOUTS = ("pyramid", "axes")
_S = 1.0 / sqrt(3.0)
PYRAMID = [[_S, -_S, -_S, _S], [_S, _S, -_S, -_S], [_S, _S, _S, _S]]
LEAST = 3  # wheels; fewer than WHEELS leave columns zero


@dataclass(frozen=True)
class WheelLayout:
    """Axes of wheels, and what is said of their size."""

    axes: list[list[float]]  # (3, n), body; zero where there is no wheel
    count: int
    words: str
    size: str


def layout_of(text: str) -> WheelLayout:
    """Read `6 pyramid 50Nms`, `3 axes 30mNms` or `wheels.csv 30mNms`.

    Raises
    ------
    DesatError
        If the form is another, or the wheels cannot turn a craft about every axis.
    """
    if match := re.fullmatch(r"\s*(\S.*\.csv)\s+(\S.*?)\s*", text):
        rows = _read_axes(match[1])
        return _layout(rows, f"axes of {match[1]}", match[2], text)
    match = re.fullmatch(r"\s*(\d+)\s+(\w+)\s+(.+?)\s*", text)
    if match is None:
        raise DesatError(
            f"--wheels {text}: the form is COUNT LAYOUT SIZE, as 4 pyramid 30mNms, or FILE SIZE, "
            "as wheels.csv 30mNms"
        )
    count, layout = int(match[1]), match[2]
    if layout not in LAYOUTS:
        raise DesatError(
            f"--wheels {text}: no layout {layout}{choices(layout, LAYOUTS)}"
        )
    if not LEAST <= count <= MOST_WHEELS:
        raise DesatError(f"--wheels {text}: {LEAST} to {MOST_WHEELS} wheels are taken")
    if layout == "pyramid" and count == WHEELS:
        return WheelLayout(PYRAMID, count, "a pyramid along (+-1, +-1, 1)", match[3])
    if layout == "pyramid":
        rows = [_on_cone(i, count) for i in range(count)]
        return _layout(rows, "a cone of 54.7 deg about z", match[3], text)
    rows = [tuple(float(i % 3 == k) for k in range(3)) for i in range(count)]
    words = "one wheel along each axis" if count == LEAST else "along x, y, z in turn"
    return _layout(rows, words, match[3], text)


def _on_cone(i: int, count: int) -> tuple[float, ...]:
    """Return the axis of wheel i, as far from z as from x and y in the mean."""
    angle = pi / 4.0 + 2.0 * pi * i / count
    size = sqrt(2.0) * _S
    return (size * cos(angle), size * sin(angle), _S)


def _layout(
    rows: list[tuple[float, ...]], words: str, size: str, text: str
) -> WheelLayout:
    """Return the layout of axes (a row each); fewer than WHEELS leave zero columns."""
    axes = np.zeros((3, max(len(rows), WHEELS)))
    axes[:, : len(rows)] = np.transpose(rows)
    strengths = np.linalg.svd(axes, compute_uv=False)
    if strengths[-1] < FLAT * strengths[0]:
        raise DesatError(
            f"--wheels {text}: the axes lie in a plane or on a line: no wheel turns the craft "
            "about the rest"
        )
    return WheelLayout(axes.tolist(), len(rows), words, size)


def _read_axes(name: str) -> list[tuple[float, ...]]:
    """Read the axes of a csv file as unit vectors."""
    place = f"--wheels {name}"
    names = {x: (f"axis_{x}", f"g{x}") for x in "xyz"}
    rows = read_columns(Path(name), place, dict.fromkeys("xyz", "1"), names)
    if not LEAST <= len(rows) <= MOST_WHEELS:
        raise DesatError(
            f"{place}: {len(rows)} wheels; {LEAST} to {MOST_WHEELS} are taken"
        )
    sizes = [float(np.linalg.norm(row)) for row in rows]
    if min(sizes) == 0.0:
        raise DesatError(f"{place}: row {sizes.index(0.0) + 1} is no axis: 0, 0, 0")
    return [tuple(x / size for x in row) for row, size in zip(rows, sizes, strict=True)]
