"""Show the progress of long work on standard error.

It is a bar on a terminal, a line that is overwritten in a notebook, and a line a minute
elsewhere.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

MINUTE = 60.0  # s, between lines where output is neither a terminal nor a notebook
BLINK = 0.5  # s, between updates of a notebook's line

_is_quiet = False  # whether no progress is shown (`--quiet`)


def quiet(is_quiet: bool) -> None:
    """Show no progress from now on, or show it again."""
    global _is_quiet
    _is_quiet = is_quiet


# Function that takes the number of finished parts, and a further text.
Tell = Callable[[int, str], None]


def in_notebook() -> bool:
    """Return whether this runs in a notebook's kernel."""
    shell = sys.modules.get("IPython")
    interpreter = shell.get_ipython() if shell is not None else None
    return (
        interpreter is not None and type(interpreter).__name__ == "ZMQInteractiveShell"
    )


@contextmanager
def progress(
    title: str, total: int, is_shown: bool = True, done: int = 0
) -> Iterator[Tell]:
    """Show the progress of `total` parts within the context.

    It yields the function to report progress with. `done` parts were made before.
    """
    if not is_shown or not total or _is_quiet:
        yield lambda count, text: None
    elif sys.stderr.isatty():
        with _bar(title, total, done) as tell:
            yield tell
    else:
        yield from _lines(title, total, done)


@contextmanager
def stages(is_shown: bool = True) -> Iterator[Callable[[str], None]]:
    """Show the current stage of work of unknown length, and how long it has run."""
    from rich.console import Console

    began = last = time.monotonic()

    def line(text: str) -> None:
        """Print a stage, at once in a notebook and at most once a minute elsewhere."""
        nonlocal last
        now = time.monotonic()
        if is_shown and (in_notebook() or now - last > MINUTE):
            last = now
            print(
                f"{text} ... ({now - began:.0f} s so far)", file=sys.stderr, flush=True
            )

    is_shown = is_shown and not _is_quiet
    if not (is_shown and sys.stderr.isatty()):
        yield line
        return
    with Console(stderr=True, emoji=False, markup=False).status("") as status:
        yield lambda text: status.update(
            f"{text} ... ({time.monotonic() - began:.0f} s so far)"
        )


@contextmanager
def _bar(title: str, total: int, done: int) -> Iterator[Tell]:
    """Show a bar on a terminal."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.percentage:.0f} %"),
        TextColumn("{task.fields[told]}"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, transient=True, console=Console(stderr=True)) as bar:
        task = bar.add_task(title, total=total, completed=done, told="")
        yield lambda count, text: bar.update(task, completed=count, told=text)


def _lines(title: str, total: int, done: int) -> Iterator[Tell]:
    """Print lines, or overwrite a line in a notebook."""
    notebook = in_notebook()
    began = last = time.monotonic()
    begin, end = ("\r", "") if notebook else ("", "\n")

    def tell(count: int, text: str) -> None:
        """Print the progress, with the time that is left, when the next line is due."""
        nonlocal last
        now = time.monotonic()
        if now - last < (BLINK if notebook else MINUTE) and not (
            notebook and count >= total
        ):
            return
        last = now
        rate = (count - done) / (now - began)
        time_left = f", {(total - count) / rate:.0f} s left" if rate > 0.0 else ""
        line = f"{title}: {100.0 * count / total:.0f} % done{', ' * bool(text)}{text}{time_left}"
        print(f"{begin}{line}", end=end, file=sys.stderr, flush=True)

    yield tell
    if notebook:
        print(file=sys.stderr)
