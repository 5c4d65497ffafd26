"""Define `desat campaign SYSTEM`, and the commands on its folder."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ...system.errors import Exit
from ...system.quantity import Quantity
from .. import options as o
from ..console import (
    Commands,
    Sections,
    WithDefault,
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
    from ...campaign.judged import CaseVerdict
    from ...campaign.report import CampaignSummary

campaigns = Commands(
    cls=WithDefault,
    no_args_is_help=True,
    rich_markup_mode=None,
    help="Fly a scenario with its [dispersions] sampled: `desat campaign NAME -n 20`, or -n 10000. "
    "The same command continues where it was stopped.",
)
app.add_typer(campaigns, name="campaign")

Accept = Annotated[
    bool,
    typer.Option(
        "--accept-versions", help="Go on with another desat, numpy, platform, libm, ..."
    ),
]
Folder = Annotated[Path, typer.Argument(metavar="FOLDER", help="A campaign's folder.")]


@campaigns.command(
    cls=Sections, epilog=example("desat campaign my12u -n 200 --stop 6h")
)
def run(
    target: o.Target,
    count: Annotated[int, typer.Option("-n", "--count", help="Cases.", min=1)] = 1000,
    sampling: Annotated[
        str,
        typer.Option(
            help="random, latin-hypercube, sobol, or saltelli (for Sobol indices)."
        ),
    ] = "random",
    seed: o.Seed = 1,
    folder: Annotated[
        Path | None,
        typer.Option(
            "--out",
            help="Its folder (default: runs/campaign-NAME).",
            show_default=False,
        ),
    ] = None,
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
    keep: Annotated[
        list[str] | None,
        typer.Option(
            help="Cases whose series and report are kept: worst:N (with --by), "
            "worst:N:NUMBER, every:N. May be repeated."
        ),
    ] = None,
    by: Annotated[
        str | None, typer.Option(help="The number that worst:N goes by.")
    ] = None,
    curve: Annotated[
        list[str] | None,
        typer.Option(
            help="A plot of the scenario of which every case keeps an envelope, for "
            "percentile curves (default: the first). May be repeated."
        ),
    ] = None,
    limit: Annotated[
        float,
        o.number(
            Quantity("--case-limit", "s", 0.1, o.LONGEST),
            "SECONDS",
            "Wall time of a case.",
        ),
    ] = 600.0,
    jobs: o.Jobs = o.CPUS,
    cluster: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS|FILE|local:N",
            help="A Dask scheduler's address or file, or N Dask workers here.",
        ),
    ] = None,
    accept_versions: Accept = False,
    everything: o.Everything = False,
    as_json: o.Json = False,
) -> None:
    """Make the cases of a campaign, or those of it that are missing, and its report."""
    from ...campaign import coordinator
    from ...system.errors import DesatError

    if by and not any(k.startswith("worst") and k.count(":") == 1 for k in keep or []):
        raise DesatError(f"--by {by}: it goes with --keep worst:N")
    rules = [
        f"{k}:{by}" if k.startswith("worst") and k.count(":") == 1 and by else k
        for k in keep or []
    ]
    plan, warnings = coordinator.planned(
        target,
        count,
        seed=seed,
        sampling=sampling,  # type: ignore[arg-type]
        options=o.options_of(
            sets,
            stop,
            step,
            algorithm,
            blocks,
            substeps=substeps,
            accuracy=accuracy,
            sources=sources,
            fmus=fmus,
            design=design,
        ),
        curves=curve,
        keep=rules,
        limit=limit,
    )
    warn(warnings)
    path = folder or Path("runs") / f"campaign-{name_of(target)}"
    coordinator.run(plan, path, jobs, cluster, not as_json, accept_versions)
    warn(coordinator.unreached(plan, path))
    _report(path, as_json, everything)


@campaigns.command(epilog=example("desat campaign status runs/campaign-my12u"))
def status(folder: Folder, as_json: o.Json = False) -> None:
    """How far a campaign is, also from elsewhere."""
    from ...campaign import coordinator

    state = coordinator.status(folder)
    if as_json:
        print_json(state)
        return
    remaining = state.get("seconds_left")
    rest = (
        f", {remaining} s left"
        if state["state"] == "running" and remaining is not None
        else ""
    )
    text = f"{state['state']}: {state['done']} of {state['count']} done, {state['failed']} failed{rest}"
    out.print(text)


@campaigns.command(epilog=example("desat campaign report runs/campaign-my12u"))
def report(
    folder: Folder, everything: o.Everything = False, as_json: o.Json = False
) -> None:
    """Write report.html and report.json of what is there; ends with 1 where a
    requirement is not shown to be met.
    """
    _report(folder, as_json, everything)


@campaigns.command(epilog=example("desat campaign case runs/campaign-my12u 17"))
def case(
    folder: Folder,
    number: Annotated[int, typer.Argument(help="The case.", min=0)],
    into: Annotated[
        Path | None,
        typer.Option(
            "--out",
            help="Its run folder (default: FOLDER/kept/NUMBER).",
            show_default=False,
        ),
    ] = None,
    accept_versions: Accept = False,
) -> None:
    """Make a case again, with its series and report: the same bits."""
    from ...campaign import coordinator
    from ...campaign.case import repeat
    from ...campaign.plan import anew, changed, read, same_versions
    from ...campaign.store import versions_of
    from ...system.errors import DesatError

    plan = read(folder)
    if number >= plan.count:
        raise DesatError(f"{folder}: case {number}: there are 0 to {plan.count - 1}")
    if text := changed(plan):
        raise DesatError(
            f"{folder}: case {number}: {text}: the case would differ; {anew(plan)}"
        )
    if row := versions_of(folder, number):
        same_versions(folder, row, accept_versions, f"case {number} and its row")
    path = into or coordinator.kept_in(folder, number)
    repeated = repeat(plan, number, path)
    out.print(f"{path / 'report.html'}")
    if repeated.or_raise(f"case {number}").code:
        for line in repeated.manifest.not_met:
            err.print(f"not met: {line}")
        raise typer.Exit(repeated.code)


def _print_numbers(summary: CampaignSummary, everything: bool) -> None:
    """Print the spread of the numbers over the cases, a row each."""
    from ...campaign.report import TERMINAL_COLUMNS, tabulate_numbers

    names = list(summary.numbers)
    judged = {verdict.requirement.number for verdict in summary.requirements.values()}
    names_to_print = to_print(names, judged, everything)
    table = tabulate_numbers(summary.numbers)
    print_table(
        table.part(TERMINAL_COLUMNS, [names.index(name) for name in names_to_print])
    )
    if rest := len(names) - len(names_to_print):
        out.print(f"{rest} more numbers in the report; --all prints them")


def describe_verdict(verdict: CaseVerdict) -> str:
    """Describe a requirement that is not shown to be met.

    It gives the required share and confidence, and how many more cases would show it.
    """
    if verdict.met:
        return ""
    more = verdict.more_cases
    enough = f"; {more} more cases like these would show it" if more else ""
    entry = verdict.requirement
    share, confidence = 100.0 * entry.probability, 100.0 * entry.confidence
    return (
        f" that {share:g} % are within, with a confidence of {confidence:g} %{enough}"
    )


_REASONS = 3  # failed cases whose reason is printed; the report has all


def _report(folder: Path, as_json: bool, everything: bool) -> None:
    """Write the report of a campaign, print its summary and exit with its code."""
    from ...campaign import report as of
    from ...numbers.text import number

    path, summary = of.write(folder)
    if summary.changed:
        warn([f"{summary.changed}: limits and titles are those of now"])
    if mixed := [v.text for v in summary.versions if v.text]:
        warn([f"cases were made with different versions: {'; '.join(mixed)}"])
    for row in summary.failed[:_REASONS]:
        err.print(f"case {row.case}: {row.message}")
    if as_json:
        print_json(summary.to_json())
    else:
        out.print(
            f"{summary.completed} of {summary.count} completed, {len(summary.failed)} failed"
        )
        _print_numbers(summary, everything)
        for name, r in summary.requirements.items():
            verdict = "met" if r.met else "NOT SHOWN"
            low, high = map(number, r.interval_outside)
            lacking = (
                f", {r.lacking} without {r.requirement.number}" if r.lacking else ""
            )
            out.print(
                f"{name}: {r.outside} of {r.n} outside{lacking} "
                f"({low} to {high} %): {verdict}{describe_verdict(r)}"
            )
        out.print(str(path))
    codes = [Exit.UNMET for verdict in summary.requirements.values() if not verdict.met]
    if summary.unmet:
        err.print(
            f"{len(summary.unmet)} not met of what each run is held against, first: "
            f"{summary.unmet[0]}"
        )
        codes.append(Exit.UNMET)
    if failed := {row.code for row in summary.failed}:
        codes.append(Exit.TIMEOUT if failed == {Exit.TIMEOUT} else Exit.COMPONENT)
    if codes:
        raise typer.Exit(max(codes))
