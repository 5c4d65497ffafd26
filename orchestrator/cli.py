"""The command `desat`."""

from __future__ import annotations

import json
import os
import sys
import traceback
from dataclasses import replace
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.markup import escape
from rich.progress import track
from rich.table import Table
from rich.text import Text

from .analyses import bound as bound_module
from .analyses import convergence as convergence_module
from .designs import dumping as design_module
from .engine.master import Algorithm
from .engine.results import SERIES
from .files import pack as pack_module
from .files.scenario import find, scenarios
from .study import draws as draws_module
from .study import explain
from .study import report as report_module
from .study import stored as stored_module
from .study import tables as tables_module
from .study.case import (
    MANIFEST,
    Options,
    Run,
    execute,
    load_run,
    prepare,
    relate,
    run_or_load,
    write_json,
)
from .study.plots import pretty_unit
from .system.errors import DesatError
from .system.interface import base_name
from .system.parameters import parse_value

app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    help="Spacecraft momentum management as co-simulated FMUs. Start with [bold]desat list[/bold], "
    "then [bold]desat run NAME[/bold]; every command explains itself with --help.",
)
# piped output is for other programs: not folded to a terminal's width
# no emoji: `file.ssd:100: …` is a line number
out = Console(emoji=False, **({"soft_wrap": True} if sys.stdout.isatty() else {"width": 200}))
err = Console(stderr=True, soft_wrap=True, emoji=False)


class Semantics(StrEnum):
    """How values move between components."""

    conserving = "conserving"
    jacobi = "jacobi"


TARGET = typer.Argument(
    metavar="NAME|FOLDER|FILE.ssp",
    help="A scenario (see `desat list`), an .ssp file, or a folder with a SystemStructure.ssd.",
    show_default=False,
)
Target = Annotated[str, TARGET]
Sets = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="COMP.VAR=VALUE",
                 help="Give a parameter (or unconnected input) another value; a choice by its "
                 "name, an array as 1,2,3. May be repeated."),
]  # fmt: skip
Sources = Annotated[
    list[str] | None,
    typer.Option("--source", metavar="COMP=FMU",
                 help="Another FMU in a component's place: a file, or one of ours by its name. "
                 "Parameters that both declare alike stay. May be repeated."),
]  # fmt: skip
Stop = Annotated[float | None, typer.Option(help="Stop time, s.")]
Step = Annotated[float | None, typer.Option(help="Step, s.")]
Alg = Annotated[
    Semantics,
    typer.Option(help="conserving: no delay in the loop; jacobi: as libcosim and Ecos do."),
]
Blocks = Annotated[bool, typer.Option("--blocks", help="Bare blocks instead of FMUs.")]
Json = Annotated[bool, typer.Option("--json", help="Print JSON for programs.")]
Classes = Annotated[
    list[str] | None,
    typer.Option("--output-class", metavar="COMP.OUT=CLASS",
                 help="Class of an output: state or interval. May be repeated."),
]  # fmt: skip
Jobs = Annotated[int, typer.Option(help="Processes.", min=1)]
CPUS = os.cpu_count() or 1


def _options(
    sets: list[str] | None, stop: float | None, step: float | None, algorithm: Semantics,
    blocks: bool, classes: list[str] | None = None, sources: list[str] | None = None, **more: Any,
) -> Options:  # fmt: skip
    overrides: dict[str, str] = {}
    for text in classes or []:
        key, _, value = text.partition("=")
        overrides[key] = value
    name: Algorithm = "jacobi" if algorithm is Semantics.jacobi else "conserving"
    return Options(
        sets=list(sets or []), sources=list(sources or []), stop=stop, step=step, algorithm=name,
        blocks=blocks, output_classes=overrides, **more,
    )  # fmt: skip


def _print_json(data: Any) -> None:
    sys.stdout.write(json.dumps(data, indent=1) + "\n")


@app.command("list")
def list_command(
    family: Annotated[str | None, typer.Argument(help="Only this family.")] = None,
    as_json: Json = False,
) -> None:
    """List the scenarios."""
    found, problems = explain.readable(family)
    if as_json:
        _print_json([{"name": n, "title": s.data.get("title", "")} for n, s in found.items()])
    else:
        table = Table("scenario", "what it is", box=None, header_style="bold", pad_edge=False)
        for name, scenario in found.items():
            table.add_row(name, scenario.data.get("title", ""))
        out.print(table)
    if problems:
        raise DesatError("\n".join(problems))


@app.command("keys")
def keys_command(
    what: Annotated[str | None, typer.Argument(help="Only this table of the language.")] = None,
    schema: Annotated[bool, typer.Option("--schema", help="A JSON schema for editors.")] = False,
    as_json: Json = False,
) -> None:
    """Print the keys of a scenario's file: type, unit and what they say."""
    if schema:
        _print_json(explain.schema())
        return
    _print_rows(explain.keys(what), as_json)


@app.command("measures")
def measures_command(as_json: Json = False) -> None:
    """Print the measures that a number may name, and their options."""
    _print_rows(explain.measures(), as_json)


@app.command("show")
def show_command(
    name: Annotated[str, typer.Argument(help="A scenario, as uosat12/table2-ocdc-ilqr-1.")],
    as_json: Json = False,
) -> None:
    """Print a scenario as merged, and where each value comes from."""
    _print_rows(explain.show(name), as_json)


def _print_rows(rows: list[dict[str, str]], as_json: bool) -> None:
    if as_json:
        _print_json(rows)
        return
    table = Table(*rows[0], box=None, header_style="bold", pad_edge=False)
    for row in rows:
        table.add_row(*(escape(str(value)) for value in row.values()))
    out.print(table)


@app.command()
def run(
    target: Target,
    sets: Sets = None,
    sources: Sources = None,
    stop: Stop = None,
    step: Step = None,
    algorithm: Alg = Semantics.conserving,
    blocks: Blocks = False,
    folder: Annotated[
        Path | None, typer.Option("--out", help="Run folder (default: a new one under runs/).")
    ] = None,
    record: Annotated[
        list[str] | None,
        typer.Option(help="Record only outputs that fit, as 'manager.*'. May be repeated."),
    ] = None,
    every: Annotated[int, typer.Option(help="Record every n-th step.", min=1)] = 1,
    csv: Annotated[bool, typer.Option("--csv", help="Write series.csv too.")] = False,
    twin: Annotated[
        bool, typer.Option(help="Also run the scenario's twin, and show it beside.")
    ] = True,
    classes: Classes = None,
    as_json: Json = False,
) -> None:
    """Run a scenario and write a run folder: series, manifest, report."""
    options = _options(
        sets, stop, step, algorithm, blocks, classes, sources, record=tuple(record or ("*",)),
        every=every,
    )  # fmt: skip
    target_folder = _run_folder(target, folder)
    _, checked = prepare(target, options)
    for warning in checked.warnings:
        err.print(f"warning: {warning}", highlight=False, markup=False)
    checked.or_raise()
    finished = execute(target, options, target_folder, progress=not as_json)
    other = _run_twin(finished, options, target_folder) if twin and finished.ok else None
    page = report_module.write_report(target_folder, finished, other)
    if csv:
        finished.results.to_csv(target_folder / "series.csv")
    _report_run(finished, other, target_folder, page, as_json)
    if finished.manifest["status"] == "interrupted":
        raise typer.Exit(130)
    if not finished.ok:
        raise typer.Exit(1)


def _run_folder(target: str, folder: Path | None) -> Path:
    if folder is not None:
        if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
            raise DesatError(f"--out {folder}: it exists already and is not an empty folder")
        return folder
    path = Path(target)
    name = path.resolve().stem if path.exists() else target.replace("/", "-")
    candidate, count = Path("runs") / name, 1
    while candidate.exists():
        count += 1
        candidate = Path("runs") / f"{name}-{count}"
    return candidate


def _run_twin(finished: Run, options: Options, folder: Path) -> Run | None:
    """Run the twin that the scenario names, into a folder beside, and compare."""
    about = finished.manifest["about"]
    name = about.get("name", "").partition("/")[0] + "/" + about.get("twin", "")
    if not about.get("twin") or name == about["name"] or name not in scenarios():
        return None
    twin_folder = folder / "twin"
    other = execute(name, replace(options, sets=[], sources=[]), twin_folder)
    relate(finished.manifest, {about["twin"]: other.manifest})
    write_json(folder / MANIFEST, finished.manifest)
    report_module.write_report(twin_folder, other)
    return other


def _report_run(finished: Run, other: Run | None, folder: Path, page: Path, as_json: bool) -> None:
    manifest = finished.manifest
    if as_json:
        _print_json({**manifest, "folder": str(folder), "report": str(page)})
        return
    if manifest["status"] != "completed":
        err.print(f"{manifest['status']}: {manifest['message']}", highlight=False, markup=False)
    table = Table(box=None, pad_edge=False, show_header=other is not None, header_style="bold")
    for column in ["", "this run", "twin", ""] if other else ["", "this run", ""]:
        table.add_column(column, justify="right" if "run" in column or column == "twin" else "left")
    for name, n in manifest["numbers"].items():
        row = [n["title"], report_module.number(n["value"])]
        if other:
            theirs = other.manifest["numbers"].get(name)
            row.append(report_module.number(theirs["value"]) if theirs else "")
        table.add_row(*row, pretty_unit(n["unit"]))
    if manifest["numbers"]:
        out.print(table)
    out.print(
        f"{manifest['steps_done']} steps, {manifest['us_per_step']} us a step; series in "
        f"{folder / SERIES}\nreport: {page.resolve()}", highlight=False, markup=False,
    )  # fmt: skip


@app.command()
def draws(
    target: Target,
    count: Annotated[int, typer.Option("-n", "--count", help="Number of draws.", min=1)] = 20,
    seed: Annotated[int, typer.Option(help="Seed of the draws.", min=0)] = 1,
    sets: Sets = None,
    stop: Stop = None,
    step: Step = None,
    algorithm: Alg = Semantics.conserving,
    blocks: Blocks = False,
    jobs: Jobs = CPUS,
    as_json: Json = False,
) -> None:
    """Run seeded draws of a scenario's dispersions."""
    options = _options(sets, stop, step, algorithm, blocks)
    result = draws_module.draws(target, count, seed, options, jobs, progress=not as_json)
    failed = [r for r in result["draws"] if r["status"] != "completed"]
    if as_json:
        _print_json(result)
    else:
        names = list(result["summary"])
        table = Table("draw", *names, box=None, header_style="bold", pad_edge=False)
        for row in result["draws"]:
            cells = [report_module.number(row["numbers"].get(n, float("nan"))) for n in names]
            table.add_row(str(row["draw"]), *cells)
        for key in ("median", "min", "max"):
            cells = [report_module.number(result["summary"][n][key]) for n in names]
            table.add_row(key, *cells, style="bold")
        table.add_row("unit", *(pretty_unit(result["summary"][n]["unit"]) for n in names))
        out.print(table)
    for row in failed:
        err.print(f"draw {row['draw']}: {row['status']}: {row['message']}", markup=False)
    if failed:
        raise typer.Exit(1)


@app.command()
def check(
    target: Target,
    sets: Sets = None,
    sources: Sources = None,
    stop: Stop = None,
    step: Step = None,
    blocks: Blocks = False,
    classes: Classes = None,
    as_json: Json = False,
) -> None:
    """Find what is wrong with a system before it runs, and print its schedule."""
    options = _options(sets, stop, step, Semantics.conserving, blocks, classes, sources)
    system, checked = prepare(target, options)
    schedule = checked.schedule
    timing: dict[str, str] = {}
    for connection, when in schedule.timing if schedule else ():
        key = (f"{connection.source}.{base_name(connection.output)} -> "
               f"{connection.target}.{base_name(connection.input)}")  # fmt: skip
        timing[key] = when
    if as_json:
        _print_json(
            {
                "problems": checked.problems,
                "warnings": checked.warnings,
                "order": schedule.order if schedule else [],
                "connections": [{"connection": k, "timing": v} for k, v in timing.items()],
            }
        )
    else:
        for problem in checked.problems:
            err.print(problem, highlight=False, markup=False)
        for warning in checked.warnings:
            err.print(f"warning: {warning}", highlight=False, markup=False)
        if schedule is not None:
            out.print("steps in this order: " + ", ".join(schedule.order), highlight=False)
            table = Table("connection", "moves", box=None, header_style="bold", pad_edge=False)
            for key, when in timing.items():
                table.add_row(key, when)
            out.print(table)
    if checked.problems:
        if not as_json:
            err.print(f"{len(checked.problems)} problem(s) in {system.where}", markup=False)
        raise typer.Exit(1)


@app.command()
def pack(
    names: Annotated[
        list[str] | None, typer.Argument(metavar="[NAME]...", help="Scenarios (default: all).")
    ] = None,
    as_json: Json = False,
) -> None:
    """Pack scenarios as self-contained .ssp files into ssp/dist/."""
    wanted = [find(n) for n in names] if names else list(scenarios().values())
    packed = [str(pack_module.pack_scenario(s, force=True)) for s in wanted]
    if as_json:
        _print_json(packed)
    else:
        out.print(f"{len(packed)} packed: {os.path.commonpath(packed)}", highlight=False)


@app.command()
def design(
    names: Annotated[
        list[str] | None,
        typer.Argument(metavar="[NAME]...", help="Scenarios (default: all with a design)."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Compute what laws need beforehand (gain tables, costates) into ssp/FAMILY/design/."""
    wanted = design_module.designable(names or [])
    made = [
        (s, d := design_module.design(s), design_module.write(s, d))
        for s in track(wanted, "design", console=err, transient=True,
                       disable=as_json or not err.is_terminal)
    ]  # fmt: skip
    if as_json:
        _print_json([design_module.as_json(*each) for each in made])
        return
    table = Table("scenario", box=None, header_style="bold", pad_edge=False)
    for column in ("|h_f| N m s", "dipole energy A2 m4 s"):
        table.add_column(column, justify="right")
    table.add_column("tuned")
    for s, d, _ in made:
        tuned = ", ".join(f"{n} = {v:.6g} {u}" for n, (v, u) in d.tuned.items())
        table.add_row(s.name, f"{d.flight.size:.3g}", f"{d.flight.energy:.6g}", tuned)
    out.print(table)
    for folder in sorted({path.parent for _, _, path in made}):
        out.print(f"written to {os.path.relpath(folder)}", highlight=False, markup=False)


@app.command()
def tables(
    family: Annotated[str, typer.Argument(help="Scenario family, as uosat12.")],
    algorithm: Alg = Semantics.conserving,
    blocks: Blocks = False,
    jobs: Jobs = CPUS,
    html: Annotated[
        Path | None, typer.Option(help="Where the page goes (default: runs/tables-FAMILY.html).")
    ] = None,
    fresh: Annotated[
        bool, typer.Option("--fresh", help="Make the draws now; default: the stored ones.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Run a family's scenarios and print the paper's tables beside ours.

    Scenarios with draws give their median; these are read from docs/papers/FAMILY/draws.json.
    """
    options = _options(None, None, None, algorithm, blocks)
    drawn, origin = _drawn(family, jobs, fresh, progress=not as_json)
    rows = tables_module.rows(family, options, jobs, drawn)
    if as_json:
        _print_json(tables_module.as_json(family, rows, origin))
        return
    for heading, group in tables_module.grouped(rows):
        table = Table(title=escape(heading), title_justify="left", box=None, header_style="bold",
                      pad_edge=False)  # fmt: skip
        lines = [tables_module.shown(row) for row in group]
        shown = tables_module.columns(lines)
        for column, text in shown.items():
            table.add_column(text, justify="right" if column in tables_module.NUMBERS else "left")
        for line in lines:
            style = {"ok": "green", "bad": "red", "": ""}[line["mark"]]
            table.add_row(*(Text(line[c], style if c == "verdict" else "") for c in shown))
        out.print(table)
        out.print()
    if origin:
        out.print(f"draws: {tables_module.origin(origin)}", highlight=False, markup=False)
    page = tables_module.write_html(
        family, rows, html or Path("runs") / f"tables-{family}.html", options, origin
    )
    out.print(f"page: {page.resolve()}", highlight=False, markup=False)


def _drawn(
    family: str, jobs: int, fresh: bool, progress: bool
) -> tuple[dict[str, Any] | None, dict[str, Any] | None]:
    """The draws of a family that has some, stored or made now, and where they are from."""
    if not stored_module.with_draws(family):
        return None, None
    if fresh:
        made = stored_module.compute(family, jobs, progress)
        return made, stored_module.provenance(made, fresh=True)
    kept = stored_module.read(family)
    if old := stored_module.outdated(kept):
        err.print(f"warning: the stored draws of {', '.join(old)} are not of this version; "
                  f"--fresh makes new ones", highlight=False, markup=False)  # fmt: skip
    return kept, stored_module.provenance(kept, fresh=False)


@app.command()
def bound(
    target: Annotated[
        str, typer.Argument(metavar="NAME|RUN|FILE.ssp", help="A scenario, or a run's folder.",
                            show_default=False)
    ],
    as_json: Json = False,
) -> None:  # fmt: skip
    """Compute the least thruster seconds that a dumping run could have done with."""
    finished = run_or_load(target, bound_module)
    with finished.results as results:
        manifest, found = finished.manifest, bound_module.of_run(finished.manifest, results)
    if as_json:
        _print_json({"scenario": manifest["scenario"], **found.as_json()})
        return
    if found.least is None:
        err.print("no momentum left: more than can be dumped in this time", markup=False)
    table = Table(box=None, pad_edge=False, show_header=False)
    table.add_column()
    table.add_column(justify="right")
    table.add_row("Thruster firing time of the run", f"{found.seconds:.2f}", "s")
    for n in found.numbers().values():
        table.add_row(n["title"], f"{n['value']:.2f}", n["unit"])
    out.print(table)


@app.command()
def convergence(
    target: Target,
    steps: Annotated[str, typer.Option(help="Steps, s.")] = "1,0.5,0.25,0.125",
    algorithm: Annotated[
        list[Semantics] | None, typer.Option(help="Only this one (default: both).")
    ] = None,
    sets: Sets = None,
    stop: Stop = None,
    blocks: Blocks = False,
    jobs: Jobs = CPUS,
    html: Annotated[
        Path | None, typer.Option(help="Where the page goes (default: runs/convergence-NAME.html).")
    ] = None,
    as_json: Json = False,
) -> None:
    """Hold a gyrostat scenario at several steps against its monolithic reference."""
    options = _options(sets, stop, None, Semantics.conserving, blocks)
    sizes = parse_value(steps)
    sizes = tuple(sizes if isinstance(sizes, list) else [sizes])
    if not all(isinstance(s, (int, float)) for s in sizes):
        raise DesatError(f"--steps {steps}: positive numbers are needed, as 1,0.5,0.25")
    wanted: tuple[Algorithm, ...] = tuple(a.value for a in algorithm or list(Semantics))
    result = convergence_module.study(
        target, options, tuple(float(s) for s in sizes), wanted, jobs, progress=not as_json
    )
    if as_json:
        _print_json(result)
        return
    table = Table(box=None, header_style="bold", pad_edge=False)
    table.add_column("algorithm")
    for name in ("step s", "attitude rad", "wheel momentum N m s", "momentum residual N m s",
                 "attitude, same delays", "wheel momentum, same delays"):  # fmt: skip
        table.add_column(name, justify="right")
    for row in result["rows"]:
        values = list(row.values())
        cells = [f"{values[1]:g}", *("" if v is None else f"{v:.2e}" for v in values[2:])]
        table.add_row(values[0], *cells)
    out.print(table)
    if result["order"] is not None:
        out.print(f"observed order (conserving): {result['order']:.2f} in attitude, "
                  f"{result['order_wheel_momentum']:.2f} in the wheels' momentum")  # fmt: skip
    name = Path(target).stem if Path(target).exists() else target.replace("/", "-")
    page = convergence_module.write_html(result, html or Path("runs") / f"convergence-{name}.html")
    out.print(f"page: {page.resolve()}", highlight=False, markup=False)


@app.command()
def report(
    folder: Annotated[Path, typer.Argument(metavar="RUN", help="A run folder.")],
) -> None:
    """Write a run's report again; also for a run that was killed."""
    finished = load_run(folder)
    twin = load_run(folder / "twin") if (folder / "twin").is_dir() else None
    out.print(str(report_module.write_report(folder, finished, twin).resolve()), markup=False)


def main() -> None:
    """Entry of the command: every error is a line, never a traceback."""
    try:
        code = app(standalone_mode=False)  # typer.Exit comes back as a number
        sys.exit(code if isinstance(code, int) else 0)
    except DesatError as error:
        for line in str(error).splitlines():
            err.print(f"error: {line}", highlight=False, markup=False)
        sys.exit(2)
    except typer.Abort:
        sys.exit(130)
    except BrokenPipeError:
        sys.exit(0)
    except OSError as error:
        what = f"{error.filename}: {error.strerror}" if error.filename else str(error)
        err.print(f"error: {what}", highlight=False, markup=False)
        sys.exit(2)
    except Exception as error:
        if hasattr(error, "show"):  # click's own messages
            error.show()
            sys.exit(getattr(error, "exit_code", 2))
        if os.environ.get("DESAT_TRACEBACK"):
            traceback.print_exc()
        err.print(
            f"error: internal: {type(error).__name__}: {error} (DESAT_TRACEBACK=1 shows where)",
            highlight=False, markup=False,
        )  # fmt: skip
        sys.exit(3)


if __name__ == "__main__":
    main()
