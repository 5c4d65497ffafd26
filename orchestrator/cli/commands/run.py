"""Define `desat run NAME`."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from importlib import import_module
from math import pi
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ...files import io
from ...system import choices
from ...system.errors import DesatError, Exit, RunError
from ...system.quantity import Quantity
from .. import options as o
from ..console import (
    Sections,
    app,
    err,
    example,
    name_of,
    out,
    print_json,
    print_table,
    to_print,
    warn,
)

if TYPE_CHECKING:
    from ...analyses.manifest import Manifest
    from ...runs.run import Case, Options, Run

BASELINE = "baseline"  # folder of the baseline's run in a run folder


@app.command(
    cls=Sections, epilog=example("desat run my12u --stop 6h --set manager.gain=0.002")
)
def run(
    target: o.Target,
    sets: o.Sets = None,
    sources: o.Sources = None,
    stop: o.Stop = None,
    step: o.Step = None,
    substeps: o.Substeps = None,
    accuracy: o.Accuracy = None,
    algorithm: o.Alg = "gauss_seidel",
    blocks: o.Blocks = False,
    fmus: o.Fmus = "native",
    design: o.DesignOption = None,
    folder: Annotated[
        Path | None,
        typer.Option("--out", help="Run folder (default: a new one under runs/)."),
    ] = None,
    record: Annotated[
        list[str] | None,
        typer.Option(
            help="Record only outputs that fit, as 'manager.*'. May be repeated."
        ),
    ] = None,
    every: Annotated[
        int | None,
        typer.Option(
            help="Keep the rows of every n-th step; numbers are made of all. Default: 1; "
            "of more than a million steps 100,000 rows with minimum, maximum and mean.",
            min=1,
        ),
    ] = None,
    csv: Annotated[bool, typer.Option("--csv", help="Write series.csv too.")] = False,
    baseline: Annotated[
        bool, typer.Option(help="Also run the scenario's baseline, and show it beside.")
    ] = True,
    classes: o.Classes = None,
    solve_loops: o.SolveLoops = False,
    time_limit: o.TimeLimit = None,
    loop: o.LoopOption = "compiled",
    call_limit: Annotated[
        float,
        o.number(
            Quantity("--call-limit", "s", 0.1, o.LONGEST),
            "SECONDS",
            "Wall time that one call of a component may take; the command then ends with 5.",
        ),
    ] = 300.0,
    isolate: Annotated[
        choices.Isolate,
        typer.Option(
            help="FMUs that run in a process each, so that one that crashes or hangs ends "
            "no other: those that are not ours, all, or none."
        ),
    ] = "foreign",
    trust: o.Trust = None,
    strict: o.Strict = False,
    outside: o.Outside = False,
    halve: Annotated[
        int,
        typer.Option(
            metavar="TIMES",
            min=0,
            max=20,
            help="A step that a foreign FMU discards is made anew in 2, 4, ... parts, so "
            "many times at most.",
        ),
    ] = 0,
    checkpoint: Annotated[
        float | None,
        o.number(
            Quantity("--checkpoint", "s"),
            "SECONDS",
            "Save the run each time so many simulated seconds are over: `desat resume RUN` "
            "goes on from there.",
        ),
    ] = None,
    everything: o.Everything = False,
    as_json: o.Json = False,
) -> None:
    """Run a scenario and write a run folder: series, manifest, report."""
    from ...runs.run import prepare, simulate
    from ...runs.validation import check_disk, describe_size

    if csv:
        import_module("pyarrow")  # before the flight
    options = o.options_of(
        sets,
        stop,
        step,
        algorithm,
        blocks,
        classes,
        sources,
        record=tuple(record or ("*",)),
        every=every or 1,
        shortens=every is None and not record,
        design=design,
        substeps=substeps,
        accuracy=accuracy,
        time_limit=time_limit,
        loop=loop,
        fmus=fmus,
        trust=trust,
        strict=strict,
        outside=outside,
        supervised=True,
        call_limit=call_limit,
        checkpoint=checkpoint,
        halvings=halve,
        solve_loops=solve_loops,
        isolate=isolate,
    )
    _free(folder)
    case = prepare(target, options)
    case.or_raise()
    with _run_folder(target, folder) as place:
        if short := check_disk(case.or_raise()[0], options, place.absolute()):
            case.warnings.append(short)
        warn(case.warnings)
        for line in [] if as_json else describe_size(case.or_raise()[0], options):
            err.print(f"note: {line}")
        finished = simulate(case, place, progress=not as_json, partial=True)
        _tell_isolation(case, finished, as_json)
        warn(finished.manifest.warnings[len(case.warnings) :])
        conclude(
            finished,
            options,
            place,
            csv=csv,
            baseline=baseline,
            everything=everything,
            as_json=as_json,
        )


def _tell_isolation(case: Case, finished: Run, as_json: bool) -> None:
    """Print which FMUs ran in processes of their own, and the cost of that a step."""
    from ...engine.instances.isolated import cost_of_a_turn
    from ...runs.isolation import isolated_in

    system, _ = case.or_raise()
    if as_json or not (names := sorted(isolated_in(system, case.options))):
        return
    turns = finished.manifest.substeps or 1
    micros = 1e6 * cost_of_a_turn() * len(names) * turns
    each = "a process of its own" if len(names) == 1 else "processes of their own"
    err.print(
        f"note: {', '.join(names)}: in {each}, which costs about {micros:.3g} us of "
        f"{finished.manifest.us_per_step} us a step; --isolate none saves that, and a crash "
        "of such an FMU then ends the run"
    )


def conclude(
    finished: Run,
    options: Options,
    folder: Path,
    *,
    csv: bool,
    baseline: bool,
    everything: bool,
    as_json: bool,
) -> None:
    """Run the baseline, write the report, print the results and exit with the code."""
    from ...engine import checkpoint

    other = (
        _run_baseline(finished, options, folder) if baseline and finished.ok else None
    )
    page = _report(finished, other, folder)
    if csv:
        _csv(finished, folder)
    if finished.ok and (other is None or other.ok):
        checkpoint.remove(folder)
        checkpoint.remove(folder / BASELINE)
    _report_run(finished, other, folder, page, everything, as_json)
    if code := finished.code or (other.code if other else 0):
        raise typer.Exit(code)


def _report(finished: Run, other: Run | None, folder: Path) -> Path | None:
    """Write the report and return its path.

    None where the disk has no room for that of a run that failed.
    """
    from ...report import report as report_module
    from ...runs.progress import stages

    with skip_if_disk_full(finished, folder, "report"), stages() as tell:
        tell("its report")
        return report_module.write_report(folder, finished, other)
    return None


def _csv(finished: Run, folder: Path) -> None:
    """Write the series as CSV, too."""
    from ...export.series import export

    with skip_if_disk_full(finished, folder, "series.csv"):
        _, note = export(folder, "csv")
        if note:
            err.print(f"note: series.csv: {note}")


@contextmanager
def skip_if_disk_full(finished: Run, folder: Path, output: str) -> Iterator[None]:
    """Omit an output for which the disk has no room, with a warning.

    This applies to a run that failed. For one that did not, RunError is raised.
    """
    from ...engine.process_state import no_space

    try:
        yield
    except OSError as error:
        if not (full := no_space(f"[Errno {error.errno}]")):
            raise
        if finished.ok:
            raise RunError(f"{folder}: its {output}: {full}", Exit.SPACE) from error
        warn([f"{folder}: it has no {output}: {full}"])


def _free(folder: Path | None) -> None:
    """Raise DesatError for a folder that is not empty."""
    if (
        folder is not None
        and folder.exists()
        and (not folder.is_dir() or any(p.name != io.LOCK for p in folder.iterdir()))
    ):
        raise DesatError(
            f"--out {folder}: it exists already and is not an empty folder"
        )


@contextmanager
def _run_folder(target: str, folder: Path | None) -> Iterator[Path]:
    """Claim a folder for this run alone; without `folder` a new one under runs/."""
    place = folder or _new_folder(name_of(target))
    with io.claimed(place, is_new=folder is None):
        _free(place)
        yield place


def _new_folder(name: str) -> Path:
    """Make a new folder under runs/."""
    for count in itertools.count(1):
        folder = Path("runs") / (name if count == 1 else f"{name}-{count}")
        folder.parent.mkdir(exist_ok=True)
        try:
            folder.mkdir()
            break
        except FileExistsError:
            continue
    return folder


def _run_baseline(finished: Run, options: Options, folder: Path) -> Run | None:
    """Run the baseline that the scenario names, into a folder beside, and compare."""
    from ...files.scenario import of_its_file
    from ...runs.manifest import end_manifest, related_to
    from ...runs.run import execute, has_checkpoints, resume

    about = finished.manifest.about
    name = about.get("name", "").partition("/")[0] + "/" + about.get("baseline", "")
    if not about.get("baseline") or name == about["name"] or of_its_file(name) is None:
        return None
    baseline_folder = folder / BASELINE
    if has_checkpoints(baseline_folder):
        other = resume(baseline_folder.absolute())
    else:
        other = execute(
            name, replace(options, sets=[], sources=[], design=None), baseline_folder
        )
    finished.manifest = related_to(
        finished.manifest, {about["baseline"]: other.manifest}
    )
    end_manifest(folder, finished.manifest)
    return other


def substeps_line(manifest: Manifest) -> str:
    """Return the line on the chosen substeps and their error, "" where none are chosen."""
    choice = manifest.substep_choice
    if choice is None:
        return ""
    count = f"{choice.substeps} substep{'s' * (choice.substeps != 1)} a step"
    if choice.estimate is None:
        return f"{count}: {choice.why}; the error is not estimated"
    if choice.why:
        return (
            f"{count}: the attitude errs by more than the accuracy of "
            f"{choice.accuracy:g} rad, by up to {min(choice.estimate, pi):.1e} rad "
            f"(estimated): {choice.why}"
        )
    line = (
        f"{count}: the attitude errs by {choice.estimate:.1e} rad at most (estimated; "
        f"accuracy {choice.accuracy:g} rad)"
    )
    for name, times in choice.switches.items():
        line += (
            f"; {name} changes {times} times, and a change at another sample would alter "
            "more than that"
        )
    return line


def _report_run(
    finished: Run,
    other: Run | None,
    folder: Path,
    page: Path | None,
    everything: bool,
    as_json: bool,
) -> None:
    """Print the results of a run."""
    from ...engine.recording.results import SERIES
    from ...numbers.verdicts import describe_verdicts
    from ...report.cases import find_cases
    from ...report.run_tables import tabulate_numbers
    from ...runs.validation import describe_kept

    manifest, thinning = finished.manifest, describe_kept(finished.results)
    if as_json:
        print_json(
            {**manifest.to_json(), "folder": str(folder), "report": page and str(page)}
        )
        return
    if not manifest.completed:
        err.print(f"{manifest.status}: {manifest.message}")
    if stopped := manifest.stopped_when:
        out.print(f"ended at {stopped.time:g} s: {stopped.condition}")
    for line in manifest.not_met:
        err.print(f"not met: {line}")
    for line in other.manifest.not_met if other else ():
        err.print(f"baseline: not met: {line}")
    for cases in find_cases(folder.parent, [manifest.parameters]):
        out.print(f"Sized: {cases.verdict}.", highlight=False, markup=False)
    verdict = describe_verdicts(manifest.verdicts, len(manifest.unmet))
    if verdict and manifest.completed:
        out.print(f"{verdict}.", highlight=False, markup=False)
    titles = ["this run", *(["baseline"] if other else [])]
    table = tabulate_numbers(
        manifest, other.manifest if other else None, titles, has_verdicts=True
    )
    names = list(manifest.numbers)
    judged = {v.number for v in manifest.verdicts.values()}
    names_to_print = to_print(names, judged, everything)
    rows = [names.index(name) for name in names_to_print]
    rows += range(len(names), len(table.rows))
    print_table(table.part(range(len(table.columns)), rows), is_folded=True)
    if rest := len(manifest.numbers) - len(names_to_print):
        out.print(f"{rest} more numbers in the report; --all prints them")
    if line := substeps_line(manifest):
        out.print(line)
    speed = f", {manifest.us_per_step} us a step" if everything else ""
    report = f"\nreport: {page.resolve()}" if page else ""
    out.print(
        f"{manifest.steps_done} steps{speed}; series in "
        f"{folder / SERIES}{thinning}{report}",
    )
