"""Exchange between components of different rates: what is handed on is handed on whole."""

from __future__ import annotations

import json
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from desat.engine.operations import Part, Places, WindowMean
from desat.export.packing import pack
from desat.runs.run import Options, execute, prepare
from desat.system.errors import DesatError, Exit
from desat.system.model import Connection
from desat.system.schedule import Rates, graded, late

numbers = st.floats(-1e3, 1e3)
counts = st.integers(1, 12)
TARGET = Places.of([2], [3])


def source(has_slope: bool = True) -> Places:
    return Places.of([0], [1 if has_slope else -1])


@given(counts, st.integers(1, 3))
def test_windows_follow_each_other_and_fill_the_time(count, steps):
    """Parts go on from step to step, and those of a slow component's window are shares
    of it."""
    rates = Rates(graded(count), {}, frozenset())
    assert rates.edge(steps * count) == steps
    assert rates.edge(steps * count + count - 1) == steps + graded(count)[-1][0]
    window = rates.window(1, steps * count)
    assert window[0][0] == 0.0
    assert sum(w for _, w in window) == pytest.approx(1.0)
    for (a, w), (b, _) in pairwise(window):
        assert a + w == pytest.approx(b)


@given(counts)
def test_parts_fill_the_step_and_grow(count):
    parts = graded(count)
    assert parts[0][0] == 0.0
    assert sum(w for _, w in parts) == pytest.approx(1.0, abs=1e-15)
    growth = [b[1] / a[1] for a, b in pairwise(parts)]
    assert growth == pytest.approx([4.5 ** (1 / count)] * (count - 1))


@given(numbers, numbers, counts)
def test_a_line_cut_and_joined_is_itself(mean, slope, count):
    parts = graded(count)
    half_lines = np.array([mean, slope, 0.0, 0.0])
    whole_line = np.zeros(4)
    part, full = (
        Part(half_lines, source(), TARGET, parts),
        WindowMean(whole_line, source(), whole_line, TARGET, parts),
    )
    for i in range(count):
        part(i)
        whole_line[:2] = half_lines[2:]
        full(i)
    size = max(abs(mean), abs(slope), 1.0)
    assert whole_line[2:] == pytest.approx([mean, slope], abs=1e-13 * size)


@given(st.lists(st.tuples(numbers, numbers), min_size=1, max_size=9), st.booleans())
def test_joined_parts_keep_integral_and_first_moment(values, has_slope):
    parts = graded(len(values))
    live = np.zeros(4)
    full = WindowMean(live, source(has_slope), live, TARGET, parts)
    integral = moment = 0.0
    for i, ((m, p), (a, w)) in enumerate(zip(values, parts, strict=True)):
        p = p if has_slope else 0.0
        live[0], live[1] = m, p
        full(i)
        integral += w * m
        # of m + p (u - 1/2) times s = a + w u, u from 0 to 1
        moment += w * (m * (a + 0.5 * w) + p * w / 12.0)
    assert live[2] == pytest.approx(integral, abs=1e-11)
    assert live[2] / 2.0 + live[3] / 12.0 == pytest.approx(moment, abs=1e-10)


def links(*pairs: str) -> list[Connection]:
    return [Connection(a, "y", b, "u") for a, b in (pair.split(">") for pair in pairs)]


def test_equal_rates_step_as_they_are():
    assert late(links("a>b", "b>c"), {"a": 3, "b": 3, "c": 3}) == (frozenset(), [])


def test_a_slow_receiver_steps_at_the_end_and_so_do_those_after_it():
    every = {"a": 1, "b": 10, "c": 10, "d": 10}
    assert late(links("a>b", "b>c", "d>c"), every) == (frozenset("bc"), [])


def test_a_slow_source_steps_at_the_start():
    assert late(links("a>b"), {"a": 10, "b": 1}) == (frozenset(), [])


def test_rates_that_do_not_nest_are_refused():
    _, problems = late(links("a>b"), {"a": 2, "b": 3})
    assert len(problems) == 1
    assert "a.y -> b.u" in problems[0]
    assert "multiple" in problems[0]


def test_a_slow_one_between_two_fast_ones_is_refused_by_name():
    stepping, problems = late(links("a>b", "b>c"), {"a": 1, "b": 10, "c": 1})
    assert stepping == {"b"}
    assert len(problems) == 1
    for word in ("b.y -> c.u", "a.y -> b.u", "step ratio of 10", "c steps 10 times"):
        assert word in problems[0]


def scenario(folder: Path, **keys: object) -> str:
    """gyrostat/full with other keys, as a file."""
    file = folder / "mine.toml"
    lines = [
        f"{k} = {json.dumps(v)}" for k, v in keys.items() if not isinstance(v, dict)
    ]
    tables = [
        f"[{k}]\n" + "\n".join(f"{n} = {v[n]}" for n in v)
        for k, v in keys.items()
        if isinstance(v, dict)
    ]
    text = "\n".join(['extends = "gyrostat/full"', *lines, *tables])
    file.write_text(text, encoding="utf-8")
    return str(file)


def final(target: str, **options: object):
    """Attitude (4,) and the wheels' momentum (4,) at the end of 20 s, and the run's
    manifest."""
    result = execute(target, Options(stop=20.0, **options))
    assert result.ok, result.manifest["message"]
    ends = [result.results.values(n)[-1] for n in ("spacecraft.q_bi", "wheels.h_wheel")]
    result.results.close()
    return (*ends, result.manifest)


@pytest.fixture(scope="module")
def truth():
    """gyrostat/full at a step where its error is below 1e-12."""
    return final("gyrostat/full", step=0.0125, blocks=True)


@pytest.mark.parametrize(
    "slow", [["spacecraft"], ["wheels"], ["spacecraft", "wheels"], ["torquers"]]
)
def test_rates_lose_no_momentum_and_little_accuracy(tmp_path, truth, slow):
    target = scenario(tmp_path, step=0.1, step_ratio=dict.fromkeys(slow, 10))
    q, h, manifest = final(target, blocks=True)
    assert manifest["numbers"]["momentum_residual"]["value"] < 1e-14
    assert manifest["unmet"] == []
    # one value in ten without a mean gave 2e-2 rad and 5e-2 N m s
    assert np.abs(q - truth[0]).max() < 2e-7
    assert np.abs(h - truth[1]).max() < 2e-7


def test_rates_that_cannot_be_are_refused_by_name(tmp_path):
    target = scenario(tmp_path, step=0.1, step_ratio={"wheels": 3, "spacecraft": 2})
    with pytest.raises(DesatError, match=r"wheels\.tau_mean_wheel.*multiple"):
        prepare(target, Options(blocks=True)).or_raise()


def test_held_values_are_said(tmp_path):
    target = scenario(tmp_path, step=0.1, step_ratio={"spacecraft": 10})
    case = prepare(target, Options(blocks=True))
    assert any("held for 10 steps" in w and "omega_bi_body" in w for w in case.warnings)
    timing = {str(c): t for c, t in case.or_raise()[1].timing}
    assert (
        timing["wheels.tau_mean_wheel[1] -> spacecraft.tau_mean_wheel[1]"]
        == "mean of 10 steps"
    )
    assert timing["wheels.h_wheel[1] -> spacecraft.h_wheel[1]"] == "at the start"


def test_substeps_converge(tmp_path, truth):
    errors = []
    for substeps in (1, 2, 4, 8):
        q, _, manifest = final(scenario(tmp_path, substeps=substeps), blocks=True)
        assert manifest["substeps"] == substeps
        assert manifest["numbers"]["momentum_residual"]["value"] < 1e-14
        errors.append(np.abs(q - truth[0]).max())
    assert all(b < a / 4.0 for a, b in pairwise(errors)), errors
    assert errors[-1] < 1e-10


def test_substeps_have_the_same_bits_as_fmus_and_as_a_packed_system(tmp_path):
    target = scenario(tmp_path, substeps=3, step_ratio={"guidance": 2})
    package = tmp_path / "mine.ssp"
    pack(prepare(target, Options()).or_raise()[0], package)
    results = [final(target, blocks=True), final(target), final(str(package))]
    for q, h, manifest in results:
        assert manifest["substeps"] == 3
        assert q.tobytes() == results[0][0].tobytes()
        assert h.tobytes() == results[0][1].tobytes()


def test_rows_of_substeps_have_states_of_the_start_and_means_of_the_step(tmp_path):
    result = execute(scenario(tmp_path, substeps=4), Options(stop=20.0, blocks=True))
    h, mean = (
        result.results.values(f"wheels.{n}") for n in ("h_wheel", "tau_mean_wheel")
    )
    result.results.close()
    assert len(h) == 21
    assert np.diff(h, axis=0) == pytest.approx(mean, abs=1e-15)


def test_a_lost_momentum_ends_with_1(tmp_path):
    target = scenario(tmp_path, residual_bound=1e-18)
    result = execute(target, Options(stop=20.0, blocks=True))
    assert result.ok
    assert result.code == Exit.UNMET
    assert "momentum_residual" in result.manifest["unmet"][0]
    assert "residual_bound = 1e-18" in result.manifest["unmet"][0]


def test_what_jacobi_leaves_out_is_said(tmp_path):
    substeps = prepare(
        scenario(tmp_path, substeps=4), Options(algorithm="jacobi", blocks=True)
    )
    assert any("substeps = 4 has no effect" in w for w in substeps.warnings)
    target = scenario(tmp_path, step=0.1, step_ratio={"wheels": 10})
    rates = prepare(target, Options(algorithm="jacobi", blocks=True))
    assert any("momentum is not conserved" in w for w in rates.warnings)
    assert not prepare("gyrostat/full", Options(algorithm="jacobi")).warnings
