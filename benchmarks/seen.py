"""What was made to fail, and what came of it: `seen.json`, from which a part of docs/failures.md is
written.

`keep` is called by the programs that make it (`same_bits`, `soak`, `killed`, `isolation`,
`targets`, `others`) when they are asked to with `--keep`; `python -m benchmarks.seen` writes the
part anew, and a test says where the page has another.
"""

from __future__ import annotations

import json
import os
import sys
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from filelock import FileLock

from desat.study.manifest import write_json

FILE = Path(__file__).with_name("seen.json")
PAGE = Path(__file__).parents[1] / "docs" / "failures.md"
BEGIN, END = "<!-- by python -m benchmarks.seen -->\n", "<!-- to here -->\n"
Seen = dict[str, dict[str, dict[str, Any]]]


def asked() -> bool:
    """Whether what is found is to be kept; the command line has the word for it no more."""
    if found := "--keep" in sys.argv:
        sys.argv.remove("--keep")
    return found


def known() -> Seen:
    """All that was kept: of what, in which part, what."""
    found: Seen = json.loads(FILE.read_text(encoding="utf-8")) if FILE.exists() else {}
    return found


def keep(of: str, part: str, what: dict[str, Any]) -> None:
    """Keep it, with the date and what else the machine did (its load average of a minute)."""
    about = {"date": datetime.now(UTC).date().isoformat(), "load": round(os.getloadavg()[0], 2)}
    with FileLock(FILE.with_suffix(".part")):
        seen = known()
        seen.setdefault(of, {})[part] = {**what, **about}
        write_json(FILE, dict(sorted(seen.items())))


def dates(parts: dict[str, dict[str, Any]]) -> str:
    """The day, or the first and the last day, of parts."""
    days = sorted({part["date"] for part in parts.values()})
    return " to ".join(dict.fromkeys((days[0], days[-1])))
