"""Compute the least effort with which a run could have done, for `desat bound`."""

from __future__ import annotations

from pathlib import Path

from ..analyses import coil_bound, lower_bound
from ..analyses.coil_bound import CoilBound
from ..analyses.lower_bound import LowerBound
from ..analyses.manifest import Manifest
from ..system.options import Options
from .prepare import prepare
from .run import load_run, run_or_load


def bound(target: str) -> tuple[Manifest, LowerBound | CoilBound]:
    """Return the bound of a scenario's run, which is made, or of a run folder.

    Of a run that dumps by thrusters it is the firing time; of momentum management by
    coils the energy for the same peak momentum of a wheel.

    Raises
    ------
    DesatError
        If the run has no such bound.
    RunError
        If the run does not complete.
    """
    by_coils = _is_by_coils(target)
    finished = run_or_load(target, None if by_coils else lower_bound)
    with finished.results as results:
        of_run = coil_bound.of_run if by_coils else lower_bound.of_run
        return finished.manifest, of_run(finished.manifest, results)


def _is_by_coils(target: str) -> bool:
    """Return whether the manager of a scenario, .ssp or run folder knows single coils.

    Then it is a law of momentum management by coils.
    """
    if any(
        (Path(target) / name).exists()
        for name in ("manifest.json", "manifest.json.part")
    ):
        with (run := load_run(Path(target))).results:
            return "axes_coil" in run.manifest.values_of("manager")
    system, _ = prepare(target, Options()).or_raise()
    manager = system.components.get("manager")
    return manager is not None and "axes_coil" in manager.interface.arrays
