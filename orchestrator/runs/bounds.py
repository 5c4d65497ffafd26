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
from .run import Run, load_run, run_or_load

NEEDED = {"environment", "spacecraft", "wheels", "manager", "torquers"}


def bound(
    target: str | Run, first: float | str | None = None
) -> tuple[Manifest, LowerBound | CoilBound]:
    """Return the bound of a run, of a run folder, or of a scenario, which flies now.

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
    if isinstance(target, Run):
        return _bound_of(target.or_raise(target.manifest.scenario), by_coils, first)
    finished = run_or_load(target, None if by_coils else lower_bound)
    with finished.results:
        return _bound_of(finished, by_coils, first)


def _bound_of(
    run: Run, by_coils: bool, first: float | str | None
) -> tuple[Manifest, LowerBound | CoilBound]:
    """Return the bound of a run, of its coils or of its thrusters."""
    manifest, results = run.manifest, run.results
    if not by_coils:
        return manifest, lower_bound.of_run(manifest, results)
    return manifest, coil_bound.of_run(manifest, results, _seconds(first, results))


def _seconds(first: float | str | None, results: Results) -> float | None:
    """Convert a time in orbits, counted from a run's start, to seconds."""
    if not isinstance(first, str):
        return first
    r, v = (results.values(f"environment.{name}")[0] for name in ("r_eci", "v_eci"))
    return float(results.times()[0]) + (orbits(first) or 0.0) * period_of(r, v)


def _is_by_coils(target: str | Run) -> bool:
    """Return whether a scenario, .ssp, run or its folder manages momentum by coils alone."""
    if isinstance(target, Run):
        manifest = target.manifest
        fires = manifest.parts.get(lower_bound.KEY) is not None
        return not fires and manifest.parameters.keys() >= NEEDED
    if any(
        (Path(target) / name).exists()
        for name in ("manifest.json", "manifest.json.part")
    ):
        with (run := load_run(Path(target))).results:
            return _is_by_coils(run)
    system, _ = prepare(target, Options()).or_raise()
    return lower_bound.applies(system) is None and system.components.keys() >= NEEDED
