"""The bench of what commands cost: its command lines work, and CPU counts their
processes too."""

from __future__ import annotations

import subprocess
import sys

import pytest

from benchmarks import commands


def test_cost_counts_children_and_names_what_fails(tmp_path):
    busy = "import time\nwhile time.process_time() < 0.3: pass"
    child = f"import subprocess, sys; subprocess.run([sys.executable, '-c', {busy!r}])"
    cpu, wall = commands.cost([sys.executable, "-c", child], tmp_path)
    assert cpu > 0.3
    assert wall > 0.3
    with pytest.raises(subprocess.CalledProcessError):
        commands.cost([sys.executable, "-c", "raise SystemExit(2)"], tmp_path)


def test_the_lines_of_the_bench_are_commands_that_there_are():
    lines = commands.commands()
    assert {"base", "help", "check", "run_60_steps", "run_day", "tables"} <= set(lines)
    two_lines = {name: lines[name] for name in ("base", "help")}
    times = commands.measure(two_lines, rounds=1)
    assert times["base"]["over_base"] == 1.0
    assert times["help"]["cpu"] > 0.0
