"""Compute the least effort with which a run could have done, for `desat bound`."""

from __future__ import annotations

from pathlib import Path

from ..analyses import coil_bound, lower_bound
from ..analyses.coil_bound import CoilBound
from ..analyses.lower_bound import LowerBound
from ..analyses.manifest import Manifest
from ..analyses.motion import period_of
from ..engine.recording.results import Results
from ..system.errors import DesatError
from ..system.options import Options, orbits
from .prepare import prepare
from .run import load_run, run_or_load

NEEDED = {"environment", "spacecraft", "wheels", "manager", "torquers"}


def bound(
    target: str, first: float | str | None = None
) -> tuple[Manifest, LowerBound | CoilBound]:
    """Return the bound of a scenario's run, which is made, or of a run folder.

    Of a run that dumps by thrusters it is the firing time; of momentum management by
    coils the energy for the same peak momentum of a wheel from `first` (s, or orbits as
    "2 orbits") on.

    Raises
    ------
    DesatError
        If the run has no such bound, or `first` is given for one of thrusters.
    RunError
        If the run does not complete.
    """
    by_coils = _is_by_coils(target)
    if first is not None and not by_coils:
        raise DesatError(
            f"--from {first}: {target} dumps by thrusters; their firing time counts over "
            "the whole run"
        )
    finished = run_or_load(target, None if by_coils else lower_bound)
    with finished.results as results:
        manifest = finished.manifest
        if not by_coils:
            return manifest, lower_bound.of_run(manifest, results)
        return manifest, coil_bound.of_run(manifest, results, _seconds(first, results))


def _seconds(first: float | str | None, results: Results) -> float | None:
    """Convert a time in orbits, counted from a run's start, to seconds."""
    if not isinstance(first, str):
        return first
    r, v = (results.values(f"environment.{name}")[0] for name in ("r_eci", "v_eci"))
    return float(results.times()[0]) + (orbits(first) or 0.0) * period_of(r, v)


def _is_by_coils(target: str) -> bool:
    """Return whether a scenario, .ssp or run folder manages momentum by coils alone."""
    if any(
        (Path(target) / name).exists()
        for name in ("manifest.json", "manifest.json.part")
    ):
        with (run := load_run(Path(target))).results:
            manifest = run.manifest
            fires = manifest.parts.get(lower_bound.KEY) is not None
            return not fires and manifest.parameters.keys() >= NEEDED
    system, _ = prepare(target, Options()).or_raise()
    return lower_bound.applies(system) is None and system.components.keys() >= NEEDED
