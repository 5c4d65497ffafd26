"""A block of one's own to begin with: a file that flies as it is, and its test. Of a
manager it is a law in twenty lines; of another role a block of ours, to be changed
where it says so."""

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
    """Write NAME.py, a manager, and test_NAME.py beside it; both. Raises DesatError for
    a name that no block can have, and where one of them exists already, unless `force`;
    then nothing is written."""
    return _write(file, LAW, {}, force)


def write(what: str, file: Path | None, force: bool = False) -> list[Path]:
    """Write a block of a role, or one that derives from a block of ours, and its test,
    as `write_law`; without a file `my_ROLE.py`. Raises DesatError for what is neither,
    too."""
    roles = role_classes()
    if what not in roles and what not in names():
        raise DesatError(
            f"{what}: no role and no block of ours{nearest(what, {*roles, *names()})}"
        )
    file = file or Path(f"my_{what}")
    if what == Manager.role:
        return write_law(file, force)
    base = roles[what].typical_block if what in roles else what
    return _write(file, "block", _description(base, block_class(base)), force)


def _description(base: str, block: type[Block]) -> dict[str, Any]:
    """What the template says of the block that one begins with."""
    method, what = "advance", "A step: dt (s) from t (s) on."
    if issubclass(block, Computer):
        method, what = (
            "compute",
            "A step: dt (s) from t (s) on; it decides at its samples.",
        )
    elif hasattr(block, "measure"):
        method, what = (
            "measure",
            "A sample: its number, and the time since the last (s).",
        )
    function = inspect.signature(getattr(block, method))
    given = list(function.parameters.values())[1:]
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
        "what": what,
        "arguments": ", ".join(f"{p.name}: {p.annotation}" for p in given),
        "names": ", ".join(p.name for p in given),
        "inputs": lines["input"],
        "outputs": lines["output"],
    }


def _write(file: Path, kind: str, more: Mapping[str, Any], force: bool) -> list[Path]:
    if not file.name:
        raise DesatError(f"NAME {file}: a file's name is needed, as my_{kind}")
    file = file if file.suffix == SUFFIX else file.with_name(file.name + SUFFIX)
    try:
        name = identifier(str(file))
    except OwnBlockError as error:
        raise DesatError(str(error)) from None
    made = {file: f"{kind}.py", file.with_name(f"test_{file.name}"): "test.py"}
    for path in made:
        if path.exists() and not force:
            raise DesatError(f"{path}: it exists; --force writes over it")
        io.place_of(path)
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("desat", f"templates/{kind}"),
        undefined=StrictUndefined,
        keep_trailing_newline=True,
    )
    words = [w for w in name.split("_") if w]
    told = {
        "name": name,
        "cls": "".join(w[:1].upper() + w[1:] for w in words) or "Mine",
        "title": " ".join(words).capitalize() or "A block",
        **more,
    }
    if told["cls"] == told.get("base_class"):
        told["cls"] = f"{told['cls']}Mine"
    file.parent.mkdir(parents=True, exist_ok=True)
    for path, template in made.items():
        text = environment.get_template(f"{template}.jinja").render(told)
        io.replace_text(path, text)
    return list(made)
