"""Runs systems of FMUs: scenarios, SSP, check, master, results, command line.

`new`, `scenario`, `run`, `size`, `compare`, `tune`, `draws`, `cases`, `load` and
`tables` do what the commands do, with their options, and return objects; `prepare`,
`simulate`, `Options`, `Case` and `Run` are what they are made of. What they import is
imported when they are called. Bad input raises `desat.system.errors.DesatError` with
one line for people.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from os import PathLike
from typing import TYPE_CHECKING, Any, Unpack

if TYPE_CHECKING:
    from pathlib import Path

    from pandas import DataFrame  # type: ignore[import-untyped]
    from xarray import Dataset

    from .begin.facts import Facts
    from .campaign.sampling import Sampling
    from .papers.tables import tables
    from .runs.prepare import Case, prepare
    from .runs.run import Run, simulate
    from .sizing.dumps import DumpSizing
    from .sizing.result import Sizing
    from .studies.compare import Comparison
    from .studies.ranking import Ranking
    from .studies.tune import Tuned
    from .system.options import Options, RunOptions

__all__ = [
    "Case",
    "Options",
    "Run",
    "cases",
    "compare",
    "draws",
    "load",
    "new",
    "prepare",
    "run",
    "scenario",
    "simulate",
    "size",
    "tables",
    "tune",
]
_AT = {
    "Case": "runs.prepare",
    "prepare": "runs.prepare",
    "Run": "runs.run",
    "simulate": "runs.run",
    "Options": "system.options",
    "tables": "papers.tables",
}
"""Where a public name is, which is imported when it is asked for."""


def __dir__() -> list[str]:
    """Return the public names."""
    return sorted(__all__)


def __getattr__(name: str) -> Any:
    """A public name that is not here."""
    if name not in _AT:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    try:
        module = import_module(f".{_AT[name]}", __name__)
    except ModuleNotFoundError as error:
        room = f"{__name__}.{_AT[name].partition('.')[0]}"
        if error.name != room:
            raise
        raise AttributeError(
            f"{__name__}.{name} needs {room}, which is not installed"
        ) from error
    return getattr(module, name)


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

    `target`: a scenario's name, a scenario file (.toml), an .ssp, an .ssd or a folder
    with one. `sets`: "component.variable" -> value in SI: a number, a choice's name, a
    list (an array, rows in lists). `stop`: seconds, or "2 orbits"; `step`: seconds.
    `folder`: where manifest and series are written; None keeps the series in memory.
    `options`: further fields of `desat.Options`.

    `.numbers` is a pandas frame of the scenario's numbers: title, value, unit, limit,
    met; `.data` an xarray Dataset of the series; `.plot("momentum")` a figure. As a
    mapping `.manifest` is the run's JSON file.

    >>> run = run("nadir_day/day-dipole", {"manager.gain": 2e-3}, stop="0.1 orbit")
    >>> run.ok
    True
    >>> run.numbers.loc["pointing", "unit"]
    'deg'
    >>> run.data["wheels.h_wheel"].dims
    ('time', 'wheel')

    Raises DesatError for wrong input. A component that fails ends the run early: see
    `.ok`, `.manifest.message`; `.or_raise(name)` makes a RunError of that.
    """
    from pathlib import Path

    from .runs.progress import in_notebook
    from .runs.run import execute
    from .system.options import of_program

    given = of_program(stop, step, sets, options)
    return execute(
        str(target), given, None if folder is None else Path(folder), in_notebook()
    )


def new(
    folder: str | PathLike[str], *, force: bool = False, **facts: Unpack[Facts]
) -> Path:
    """Begin a craft, as `desat new craft` does, and return its folder; `facts` are its
    options as texts. What is not given is typical of the craft's class.

    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as here:
    ...     craft = new(f"{here}/my12u", size="12U", altitude="400km", rods="0.2")
    ...     sorted(p.name for p in craft.iterdir())
    ['craft.toml', 'detumbling.toml', 'nominal.toml', 'worst.toml']

    Raises DesatError for what cannot be, and for a folder that exists, unless `force`.
    """
    import shlex
    from pathlib import Path

    from .begin.craft import write
    from .begin.facts import CraftFacts, Facts
    from .system.errors import DesatError, nearest

    if unknown := [name for name in facts if name not in Facts.__annotations__]:
        raise DesatError(
            f"{unknown[0]}: no fact of a craft"
            f"{nearest(unknown[0], Facts.__annotations__)}"
        )
    typed = [f"--{name.replace('_', '-')}={value}" for name, value in facts.items()]
    command = shlex.join(["desat", "new", "craft", str(folder), *typed])
    write(Path(folder), CraftFacts(**facts), command, force)
    return Path(folder)


def scenario(target: str | PathLike[str]) -> DataFrame:
    """The values of a scenario as merged, by their keys: `value`, the file that it is
    `from` and the axis' `cell`, as `desat show` prints them.

    >>> scenario("nadir_day/day-dipole").loc["stop", "value"]
    86400.0

    Raises DesatError where there is none.
    """
    from pandas import DataFrame

    from .runs import explain

    return DataFrame(explain.show(str(target))).set_index("key")


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
    """Size a craft, as `desat size` does: its `answer` is a sentence, `as_json()` all
    of it. A craft that dumps by thrusters between thresholds gives a `DumpSizing`, any
    other a `Sizing`.

    `year`: other days of a year, too; `laws`: other laws, too; `flown`: the closed loop
    beside; `duty` (1) and `margin` (1): what rods are recommended for. The rest as for
    `run`.

    >>> sized = size("nadir_day/day-dipole", stop="2 orbits", year=False, laws=False, flown=False)
    >>> sized.answer
    'nadir_day/day-dipole: rods of 0.168 A m2 are recommended: they hold ...'

    Raises DesatError for a craft without what it takes, RunError where a run does not
    complete.
    """
    from .sizing import dumps, sizing
    from .sizing.requirements import SizingRequirements
    from .system.options import of_program

    given = of_program(stop, None, sets, options)
    requirements = SizingRequirements(duty, margin, laws=laws, year=year, flown=flown)
    sized = dumps.size if dumps.is_of(str(target), given) else sizing.size
    return sized(str(target), given, requirements)


def compare(
    *targets: str | PathLike[str],
    laws: str | Sequence[str] | None = None,
    by: str | None = None,
    sets: Mapping[str, Any] | None = None,
    stop: float | str | None = None,
    step: float | None = None,
    **options: Unpack[RunOptions],
) -> Comparison | Ranking:
    """Hold scenarios (flown now) and run folders against the first, as `desat compare`
    does; or, with `laws`, fly one craft law by law: "all", names of laws, or files of
    your own. `by`: what laws are ranked by, "peak,duty". The rest as for `run`.
    `.numbers` is a pandas frame.

    >>> compared = compare("nadir_day/day-dipole", "nadir_day/day-igrf", stop=600.0)
    >>> list(compared.numbers.columns[2:])
    ['nadir_day/day-dipole', 'nadir_day/day-igrf', 'less nadir_day/day-igrf']

    Raises DesatError for wrong input, RunError where a run does not complete.
    """
    from .studies import compare as study
    from .system.errors import DesatError
    from .system.options import of_program

    given, names = of_program(stop, step, sets, options), [str(t) for t in targets]
    if laws is None:
        if by is not None:
            raise DesatError("by: it ranks laws: laws='all'")
        if study.are_campaigns(names):
            raise DesatError(f"{names[0]}: campaigns are compared by `desat compare`")
        return study.side_by_side(names, given)
    from .studies import ranking

    if len(names) != 1:
        raise DesatError(f"{' '.join(names)}: laws are flown on one craft")
    asked = [laws] if isinstance(laws, str) else list(laws)
    own = [x for x in asked if x.endswith((".py", ".fmu"))]
    known = [x for x in asked if x not in own]
    criteria = ranking.criteria(by) if by is not None else ()
    return ranking.choose(names[0], given, criteria, known, own)


def tune(
    target: str | PathLike[str],
    parameter: str,
    number: str,
    *,
    most: bool = False,
    between: tuple[float, float] | None = None,
    count: int = 8,
    unseen: int = 16,
    seed: int = 1,
    jobs: int = 1,
    sets: Mapping[str, Any] | None = None,
    stop: float | str | None = None,
    step: float | None = None,
    **options: Unpack[RunOptions],
) -> Tuned:
    """Find the value of `component.parameter` with the least (`most`: the largest)
    median of a number over `count` samples, judged by `unseen` others, as `desat tune`
    does. `.best` is it, `.answer` a sentence. `jobs` as for `draws`; the rest as for
    `run`.

    Raises DesatError for what there is not, RunError where a run does not complete.
    """
    from .studies import tune as study
    from .system.options import of_program

    given = of_program(stop, step, sets, options)
    return study.tune(
        str(target),
        parameter,
        number,
        given,
        most=most,
        between=between,
        draws=count,
        unseen=unseen,
        seed=seed,
        jobs=jobs,
    )


def load(folder: str | PathLike[str], *, curves: bool = False) -> Dataset:
    """The results in a run's or a campaign's folder, also of one that was killed, as an
    xarray Dataset that is read where it is looked at.

    Of a run: `ds["wheels.h_wheel"]` over `time` and `wheel`, vectors over `axis`, means
    over steps over `interval`, with units, frame, description and choices as
    attributes; `ds.attrs` has scenario, epoch, versions, numbers and the manifest, as
    JSON. Of a campaign: `in.*` and `out.*` over `case`, a row each in
    `ds.to_dataframe()`; `curves`: instead, the envelopes of its curves over `case` and
    `part`.

    Raises DesatError where it is neither.
    """
    from pathlib import Path

    where = Path(folder)
    if (where / "campaign.json").exists():
        from .campaign.dataset import of_campaign

        return of_campaign(where, curves)
    from .runs.run import load_run

    return load_run(where).data


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
) -> dict[str, Any]:
    """Run seeded samples of a system's dispersions; arguments as for `run`.

    Return a dict: `draws`, a row each with status, numbers and sampled values; and
    `summary`, of each number its unit, median, min, max and n. Sample i of a seed is
    the same whatever `count` and `jobs`, processes; with more than one, the caller's
    script needs `if __name__ == "__main__":`.

    Raises DesatError for wrong input, and where there are no dispersions.
    """
    from .campaign import draws as study
    from .runs.progress import in_notebook
    from .system.options import of_program

    given = of_program(stop, step, sets, options)
    return study.draws(str(target), count, seed, given, jobs, in_notebook()).to_json()


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
    """Make the cases of a campaign that its folder has not yet, and its report; return
    it as `load` does. What `desat campaign run` does: `sets`, `stop`, `step`, `options`
    as for `run`; `keep`, `limit` (s), `cluster`, `accept_versions` as its options;
    `curves`: plots by name, None the first.

    The caller's script needs `if __name__ == "__main__":`, as there are processes.
    Raises DesatError for wrong input, and where the folder has another campaign.
    """
    from pathlib import Path

    from .campaign import coordinator, report
    from .runs.progress import in_notebook
    from .system.options import of_program

    given = of_program(stop, step, sets, options)
    plan, _ = coordinator.planned(
        str(target),
        count,
        seed=seed,
        sampling=sampling,
        options=given,
        curves=curves,
        keep=keep,
        limit=limit,
    )
    coordinator.run(plan, Path(folder), jobs, cluster, in_notebook(), accept_versions)
    report.write(Path(folder))
    return load(folder)
