"""The pages of the site that are made of the code: blocks, commands, and files beside
docs/."""

from __future__ import annotations

import base64
import inspect
import json
import os
import re
from pathlib import Path
from typing import Any

import equations
import typer
from typer.core import TyperGroup
from typer.main import get_command

from desat.cli import app_for
from desat.files.scenario import scenarios
from desat.fmus import registry
from desat.runs import explain
from desat.runs.drawings import loop_of_system
from desat.runs.prepare import prepare
from desat.system.interface import role_classes
from desat.system.options import Options

ROOT = Path(__file__).parents[1]
FOLDER = "generated"
NOTEBOOK = Path("tutorials/7-notebook.ipynb")
BESIDE = {"CONTRIBUTING.md": "contributing.md", "CHANGELOG.md": "changelog.md"}
"""Pages beside docs/, and what they are called here."""


def link(app: Any, page: str, source: list[str]) -> None:
    """Links to what is made here, in a page that names the file of the repository."""
    source[0] = re.sub(
        r"\]\(\.\./((?:\.\./)*)fmus/interfaces\.md",
        rf"](\1{FOLDER}/blocks.md",
        source[0],
    )


def write(docs: Path) -> None:
    """Write the pages below a folder of docs/."""
    folder = docs / FOLDER
    (folder / "blocks").mkdir(parents=True, exist_ok=True)
    pages = {"blocks.md": _blocks(), "commands.md": _commands()}
    drawn = _drawings()
    for name in registry.names():
        pages[f"blocks/{name}.md"] = _block(name, drawn.get(name))
    pages |= {f"blocks/{name}-loop.svg": text for name, (_, text) in drawn.items()}
    for name, here in BESIDE.items():
        text = (ROOT / name).read_text(encoding="utf-8")
        pages[here] = text.replace("](docs/", "](../")
    files = {name: text.encode() for name, text in pages.items()}
    files |= _notebook(docs / NOTEBOOK)
    for old in [p for form in ("md", "svg", "png") for p in folder.rglob(f"*.{form}")]:
        if str(old.relative_to(folder)) not in files:
            old.unlink()
    for name, content in files.items():
        file = folder / name
        if not file.exists() or file.read_bytes() != content:
            made = file.with_suffix(f".{os.getpid()}")  # two builds may run at a time
            made.write_bytes(content)
            made.replace(file)


def _notebook(file: Path) -> dict[str, bytes]:
    """The page of a notebook with its outputs, and its pictures, by their names."""
    lines: list[str] = []
    pictures: dict[str, bytes] = {}
    for cell in json.loads(file.read_text(encoding="utf-8"))["cells"]:
        source = "".join(cell["source"])
        if cell["cell_type"] == "markdown":
            lines += [source, ""]
            continue
        lines += ["```python", source, "```", ""]
        for output in cell["outputs"]:
            data = output.get("data", {})
            if "image/png" in data:
                name = f"{file.stem}-{len(pictures) + 1}.png"
                pictures[name] = base64.b64decode(data["image/png"])
                lines += [f"![{source.splitlines()[0]}]({name})", ""]
                continue
            text = "".join(output.get("text") or data.get("text/plain") or [])
            lines += ["```text", text.rstrip(), "```", ""]
    lines += [
        f"The notebook: {{download}}`{file.name} <../tutorials/{file.name}>`.",
        "",
    ]
    return {f"{file.stem}.md": "\n".join(lines).encode(), **pictures}


def _table(heads: list[str], rows: list[list[str]]) -> str:
    """A table, without the columns that are empty throughout."""
    full = [i for i in range(len(heads)) if any(row[i] for row in rows)]
    lines = [
        [heads[i] for i in full],
        ["---"] * len(full),
        *([r[i] for i in full] for r in rows),
    ]
    return "\n".join(
        "| " + " | ".join(x.replace("|", "\\|") for x in r) + " |" for r in lines
    )


def _blocks() -> str:
    rows = explain.blocks(None)[1]
    found, roles = {row["role"] for row in rows}, role_classes()
    lines = [
        "# Blocks",
        "",
        "Each block is an FMU: a file of `components/blocks/`, of which "
        "`make fmus` builds one of Python and one of C. Its page has the text, the equations "
        "and the variables that `desat help blocks NAME` prints. All blocks of a role have "
        "the role's connectors, so that one can stand for another.",
        "",
    ]
    for role in [*(r for r in roles if r in found), *sorted(found - set(roles))]:
        of = [
            [f"[`{r['block']}`](blocks/{r['block']}.md)", r["title"]]
            for r in rows
            if r["role"] == role
        ]
        said = roles[role].role_title if role in roles else ""
        lines += [
            f"## {said or role}",
            "",
            f"Role `{role}`.",
            "",
            _table(["block", ""], of),
            "",
        ]
    lines += [
        "```{toctree}",
        ":hidden:",
        "",
        *(f"{n} <blocks/{n}>" for n in registry.names()),
        "```",
        "",
    ]
    return "\n".join(lines)


def _drawings() -> dict[str, tuple[str, str]]:
    """Where each block flies, and the block there with its neighbours.

    A block that no scenario of ours has stands in the place of one of its role.
    """
    found: dict[str, tuple[str, str]] = {}
    places: dict[str, list[tuple[str, str]]] = {}  # role: scenario, component
    kinds = set()
    most: dict[str, int] = {}
    for name, scenario in scenarios().items():
        of = scenario.content
        kind = repr((scenario.family, of.craft, of.ssd, of.sources))
        if kind in kinds:
            continue
        kinds.add(kind)
        system, _ = prepare(name, Options()).or_raise()
        for component in system.components.values():
            places.setdefault(component.interface.role, []).append(
                (name, component.name)
            )
            model = component.interface.model
            wires = sum(
                component.name in (c.source, c.target) for c in system.connections
            )
            if wires > most.get(model, 0):  # where it has most neighbours
                most[model] = wires
                found[model] = f"`{name}`", loop_of_system(system, component.name)
    for block in registry.names():
        role = registry.block_class(block).role
        for name, component in places.get(role, []):
            if block in found:
                break
            case = prepare(name, Options(sources=[f"{component}={block}"]))
            if not case.problems:
                system, _ = case.or_raise()
                where = f"`{name}` with it as {component}"
                found[block] = where, loop_of_system(system, component)
    return found


def _block(name: str, drawn: tuple[str, str] | None) -> str:
    text, rows = explain.blocks(name)
    block = registry.block_class(name)
    said = inspect.getdoc(block) or name
    title, _, body = said.partition("\n")
    lines = [
        f"# {title}",
        "",
        f"Block `{name}`, role `{block.role}` ([all blocks](../blocks.md)).",
        "",
        _body(body),
    ]
    if drawn:
        lines += [
            f"![{name} with its neighbours]({name}-loop.svg)",
            "",
            f"*Its neighbours in {drawn[0]}.*",
            "",
        ]
    if laws := text.removeprefix(said).strip():
        lines += ["## Where it fits", "", *(f"- {x}" for x in laws.splitlines()), ""]
    heads = [
        "name",
        "meaning",
        "unit",
        "size",
        "start",
        "allowed",
        "usually",
        "needed by",
    ]
    for kind, says in (
        ("parameter", "Parameters"),
        ("input", "Inputs"),
        ("output", "Outputs"),
    ):
        of = [_variable(row) for row in rows if row["kind"] == kind]
        if of:
            lines += [
                f"## {says}",
                "",
                "```{container} wide",
                _table(heads, of),
                "```",
                "",
            ]
    return "\n".join(lines)


def _variable(row: dict[str, str]) -> list[str]:
    plain, _, size = row["name"].partition(" (")
    needed = ", ".join(f"`{x}`" for x in row["needed by"].split(", ") if x)
    unit = "" if row["unit"] == "1" else row["unit"]
    usually = f"`{row['usually']}`" if row["usually"] else ""
    return [
        f"`{plain}`",
        _escaped(row["meaning"]),
        unit,
        size.rstrip(")"),
        _start(row["start"]),
        row["allowed"],
        usually,
        needed,
    ]


def _start(text: str) -> str:
    """A start value as short as it can be."""
    short = re.sub(r"\d+\.\d{7,}", lambda x: f"{float(x[0]):.6g}", text)
    return (
        re.sub(r"\.0\b(?!e)", "", short)
        .replace("True", "true")
        .replace("False", "false")
    )


def _body(text: str) -> str:
    """A docstring as Markdown: what is indented are equations."""
    made = []
    for part in text.strip().split("\n\n"):
        lines = part.split("\n")
        if not all(line.startswith("    ") for line in lines):
            made.append(_escaped(part))
        elif tex := equations.block([line[4:] for line in lines]):
            made.append(f"```{{math}}\n{tex}\n```")
        else:
            made.append("```text\n" + "\n".join(line[4:] for line in lines) + "\n```")
    return "\n\n".join(made) + "\n"


def _escaped(text: str) -> str:
    """Plain text whose signs are no Markdown, but for code and bold."""
    parts = re.split(r"(`[^`]*`|\*\*)", text)
    return "".join(
        p if i % 2 else re.sub(r"([<\[\]*_$|])", r"\\\1", p)
        for i, p in enumerate(parts)
    )


def _commands() -> str:
    lines = [
        "# Commands",
        "",
        "Made from the commands themselves: the same text as "
        "`desat COMMAND --help`. What each is for: [reference](../reference.md#commands); "
        "exit codes: [reference](../reference.md#exit-codes-and-checks).",
        "",
    ]
    root = get_command(app_for([]))
    assert isinstance(root, TyperGroup)
    for words, command in _walk(["desat"], root):
        if isinstance(command, TyperGroup) and not command.invoke_without_command:
            continue
        context = typer.Context(command, info_name=" ".join(words))
        usage = " ".join([*words, *command.collect_usage_pieces(context)])
        lines += [
            f"## {' '.join(words)}",
            "",
            f"    {usage}",
            "",
            _escaped(inspect.cleandoc(command.help or "")),
            "",
        ]
        told = [p.get_help_record(context) for p in command.params if not p.hidden]
        if rows := [
            [f"`{names}`", _escaped(what)] for names, what in filter(None, told)
        ]:
            lines += ["```{container} wide", _table(["", ""], rows), "```", ""]
    return "\n".join(lines)


def _walk(words: list[str], command: Any) -> Any:
    if len(words) > 1:
        yield words, command
    if isinstance(command, TyperGroup):
        for name in sorted(command.commands):
            if not command.commands[name].hidden:
                yield from _walk([*words, name], command.commands[name])
