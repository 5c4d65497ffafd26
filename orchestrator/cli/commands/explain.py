"""`desat keys`, `desat measures`, `desat show`: the scenario language, and a scenario as merged."""

from __future__ import annotations

from typing import Annotated

import typer
from rich.table import Table

from .. import options as o
from ..console import app, out, print_json


@app.command()
def keys(
    what: Annotated[str | None, typer.Argument(help="Only this table of the language.")] = None,
    schema: Annotated[bool, typer.Option("--schema", help="A JSON schema for editors.")] = False,
    markdown: Annotated[
        bool, typer.Option("--markdown", help="The whole language as a page.")
    ] = False,
    as_json: o.Json = False,
) -> None:
    """Print the keys of a scenario's file: type, unit and what they say."""
    from ...runs import explain

    if schema:
        print_json(explain.schema())
        return
    if markdown:
        print(explain.page(), end="")
        return
    print_rows(explain.keys(what), as_json)


@app.command()
def measures(as_json: o.Json = False) -> None:
    """Print the measures that a number may name, and their options."""
    from ...runs import explain

    print_rows(explain.measures(), as_json)


@app.command()
def show(
    name: Annotated[
        str,
        typer.Argument(metavar="NAME|FILE|FOLDER", help="A scenario, as "
                       "uosat12/table2-ocdc-ilqr-1, a scenario file of your own (.toml), or a "
                       "craft's folder.",
                       autocompletion=o.complete_name),
    ],
    as_json: o.Json = False,
) -> None:  # fmt: skip
    """Print a scenario as merged, and where each value comes from."""
    from ...runs import explain

    print_rows(explain.show(name), as_json)


def print_rows(rows: list[dict[str, str]], as_json: bool) -> None:
    if as_json:
        print_json(rows)
        return
    table = Table(*rows[0], box=None, header_style="bold", pad_edge=False)
    for row in rows:
        table.add_row(*(str(value) for value in row.values()))
    out.print(table)
