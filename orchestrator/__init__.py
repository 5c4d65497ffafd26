"""Run systems of FMUs: scenarios, SSP, check, master, results, command line.

`new`, `scenario`, `check`, `run`, `size`, `bound`, `compare`, `tune`, `draws`, `sweep`,
`cases` (also `campaign`), `fit`, `load`, `export` and `tables` do the same as the
commands, with their options, and return objects; `prepare`, `simulate`, `Options`, `Case` and
`Run` are the parts they use. Their imports are made when they are called. Wrong input
raises `desat.DesatError` with a text of one line for the user.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from os import PathLike
from typing import TYPE_CHECKING, Any, Unpack

from .system.program_values import with_plain_arguments

if TYPE_CHECKING:
    from pathlib import Path

    from pandas import DataFrame  # type: ignore[import-untyped]
    from xarray import Dataset

    from .analyses.coil_bound import CoilBound
    from .analyses.lower_bound import LowerBound
    from .begin.facts import Facts
    from .campaign.sampling import Sampling
    from .campaign.sweep import Sweep
    from .papers.tables import tables
    from .runs.case import Case
    from .runs.prepare import prepare
    from .runs.run import Run, simulate
    from .sizing.dumps import DumpSizing
    from .sizing.result import Sizing
    from .studies.compare import Comparison
    from .studies.faults import FaultTable
    from .studies.ranking import Ranking
    from .studies.tune import Tuned
    from .system.errors import DesatError, RunError
    from .system.options import Options, RunOptions
    from .telemetry.fit import Fit

__all__ = [
    "Case",
    "DesatError",
    "Options",
    "Run",
    "RunError",
    "__version__",
    "bound",
    "campaign",
    "cases",
    "check",
    "compare",
    "draws",
    "export",
    "faults",
    "fit",
    "load",
    "new",
    "prepare",
    "run",
    "scenario",
    "simulate",
    "size",
    "sweep",
    "tables",
    "tune",
]
# modules of public names that are imported at first use
_AT = {
    "Case": "runs.case",
    "prepare": "runs.prepare",
    "Run": "runs.run",
    "simulate": "runs.run",
    "Options": "system.options",
    "DesatError": "system.errors",
    "RunError": "system.errors",
    "tables": "papers.tables",
}


def __dir__() -> list[str]:
    """Return the public names."""
    return sorted(__all__)


def __getattr__(name: str) -> Any:
    """Import a public name that is defined in another module.

    Raises
    ------
    AttributeError
        If there is no such name, or its package is not installed.
    """
    if name == "__version__":
        from importlib.metadata import version

        return version("desat")
    from importlib import import_module

    if name in ("campaign", "export"):  # packages that can be called
        return import_module(f".{name}", __name__)
    if name not in _AT:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    try:
        module = import_module(f".{_AT[name]}", __name__)
    except ModuleNotFoundError as error:
        package = f"{__name__}.{_AT[name].partition('.')[0]}"
        if error.name != package:
            raise
        raise AttributeError(
            f"{__name__}.{name} needs {package}, which is not installed"
        ) from error
    return getattr(module, name)


@with_plain_arguments
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

    Parameters
    ----------
    target
        A scenario's name, a scenario file (.toml), an .ssp, an .ssd or a folder with
        one.
    sets
        "component.variable" -> value in SI: a number, a choice's name, or the elements
        of an array as a list, a tuple, a numpy array or a pandas Series. A mapping has
        the variables of a component: {"manager": {"gain": 2e-3}}.
    stop
        Stop time in seconds, a timedelta, or a text as "6h" or "2 orbits".
    step
        Step in seconds.
    folder
        Folder for manifest and series; None: the series stay in memory.
    **options
        Further fields of `desat.Options`. `sources` maps a component to an FMU, a block
        file or a block class.

    Returns
    -------
    Run
        `run["wheels.h_wheel"]` is a series as a numpy array, `.numbers` a pandas frame
        of the scenario's numbers: title, value, unit, limit, met. `.to_dataframe()` has
        all series, `.data` is an xarray Dataset of them, and `.plot("momentum")` a
        figure. As a mapping `.manifest` is the run's JSON file.

    Raises
    ------
    DesatError
        If the input is wrong. A component that fails ends the run early instead: see
        `.ok` and `.manifest.message`; `.or_raise(name)` raises it as a RunError.

    Examples
    --------
    >>> run = run("nadir_day/day-dipole", {"manager.gain": 2e-3}, stop="0.1 orbit")
    >>> run.ok
    True
    >>> run.numbers.loc["pointing", "unit"]
    'deg'
    >>> run.data["wheels.h_wheel"].dims
    ('time', 'wheel')
    """
    from pathlib import Path

    from .runs.program import options_of
    from .runs.progress import in_notebook
    from .runs.run import execute

    options_given = options_of(stop, step, sets, options)
    return execute(
        str(target),
        options_given,
        None if folder is None else Path(folder),
        in_notebook(),
    )


@with_plain_arguments
def new(
    folder: str | PathLike[str], *, force: bool = False, **facts: Unpack[Facts]
) -> Path:
    """Write a new craft, as `desat new craft` does, and return its folder.

    Parameters
    ----------
    folder
        Folder of the craft.
    force
        Write into a folder that exists.
    **facts
        Options of `desat new craft`: texts as typed, or numbers in SI (`altitude` and
        `sso` in m, `inclination` in rad, `sun` in m, `secular` in N m), lists of numbers
        for `box`, `inertia` and `secular`, a datetime for `epoch`. Values that are not
        given are typical of the craft's class.

    Returns
    -------
    Path
        The folder.

    Raises
    ------
    DesatError
        If the facts are unknown or impossible, or the folder exists and `force` is
        False.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as here:
    ...     craft = new(f"{here}/my12u", size="12U", altitude=400e3, rods=0.2)
    ...     sorted(p.name for p in craft.iterdir())
    ['craft.toml', 'detumbling.toml', 'nominal.toml', 'rollout.toml', 'worst.toml']
    """
    import shlex
    from pathlib import Path

    from .begin.facts import craft_facts, typed_facts
    from .runs.new_craft import write_craft

    typed = typed_facts(facts)
    options = [
        f"--{name.replace('_', '-')}={text}"
        for name, texts in typed.items()
        for text in ([texts] if isinstance(texts, str) else texts)
    ]
    command = shlex.join(["desat", "new", "craft", str(folder), *options])
    write_craft(Path(folder), craft_facts(typed), command, force)
    return Path(folder)


def scenario(target: str | PathLike[str]) -> DataFrame:
    """Return the values of a scenario as merged, as `desat show` prints them.

    Parameters
    ----------
    target
        A scenario's name or file, or a craft's folder.

    Returns
    -------
    DataFrame
        By key: `value`, the file that it is `from`, and the `cell` of the axes.

    Raises
    ------
    DesatError
        If there is no such scenario.

    Examples
    --------
    >>> scenario("nadir_day/day-dipole").loc["stop", "value"]
    86400.0
    """
    from pandas import DataFrame

    from .runs import explain

    return DataFrame(explain.show(str(target))).set_index("key")


@with_plain_arguments
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
    slew_angle: float = 0.0,
    slew_time: float = 0.0,
    tip_off: float | None = None,
    arm: float | None = None,
    specific_impulse: float | None = None,
    **options: Unpack[RunOptions],
) -> Sizing | DumpSizing:
    """Size a craft, as `desat size` does.

    Parameters
    ----------
    target, sets, stop, **options
        As for `run`.
    year
        Size for other days of a year, too.
    laws
        Size for other laws than the craft's own, too.
    flown
        Fly the closed loop with the sizes that count.
    duty
        Duty of the coils (1) for which rods are recommended.
    margin
        Margin of the recommended rods (1).
    slew_angle, slew_time
        Turn (rad) that the wheels make in a time (s); 0: none.
    tip_off
        Rate after separation (rad/s); None: that of detumbling.toml, else 5 deg/s.
    arm, specific_impulse
        Of thrusters (m, s); None: the craft's.

    Returns
    -------
    Sizing or DumpSizing
        A `DumpSizing` for a craft that dumps by thrusters between thresholds, otherwise
        a `Sizing`. Its `answer` is a sentence; `as_json()` returns everything.

    Raises
    ------
    DesatError
        If the craft lacks data that this needs.
    RunError
        If a run does not complete.

    Examples
    --------
    >>> sized = size("nadir_day/day-dipole", stop="2 orbits", year=False, laws=False, flown=False)
    >>> sized.answer
    'nadir_day/day-dipole holds with margins of 95 % of the wheels (a wheel lost, ...'
    """
    from .runs.program import options_of
    from .sizing import dumps, sizing
    from .sizing.requirements import SizingRequirements

    options_given = options_of(stop, None, sets, options)
    requirements = SizingRequirements(
        duty,
        margin,
        slew_angle,
        slew_time,
        tip_off,
        arm,
        specific_impulse,
        laws,
        year,
        flown,
    )
    sized = dumps.size if dumps.is_of(str(target), options_given) else sizing.size
    return sized(str(target), options_given, requirements)


@with_plain_arguments
def fit(
    target: str | PathLike[str],
    log: str | PathLike[str],
    sets: Mapping[str, Any] | None = None,
    *,
    scalar_first: bool = False,
    field_error: float = 100e-9,
    attitude_error: float = 1.745e-3,
    write: bool = False,
    **options: Unpack[RunOptions],
) -> Fit:
    """Fit a craft to telemetry, as `desat fit` does.

    Parameters
    ----------
    target, sets, **options
        As for `run`.
    log
        Its csv, as `desat fit --help` says.
    scalar_first
        Whether the first number of an attitude is the scalar.
    field_error, attitude_error
        Standard deviations of each axis of the field's model (T) and of the attitude
        (rad).
    write
        Write what the log shows into the craft file of the target, a folder.

    Returns
    -------
    Fit
        `.parameters` has value, deviation and what is observed of each.

    Raises
    ------
    DesatError
        If the log is none of the craft, or shows nothing of it; no file is changed.
    """
    from pathlib import Path

    from .runs.program import options_of
    from .telemetry import craft_file
    from .telemetry.target import fit_target

    file = craft_file.craft_file_of(str(target)) if write else None
    options_given = options_of(None, None, sets, options)
    errors = field_error, attitude_error
    result = fit_target(str(target), options_given, Path(log), scalar_first, errors)
    if file is not None:
        craft_file.write_fit(file, result, Path(log).name)
    return result


@with_plain_arguments
def compare(
    *targets: str | PathLike[str] | Run | Sequence[str | PathLike[str] | Run],
    laws: str | Sequence[str] | None = None,
    by: str | None = None,
    sets: Mapping[str, Any] | None = None,
    stop: float | str | None = None,
    step: float | None = None,
    **options: Unpack[RunOptions],
) -> Comparison | Ranking:
    """Compare scenarios, runs and run folders with the first, or the laws of one craft.

    It does what `desat compare` does; scenarios fly now.

    Parameters
    ----------
    *targets
        Scenarios, runs and run folders, or one list of them; with `laws` one craft.
    laws
        "all", names of laws, or files of your own: the craft flies law by law.
    by
        Criteria by which laws are ranked, as "peak,duty".
    sets, stop, step, **options
        As for `run`.

    Returns
    -------
    Comparison or Ranking
        A `Ranking` with `laws`. `.numbers` is a pandas frame.

    Raises
    ------
    DesatError
        If the input is wrong.
    RunError
        If a run does not complete.

    Examples
    --------
    >>> compared = compare("nadir_day/day-dipole", "nadir_day/day-igrf", stop=600.0)
    >>> list(compared.numbers.columns[2:])
    ['nadir_day/day-dipole', 'nadir_day/day-igrf', 'less nadir_day/day-igrf']
    """
    from .runs.program import options_of
    from .runs.run import Run
    from .studies import compare as study
    from .system.errors import DesatError

    options_given = options_of(stop, step, sets, options)
    if len(targets) == 1 and isinstance(targets[0], (list, tuple)):
        targets = tuple(targets[0])
    if laws is None:
        each = [t if isinstance(t, Run) else str(t) for t in targets]
        if by is not None:
            raise DesatError("by: it ranks laws: laws='all'")
        folders = [t for t in each if isinstance(t, str)]
        if len(folders) == len(each) and study.are_campaigns(folders):
            raise DesatError(f"{each[0]}: campaigns are compared by `desat compare`")
        return study.side_by_side(each, options_given)
    names = [str(t) for t in targets]
    from .studies import ranking
    from .studies.criteria import criteria as criteria_of

    if len(names) != 1:
        raise DesatError(f"{' '.join(names)}: laws are flown on one craft")
    law_names = [laws] if isinstance(laws, str) else list(laws)
    own_laws = [x for x in law_names if x.endswith((".py", ".fmu"))]
    known = [x for x in law_names if x not in own_laws]
    criteria = criteria_of(by) if by is not None else ()
    return ranking.choose(names[0], options_given, criteria, known, own_laws)


@with_plain_arguments
def faults(
    *targets: str | PathLike[str],
    names: Sequence[str] = (),
    laws: str | Sequence[str] = (),
    count: int = 40,
    seed: int = 1,
    number: str | None = None,
    limits: Mapping[str, float] | None = None,
    jobs: int = 1,
    more: int = 0,
    tune: str | Mapping[str, str] = "",
    sets: Mapping[str, Any] | None = None,
    stop: float | str | None = None,
    step: float | None = None,
    **options: Unpack[RunOptions],
) -> FaultTable:
    """Fly scenarios under faults that their laws do not know of, as `desat faults` does.

    Parameters
    ----------
    *targets
        Scenarios, each with its own law, or one craft.
    names
        Faults by name; none: all of them.
    laws
        Laws that fly the one craft besides its own, by name, or all.
    count, seed
        Samples of each fault.
    number
        Number whose median is given; None: the first time that the scenario measures,
        else the fill of the fullest wheel.
    limits
        Largest values of numbers, by name; a sample beyond one fails.
    jobs
        Number of processes, as for `draws`.
    more
        Samples of a fault under which the first law is worse than another; 0: `count`.
    tune
        Parameter `component.parameter` that is searched first, without a fault and over
        other samples: of each law that has it, or by the target that has the law.
    sets, stop, step, **options
        As for `run`.

    Returns
    -------
    FaultTable
        `.rows` has the outcomes by fault, `.answer` says under which each law breaks.

    Raises
    ------
    DesatError
        If a target, a fault, a law or a number is unknown.
    RunError
        If a run does not complete.
    """
    from .runs.program import options_of
    from .studies import faults as study

    return study.fly_faults(
        [str(target) for target in targets],
        options_of(stop, step, sets, options),
        study.chosen(names),
        count,
        seed,
        [laws] if isinstance(laws, str) else laws,
        number,
        limits or {},
        jobs,
        more=more,
        free=tune or {},
    )


@with_plain_arguments
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
    """Find the best value of a parameter over random samples, as `desat tune` does.

    The median of a number over `count` samples is minimised, and `unseen` other samples
    test the result.

    Parameters
    ----------
    target
        As for `run`.
    parameter
        The parameter, `component.parameter`.
    number
        Name of the number.
    most
        Maximise the number instead.
    between
        Range of the parameter.
    count
        Number of samples for tuning.
    unseen
        Number of samples that test the result.
    seed
        Seed of the samples.
    jobs
        Number of processes, as for `draws`.
    sets, stop, step, **options
        As for `run`.

    Returns
    -------
    Tuned
        `.best` is the value, `.answer` a sentence.

    Raises
    ------
    DesatError
        If the target, the parameter or the number is unknown.
    RunError
        If a run does not complete.
    """
    from .runs.program import options_of
    from .studies import tune as study

    options_given = options_of(stop, step, sets, options)
    return study.tune(
        str(target),
        parameter,
        number,
        options_given,
        most=most,
        between=between,
        draws=count,
        unseen=unseen,
        seed=seed,
        jobs=jobs,
    )


def load(folder: str | PathLike[str], *, curves: bool = False) -> Run | Dataset:
    """Load the results in a run's or a campaign's folder, also of one that was killed.

    Parameters
    ----------
    folder
        Folder of a run or a campaign.
    curves
        For a campaign: return the envelopes of its curves over `case` and `part`
        instead.

    Returns
    -------
    Run or Dataset
        A `Run`, as from `run`: its `.data` is an xarray Dataset that is read when it is
        used, with `ds["wheels.h_wheel"]` over `time` and `wheel`, vectors over `axis`
        and means over steps over `interval`, and units, frame, description and choices
        as attributes. For a campaign an xarray Dataset: `in.*` and `out.*` over `case`,
        a row each in `ds.to_dataframe()`.

    Raises
    ------
    DesatError
        If the folder is neither.
    """
    from pathlib import Path

    path = Path(folder)
    if (path / "campaign.json").exists():
        from .campaign.dataset import of_campaign

        return of_campaign(path, curves)
    from .runs.run import load_run

    if curves:
        from .system.errors import DesatError

        raise DesatError(f"{folder}: curves: it is no campaign")
    return load_run(path)


@with_plain_arguments
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
    """Run seeded samples of a system's dispersions.

    Sample i of a seed is the same for every `count` and `jobs`.

    Parameters
    ----------
    target, sets, stop, step, **options
        As for `run`.
    count
        Number of samples.
    seed
        Seed of the samples.
    jobs
        Number of processes. With more than one the caller's script needs `if __name__
        == "__main__":`.

    Returns
    -------
    dict
        `draws`: a row for each sample, with status, numbers and sampled values; and
        `summary`: the unit, median, min, max and n of each number.

    Raises
    ------
    DesatError
        If the input is wrong, or the system has no dispersions.
    """
    from .campaign import draws as study
    from .runs.program import options_of
    from .runs.progress import in_notebook

    options_given = options_of(stop, step, sets, options)
    return study.draws(
        str(target), count, seed, options_given, jobs, in_notebook()
    ).to_json()


@with_plain_arguments
def check(
    target: str | PathLike[str],
    sets: Mapping[str, Any] | None = None,
    *,
    stop: float | str | None = None,
    step: float | None = None,
    **options: Unpack[RunOptions],
) -> Case:
    """Find what is wrong with a system before it runs, as `desat check` does.

    Parameters
    ----------
    target, sets, stop, step, **options
        As for `run`.

    Returns
    -------
    Case
        `.problems` and `.warnings` are lists of lines; `.or_raise()` raises the
        problems.

    Raises
    ------
    DesatError
        If the target or an option cannot be read.

    Examples
    --------
    >>> check("nadir_day/day-dipole").problems
    []
    """
    from .runs.checking import check as find
    from .runs.program import options_of

    return find(str(target), options_of(stop, step, sets, options))


@with_plain_arguments
def bound(target: str | PathLike[str] | Run) -> LowerBound | CoilBound:
    """Compute the least effort with which a run could have done, as `desat bound` does.

    Parameters
    ----------
    target
        A scenario, which runs now, a run, or the folder of a run.

    Returns
    -------
    LowerBound or CoilBound
        Of dumping by thrusters the firing time; of momentum management by coils the
        energy for the same peak momentum of a wheel. `as_json()` returns everything.

    Raises
    ------
    DesatError
        If the run has no such bound.
    RunError
        If the run does not complete.
    """
    from .runs.bounds import bound as bound_of
    from .runs.run import Run

    return bound_of(target if isinstance(target, Run) else str(target))[1]


@with_plain_arguments
def sweep(
    target: str | PathLike[str],
    axes: Mapping[str, Sequence[Any]],
    sets: Mapping[str, Any] | None = None,
    *,
    samples: int = 0,
    seed: int = 1,
    jobs: int = 1,
    stop: float | str | None = None,
    step: float | None = None,
    **options: Unpack[RunOptions],
) -> Sweep:
    """Run a system at several values of parameters, as `desat sweep` does.

    Parameters
    ----------
    target, sets, stop, step, **options
        As for `run`.
    axes
        "component.parameter" -> its values in SI; several give every combination.
    samples
        Number of random samples at each combination, whose medians are returned; 0:
        none.
    seed, jobs
        As for `draws`.

    Returns
    -------
    Sweep
        `.numbers` is a pandas frame: a row for each combination.

    Raises
    ------
    DesatError
        If a parameter is unknown, or a value is out of bounds.

    Examples
    --------
    >>> swept = sweep("nadir_day/day-dipole", {"manager.gain": [1e-3, 2e-3]}, stop=60.0)
    >>> swept.numbers["manager.gain"].tolist()
    [0.001, 0.002]
    """
    from .campaign import sweep as study
    from .runs.program import options_of
    from .runs.progress import in_notebook
    from .system.program_values import plain_values

    values = {
        name: list(plain_values({name: list(x)})[name]) for name, x in axes.items()
    }
    options_given = options_of(stop, step, sets, options)
    return study.sweep(
        str(target),
        values,
        options_given,
        jobs,
        in_notebook(),
        draws=samples,
        seed=seed,
    )


@with_plain_arguments
def cases(
    target: str | PathLike[str],
    count: int,
    folder: str | PathLike[str] | None = None,
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
    """Run the missing cases of a campaign, write its report and return its results.

    It does what `desat campaign run` does. The caller's script needs
    `if __name__ == "__main__":`, because processes are started.

    Parameters
    ----------
    target, sets, stop, step, **options
        As for `run`.
    count
        Number of cases.
    folder
        Folder of the campaign, whose cases are not run again; None: that of the
        command, runs/campaign-NAME.
    seed, sampling
        Seed and method of sampling.
    keep
        Cases whose series and report are stored, as the option of the command.
    curves
        Names of plots with percentile curves; None: the first plot.
    limit
        Wall time of a case (s).
    jobs, cluster
        Number of processes, or a Dask cluster, as the options of the command.
    accept_versions
        Continue with other versions than those of the folder.

    Returns
    -------
    Dataset
        The campaign, as from `load`.

    Raises
    ------
    DesatError
        If the input is wrong, or the folder has another campaign.
    """
    from pathlib import Path

    from .campaign import coordinator, report
    from .cli.console import name_of
    from .runs.program import options_of
    from .runs.progress import in_notebook

    options_given = options_of(stop, step, sets, options)
    plan, _ = coordinator.planned(
        str(target),
        count,
        seed=seed,
        sampling=sampling,
        options=options_given,
        curves=curves,
        keep=keep,
        limit=limit,
    )
    path = Path(folder or Path("runs") / f"campaign-{name_of(str(target))}")
    coordinator.run(plan, path, jobs, cluster, in_notebook(), accept_versions)
    report.write(path)
    return load(path)  # type: ignore[return-value]  # a campaign's
