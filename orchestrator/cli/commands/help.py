"""Define `desat help TOPIC`: documentation pages, scenario language, blocks."""

from __future__ import annotations

from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from .. import options as o
from ..console import Commands, app, example, out, print_json, print_rows


class _Topics(TyperGroup):
    """A group that runs its command `page` if the first argument is a page's name."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Insert `page` before a first argument that is no command."""
        if args and args[0] not in self.commands and not args[0].startswith("-"):
            args = ["page", *args]
        return super().parse_args(ctx, args)


topics = Commands(
    cls=_Topics,
    invoke_without_command=True,
    rich_markup_mode=None,
    help="Pages of the documentation, the scenario language, the blocks: `desat help` lists them, "
    "`desat help WORDS` searches them.",
)
app.add_typer(topics, name="help", epilog=example("desat help own-block"))


@topics.callback()
def _topics(ctx: typer.Context) -> None:
    if ctx.invoked_subcommand is None:
        from ...runs import pages

        rows = [
            {"topic": name, "what it is": title}
            for name, title in pages.titles().items()
        ]
        rows[:0] = [
            {
                "topic": "blocks [ROLE|NAME]",
                "what it is": "The blocks, their variables and laws",
            },
            {"topic": "keys [TABLE]", "what it is": "The keys of a scenario file"},
            {"topic": "measures", "what it is": "The measures that a number may name"},
        ]
        print_rows(rows, as_json=False)


@topics.command(hidden=True, epilog=example("desat help own-block"))
def page(
    words: Annotated[
        list[str],
        typer.Argument(metavar="TOPIC|WORDS", help="A page, or words to search for."),
    ],
) -> None:
    """Print a page of the documentation, or the topics that have some words."""
    from ...runs import pages

    name = " ".join(words)
    if name not in pages.titles() and (rows := pages.found(name)):
        print_rows(rows, as_json=False)
        return
    text = pages.text(name)
    if not out.is_terminal:
        out.print(text, end="")
        return
    from rich.markdown import Markdown

    with out.pager(styles=True):
        out.print(Markdown(text))


@topics.command(epilog=example("desat help keys design"))
def keys(
    name: Annotated[
        str | None, typer.Argument(help="Only this table of the language.")
    ] = None,
    schema: Annotated[
        bool, typer.Option("--schema", help="A JSON schema for editors.")
    ] = False,
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
    print_rows(explain.keys(name), as_json)


@topics.command(epilog=example("desat help measures"))
def measures(as_json: o.Json = False) -> None:
    """Print the measures that a number may name, and their options."""
    from ...runs import explain

    print_rows(explain.measures(), as_json)


@topics.command(epilog=example("desat help blocks manager_cross_product"))
def blocks(
    name: Annotated[
        str | None,
        typer.Argument(metavar="ROLE|NAME", help="Those of a role, or one of them."),
    ] = None,
    as_json: o.Json = False,
) -> None:
    """Print the blocks by role; of one what it computes, its parameters, inputs and
    outputs: unit, start value, what is allowed, what of the craft it usually follows,
    and what needs it.
    """
    from ...runs import explain

    text, rows = explain.blocks(name)
    if as_json:
        print_json({"text": text, "rows": rows})
        return
    if text:
        out.print(text, highlight=False, markup=False)
        out.print()
    print_rows(rows, as_json=False)
