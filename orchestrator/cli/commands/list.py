"""`desat list`: what there is to run."""

from __future__ import annotations

from typing import Annotated

import typer
from rich.table import Table

from ...files.scenario import Scenario, readable, summary
from ...system.errors import DesatError
from ..common import Json, app, complete_family, out, print_json


@app.command("list")
def list_command(
    family: Annotated[
        str | None,
        typer.Argument(help="Only this family, by name.", autocompletion=complete_family),
    ] = None,
    everything: Annotated[bool, typer.Option("--all", help="Every scenario by name.")] = False,
    as_json: Json = False,
) -> None:
    """List the families of scenarios, or the scenarios of one."""
    if family or everything or as_json:
        from ...study.explain import readable as checked

        known, problems = checked(family)
    else:
        known, problems = readable(family)
    _print_list(known, bool(family or everything), as_json)
    if problems:
        raise DesatError("\n".join(problems))


def _print_list(known: dict[str, Scenario], by_name: bool, as_json: bool) -> None:
    if as_json:
        print_json([{"name": n, "title": s.data.get("title", "")} for n, s in known.items()])
        return
    if by_name:
        table = Table("scenario", "what it is", box=None, header_style="bold", pad_edge=False)
        for name, scenario in known.items():
            table.add_row(name, scenario.data.get("title", ""))
        out.print(table)
        return
    families: dict[str, list[Scenario]] = {}
    for scenario in known.values():
        families.setdefault(scenario.family, []).append(scenario)
    table = Table("family", "scenarios", "what it is", "such as", box=None, header_style="bold",
                  pad_edge=False)  # fmt: skip
    table.columns[1].justify = "right"
    for name, members in families.items():
        table.add_row(name, str(len(members)), summary(name), members[0].name)
    out.print(table)
    out.print("`desat list FAMILY` has a family's scenarios, `desat list --all` all of them",
              highlight=False, markup=False)  # fmt: skip
