"""What decides a verdict, an exit code or a time: a test for each mutation that survived."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from test_failures import binary, options, ssd, system

from desat.campaign.judged import requirement
from desat.language.scenario import Requirement
from desat.runs.run import prepare, simulate
from desat.system.errors import Exit

__all__ = ["binary", "system"]  # fixtures


def judged(values: list[float], completed: list[bool], **bounds: float) -> dict[str, object]:
    cases = np.arange(len(values))
    entry = Requirement(number="x", **bounds)
    return requirement(entry, {"x": np.array(values)}, np.array(completed), cases, Path("c"))


def test_a_case_that_failed_is_outside_whatever_its_numbers():
    """A failed row does carry finite numbers: those until it failed."""
    told = judged([1.0, 1.0, 1.0], [True, False, True], max=2.0)
    assert (told["within"], told["outside"], told["cases_outside"]) == (2, 1, [1])


@pytest.mark.parametrize("bounds", [{"max": 2.0}, {"min": 2.0}, {"min": 2.0, "max": 2.0}])
def test_a_number_at_its_limit_is_within(bounds):
    told = judged([2.0], [True], **bounds)
    assert (told["within"], told["outside"]) == (1, 0)


def test_a_bound_that_is_unmet_ends_a_run_with_1(desat, tmp_path):
    for bound, code in ((1e-30, Exit.UNMET), (1.0, Exit.COMPLETED)):
        file = tmp_path / "mine.toml"
        file.write_text(f'extends = "gyrostat/light"\nresidual_bound = {bound}\n')
        out = tmp_path / str(int(code))
        done = desat("run", str(file), "--stop", "20", "--no-twin", "--out", str(out))
        assert done.returncode == code
        assert ("momentum_residual" in done.stdout + done.stderr) >= (code == Exit.UNMET)


def test_rows_begin_at_the_start_time(system):
    (system / "SystemStructure.ssd").write_text(ssd(start="5", stop="15"))
    run = simulate(prepare(str(system), options("NOTHING")))
    assert run.results.times().tolist() == [5.0 + k for k in range(11)]
