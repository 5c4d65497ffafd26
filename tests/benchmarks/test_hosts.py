"""The table of hosts: what is tried, told and kept of the page."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks import hosts
from desat.files import paths


def test_each_fmu_is_told_and_the_page_keeps_the_rest(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    native = paths.fmus() / "native" / "spacecraft_rigid.fmu"
    broken = tmp_path / "broken.fmu"
    broken.write_bytes(native.read_bytes()[:1000])
    answer = hosts.tried("desat", [broken, native])
    assert "broken.fmu: not a readable" in answer["broken"]["why"]
    theirs = hosts.tried("FMPy", [native])
    assert hosts.same(answer["spacecraft_rigid"]["outputs"], theirs["spacecraft_rigid"])
    other = {**theirs["spacecraft_rigid"]["outputs"], "q_bi[3]": 0.5}
    assert not hosts.same(other, theirs["spacecraft_rigid"])
    page = tmp_path / "hosts.md"
    page.write_text(f"before\n{hosts.BEGIN}\nold\n{hosts.END}\nafter\n")
    monkeypatch.setattr(hosts, "PAGE", page)
    hosts.write(["| native | 1 of 1 |"], ["- why"])
    text = page.read_text()
    assert text.startswith("before\n")
    assert text.endswith(f"- why\n{hosts.END}\nafter\n")
    assert "old" not in text


def test_an_fmu_that_ends_its_host_is_told_and_the_next_one_tried(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    lines = iter(
        ['TOLD {"fmu": "a.fmu", "outputs": {}}', 'TOLD {"fmu": "c.fmu", "why": "x"}']
    )

    class Done:
        def __init__(self) -> None:
            self.stdout, self.returncode = next(lines), -11

    monkeypatch.setattr(hosts.subprocess, "run", lambda *a, **k: Done())
    answer = hosts.tried("C", [Path("a.fmu"), Path("b.fmu"), Path("c.fmu")])
    assert answer["b"] == {"why": "ends the process (-11)"}
    assert answer["c"] == {"why": "x"}
