"""Write a user's first block: a file that flies as it is, and its test.

For a manager it is a law in twenty lines; for another role it derives from a block of
the project and marks where to change it.
"""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from desat.components.contract.block import Block
from desat.components.contract.roles import Computer, Manager
from desat.fmus.own import SUFFIX, OwnBlockError, identifier
from desat.fmus.registry import block_class, names

from ..files import io
from ..system.errors import DesatError, nearest
from ..system.interface import role_classes

LAW = "law"


def write_law(file: Path, force: bool = False) -> list[Path]:
    """Write NAME.py, a manager, and test_NAME.py beside it; return both paths.

    Raises
    ------
    DesatError
        If no block can have the name, or one of the files exists and `force` is not
        set; then nothing is written.
    """
    return _write(file, LAW, {}, force)


def write(kind: str, file: Path | None, force: bool = False) -> list[Path]:
    """Write a block of a role, or one derived from a project's block, and its test.

    Without a file it is `my_ROLE.py`.

    Raises
    ------
    DesatError
        If `kind` is neither a role nor a block, or as in `write_law`.
    """
    roles = role_classes()
    if kind not in roles and kind not in names():
        raise DesatError(
            f"{kind}: no role and no block of ours{nearest(kind, {*roles, *names()})}"
        )
    file = file or Path(f"my_{kind}")
    if kind == Manager.role:
        return write_law(file, force)
    base = roles[kind].typical_block if kind in roles else kind
    return _write(file, "block", _description(base, block_class(base)), force)


def _description(base: str, block: type[Block]) -> dict[str, Any]:
    """Return the values of the template that describe the base block."""
    method, meaning = "advance", "A step: dt (s) from t (s) on."
    if issubclass(block, Computer):
        method, meaning = (
            "compute",
            "A step: dt (s) from t (s) on; it decides at its samples.",
        )
    elif hasattr(block, "measure"):
        method, meaning = (
            "measure",
            "A sample: its number, and the time since the last (s).",
        )
    function = inspect.signature(getattr(block, method))
    arguments = list(function.parameters.values())[1:]
    lines: dict[str, list[str]] = {"input": [], "output": []}
    for v in block.variables:
        if v.causality in lines and v.name != "fault":
            text = f"{v.name}: {v.description}"
            unit = f" ({v.unit})" if v.unit != "1" else ""
            lines[v.causality].append(text[: 86 - len(unit)] + unit)
    return {
        "base": base,
        "base_class": block.__name__,
        "method": method,
        "what": meaning,
        "arguments": ", ".join(f"{p.name}: {p.annotation}" for p in arguments),
        "names": ", ".join(p.name for p in arguments),
        "inputs": lines["input"],
        "outputs": lines["output"],
    }


def _write(file: Path, kind: str, more: Mapping[str, Any], force: bool) -> list[Path]:
    """Render the templates of a block and its test, and return their paths."""
    if not file.name:
        raise DesatError(f"NAME {file}: a file's name is needed, as my_{kind}")
    file = file if file.suffix == SUFFIX else file.with_name(file.name + SUFFIX)
    try:
        name = identifier(str(file))
    except OwnBlockError as error:
        raise DesatError(str(error)) from None
    templates = {file: f"{kind}.py", file.with_name(f"test_{file.name}"): "test.py"}
    for path in templates:
        if path.exists() and not force:
            raise DesatError(f"{path}: it exists; --force writes over it")
        io.place_of(path)
    from ..files.templates import text_templates

    environment = text_templates(kind)
    words = [w for w in name.split("_") if w]
    values = {
        "name": name,
        "cls": "".join(w[:1].upper() + w[1:] for w in words) or "Mine",
        "title": " ".join(words).capitalize() or "A block",
        **more,
    }
    if values["cls"] == values.get("base_class"):
        values["cls"] = f"{values['cls']}Mine"
    file.parent.mkdir(parents=True, exist_ok=True)
    for path, template in templates.items():
        text = environment.get_template(f"{template}.jinja").render(values)
        io.replace_text(path, text)
    return list(templates)
