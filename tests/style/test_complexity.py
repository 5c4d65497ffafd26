"""Functions stay small: how many exceed ten decisions or forty statements may only shrink."""

from __future__ import annotations

import ast
import json
import subprocess
import sys
from pathlib import Path

from tests.conftest import ROOT
from tests.style.source import nodes_of

#: Functions above ruff's C901 at 10 or PLR0915 at 40, and the reason. The list may only
#: shrink.
SEQUENCE = "a script that is read from top to bottom, step by step as the other program"
ONE_STORY = "a test of one course of events, whose steps follow from each other"
TOO_LARGE = {
    "benchmarks/basilisk_day.py built": SEQUENCE,
    "benchmarks/basilisk_loop.py main": SEQUENCE,
    "benchmarks/basilisk_plant.py main": SEQUENCE,
    "benchmarks/detumbling.py detumbled": "the loop over samples of many crafts at once",
    "benchmarks/laws.py cost": SEQUENCE,
    "benchmarks/monolith.py run": "a whole loop in one function, which it is there to be",
    "benchmarks/release.py main": SEQUENCE,
    "benchmarks/run.py fmpy": SEQUENCE,
    "benchmarks/sizing.py estimated": "an independent estimate, written apart from ours",
    "components/maths/kalman.py predict": "loops over matrices whose zeros it leaves out",
    "components/physics/rigid_body.py slopes": "unpacks what its inner function needs",
    "components/physics/rigid_body.py slope": "where a simulation spends its time",
    "orchestrator/engine/compiled.py _rows": "one case for each kind of operation",
    "orchestrator/engine/recording/recorder.py __init__": "one field after the other",
    "orchestrator/export/loop_fmu.py _variables": "could be split: inputs, outputs, others",
    "orchestrator/papers/analyses/unloading.py numbers": "one entry for each number",
    "orchestrator/runs/step_case.py step": "could be split: begin, step, end of a run",
    "orchestrator/sizing/model.py fly": "the recursion over rows, and what it prepares",
    "orchestrator/sizing/sizing.py size": "one field of the answer after the other",
    "tests/mutations.py choose_tests": "could be split: draw, then fill up",
    "tests/mutations.py main": SEQUENCE,
    "tests/campaign/test_campaign.py test_clusters_that_do_not_serve": ONE_STORY,
    "tests/fmus/test_fmi3.py test_what_it_refuses_it_says": ONE_STORY,
    "tests/fmus/test_native.py test_block_and_both_fmus_are_bitwise_alike": ONE_STORY,
    "tests/files/test_ssp.py test_scenario_files": ONE_STORY,
    "tests/web/test_page.py "
    "test_a_slider_moved_in_a_browser_gives_what_the_shown_line_prints": ONE_STORY,
}
FOLDERS = ("benchmarks", "components", "docs", "fmus", "orchestrator", "tests")
RULES = [
    "--isolated",
    "--select",
    "C901,PLR0915",
    "--config",
    "lint.mccabe.max-complexity = 10",
    "--config",
    "lint.pylint.max-statements = 40",
]


def name_of(file: Path, line: int) -> str:
    """Return file and name of the function that begins at a line."""
    (name,) = (
        node.name
        for node in nodes_of(file)
        if isinstance(node, ast.FunctionDef) and node.lineno == line
    )
    return f"{file.relative_to(ROOT).as_posix()} {name}"


def test_no_more_functions_are_too_large() -> None:
    command = [sys.executable, "-m", "ruff", "check", *RULES, "--output-format", "json"]
    process = subprocess.run(
        [*command, *FOLDERS], cwd=ROOT, text=True, capture_output=True, check=False
    )
    large_functions = {
        name_of(Path(entry["filename"]), entry["location"]["row"])
        for entry in json.loads(process.stdout)
    }
    assert large_functions == set(TOO_LARGE), (
        "a function is too large, or one no longer is"
    )
