"""What a controller wants of wheels beyond what they can: axes about which none that works turns
the craft, and more momentum than they hold."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from desat.components.physics.orbit import EARTH_RADIUS, mean_motion

from ..numbers.derived import matrices
from ..system import cyclic
from ..system.model import Component, System

ROUND = 0.1
"""Up to this eccentricity an orbit is taken for a circle."""
FLAT = 1e-3
"""Axes whose smallest singular value, against the largest, is below this lie in a plane."""


def warnings(system: System) -> Iterator[str]:
    """A line each for wheels that leave an axis out, for what a failure leaves out, and for wheels
    that hold less than an orbit turns in and out of them."""
    yield from _axes(system)
    yield from _capacity(system)


def _capacity(system: System) -> Iterator[str]:
    wheels, craft, guide = (system.roles.get(x) for x in ("wheels", "spacecraft", "guidance"))
    orbit = _orbit(system.roles.get("environment"))
    if wheels is None or craft is None or guide is None or orbit is None:
        return
    if not craft.interface.arrays.keys() >= {"inertia", "residual_dipole_body"}:
        return
    if guide.interface.model not in ("guidance_nadir", "guidance_inertial") or not (
        wheels.interface.arrays.keys() >= {"inertia_wheel", "speed_limit", "axes_wheel"}
    ):
        return
    spin = np.array(wheels.values["inertia_wheel"])
    axes = np.reshape(wheels.values["axes_wheel"], (3, 4))[:, spin > 0.0]
    if not axes.size or _left_out(axes):
        return  # which is said
    has = float(spin[spin > 0.0].min()) * wheels.values["speed_limit"]
    nadir = guide.interface.model == "guidance_nadir"
    q = guide.values["q_bo" if nadir else "q_target_bi"]
    xx, xy, xz, yx, yy, yz, zx, zy, zz = craft.values["inertia"]
    dipole, turned = craft.values["residual_dipole_body"], matrices(np.array([q]))[0]
    brings = cyclic.momentum(nadir, *orbit, (xx, xy, xz, yx, yy, yz, zx, zy, zz),
                             dipole, turned)  # fmt: skip
    if (needs := cyclic.fullest(axes, brings)) > has:
        where = craft.given.get("residual_dipole_body", system.where)
        yield f"{where}: {wheels.name}: {cyclic.shortfall(needs, has)}"


def _orbit(environment: Component | None) -> tuple[float, float] | None:
    """Mean motion (rad/s) and inclination (rad) of an orbit that is nearly circular; None for
    another one."""
    names = environment.interface.signals if environment is not None else {}
    if environment is None or "inclination" not in names:
        return None
    if "eccentricity" in names and environment.values["eccentricity"] > ROUND:
        return None
    inclination = environment.values["inclination"]
    if "mean_motion" in names:
        return environment.values["mean_motion"], inclination
    if "altitude" in names:
        return mean_motion(EARTH_RADIUS + environment.values["altitude"]), inclination
    if "orbit_start" not in names or environment.choice("orbit_start") == "state":
        return None
    return mean_motion(environment.values["semi_major_axis"]), inclination


def _axes(system: System) -> Iterator[str]:
    if not system.by_input["tau_ctrl_body"]:
        return  # nobody wants three axes: a boom, a bias wheel
    for c in system.components.values():
        if c.interface.role != "wheels" or "axes_wheel" not in c.interface.arrays:
            continue
        there = np.array(c.values["inertia_wheel"]) > 0.0
        axes = np.reshape(c.values["axes_wheel"], (3, 4))
        if lost := _left_out(axes[:, there]):
            yield (f"{c.name}: {int(there.sum())} wheels: none turns the craft about {lost}, which "
                   "the controller wants")  # fmt: skip
            continue
        failed, since = c.choice("failed"), c.values["failed_from"]
        if failed != "none" and since < system.stop:
            there[[int(x) - 1 for x in failed.split("+")]] = False
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
    normal = left[:, 2] * np.sign(left[np.argmax(np.abs(left[:, 2])), 2]) + 0.0
    return "(" + ", ".join(f"{x:.3g}" for x in normal) + ")"
