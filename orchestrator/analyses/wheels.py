"""Find axes that the controller commands and about which no working wheel turns."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ..system.model import Component, System
from ..system.wheels import FLAT, axes_of, existing


def warnings(system: System) -> Iterator[str]:
    """Yield a line for each axis without a wheel, from the start or after a failure."""
    yield from _axes(system)


def _axes(system: System) -> Iterator[str]:
    """Yield a line for each set of wheels that leaves out an axis."""
    if not system.by_input["tau_ctrl_body"]:
        return  # no three-axis control: a boom or a bias wheel
    for c in system.components.values():
        if c.interface.role != "wheels" or "axes_wheel" not in c.interface.arrays:
            continue
        there, axes = existing(c.values), axes_of(c.values)
        if missing := _left_out(axes[:, there]):
            yield (
                f"{c.name}: {int(there.sum())} wheels: none of them gives torque about {missing}, which "
                "the controller wants"
            )
            continue
        rest = there.copy()
        failures = _failures(system, c)
        for source, groups, begin in sorted(failures, key=lambda x: x[0].values[x[2]]):
            failed, since = source.choice(groups), source.values[begin]
            if failed == "none" or since >= system.stop:
                continue
            rest[[int(x) - 1 for x in failed.split("+")]] = False
            if missing := _left_out(axes[:, rest]):
                yield (
                    f"{source.origins.get(groups, system.place)}: {source.name}.{groups} = "
                    f"{failed}: from {max(since, system.start):g} s on no wheel gives "
                    f"torque about {missing}, which the controller commands"
                )
                break


def _failures(
    system: System, wheels: Component
) -> Iterator[tuple[Component, str, str]]:
    """Yield who says that wheels fail, in which parameter, and which has the time."""
    yield wheels, "failed", "failed_from"
    for c in system.components.values():
        if "wheels_out" in c.values:
            yield c, "wheels_out", "out_from"


def _left_out(axes: NDArray[np.float64]) -> str:
    """Return the direction that axes (3, n) do not reach as text; empty if none."""
    axes_left, sizes, _ = (
        np.linalg.svd(axes) if axes.size else (np.eye(3), np.zeros(3), None)
    )
    if len(sizes) == 3 and sizes[2] > FLAT * sizes[0]:
        return ""
    if len(sizes) < 2 or sizes[1] <= FLAT * sizes[0]:
        return "two axes"
    normal = (
        axes_left[:, 2] * np.sign(axes_left[np.argmax(np.abs(axes_left[:, 2])), 2])
        + 0.0
    )
    return "(" + ", ".join(f"{x:.3g}" for x in normal) + ")"
