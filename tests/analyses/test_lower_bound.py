"""The lower bound on firing time: the prototype's values, and runs above it."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from desat.analyses import lower_bound
from desat.components.maths import vector
from desat.files.build import build
from desat.runs.checks import check_draft
from desat.runs.run import Options, execute
from desat.system.errors import DesatError

number = st.floats(-1, 1, allow_nan=False)

triple = st.tuples(number, number, number)

PULSE = 0.05
"""s; a plan holds its torques over 10 s at their mean, a pulse stands somewhere in them
"""

# an independent prototype, before this code
LEAST = {
    (0.0, -2.4e-6): (87.79, 81.55, 78.32),
    (36.0, -2.4e-6): (52.85, 40.06, 52.12),
    (40.0, -2.4e-6): (49.32, 35.55, 51.38),
    (36.0, 2.4e-6): (50.23, 42.91, 50.01),
    (40.0, 2.4e-6): (46.43, 38.80, 49.27),
}


def bound_of(name, **values):
    run = execute(name, Options(blocks=True, values=values))
    return lower_bound.of_run(run.manifest, run.results)


@pytest.mark.parametrize(("limit", "b_y"), LEAST)
def test_bounds_are_the_prototypes(limit, b_y):
    for case, seconds in zip((1, 2, 3), LEAST[limit, b_y], strict=True):
        bound = bound_of(
            f"uosat12/table3-ocdc-ilqr-{case}",
            # rods of zero under a manager are refused
            **{
                "torquers.drive": "limited",
                "torquers.m_limit": max(limit, 1e-9),
                "environment.paper_b_y": b_y,
            },
        )
        assert bound.least == pytest.approx(seconds, abs=0.011)


def test_a_pulsed_coil_is_bounded_by_its_duty_and_an_ideal_one_not():
    name = "uosat12/table3-dct-ilqr-1"
    assert bound_of(name).least == pytest.approx(52.85, abs=0.011)
    assert bound_of(name, **{"torquers.drive": "ideal"}).least == pytest.approx(
        0.0, abs=1e-9
    )
    dead = bound_of(name, **{"torquers.failed_coil": "2"}).least
    late = bound_of(
        name, **{"torquers.failed_coil": "2", "torquers.failed_from": 300.0}
    ).least
    assert 52.9 < late < dead < 87.79


def test_nozzles_as_the_axis_pairs_have_the_same_bound():
    """The default nozzles are one each way about every axis."""
    from desat.runs.prepare import read
    from desat.system.interface import interface_of_block

    pairs = execute("uosat12/table3-dct-ilqr-2", Options(blocks=True))
    pairs_bound = lower_bound.of_run(pairs.manifest, pairs.results)
    draft = build(read("uosat12/table3-dct-ilqr-2"), Options(blocks=True))
    pairs_of_nozzles = draft.components["thrusters"]
    draft.components["thrusters"] = replace(
        pairs_of_nozzles,
        source="resources/thrusters_nozzles.fmu",
        interface=interface_of_block("thrusters_nozzles"),
        parameters={
            k: v for k, v in pairs_of_nozzles.parameters.items() if "tau_level" not in k
        },
    )
    system, _ = check_draft(draft).or_raise()
    from desat.system.model import table

    thrusters = table(system.components.values())["thrusters"]
    manifest = replace(
        pairs.manifest, parameters={**pairs.manifest.parameters, "thrusters": thrusters}
    )
    nozzles_bound = lower_bound.of_run(manifest, pairs.results)
    assert nozzles_bound.least == pytest.approx(pairs_bound.least, rel=1e-9)


direction = triple.filter(lambda v: vector.norm(v) > 0.1).map(
    lambda v: vector.scale(2.45 / vector.norm(v), v)
)


@pytest.mark.parametrize(
    "method",
    ["dct", "ocdc", "bounded_quadratic", "bounded_one_norm", "receding_horizon"],
)
@settings(max_examples=6)
@given(
    direction, st.integers(0, 62).map(lambda k: 0.1 * k), st.sampled_from([0.0, 1e-4])
)
def test_no_law_beats_the_bound(method, h, phase, disturbance):
    run = execute(
        f"uosat12/starts-{method}",
        Options(
            blocks=True,
            values={
                "spacecraft.h_start_body": list(h),
                "environment.phase": phase,
                "spacecraft.tau_disturbance_body": [disturbance, 0.0, -disturbance],
            },
        ),
    )
    bound = lower_bound.of_run(run.manifest, run.results)
    remaining = np.abs(run.results.values("spacecraft.h_copy_wheel")[-1]).sum()
    assert bound.least_same_end <= bound.seconds + PULSE
    assert bound.least <= bound.seconds + remaining / 0.04 + PULSE
    if method == "receding_horizon":
        above = (
            1.01 if disturbance == 0.0 else 1.04
        )  # it plans with the right torque, or without
        assert bound.seconds <= bound.least_same_end * above + PULSE
        assert bound.final_momentum <= 0.002 + 10 * disturbance


def test_manifest_and_report_show_the_bound(desat, tmp_path):
    folder = tmp_path / "run"
    desat(
        "run",
        "uosat12/table3-ocdc-ilqr-2",
        "--out",
        str(folder),
        "--no-baseline",
        check=True,
    )
    numbers = json.loads((folder / "manifest.json").read_text())["numbers"]
    assert numbers["bound"]["value"] == pytest.approx(40.06, abs=0.011)
    above = 100 * (
        numbers["firing_time"]["value"] / numbers["bound_same_end"]["value"] - 1
    )
    assert numbers["above_bound"]["value"] == pytest.approx(above)
    assert numbers["above_bound"]["unit"] == "%"
    assert numbers["above_bound"]["title"] in (folder / "report.html").read_text()
    answer = json.loads(desat("bound", str(folder), "--json", check=True).stdout)
    assert answer["least"] == pytest.approx(numbers["bound"]["value"], rel=1e-12)
    assert answer["scenario"] == "uosat12/table3-ocdc-ilqr-2"
    again = json.loads(
        desat("bound", "uosat12/table3-ocdc-ilqr-2", "--json", check=True).stdout
    )
    assert again == answer


def test_what_has_no_bound_says_why(desat):
    result = desat("bound", "plant/light")
    assert result.returncode == 2
    assert "plant/light: no manager commands thrusters" in result.stderr
    name = "uosat12/table3-ocdc-ilqr-1"
    for options, text in (
        (Options(algorithm="jacobi"), "a run by jacobi"),
        (
            Options(record=("manager.*",)),
            "not recorded, and the bound needs it: environment.b_eci",
        ),
        (Options(every=2), "every step recorded"),
    ):
        options.blocks = True
        run = execute(name, options)
        with pytest.raises(DesatError, match=text):
            lower_bound.of_run(run.manifest, run.results)
        # a run's own is of all rows, also of those that are not kept
        assert ("bound" in run.manifest["numbers"]) == (options.every > 1)
