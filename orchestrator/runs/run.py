"""Run a system: initialise, step, record, and leave a run folder."""

from __future__ import annotations

import math
import shlex
import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import chdir
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from html import escape
from os import PathLike
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, overload

from numpy.typing import NDArray

from ..analyses import analyses, coverage, not_checked
from ..analyses.manifest import UNKNOWN, Manifest, SubstepChoice
from ..engine import child
from ..engine.checkpoint import FOLDER, Checkpoint, newest, remove
from ..engine.process_state import no_space
from ..engine.recording.recorder import recover
from ..engine.recording.results import MANIFEST, SERIES, Results
from ..engine.recording.row_buffer import Layout, RowBuffer
from ..files import library
from ..language.content import content_of
from ..numbers.shapes import LONG
from ..numbers.text import spell_unit
from ..numbers.verdicts import describe_verdicts, judge
from ..system.errors import DesatError, Exit, RunError, UnknownSeriesError, nearest
from ..system.model import System
from ..system.options import Options, as_arguments, from_json
from ..system.schedule import schedule
from . import stopping, substep_choice
from .case import Case
from .manifest import (
    check_identity,
    end_manifest,
    numbers,
    read_manifest,
    resumed,
    unrecorded,
)
from .prepare import prepare
from .progress import stages
from .step_case import StepOutcome, step
from .validation import kept_every

if TYPE_CHECKING:
    from pandas import DataFrame  # type: ignore[import-untyped]
    from xarray import DataArray, Dataset

    from ..figures.canvas import Figure


Array = NDArray[Any]
SHOWN = 6  # numbers in a run's `repr`

__all__ = [
    "Case",
    "Options",
    "Run",
    "execute",
    "load_run",
    "prepare",
    "run_or_load",
    "simulate",
]


@dataclass(repr=False)
class Run:
    """Finished or stopped run, with its manifest and its series."""

    manifest: Manifest
    results: Results
    signal: int = 0  # signal to stop that came meanwhile; 0: none

    @property
    def ok(self) -> bool:
        """Return whether the run completed, at its stop time or by its `stop_when`."""
        return self.manifest.completed

    @property
    def code(self) -> Exit:
        """Return the exit code that says how the run ended."""
        if self.ok:
            return Exit.UNMET if self.manifest.not_met else Exit.COMPLETED
        if self.manifest.exit is not None:
            return Exit(self.manifest.exit)
        if self.manifest.status == stopping.LATE:
            return Exit.TIMEOUT
        return Exit.COMPONENT

    @property
    def numbers(self) -> DataFrame:
        """Return the scenario's numbers by name as a table.

        Its columns are title, value, unit, limit as text, and whether the limit is met
        (both missing where there is none).
        """
        from pandas import DataFrame

        judged = {v.number: v for v in self.manifest.verdicts.values()}
        rows = {
            name: (
                number.title,
                number.value,
                number.unit,
                judged[name].limits,
                judged[name].met,
            )
            if name in judged
            else (number.title, number.value, number.unit, None, None)
            for name, number in self.manifest.numbers.items()
        }
        columns = ["title", "value", "unit", "limit", "met"]
        frame = DataFrame.from_dict(rows, orient="index", columns=columns)
        return frame.astype({"met": "boolean"})  # so that `~frame.met` is a selection

    @property
    def folder(self) -> Path | None:
        """Return the folder of the run; None: its series are in memory."""
        return self.results.folder

    @property
    def data(self) -> Dataset:
        """Return the series as an xarray Dataset that is read on access.

        For example `run.data["wheels.h_wheel"]` is over `time` and `wheel`, with its
        unit (see `runs/dataset.py`).
        """
        from .dataset import of_results

        return of_results(self.manifest, self.results)

    def __enter__(self) -> Run:
        return self

    def __exit__(self, *error: object) -> None:
        """Close the file of the series."""
        self.results.close()

    def to_xarray(self) -> Dataset:
        """Return the series as `data` does."""
        return self.data

    def keys(self) -> list[str]:
        """Return the names of the series."""
        return list(self)

    def values(self) -> Iterator[DataArray]:
        """Return the series, as `run[name]` has them."""
        return (series for _, series in self.items())

    def items(self) -> Iterator[tuple[str, DataArray]]:
        """Return the series with their names."""
        data = self.data
        return ((name, self._series(data, name)) for name in self)

    def __len__(self) -> int:
        """Return the number of series."""
        return len(self.results.names())

    def __bool__(self) -> bool:
        """Return True, also for a run without series."""
        return True

    def __iter__(self) -> Iterator[str]:
        """Iterate over the names of the series."""
        return iter(self.results.names())

    def __contains__(self, series: object) -> bool:
        """Return whether there is a series of this name."""
        return series == "time" or series in self.results.names()

    @overload
    def __getitem__(self, series: str) -> DataArray: ...
    @overload
    def __getitem__(self, series: list[str]) -> Dataset: ...
    def __getitem__(self, series: str | list[str]) -> DataArray | Dataset:
        """Return a series `component.variable` over time as an xarray DataArray.

        Its elements have labels, and its unit is an attribute (see `data`). A value
        that holds until the next step, and a mean over a step, has a row less than
        there are times. `.values` is the numpy array; `run["time"].values` are the
        times (s). xarray joins by time what is added or compared: changes from row to
        row are `.diff("time")`. Several names give a Dataset.

        Raises
        ------
        UnknownSeriesError
            If there is no such series: a DesatError and a KeyError.
        """
        names = self.results.names()
        for name in [series] if isinstance(series, str) else series:
            if name not in self:
                raise UnknownSeriesError(
                    f"{self.manifest.scenario}: no series {name}{nearest(name, names)}"
                )
        if not isinstance(series, str):
            return self.data[series]
        return self._series(self.data, series)

    def _series(self, data: Dataset, name: str) -> DataArray:
        """Return a series of the data set without the row that holds no value."""
        array = data[name]
        rows = array if name == "time" else array[: self.results.count(name)]
        return rows.load().copy()  # which its user may write to

    def to_dataframe(self) -> DataFrame:
        """Return all series as a table over `time [s]`.

        It has the columns of the parquet file: for each element `component.variable[i]
        [unit]`. Means over steps stand at the step's beginning, so the last row has
        none.
        """
        from .table import table_of

        table, _ = table_of(self.results, with_last=True)
        return table.to_pandas().set_index("time [s]")

    def write_report(self, folder: str | PathLike[str] | None = None) -> Path:
        """Write report.html and return its path.

        It goes into `folder`, or into the run's own.

        Raises
        ------
        DesatError
            If neither is there.
        """
        from importlib import import_module

        place = self.results.folder if folder is None else Path(folder)
        if place is None:
            raise DesatError(
                "folder: the run's series are in memory: the folder to write to is needed"
            )
        place.mkdir(parents=True, exist_ok=True)
        # by name: the report is made of runs, and so lies above them
        report = import_module(".report.report", __package__.rpartition(".")[0])
        path: Path = report.write_report(place, self)
        return path

    def plot(
        self, name: str | None = None, file: str | PathLike[str] | None = None
    ) -> Figure:
        """Draw a plot of the scenario by name, or a series by its `component.output`.

        None is the first plot. A notebook shows the figure. With `file` (.svg, .png,
        .pdf) it is written, too.

        Raises
        ------
        DesatError
            If there is no such plot or series.
        """
        from ..figures.plots import of_name

        runs = [(self.manifest.scenario, self.results, self.manifest.parameters)]
        figure = of_name(name, self.manifest.content.plots, runs)
        if file is not None:
            from ..figures.painting import save

            save(figure, Path(file))
        return figure

    def __repr__(self) -> str:
        manifest = self.manifest
        number_texts = [
            f"{n}={x.value:.4g} {spell_unit(x.unit)}".rstrip()
            for n, x in list(manifest.numbers.items())[:SHOWN]
            if x.value is not None
        ]
        more = [f"{len(manifest.not_met)} not met"] if manifest.not_met else []
        return f"<Run {manifest.scenario}: {', '.join([manifest.status, *number_texts, *more])}>"

    def _repr_html_(self) -> str:
        from ..figures.canvas import in_notebook

        manifest = self.manifest
        answer = describe_verdicts(manifest.verdicts, len(manifest.unmet))
        try:
            figure = in_notebook(self.plot())
        except DesatError:  # what it shows is not recorded
            figure = ""
        table = self.numbers.to_html(na_rep="")
        return f"<p>{escape(repr(self))}</p><p>{escape(answer)}</p>{figure}{table}"

    def or_raise(self, target: str) -> Run:
        """Return the run if it completed; raise RunError, with the target, if not."""
        if self.ok:
            return self
        manifest = self.manifest
        raise RunError(f"{target}: {manifest.status}: {manifest.message}", self.code)


def execute(
    target: str, options: Options, folder: Path | None = None, progress: bool = False
) -> Run:
    """Prepare and run a scenario, an .ssp or a folder.

    Raises
    ------
    DesatError
        If the run cannot begin.
    """
    return simulate(prepare(target, options), folder, progress, partial=True)


def simulate(
    case: Case,
    folder: Path | None = None,
    progress: bool = False,
    checkpoint: Checkpoint | None = None,
    choice: SubstepChoice | None = None,
    partial: bool = False,
) -> Run:
    """Run a prepared case; with `folder` None the series stay in memory.

    With `partial` a run that a signal ends is returned as any other. Otherwise the
    signal ends the study that the run belongs to, by an exception.

    `choice` is that of the substeps with which the run begins; None: it chooses itself.
    With `checkpoint` the run continues from there, in the folder of the run that was
    ended (`resume`).

    A component that fails, a signal to stop and the time limits end the run early: the
    rows recorded until then are kept, and the manifest's status says which it was. A
    run that ends by its scenario's `stop_when` is completed, and the manifest's
    `stopped_when` says when. With `case.options.supervised` it runs in a process of its
    own, which a component may end (`engine/child.py`).

    Raises
    ------
    DesatError
        If the run cannot begin.
    RunError
        If there is no room for it.
    KeyboardInterrupt, SystemExit
        If a signal stops it before it has begun, or it is not `partial`.
    """
    system, _ = case.or_raise()
    if checkpoint is None and choice is None:
        choice = substep_choice.choose(case.target, system, case.options)
    if checkpoint is not None:
        choice = Manifest.from_json(checkpoint.about["manifest"]).substep_choice
    for attempts_left in reversed(range(substep_choice.AGAIN)):
        run = _simulate(_with_inner(case, choice), choice, folder, progress, checkpoint)
        if run.signal and not partial:
            run.results.close()
            child.raise_stop(run.signal)
        if choice is None or not run.ok:
            break
        more = substep_choice.choose_again(
            case.target, system, case.options, choice, run.results
        )
        if more is None:
            break
        if more.substeps == choice.substeps or not attempts_left:
            _tell(run, more, folder)
            break
        run.results.close()
        if folder is not None:
            remove(folder)
        choice, checkpoint = more, None
    if run.ok:
        with stages(progress and system.steps > LONG) as tell:
            tell("rows that its file keeps")
            _thin(run, kept_every(system, case.options), case.options.every == 1)
    return run


def _thin(run: Run, every: int, extremes: bool) -> None:
    """Keep one row of so many of a run, whose numbers are those of all rows.

    With `extremes` plots show what its series do between them.
    """
    if every == 1:
        return
    if extremes:
        from ..figures.plots import keep_derived_lines  # slow import

        plots = run.manifest.content.plots
        keep_derived_lines(plots, run.results, run.manifest.parameters)
    run.results.thin(every, extremes)


def _with_inner(case: Case, choice: SubstepChoice | None) -> Case:
    """Return the case with the chosen number of substeps."""
    if choice is None or case.system is None:
        return case
    system = replace(case.system, substeps=choice.substeps)
    order = schedule(system, case.options.breaks_loops)
    return replace(case, system=system, schedule=order, manifest=None)


def _tell(run: Run, choice: SubstepChoice, folder: Path | None) -> None:
    """Add the result of a second substep choice to a run's manifest."""
    choice_made = run.manifest.substep_choice
    choice = replace(choice, switches=choice_made.switches if choice_made else {})
    manifest = replace(run.manifest, substep_choice=choice)
    manifest = replace(
        manifest,
        numbers={**manifest.numbers, **coverage.numbers(manifest, run.results)},
    )
    if choice.substeps != manifest.substeps:
        line = (
            f"made {substep_choice.AGAIN} times, it would want {choice.substeps} substeps "
            f"still: {choice.again[-1]}"
        )
        manifest = replace(manifest, warnings=[*manifest.warnings, line])
    run.manifest = manifest
    if folder is not None:
        end_manifest(folder, run.manifest)


def _simulate(
    case: Case,
    choice: SubstepChoice | None,
    folder: Path | None,
    progress: bool,
    checkpoint: Checkpoint | None,
) -> Run:
    """Run a case whose number of substeps is known."""
    system, _ = case.or_raise()
    options, clock = case.options, time.perf_counter()
    began = datetime.now(UTC)
    warned = list(case.warnings)
    if choice is not None and choice.estimate is None:
        warned += coverage.warnings(system)
    slow = None
    if checkpoint is None and (slow := substep_choice.decimated(system, options)):
        warned.append(
            f"{slow.of}: slower than the step (step_ratio): the attitude errs by about "
            f"{slow.attitude:.1e} rad and a wheel's momentum by {slow.momentum:.1e} N m s, "
            f"until {slow.until:g} s"
        )
    manifest = replace(
        Manifest.of(system, options, case.target)
        if case.manifest is None
        else case.manifest,
        substep_choice=choice,
        decimated=slow,
        started=began.isoformat(timespec="seconds"),
        steps=system.steps,
        warnings=warned,
    )
    if checkpoint is not None:
        again = f"desat run {shlex.quote(case.target)}{as_arguments(options)}"
        manifest = resumed(manifest, checkpoint.about["manifest"], str(folder), again)
    if folder is not None:
        folder = folder.absolute()  # a component may change the working directory
    elif options.checkpoint is not None:
        raise DesatError("checkpoints need a run folder")
    if options.supervised and child.CAN:
        outcome, results = _simulate_apart(case, folder, manifest, progress, checkpoint)
    else:
        outcome, results = step(case, folder, manifest, progress, checkpoint)
    if choice is not None:
        choice = replace(choice, switches=substep_choice.switches(system, results))
    run = Run(
        replace(
            manifest,
            substep_choice=choice,
            warnings=[*manifest.warnings, *outcome.warnings],
            status=outcome.status,
            message=outcome.message,
            steps_done=outcome.steps,
            end_time=system.start + outcome.steps * system.step,
            stopped_when=outcome.stopped,
            loop=outcome.loop,
            wall_seconds=round(time.perf_counter() - clock, 6),
            us_per_step=round(1e6 * outcome.seconds / max(outcome.steps, 1), 3),
            balance=outcome.balance,
            rows=outcome.rows,
            exit=int(outcome.code) or None,
        ),
        results,
        outcome.signal,
    )
    try:
        with stages(progress and system.steps > LONG) as tell:
            tell("its numbers")
            _measure(run, system)
    finally:  # the manifest is kept whatever fails in there
        if folder is not None:
            end_manifest(folder, run.manifest)
    return run


def _measure(run: Run, system: System) -> None:
    """Add numbers, verdicts and unmet conditions of a run to its manifest."""
    manifest, results = run.manifest, run.results
    if not len(results.times()):
        return
    content = content_of(system.about)
    manifest = run.manifest = replace(
        manifest,
        numbers=numbers(content, results, manifest.parameters),
        not_checked=unrecorded(content, results),
    )
    for analysis in analyses():
        if manifest.parts.get(analysis.KEY) is not None:
            manifest = replace(
                manifest,
                numbers={**manifest.numbers, **analysis.numbers(manifest, results)},
            )
            manifest = run.manifest = replace(
                manifest,
                unmet=[*manifest.unmet, *analysis.unmet(manifest, results)],
                warnings=[*manifest.warnings, *analysis.remarks(manifest, results)],
                not_checked={
                    **manifest.not_checked,
                    **analysis.unchecked(manifest, results),
                },
            )
    if manifest.completed:
        verdicts, unjudged = judge(
            content, manifest.numbers, system.start, manifest.end_time or system.start
        )
        manifest = replace(
            manifest,
            verdicts=verdicts,
            not_checked={**unjudged, **manifest.not_checked},
        )
    lines = dict.fromkeys([*manifest.warnings, *not_checked(manifest.not_checked)])
    run.manifest = replace(manifest, warnings=list(lines))


def _simulate_apart(
    case: Case,
    folder: Path | None,
    manifest: Manifest,
    progress: bool,
    checkpoint: Checkpoint | None = None,
) -> tuple[StepOutcome, Results]:
    """Run a case in a process of its own, and return how it ended and its rows.

    If the process was ended early, the rows until then are returned.
    """
    system, schedule = case.or_raise()
    options, unwritten = case.options, RowBuffer.shared()
    place = folder or library.scratch("run")
    library.unpack(system)

    def work(tell: Callable[[str, Any], None], unwritten: RowBuffer) -> None:
        """Step the case in the child process."""
        step(case, place, manifest, progress, checkpoint, unwritten, tell)

    limit = min(options.call_limit, options.time_limit or math.inf)
    try:
        ended = child.watch(work, schedule.order, unwritten, limit)
        layout, outcome = child.layout_of(ended), ended.reports.get("outcome")
        full = no_space(ended.reports.get("bug", ""))
        _raise_error_of(ended, layout is None or outcome is not None)
        if outcome is None and not full:
            _raise_bug_of(ended)
        if outcome is not None:
            outcome.signal = outcome.signal or ended.signal
            if ended.exit_text:  # all is recorded: it ended while a component was freed
                outcome.status, outcome.message = (
                    "failed",
                    f"{ended.text()}, after the run",
                )
            return outcome, Results.open(place)
        if layout is None:
            child.stopped(ended)
        if layout is None and full:
            raise RunError(f"{place}: {full}", Exit.SPACE)
        if layout is None:
            raise RunError(ended.text(), Exit.TIMEOUT if ended.hung else Exit.COMPONENT)
        return _cut_short(system, options, place, ended, layout, unwritten, full)
    finally:
        unwritten.close()
        if folder is None:  # open series stay readable until they are closed
            shutil.rmtree(place, ignore_errors=True)


def _raise_error_of(ended: child.Ended, is_final: bool) -> None:
    """Raise the error that the child process has reported, where it is final."""
    if "error" in ended.reports and is_final:
        kind, arguments = ended.reports["error"]
        raise kind(*arguments)


def _raise_bug_of(ended: child.Ended) -> None:
    """Raise the unexpected exception that the child process has reported."""
    if "system" in ended.reports:
        raise OSError(*ended.reports["system"])
    if "bug" in ended.reports and not ended.signal:
        raise RuntimeError(ended.reports["bug"])


def _cut_short(
    system: System,
    options: Options,
    place: Path,
    ended: child.Ended,
    layout: Layout,
    unwritten: RowBuffer,
    full: str,
) -> tuple[StepOutcome, Results]:
    """Reconstruct the outcome and rows of a run whose process could not report them."""
    outcome = StepOutcome("failed", ended.text(), Exit.COMPONENT)
    if "error" in ended.reports:  # an error while it recorded
        outcome.message = str(ended.reports["error"][1][0])
    if full:
        outcome = StepOutcome("no space", f"{place / SERIES}: {full}", Exit.SPACE)
    elif ended.signal:
        outcome = StepOutcome("interrupted", "stopped by the user", 128 + ended.signal)
        outcome.signal = ended.signal
    elif ended.hung:
        outcome = StepOutcome(stopping.LATE, ended.text(), Exit.TIMEOUT)
    part, path = place / f"{SERIES}.part", place / SERIES
    unwritten.lay_out(layout)
    if full:  # there is no space for a copy either: read the part as it is
        outcome.rows = unwritten.written
        results = Results.open(part, outcome.rows)
    elif path.exists() and not part.exists():  # it ended after all was recorded
        results = Results.open(path)
    else:
        recover(part, path, layout, unwritten)
        results = Results.open(path)
    times, rows = results.times(), len(results.times())
    outcome.steps = round((times[-1] - system.start) / system.step) if len(times) else 0
    outcome.message += f"; {rows} rows are kept"
    return outcome, results


def load_run(folder: Path) -> Run:
    """Load a run from its folder; raise DesatError where there is none."""
    manifest = read_manifest(folder)
    if manifest.message is None:
        manifest = replace(
            manifest,
            message="",
            steps_done=UNKNOWN,
            us_per_step=UNKNOWN,
            wall_seconds=UNKNOWN,
        )
    if manifest.status == "running":
        manifest = replace(manifest, status="killed (or still running)")
    results = Results.open(folder)
    try:
        check_identity(folder, manifest, results)
    except DesatError:
        results.close()
        raise
    return Run(manifest, results)


def run_or_load(target: str, analysis: ModuleType | None = None) -> Run:
    """Load the run of a run folder, or run a scenario, .ssp or folder now.

    Raises
    ------
    RunError
        If the run does not complete.
    DesatError
        If `analysis` does not apply to the system, before the run begins.
    """
    folder = Path(target)
    if any((folder / f"{MANIFEST}{end}").exists() for end in ("", ".part")):
        return load_run(folder)
    case = prepare(target, Options())
    if analysis is not None and analysis.applies(case.or_raise()[0]) is None:
        raise DesatError(analysis.NOT_APPLICABLE.format(target))
    return simulate(case).or_raise(target)


# --- Continuing a run -----------------------------------------------------------------
#
# A run continues from its newest checkpoint with the same bits as without a break:
# series, numbers and manifest are those of an uninterrupted run, except for wall times.


def has_checkpoints(folder: Path) -> bool:
    """Return whether a run folder has checkpoints to continue from."""
    return (folder / FOLDER).is_dir()


def options_of(folder: Path) -> Options:
    """Return the options of a run with checkpoints; raise DesatError without one."""
    return from_json(_newest(folder).about)


def _newest(folder: Path) -> Checkpoint:
    """Return the newest checkpoint; raise DesatError where there is none."""
    if (checkpoint := newest(folder)) is None:
        if (folder / MANIFEST).exists() and read_manifest(folder).completed:
            raise DesatError(f"{folder}: it has completed")
        raise DesatError(
            f"{folder}: it has no checkpoint; `desat run --checkpoint` writes them"
        )
    return checkpoint


def resume(folder: Path, progress: bool = False) -> Run:
    """Continue a run in its folder, an absolute path; load one that has completed.

    Raises
    ------
    DesatError
        If there is no checkpoint, or what the run was made of has changed.
    """
    if (folder / MANIFEST).exists():
        run = load_run(folder)
        if run.ok:
            return run
        run.results.close()
    checkpoint = _newest(folder)
    target, options = checkpoint.about["target"], from_json(checkpoint.about)
    try:
        with chdir(checkpoint.about["from"]):
            case = prepare(target, options)
            return simulate(case, folder, progress, checkpoint, partial=True)
    except OSError as error:
        if error.filename == checkpoint.about["from"]:
            raise DesatError(
                f"{error.filename}: {error.strerror}: the run began there"
            ) from error
        raise
