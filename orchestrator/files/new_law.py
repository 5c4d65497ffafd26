"""A law of one's own to begin with: a manager's block file that flies as it is, and its test."""

from __future__ import annotations

from pathlib import Path

from desat.fmus.own import SUFFIX, OwnBlockError, identifier

from ..system.errors import DesatError


def write(file: Path, force: bool = False) -> list[Path]:
    """Write NAME.py and test_NAME.py beside it; both. Raises DesatError for a name that no block
    can have, and where one of them exists already, unless `force`; then nothing is written."""
    file = file if file.suffix == SUFFIX else file.with_name(file.name + SUFFIX)
    try:
        name = identifier(str(file))
    except OwnBlockError as error:
        raise DesatError(str(error)) from None
    made = {file: "law.py", file.with_name(f"test_{file.name}"): "test.py"}
    for path in made:
        if path.exists() and not force:
            raise DesatError(f"{path}: it exists; --force writes over it")
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("desat", "templates/law"), undefined=StrictUndefined,
        keep_trailing_newline=True,
    )  # fmt: skip
    words = [w for w in name.split("_") if w]
    told = {"name": name, "cls": "".join(w[:1].upper() + w[1:] for w in words) or "Law",
            "title": " ".join(words).capitalize() or "A law"}  # fmt: skip
    file.parent.mkdir(parents=True, exist_ok=True)
    for path, template in made.items():
        text = environment.get_template(f"{template}.jinja").render(told)
        path.write_text(text, encoding="utf-8")
    return list(made)
