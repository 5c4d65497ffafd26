"""Collect the data of the view of orbit and attitude (`templates/scene.js`).

Series are thinned to at most `ROWS` rows and packed as 16-bit integers with a scale,
so that they take less than 100 kB in a page.
"""

from __future__ import annotations

import base64
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from desat.components.blocks.environment_planet import BODIES

from ..analyses.manifest import Manifest
from ..engine.recording.results import Results
from ..figures.craft import DIRECTIONS, pieces
from ..runs.drawings import components_by_role
from ..system.typed import JsonObject
from ..system.wheels import axes_of, capacities

Array = NDArray[np.float64]
ROWS = 1500


def view_of_run(manifest: Manifest, results: Results) -> JsonObject | None:
    """Return the data of the view of a run; None where its attitude is not recorded."""
    roles = components_by_role(manifest)
    values = {
        role: manifest.values_of(name)
        for role, name in roles.items()
        if role in ("spacecraft", "wheels", "torquers", "thrusters")
    }
    sources = sources_of(roles)
    recorded = set(results.names())
    series = {
        name: results.series(source)
        for name, source in sources.items()
        if source in recorded
    }
    if "q" not in series:
        return None
    count = min(map(len, series.values()))
    some = np.arange(count) % max(1, -(-count // ROWS)) == 0
    rows_of = {name: np.asarray(s.at(some), float) for name, s in series.items()}
    return view(np.asarray(results.times()[:count][some], float), rows_of, values)


def sources_of(roles: Mapping[str, str]) -> dict[str, str]:
    """Return which series the view shows, by its name for each.

    Parameters
    ----------
    roles
        Name of the component of each role.
    """
    environment, craft = roles.get("environment", ""), roles.get("spacecraft", "")
    wheels, thrusters = roles.get("wheels"), roles.get("thrusters", "")
    return {
        "r": f"{environment}.r_eci",
        "v": f"{environment}.v_eci",
        "b": f"{environment}.b_eci",
        "sun": f"{environment}.sun_eci",
        "light": f"{environment}.sunlight",
        "q": f"{craft}.q_bi",
        "h": f"{wheels}.h_wheel" if wheels else f"{craft}.h_copy_wheel",
        "fired": f"{thrusters}.on_time_nozzle",
    }


def view(
    times: Array, series: Mapping[str, Array], values: Mapping[str, Mapping[str, Any]]
) -> JsonObject | None:
    """Return the data of the view; None where there is no attitude.

    Parameters
    ----------
    times
        Times (s) of the rows.
    series
        By the names of `sources_of`: position and velocity (rows, 3) m, m/s, field (rows, 3) T, direction
        of the Sun (rows, 3) and attitude (rows, 4), eci; light (rows,); momentum
        (rows, wheels) N m s; time that each nozzle was open so far (rows, nozzles) s.
    values
        Parameters of spacecraft, wheels, torquers and thrusters.
    """
    if "q" not in series or len(series["q"]) < 2:
        return None
    count = min(len(times), *(len(s) for s in series.values()))
    stride = max(1, -(-count // ROWS))
    rows = slice(0, count, stride)
    times = times[:count][rows]
    if len(times) < 2:
        return None
    rows_by_series = {name: s[rows] for name, s in series.items()}
    craft = values.get("spacecraft", {})
    if "h" in rows_by_series:
        wheels = values.get("wheels") or craft
        momenta = rows_by_series["h"]
        largest = capacities(wheels)[: momenta.shape[1]]
        if np.isfinite(largest).all():
            rows_by_series["fill"] = momenta[:, largest > 0.0] / largest[largest > 0.0]
        rows_by_series["h"] = momenta @ axes_of(wheels)[:, : momenta.shape[1]].T
    if "fired" in rows_by_series:  # since the row before
        rows_by_series["fired"] = np.diff(rows_by_series["fired"], axis=0, prepend=0.0)
    for name in ("r", "v"):
        if name in rows_by_series:
            rows_by_series[name] = 1e-3 * rows_by_series[name]  # km, km/s
    return {
        "count": len(times),
        "first": float(times[0]),
        "step": float(times[1] - times[0]),
        "series": {name: _packed(s) for name, s in rows_by_series.items()},
        "colours": DIRECTIONS,
        "body": body_of(craft),
        "craft": [
            p.to_json()
            for p in pieces(
                craft,
                values.get("wheels"),
                values.get("torquers"),
                values.get("thrusters"),
            )
        ],
    }


def body_of(craft: Mapping[str, Any]) -> JsonObject | None:
    """Return name, radius (km) and mu (km3/s2) of the Moon or Mars; None: the Earth."""
    for name, (mu, radius, *_) in zip(("Moon", "Mars"), BODIES, strict=True):
        if craft.get("mu") == mu:
            return {"name": name, "radius": 1e-3 * radius, "mu": 1e-9 * mu}
    return None


def _packed(values: Array) -> JsonObject:
    """Return values as base64 of little-endian 16-bit integers, and their scale."""
    largest = float(np.abs(values).max(initial=0.0, where=np.isfinite(values)))
    scale = largest / 32767.0 if largest > 0.0 else 1.0
    rounded = np.rint(np.nan_to_num(values) / scale).astype("<i2")
    return {"data": base64.b64encode(rounded.tobytes()).decode(), "scale": scale}
