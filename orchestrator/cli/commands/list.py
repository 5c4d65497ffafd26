"""Define `desat list`: scenarios that can be run."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ...files.paths import NOMINAL
from ...report.table import Column, Table
from ...system.errors import DesatError
from .. import options as o
from ..console import app, example, out, print_json, print_table

if TYPE_CHECKING:
    from ...runs.catalogue import Family


@app.command("list", epilog=example("desat list uosat12"))
def list_command(
    ctx: typer.Context,
    family: Annotated[
        str | None,
        typer.Argument(
            metavar="FAMILY|FOLDER",
            autocompletion=o.complete_family,
            help="Only this family, or the scenarios of a craft of your own.",
        ),
    ] = None,
    everything: Annotated[
        bool, typer.Option("--all", help="Every scenario by name.")
    ] = False,
    html: Annotated[
        bool,
        typer.Option(
            "--html",
            help="Write index.html of a folder (default: this one): its crafts, runs, "
            "sizings, campaigns and other pages, each with verdict and first picture.",
        ),
    ] = False,
    as_json: o.Json = False,
) -> None:
    """List the families of scenarios, or the scenarios of one or of a craft's folder.

    What is wrong with a file is said, too; with a family, --all or --json also what is
    wrong with the systems that they describe.
    """
    from ...runs import catalogue

    if html:
        o.refuse(ctx, "it does not go with --html", "everything", "as_json")
        from ...report.index import write_index

        page, count = write_index(Path(family or "."))
        out.print(
            f"page: {page.resolve()} ({count} {'entry' if count == 1 else 'entries'})",
            highlight=False,
        )
        return
    if family and (Path(family) / NOMINAL).is_file():
        own_folder = catalogue.of_folder(Path(family))
        if as_json:
            print_json(
                [
                    {"name": name, "title": title}
                    for name, title in own_folder.scenarios.items()
                ]
            )
        else:
            _print_scenarios([own_folder])
        if own_folder.problems:
            raise DesatError("\n".join(own_folder.problems))
        return
    names, in_full = (
        [family] if family else catalogue.families(),
        bool(family or everything or as_json),
    )
    families = [catalogue.family(name, in_full) for name in names]
    if as_json:
        rows = [(n, title) for f in families for n, title in f.scenarios.items()]
        print_json([{"name": name, "title": title} for name, title in rows])
    elif family or everything:
        _print_scenarios(families)
    else:
        _print_families(families)
    if problems := [line for f in families for line in f.problems]:
        raise DesatError("\n".join(problems))


def _print_scenarios(families: list[Family]) -> None:
    """Print the scenarios of families, a row each."""
    columns = [Column("scenario", kind="text"), Column("what it is", kind="text")]
    rows = [scenario for family in families for scenario in family.scenarios.items()]
    print_table(Table("", columns, rows), is_folded=True)


def _print_families(families: list[Family]) -> None:
    """Print families, a row each."""
    columns = [
        Column("family", kind="text"),
        Column("scenarios", form="d"),
        Column("what it is", kind="text"),
        Column("such as", kind="text"),
    ]
    rows = [
        (
            family.name,
            len(family.scenarios),
            family.title,
            min(family.scenarios, key=len, default=""),
        )
        for family in families
    ]
    print_table(Table("", columns, rows), is_folded=True)
    out.print(
        "`desat list FAMILY` has a family's scenarios, `desat list --all` all of them"
    )
