"""Define `desat compare A B ...`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ...report.table import ROW_UNIT, Column, Row, Table
from ...runs.progress import stages
from ...system.errors import DesatError, Exit
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
    warn,
)

if TYPE_CHECKING:
    from ...campaign.pairs import Pairs
    from ...studies.compare import Comparison


@app.command(cls=Sections, epilog=example("desat compare my12u --laws all"))
def compare(
    ctx: typer.Context,
    targets: Annotated[
        list[str],
        typer.Argument(
            metavar="A B ...",
            autocompletion=o.complete_name,
            help="Scenarios, which fly now, and run folders; or campaigns' folders; or a "
            "run and a log of telemetry (.csv).",
        ),
    ],
    count: Annotated[
        int | None,
        typer.Option(
            "-n",
            "--count",
            min=1,
            help="Fly this many random samples of each scenario, the same for all, and "
            "print the statistics of their differences.",
        ),
    ] = None,
    seed: o.Seed = 1,
    laws: Annotated[
        str | None,
        typer.Option(
            metavar="all|NAME,...",
            help="Fly one craft with each manager of ours that fits it, or with these, "
            "gains by rule, and rank the laws.",
        ),
    ] = None,
    law: Annotated[
        list[str] | None,
        typer.Option(
            metavar="FILE", help="A law of your own among them: my_law.py, or an FMU."
        ),
    ] = None,
    by: Annotated[
        str | None,
        typer.Option(
            metavar="NAME,...",
            help="What laws are ranked by: peak, emptying, energy, torquer, duty, pointing, "
            "firing, stored.",
        ),
    ] = None,
    sets: o.Sets = None,
    sources: o.Sources = None,
    stop: o.Stop = None,
    step: o.Step = None,
    substeps: o.Substeps = None,
    accuracy: o.Accuracy = None,
    blocks: o.Blocks = False,
    fmus: o.Fmus = "native",
    time_limit: o.TimeLimit = None,
    jobs: o.Jobs = o.CPUS,
    html: Annotated[
        Path | None,
        o.output_file(
            "--html", "Where the page goes (default: runs/compare-A-B.html)."
        ),
    ] = None,
    as_json: o.Json = False,
) -> None:
    """Compare scenarios, runs or campaigns with the first, or the laws of a craft.

    All numbers stand in one table with their differences, the first less each other,
    and a page has the series overlaid. With -n, and of campaigns, the differences are
    paired sample by sample: median, interval, share of samples that are lower. With
    --laws one craft flies law by law, and the laws are ranked. A log is laid over a run:
    wheels, rates, attitude error and dumps, as measured and as simulated.
    """
    from ...campaign import pairs
    from ...studies import compare as study

    options = o.options_of(
        sets,
        stop,
        step,
        "gauss_seidel",
        blocks,
        sources=sources,
        substeps=substeps,
        accuracy=accuracy,
        time_limit=time_limit,
        fmus=fmus,
    )
    if any(target.endswith(".csv") for target in targets):
        reason = "a log is laid over a run as it is"
        o.refuse(ctx, reason, "count", "seed", "laws", "law", "by")
        _lay_over(targets, options, html, as_json)
        return
    if count is None:
        o.refuse(ctx, "it goes with -n", "seed")
    if laws is not None or law:
        samples = count, seed, jobs
        _compare_laws(targets, laws, law or [], by, options, samples, html, as_json)
        return
    if by is not None:
        raise DesatError("--by: it ranks laws: --laws all")
    campaigns = study.are_campaigns(targets)
    if campaigns:
        o.refuse(
            ctx,
            "campaigns are compared as they are",
            "count",
            "sets",
            "sources",
            "stop",
            "step",
            "substeps",
            "accuracy",
            "blocks",
            "fmus",
            "time_limit",
        )
    if html is not None and (campaigns or count is not None):
        raise DesatError("--html: only comparisons of runs, without -n, have a page")
    if campaigns:
        first, *others = map(Path, targets)
        show_pairs([pairs.compare(first, other) for other in others], as_json)
    elif count is not None:
        _draws(targets, count, seed, options, jobs, as_json)
    else:
        with stages(not as_json) as tell:
            comparison = study.side_by_side(targets, options, tell)
        page = html or Path("runs") / f"compare-{'-'.join(map(name_of, targets))}.html"
        _show(comparison, study.write(comparison, page), as_json)


def _lay_over(
    targets: Sequence[str], options: Any, html: Path | None, as_json: bool
) -> None:
    """Lay a log over a run or scenario and print their differences."""
    from ...runs.run import load_run, prepare, simulate
    from ...studies.compare import is_run
    from ...telemetry.log import origin_of, read_log
    from ...telemetry.overlay import lay_over

    if len(targets) != 2 or targets[0].endswith(".csv"):
        raise DesatError(f"{' '.join(targets)}: a run and a log after it are needed")
    target, file = targets
    with stages(not as_json) as tell:
        tell(target)
        simulation = (
            load_run(Path(target))
            if is_run(target)
            else simulate(prepare(target, options))
        )
    manifest = simulation.or_raise(target).manifest
    log = read_log(Path(file), origin_of(manifest.parameters))
    overlay = lay_over(target, simulation.results, log)
    name = f"compare-{name_of(target)}-{Path(file).stem}.html"
    page = overlay.write(html or Path("runs") / name)
    if as_json:
        print_json({**overlay.as_json(), "page": str(page)})
        return
    print_table(overlay.table)
    print_table(overlay.dump_table)
    out.print(f"page: {page.resolve()}")


def _compare_laws(
    targets: Sequence[str],
    laws: str | None,
    others: Sequence[str],
    by: str | None,
    options: Any,
    samples: tuple[int | None, int, int],
    html: Path | None,
    as_json: bool,
) -> None:
    """Rank the laws of one craft, by a run each or over samples.

    `samples` has their number or None, the seed and the number of processes.
    """
    if len(targets) > 1:
        raise DesatError(f"{' '.join(targets)}: --laws flies one craft")
    names = [x.strip() for x in (laws or "").split(",") if x.strip()]
    count, seed, jobs = samples
    if count is None:
        _laws(targets[0], names, others, by, options, html, as_json)
        return
    if html is not None:
        raise DesatError(
            "--html: only a ranking of one run each, without -n, has a page"
        )
    of_samples = count, seed, jobs
    _sampled_laws(targets[0], names, others, by, options, of_samples, as_json)


def _laws(
    target: str,
    laws: Sequence[str],
    others: Sequence[str],
    by: str | None,
    options: Any,
    html: Path | None,
    as_json: bool,
) -> None:
    """Fly a craft law by law and print the ranking."""
    from ...studies import criteria as measures
    from ...studies import ranking as study

    criteria = measures.criteria(by) if by is not None else ()
    with stages(not as_json) as tell:
        ranked = study.choose(target, options, criteria, laws, others, tell)
    page = ranked.write(html or Path("runs") / f"compare-{name_of(target)}-laws.html")
    warn(ranked.comparison.warnings)
    if as_json:
        print_json({**ranked.as_json(), "page": str(page)})
    else:
        out.print(ranked.answer, highlight=False, markup=False)
        print_table(ranked.table)
        for line in ranked.notes:
            out.print(line, highlight=False, markup=False)
        for names, reason in ranked.declined():
            out.print(f"does not fit: {names}: {reason}", highlight=False, markup=False)
        out.print(f"page: {page.resolve()}")
    if ranked.ranked[0].not_met:
        raise typer.Exit(Exit.UNMET)


def _sampled_laws(
    target: str,
    laws: Sequence[str],
    others: Sequence[str],
    by: str | None,
    options: Any,
    samples: tuple[int, int, int],
    as_json: bool,
) -> None:
    """Fly samples of a craft law by law and print the ranking.

    `samples` has their number, seed and the number of processes.
    """
    from ...studies import criteria as measures
    from ...studies.ranking import by_reason
    from ...studies.sampled_laws import rank_samples

    criteria = measures.criteria(by) if by is not None else ()
    with stages(not as_json) as tell:
        progress = None if as_json else tell
        ranked = rank_samples(
            target, options, criteria, laws, others, *samples, progress
        )
    warn(ranked.warnings)
    if as_json:
        print_json(ranked.as_json())
    else:
        out.print(ranked.answer, highlight=False, markup=False)
        print_table(ranked.table)
        for line in ranked.notes:
            out.print(line, highlight=False, markup=False)
        for texts, reason in by_reason(ranked.refused):
            out.print(f"does not fit: {texts}: {reason}", highlight=False, markup=False)
    if ranked.ranked[0].failed:
        raise typer.Exit(Exit.UNMET)


def _draws(
    targets: Sequence[str],
    count: int,
    seed: int,
    options: Any,
    jobs: int,
    as_json: bool,
) -> None:
    """Fly the same samples of each scenario and print their differences."""
    from ...studies.compare import paired_draws

    differences, files = paired_draws(
        targets, count, seed, options, jobs, progress=not as_json
    )
    for each in files:
        warn(f"{each.scenario}: {line}" for line in each.warnings)
    show_pairs(differences, as_json)
    rows = [(each.scenario, row) for each in files for row in each.rows]
    for target, row in rows:
        if not row.completed:
            err.print(f"{target}: draw {row.number}: {row.status}: {row.message}")
        if row.unmet:
            err.print(f"{target}: draw {row.number}: not met: {'; '.join(row.unmet)}")
    if code := max(row.code for _, row in rows):
        raise typer.Exit(code)


def _show(comparison: Comparison, page: Path, as_json: bool) -> None:
    """Print a comparison; exit with 1 where a requirement is not met."""
    from ...studies.compare import difference_text

    warn(comparison.warnings)
    if as_json:
        print_json({**comparison.as_json(), "page": str(page)})
    else:
        print_table(comparison.table)
        if text := difference_text(comparison):
            out.print(text, highlight=False, markup=False)
        out.print(f"page: {page.resolve()}")
    unmet = [
        (t, line)
        for t, run in zip(comparison.targets, comparison.runs, strict=True)
        for line in run.manifest.not_met
    ]
    for target, line in unmet:
        err.print(f"{target}: not met: {line}")
    if unmet:
        raise typer.Exit(Exit.UNMET)


def show_pairs(pairs: Sequence[Pairs], as_json: bool) -> None:
    """Print paired differences (`pairs.compare`) as tables, or as JSON.

    The JSON is one object, or a list of several.
    """
    for each in pairs:
        warn(each.warnings)
    if as_json:
        entries = [each.to_json() for each in pairs]
        print_json(entries[0] if len(entries) == 1 else entries)
        return
    for each in pairs:
        out.print(
            f"{each.first} less {each.second}, {each.pairs} pairs; intervals of 95 %:"
        )
        print_table(_tabulate_pairs(each))


def _tabulate_pairs(pairs: Pairs) -> Table:
    """Tabulate the differences: median with its interval, shares below and above."""
    columns = [
        Column("number", kind="text"),
        Column("median", ROW_UNIT),
        Column("from", ROW_UNIT),
        Column("to", ROW_UNIT),
        Column("lower %"),
        Column("from"),
        Column("to"),
        Column("higher %"),
        Column("pairs", form="d"),
        Column("unit", kind="unit"),
    ]
    rows: list[Row] = []
    for name, spread in pairs.numbers.items():
        if not spread.n:
            continue
        title = spread.title or name
        # there may be too few pairs for an interval of the median
        interval = spread.interval if spread.interval_holds else (None, None)
        higher = 100.0 * (spread.higher or 0) / spread.n
        shares = (spread.share_lower, *spread.share_lower_interval, higher)
        rows.append(
            (title, spread.levels["median"], *interval, *shares, spread.n, spread.unit)
        )
    return Table("", columns, rows)
