"""`desat help blocks [ROLE|NAME]`."""

from __future__ import annotations

from typing import Annotated

import typer

from .. import options as o
from ..console import app, out, print_json
from .explain import print_rows

topics = typer.Typer(no_args_is_help=True, rich_markup_mode=None, help="What there is: blocks.")
app.add_typer(topics, name="help")


@topics.command()
def blocks(
    what: Annotated[
        str | None, typer.Argument(metavar="ROLE|NAME", help="Those of a role, or one of them.")
    ] = None,
    as_json: o.Json = False,
) -> None:
    """Print the blocks by role; of one what it computes, its parameters, inputs and outputs: unit,
    start value, what is allowed, what of the craft it usually follows, and what needs it."""
    from ...runs import explain

    text, rows = explain.blocks(what)
    if as_json:
        print_json({"text": text, "rows": rows})
        return
    if text:
        out.print(text, highlight=False, markup=False)
        out.print()
    print_rows(rows, as_json=False)
