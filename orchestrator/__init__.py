"""Runs systems of FMUs: scenarios, SSP, check, master, results, command line.

`run`, `load`, `draws`, `cases` and `tables` are what programs need of it, and `prepare`,
`simulate`, `Options`, `Case` and `Run` what they are made of; what they import is
imported when they are called. Bad input raises `desat.system.errors.DesatError` with one line for
people.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from os import PathLike
from typing import TYPE_CHECKING, Any, Unpack

if TYPE_CHECKING:
    from xarray import Dataset

    from .campaign.draws import Draws
    from .campaign.sampling import Sampling
    from .papers.comparison import PaperCell
    from .runs.prepare import Case, prepare
    from .runs.run import Run, simulate
    from .sizing.dumps import DumpSizing
    from .sizing.sizing import Sizing
    from .system.options import Options, RunOptions

__all__ = ["Case", "Options", "Run", "cases", "draws", "load", "prepare", "run", "simulate", "size",
           "tables"]  # fmt: skip
_AT = {
    "Case": "runs.prepare", "prepare": "runs.prepare", "Run": "runs.run", "simulate": "runs.run",
    "Options": "system.options",
}  # fmt: skip
"""Where a public name is, which is imported when it is asked for."""


def __getattr__(name: str) -> Any:
    """A public name that is not here."""
    if name not in _AT:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(f".{_AT[name]}", __name__), name)


def run(
    target: str | PathLike[str],
    sets: Mapping[str, Any] | None = None,
    *,
    stop: float | str | None = None,
    step: float | None = None,
    folder: str | PathLike[str] | None = None,
    **options: Unpack[RunOptions],
) -> Run:
    """Run a system and return its manifest and series.

    `target`: a scenario's name, a scenario file (.toml), an .ssp, an .ssd or a folder with one.
    `sets`: "component.variable" -> value in SI: a number, a choice's name, a list (an array, rows
    in lists). `stop`: seconds, or
    "2 orbits"; `step`: seconds. `folder`: where manifest and series are written; None keeps
    the series in memory. `options`: further fields of `desat.Options`.

    `.numbers` is a pandas frame of the scenario's numbers: title, value, unit, limit, met. As a
    mapping `.manifest` is the run's JSON file. `.results.values("component.output")` is an array
    (rows,) or (rows, n), row k at `start + k step`.

    Raises DesatError for wrong input. A component that fails ends the run early: see `.ok`,
    `.manifest.message`; `.or_raise(name)` makes a RunError of that.
    """
    from pathlib import Path

    from .runs.run import execute
    from .system.options import of_program

    given = of_program(stop, step, sets, options)
    return execute(str(target), given, None if folder is None else Path(folder))


def size(
    target: str | PathLike[str],
    sets: Mapping[str, Any] | None = None,
    *,
    stop: float | str | None = None,
    year: bool = True,
    laws: bool = True,
    flown: bool = True,
    duty: float = 0.5,
    margin: float = 1.3,
    **options: Unpack[RunOptions],
) -> Sizing | DumpSizing:
    """Size a craft, as `desat size` does: its `answer` is a sentence, `as_json()` all of it. A
    craft that dumps by thrusters between thresholds gives a `DumpSizing`, any other a `Sizing`.

    `year`: other days of a year, too; `laws`: other laws, too; `flown`: the closed loop beside;
    `duty` (1) and `margin` (1): what rods are recommended for. The rest as for `run`.

    Raises DesatError for a craft without what it takes, RunError where a run does not complete.
    """
    from .sizing import dumps, sizing
    from .system.options import of_program

    given = of_program(stop, None, sets, options)
    wishes = sizing.Wishes(duty, margin, laws=laws, year=year, flown=flown)
    sized = dumps.size if dumps.is_of(str(target), given) else sizing.size
    return sized(str(target), given, wishes)


def load(folder: str | PathLike[str]) -> Dataset:
    """The results in a run's or a campaign's folder, also of one that was killed, as an xarray
    Dataset that is read where it is looked at.

    Of a run: `ds["wheels.h_wheel"]` over `time` (states, at t_k) or `interval` (over [t_k, t_k+1)),
    with units, frame, description and choices as attributes; `ds.attrs` has scenario, epoch,
    versions, numbers and the manifest, as JSON. Of a campaign: `in.*` and `out.*` over `case`, and
    `curve.*` over `case` and `part`.

    Raises DesatError where it is neither.
    """
    from pathlib import Path

    where = Path(folder)
    if (where / "campaign.json").exists():
        from .campaign.dataset import of_campaign

        return of_campaign(where)
    from .report.dataset import of_run

    return of_run(where)


def draws(
    target: str | PathLike[str],
    count: int = 20,
    seed: int = 1,
    sets: Mapping[str, Any] | None = None,
    *,
    stop: float | str | None = None,
    step: float | None = None,
    jobs: int = 1,
    **options: Unpack[RunOptions],
) -> Draws:
    """Run seeded draws of a system's dispersions; arguments as for `run`.

    Returns "draws": a row each with status, numbers and drawn values; and "summary": of each number
    its unit, median, min, max and n. Draw i of a seed is the same whatever `count` and `jobs`,
    processes; with more than one, the caller's script needs `if __name__ == "__main__":`.

    Raises DesatError for wrong input, and where there are no dispersions.
    """
    from .campaign import draws as study
    from .system.options import of_program

    given = of_program(stop, step, sets, options)
    return study.draws(str(target), count, seed, given, jobs)


def cases(
    target: str | PathLike[str],
    count: int,
    folder: str | PathLike[str],
    sets: Mapping[str, Any] | None = None,
    *,
    seed: int = 1,
    sampling: Sampling = "random",
    keep: Sequence[str] = (),
    curves: Sequence[str] | None = None,
    limit: float = 600.0,
    jobs: int = 1,
    cluster: str | None = None,
    stop: float | str | None = None,
    step: float | None = None,
    accept_versions: bool = False,
    **options: Unpack[RunOptions],
) -> Dataset:
    """Make the cases of a campaign that its folder has not yet, and its report; return it as `load`
    does. What `desat campaign run` does: `sets`, `stop`, `step`, `options` as for `run`; `keep`,
    `limit` (s), `cluster`, `accept_versions` as its options; `curves`: plots by name, None the
    first.

    The caller's script needs `if __name__ == "__main__":`, as there are processes. Raises
    DesatError for wrong input, and where the folder has another campaign.
    """
    from pathlib import Path

    from .campaign import coordinator, report
    from .system.options import of_program

    given = of_program(stop, step, sets, options)
    plan, _ = coordinator.planned(
        str(target), count, seed=seed, sampling=sampling, options=given, curves=curves, keep=keep,
        limit=limit,
    )  # fmt: skip
    coordinator.run(plan, Path(folder), jobs, cluster, False, accept_versions)
    report.write(Path(folder))
    return load(folder)


def tables(
    family: str, *, jobs: int = 1, **options: Unpack[RunOptions]
) -> list[PaperCell]:  # fmt: skip
    """Run a family's scenarios and return the cells of its paper's tables: each the paper's value,
    ours, unit and band. Medians of draws are the stored ones. `jobs` as for `draws`; `options`:
    fields of `desat.Options`.

    Raises DesatError for an unknown family, and RunError where a run does not complete.
    """
    from .papers import stored
    from .papers import tables as study
    from .system.options import of_program

    drawn = stored.read(family) if stored.with_draws(family) else None
    return study.rows(family, of_program(None, None, None, options), jobs, drawn)
