"""How far a target travels through the code before it can run, counted on the running
program.

    python tests/way.py TARGET

TARGET as `desat run` takes it. `prepare` is called with it, and every call of a
function of the orchestrator is followed. Printed, as JSON: `functions`, different ones
that ran; `calls`, different pairs of caller and callee in two files; `total`, all
calls. Joining files lowers the second alone.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable
from types import FrameType
from typing import Any

Place = tuple[str, str]
"""File and function, without what is defined within it."""


def follow_call(call: Callable[[], object], root: str) -> dict[str, int]:
    """What a call goes through of the files below a folder."""
    functions: set[Place] = set()
    pairs: set[tuple[Place, Place]] = set()
    total = 0

    def place(frame: FrameType) -> Place:
        name = frame.f_code.co_qualname.split(".<locals>.<")[
            0
        ]  # a comprehension's is its owner's
        return frame.f_code.co_filename, name

    def profile(frame: FrameType, event: str, argument: Any) -> None:
        nonlocal total
        if event != "call" or not frame.f_code.co_filename.startswith(root):
            return
        total += 1
        here, back = place(frame), frame.f_back
        while back is not None and not back.f_code.co_filename.startswith(root):
            back = back.f_back
        if back is not None and place(back)[0] != here[0]:
            pairs.add((place(back), here))
        functions.add(here)

    sys.setprofile(profile)
    try:
        call()
    finally:
        sys.setprofile(None)
    named_functions = [
        name for _, name in functions if not name.rpartition(".")[2].startswith("<")
    ]
    return {"functions": len(named_functions), "calls": len(pairs), "total": total}


def main() -> None:
    import desat
    from desat.runs.prepare import prepare
    from desat.system.options import Options

    root = os.path.realpath(os.path.dirname(desat.__file__)) + "/"
    print(json.dumps(follow_call(lambda: prepare(sys.argv[1], Options()), root)))


if __name__ == "__main__":
    main()
