"""The axes about which wheels that work can turn a craft whose controller wants all three."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ..system.model import Component, System
from ..system.parameters import choice_of, number_of

FLAT = 1e-3
"""Axes whose smallest singular value, against the largest, is below this lie in a plane."""


def warnings(system: System) -> Iterator[str]:
    """A line for wheels that leave an axis out, and one for what a failure leaves out."""
    if not any(c.input.partition("[")[0] == "tau_ctrl_body" for c in system.connections):
        return  # nobody wants three axes: a boom, a bias wheel
    for c in system.components.values():
        if c.interface.role != "wheels" or not c.interface.elements("axes_wheel"):
            continue
        there = np.array(_values(c, "inertia_wheel")) > 0.0
        axes = np.reshape(_values(c, "axes_wheel"), (3, 4))
        if lost := _left_out(axes[:, there]):
            yield (f"{c.name}: {int(there.sum())} wheels: none turns the craft about {lost}, which "
                   "the controller wants")  # fmt: skip
            continue
        failed, since = choice_of(c, "failed"), number_of(c, "failed_from")
        if failed.isdecimal() and since < system.stop:
            there[int(failed) - 1] = False
            if lost := _left_out(axes[:, there]):
                where, begin = c.given.get("failed", system.where), max(since, system.start)
                yield (f"{where}: {c.name}.failed = {failed}: from {begin:g} s on no wheel turns "
                       f"the craft about {lost}, which the controller wants")  # fmt: skip


def _left_out(axes: NDArray[np.float64]) -> str:
    """The direction that axes (3, n) do not reach, for people; empty: none."""
    left, sizes, _ = np.linalg.svd(axes) if axes.size else (np.eye(3), np.zeros(3), None)
    if len(sizes) == 3 and sizes[2] > FLAT * sizes[0]:
        return ""
    if len(sizes) < 2 or sizes[1] <= FLAT * sizes[0]:
        return "two axes"
    normal = left[:, 2] * np.sign(left[np.argmax(np.abs(left[:, 2])), 2])
    return "(" + ", ".join(f"{x:.3g}" for x in normal) + ")"


def _values(component: Component, name: str) -> list[float]:
    return [number_of(component, s.name) for s in component.interface.elements(name)]
