"""An empty tank."""

from __future__ import annotations

from pathlib import Path

import pytest

import desat as library
from desat.begin.craft import write
from desat.begin.facts import CraftFacts
from tests.conftest import started


def test_a_run_says_that_its_tank_is_empty(tmp_path: Path) -> None:
    write(
        tmp_path / "mine",
        CraftFacts(
            altitude="600km",
            size="12U",
            wheels="3 axes 10mNms",
            rods="none",
            thrusters="4 50mN",
            dump="thrusters 70:10",
            secular="20uNm",
            propellant="0.0001kg",
        ),
        "",
    )
    run = library.run(str(tmp_path / "mine"), stop=3000.0)
    assert [
        w for w in run.manifest.warnings if "its tank of 0.0001 kg is empty from" in w
    ]


def test_an_empty_tank_fires_nothing() -> None:
    jets = started(
        "thrusters",
        sample_time=1.0,
        tau_level=(1.0, 1.0, 1.0),
        arm=1.0,
        least_pulse=0.01,
        specific_impulse=100.0,
        tank=3e-3,
    )
    jets.tau_cmd_thruster_body = (1.0, 0.0, 0.0)
    for k in range(20):
        jets.advance(float(k), 1.0)
    jets.output(20.0)
    # 1 N takes 1 / (100 s g0) = 1.0197 g a second: 2.94 s, and nothing after
    assert jets.propellant == 3e-3
    assert jets.propellant_left == 0.0
    assert jets.on_time == pytest.approx(3e-3 * 100.0 * 9.80665, rel=1e-12)


@pytest.mark.parametrize("step", [1.0, 0.25])
@pytest.mark.parametrize("name", ["thrusters", "thrusters_nozzles", "thrusters_valves"])
def test_each_pulse_takes_its_loss_once(name: str, step: float) -> None:
    """A pulse of t takes the propellant of t + loss, whatever the step is."""
    values = {"sample_time": 1.0, "least_pulse": 0.01, "specific_impulse": 100.0}
    amounts = []
    for loss in (0.0, 0.02):
        jets = started(name, pulse_loss=loss, placement=1, **values)
        jets.tau_cmd_thruster_body = (0.01, 0.0, 0.0)
        for k in range(round(10.0 / step)):
            jets.advance(step * k, step)
        jets.output(10.0)
        amounts.append((jets.propellant, jets.on_time))
    (without, on_time), (with_loss, same) = amounts
    assert same == on_time
    assert with_loss / without == pytest.approx((on_time + 10 * 0.02) / on_time)
