"""Write the pages of families from their templates, with numbers and figures of runs
made now.

The template is page.md beside the scenarios; draws that are outdated are made anew.
"""

from __future__ import annotations

import argparse
import os
import sys
from math import inf
from pathlib import Path

from desat.system.errors import DesatError

from ..validation.verbs import ValidationVerbs
from . import writing


def main() -> int:
    """The command."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.pages", description=__doc__
    )
    parser.add_argument(
        "families", nargs="*", metavar="FAMILY", help="default: all that have one"
    )
    parser.add_argument(
        "--into", type=Path, help="write to INTO/FAMILY (default: docs/papers)"
    )
    parser.add_argument(
        "--draft",
        type=float,
        metavar="SECONDS",
        help="to try a template: runs end after so many seconds",
    )
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    arguments = parser.parse_args()
    if arguments.draft is not None and not 1.0 <= arguments.draft < inf:
        parser.error(f"--draft {arguments.draft:g}: seconds from 1 on are needed")
    try:
        for family in arguments.families or writing.families():
            into = arguments.into / family if arguments.into is not None else None
            result = writing.write(
                family, into, arguments.jobs, arguments.draft, ValidationVerbs
            )
            print(*map(os.path.relpath, result), sep="\n")
    except DesatError as error:
        print(f"error: {error}", file=sys.stderr)
        return int(error.code)
    return 0


if __name__ == "__main__":
    sys.exit(main())
