"""How far a campaign is, for people and for programs."""

from __future__ import annotations

import os
import platform
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from . import damaged
from .plan import read

STATUS = "status.json"
_LINE = 60.0
"""Seconds from one line to the next where no terminal looks on."""


@dataclass
class Progressed:
    """How far a campaign is."""

    count: int
    done: int
    failed: int
    began: float = field(default_factory=time.monotonic)
    first: int = 0

    @property
    def rate(self) -> float:
        """Cases a second since this head began."""
        return (self.done - self.first) / max(time.monotonic() - self.began, 1e-9)

    def as_json(self, state: str) -> dict[str, Any]:
        """What `status.json` says."""
        left = (self.count - self.done) / self.rate if self.rate else None
        return {"state": state, "count": self.count, "done": self.done, "failed": self.failed,
                "cases_per_second": round(self.rate, 3),
                "seconds_left": None if left is None else round(left),
                "head": f"{platform.node()}:{os.getpid()}", "written": time.time()}  # fmt: skip

    def line(self) -> str:
        """The same for people."""
        left = (self.count - self.done) / self.rate if self.rate else float("nan")
        return (
            f"{self.done} of {self.count} done, {self.failed} failed, "
            f"{self.rate:.1f} a second, {left:.0f} s left"
        )


class Shown:
    """Progress: a bar where a person looks, a line a minute elsewhere."""

    def __init__(self, at: Progressed, wanted: bool) -> None:
        self._at, self._wanted, self._last = at, wanted, time.monotonic()
        console = Console(stderr=True)
        self._bar = Progress(
            TextColumn("cases"), BarColumn(), MofNCompleteColumn(),
            TextColumn("{task.fields[told]}"), TimeRemainingColumn(), console=console,
            transient=True,
        ) if wanted and console.is_terminal else None  # fmt: skip

    def __enter__(self) -> Any:
        if self._bar is not None:
            self._bar.start()
            self._task = self._bar.add_task(
                "", total=self._at.count, completed=self._at.done, told=""
            )
        return self._show

    def _show(self) -> None:
        if self._bar is not None:
            told = f"{self._at.failed} failed, {self._at.rate:.1f} a second"
            self._bar.update(self._task, completed=self._at.done, told=told)
        elif self._wanted and time.monotonic() - self._last > _LINE:
            self._last = time.monotonic()
            print(self._at.line(), file=sys.stderr, flush=True)

    def __exit__(self, *_: object) -> None:
        if self._bar is not None:
            self._bar.stop()


def status(folder: Path) -> dict[str, Any]:
    """How far a campaign is, as its head wrote last. Raises DesatError where there is none."""
    plan = read(folder)
    blank = {"state": "running", "count": plan.count, "done": 0, "failed": 0}
    try:
        told = {**blank, **damaged.table(folder / STATUS)}
    except FileNotFoundError:
        told = blank
    head, _, pid = str(told.get("head", "")).rpartition(":")
    if told["state"] == "running" and head == platform.node() and not (
        pid.isdecimal() and _lives(int(pid))
    ):  # fmt: skip
        told["state"] = "killed"
    return told


def _lives(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        pass
    return True
