"""How far long work is: a bar on a terminal, a line that is written over in a notebook,
a line a minute elsewhere; all on standard error."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

MINUTE = 60.0
"""Seconds from one line to the next where nobody looks on."""
BLINK = 0.5
"""Seconds from one state of a notebook's line to the next."""

Tell = Callable[[int, str], None]
"""Takes how much is done, and what else there is to say of it."""


def in_notebook() -> bool:
    """Whether a notebook's kernel runs this."""
    shell = sys.modules.get("IPython")
    found = shell.get_ipython() if shell is not None else None
    return found is not None and type(found).__name__ == "ZMQInteractiveShell"


@contextmanager
def progress(
    title: str, total: int, wanted: bool = True, done: int = 0
) -> Iterator[Tell]:
    """Within: what is told of `total` parts, of which `done` were made before, is
    shown."""
    if not wanted or not total:
        yield lambda made, text: None
    elif sys.stderr.isatty():
        with _bar(title, total, done) as tell:
            yield tell
    else:
        yield from _lines(title, total, done)


@contextmanager
def stages(wanted: bool = True) -> Iterator[Callable[[str], None]]:
    """Within: the stage that work of unknown length is at is shown, and for how long it
    has run."""
    from rich.console import Console

    began = last = time.monotonic()

    def line(text: str) -> None:
        nonlocal last
        now = time.monotonic()
        if wanted and (in_notebook() or now - last > MINUTE):
            last = now
            print(
                f"{text} ... ({now - began:.0f} s so far)", file=sys.stderr, flush=True
            )

    if not (wanted and sys.stderr.isatty()):
        yield line
        return
    with Console(stderr=True, emoji=False, markup=False).status("") as status:
        yield lambda text: status.update(
            f"{text} ... ({time.monotonic() - began:.0f} s so far)"
        )


@contextmanager
def _bar(title: str, total: int, done: int) -> Iterator[Tell]:
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.percentage:.0f} %"),
        TextColumn("{task.fields[told]}"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, transient=True, console=Console(stderr=True)) as shown:
        task = shown.add_task(title, total=total, completed=done, told="")
        yield lambda made, text: shown.update(task, completed=made, told=text)


def _lines(title: str, total: int, done: int) -> Iterator[Tell]:
    notebook = in_notebook()
    began = last = time.monotonic()
    begin, end = ("\r", "") if notebook else ("", "\n")

    def tell(made: int, text: str) -> None:
        nonlocal last
        now = time.monotonic()
        if now - last < (BLINK if notebook else MINUTE) and not (
            notebook and made >= total
        ):
            return
        last = now
        rate = (made - done) / (now - began)
        left = f", {(total - made) / rate:.0f} s left" if rate > 0.0 else ""
        said = (
            f"{title}: {100.0 * made / total:.0f} % done{', ' * bool(text)}{text}{left}"
        )
        print(f"{begin}{said}", end=end, file=sys.stderr, flush=True)

    yield tell
    if notebook:
        print(file=sys.stderr)
