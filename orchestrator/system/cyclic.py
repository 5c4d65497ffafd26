"""Compute the cyclic momentum of an orbit, which wheels hold whatever coils do."""

from __future__ import annotations

from collections.abc import Sequence
from math import pi

import numpy as np
from numpy.typing import NDArray

from desat.components.contract.block import Mat33
from desat.components.maths.attitude import matrix
from desat.components.physics import geomagnetic
from desat.components.physics import torques as torques_of
from desat.components.physics.orbit import MU, lvlh_attitude, orbit_plane

Array = NDArray[np.float64]
DIPOLE = 7.75e15  # T m3, of the Earth: mu_0 / (4 pi) times the moment; IGRF-14, 2025


def momentum(
    nadir: bool,
    rate: float,
    inclination: float,
    inertia: Mat33,
    dipole: Sequence[float],
    turned: Array | None = None,
) -> Array:
    """Compute the cyclic momentum over a circular orbit, about its middle.

    It is of residual dipole and gravity gradient alone, in the field of a dipole along
    the Earth's axis. Drag, radiation and the field's tilt are left out.

    Parameters
    ----------
    nadir
        Whether the craft turns with the orbit; otherwise it stays fixed in eci.
    rate
        Mean motion (rad/s).
    inclination
        Inclination (rad).
    inertia
        Moments of inertia (kg m2), body.
    dipole
        Residual dipole (A m2), body.
    turned
        (3, 3) attitude relative to that frame; None: the identity.

    Returns
    -------
    array
        (N, 3) N m s, body.
    """
    to_node, ahead, _ = (np.array(x) for x in orbit_plane(inclination, 0.0))
    u = np.linspace(0.0, 2.0 * pi, 361)[:, None]
    out, along = (
        np.cos(u) * to_node + np.sin(u) * ahead,
        np.cos(u) * ahead - np.sin(u) * to_node,
    )
    radius = (MU / rate**2) ** (1.0 / 3.0)
    beyond = np.eye(3) if turned is None else turned
    turns, torques = [], []
    for r, v in zip((radius * out).tolist(), along.tolist(), strict=True):
        c = (
            beyond @ np.reshape(matrix(lvlh_attitude(r, v)), (3, 3))
            if nadir
            else beyond
        )
        field = geomagnetic.dipole(r, (0.0, 0.0, -DIPOLE))
        x, y, z = (c @ r).tolist()
        gravity = torques_of.gravity_gradient((x, y, z), inertia)
        turns.append(c)
        torques.append(c.T @ (np.cross(dipole, c @ field) + gravity))
    each = np.array(torques)
    step = 2.0 * pi / rate / (len(u) - 1)
    impulse = np.cumsum(
        np.vstack([np.zeros(3), (each[1:] + each[:-1]) * step / 2.0]), axis=0
    )
    cyclic = impulse - u / u[-1] * impulse[-1]
    cyclic -= (cyclic.max(axis=0) + cyclic.min(axis=0)) / 2.0
    return np.asarray(np.einsum("kij,kj->ki", np.array(turns), cyclic))


def fullest(axes: Array, cyclic: Array) -> float:
    """Return the largest momentum (N m s) of a wheel along axes (3, n).

    The momentum is shared with least squares.
    """
    return float(np.abs(cyclic @ np.linalg.pinv(axes).T).max())


def shortfall(
    needs: float, has: float, cause: str = "residual dipole and gravity gradient"
) -> str:
    """Return the text that wheels (N m s) cannot hold the momentum of an orbit."""
    return (
        f"{has * 1e3:.4g} mN m s a wheel; {cause} turn "
        f"{needs * 1e3:.4g} mN m s in and out of the fullest within each orbit, which no rods "
        "prevent"
    )
