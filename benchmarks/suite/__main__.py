"""`python -m benchmarks.suite [HOST ...] [--write FOLDER] [--keep]`: all systems of the
suite in each host that is here, and a table of what came of them.

Each system and host has a process of its own. `--write` writes the .ssp files and
expected.json for other tools, `--keep` the table into docs/hosts.md.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import math
import os
import signal
import subprocess
import sys
import tempfile
from collections import defaultdict
from datetime import date
from importlib.metadata import version
from pathlib import Path
from textwrap import fill

from rich.progress import track

from benchmarks.hosts import PAGE
from desat.engine.current_call import describe_exit
from desat.fmus.compiler import NoCompilerError, zig

from .files import System, package
from .hosts import HOSTS, PACKAGES, is_for
from .systems import GROUPS, systems

BEGIN, END = "<!-- made by `python -m benchmarks.suite` -->", "<!-- to here -->"
LIMIT = 10.0  # s: of the process of a system
TOLERANCE = 1e-9  # relative, of a number
REFUSAL = "refused, which is allowed"
PASSES = ("", REFUSAL)
MARK = "TOLD "  # begins the line of a process that has an outcome


def judge(system: System, outcome: dict[str, object]) -> str:
    """Return what is wrong with the outcome of a system, or one of PASSES.

    Parameters
    ----------
    system
        The system.
    outcome
        `numbers` by name, or `message` of a refusal, or `ended`: how the process did.
    """
    if ended := outcome.get("ended"):
        return str(ended)
    if message := outcome.get("message"):
        if not system.refused:
            return f"refused: {message}"
        return REFUSAL if system.numbers else ""
    numbers = outcome["numbers"]
    assert isinstance(numbers, dict)
    if not system.numbers:
        return "runs to the end without a message"
    for name, value in system.numbers.items():
        if not math.isclose(numbers[name], value, rel_tol=TOLERANCE):
            return f"{numbers[name]:g}, not {value:g}"
    return ""


def run(host: str, system: System, path: Path) -> dict[str, object]:
    """Run a system in this process; whatever a host raises is a refusal."""
    try:
        return {"numbers": HOSTS[host](system, path)}
    except Exception as error:
        lines = str(error).strip().splitlines()
        message = lines[0] if lines else type(error).__name__
        return {"message": message.replace(f"{path.parent}/", "")}


def run_apart(host: str, name: str, path: Path) -> dict[str, object]:
    """Run a system in a process of its own, all of whose files are beside `path`."""
    folder = path.parent / "tmp" / "inner"
    folder.mkdir(parents=True)
    command = [sys.executable, "-m", "benchmarks.suite", "--child", name, str(path)]
    process = subprocess.Popen(
        [*command, host],
        env={**os.environ, "TMPDIR": str(folder)},
        text=True,
        errors="replace",
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    try:
        out, _ = process.communicate(timeout=LIMIT)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.communicate()
        return {"ended": f"does not end within {LIMIT:g} s"}
    if any(path.parent.rglob("outside.txt")):
        return {"ended": "writes outside its folder"}
    lines = [x for x in out.splitlines() if x.startswith(MARK)]
    if not lines:
        code = process.returncode
        status = describe_exit(-code if code < 0 else code << 8)
        return {"ended": f"ends the process: {status}"}
    outcome: dict[str, object] = json.loads(lines[-1].removeprefix(MARK))
    return outcome


def write(folder: Path) -> None:
    """Write all systems and expected.json."""
    try:
        zig()
        platforms = "linux64,win64"
    except NoCompilerError:
        platforms = ""
    folder.mkdir(parents=True, exist_ok=True)
    expected = {}
    for name, (group, system) in systems().items():
        (folder / f"{name}.ssp").write_bytes(package(system, platforms))
        expected[name] = {
            "group": group,
            "about": system.about,
            "step": 1.0,
            "stop": system.stop,
            "numbers": system.numbers,
            "refusal_allowed": system.refused,
        }
    text = json.dumps(expected, indent=1, ensure_ascii=False)
    (folder / "expected.json").write_text(text + "\n", encoding="utf-8")


def outcomes(host: str) -> dict[str, str]:
    """Run all systems that are for a host: what is wrong with each."""
    faults = {}
    chosen = {n: s for n, (_, s) in systems().items() if is_for(host, s)}
    for name in track(chosen, host, transient=True, disable=not sys.stderr.isatty()):
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / f"{name}.ssp"
            path.write_bytes(package(chosen[name]))
            faults[name] = judge(chosen[name], run_apart(host, name, path))
    return faults


def table(results: dict[str, dict[str, str]]) -> str:
    """Return the table of what each host does, and beneath it what is wrong."""
    group_of = {name: group for name, (group, _) in systems().items()}
    lines = [f"| group | {' | '.join(results)} |", "|---" * (len(results) + 1) + "|"]
    for group in GROUPS:
        cells = []
        for faults in results.values():
            mine = [fault for name, fault in faults.items() if group_of[name] == group]
            cells.append(f"{sum(f in PASSES for f in mine)} of {len(mine)}")
        lines.append(f"| {group} | {' | '.join(cells)} |")
    lines.append("")
    for host, faults in results.items():
        names = defaultdict(list)
        for name, fault in faults.items():
            if fault:
                names[fault].append(f"`{name}`")
        for fault, found in names.items():
            lines.append(f"- {host}: {', '.join(found)}: {fault}")
    return "\n".join(lines) + "\n"


def keep(text: str, hosts: list[str]) -> None:
    """Write the table between its marks on the page."""
    versions = ", ".join(f"{h} {version(PACKAGES[h])}" for h in hosts)
    intro = fill(f"{date.today()}: {versions}; {len(systems())} systems.", 120)
    page = PAGE.read_text(encoding="utf-8")
    before, _, after = page.partition(BEGIN)
    after = after.partition(END)[2]
    PAGE.write_text(f"{before}{BEGIN}\n{intro}\n\n{text}{END}{after}", encoding="utf-8")


def main() -> None:
    """Run the systems, print the table, and keep or write what is asked for."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.suite")
    parser.add_argument("hosts", nargs="*", metavar="HOST", help=", ".join(HOSTS))
    parser.add_argument("--write", type=Path, metavar="FOLDER")
    parser.add_argument("--keep", action="store_true")
    parser.add_argument("--child", nargs=2, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if wrong := [host for host in options.hosts if host not in HOSTS]:
        parser.error(f"{wrong[0]}: there is {', '.join(HOSTS)}")
    if options.child:
        name, path = options.child
        outcome = run(options.hosts[0], systems()[name][1], Path(path))
        print(MARK + json.dumps(outcome), flush=True)
        return
    if options.write:
        write(options.write)
        return
    here = [h for h in HOSTS if importlib.util.find_spec(PACKAGES[h])]
    hosts = options.hosts or here
    text = table({host: outcomes(host) for host in hosts})
    print(text)
    if options.keep:
        keep(text, hosts)


if __name__ == "__main__":
    main()
