"""The least energy of coils: below that of the run, whatever the wheels start with."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from desat.analyses import coil_bound
from desat.begin.craft import write
from desat.begin.facts import CraftFacts
from desat.components.laws import momentum_offline as offline
from desat.runs.run import Options, execute

DRIFT = {
    "altitude": "700km",
    "inclination": "60deg",
    "size": "12U",
    "pointing": "inertial",
    "secular": "0.2uNm",
}
NADIR = {"altitude": "500km", "inclination": "60deg", "size": "12U", "rods": "0.2"}


@pytest.mark.parametrize(
    ("facts", "sets"),
    [
        (DRIFT, ["h_start_wheel=-5.2e-4,-5.2e-4,5.2e-4,5.2e-4", "gain=1e-7"]),
        (NADIR, ["h_start_wheel=3e-3,-1e-3,2e-3,1e-3", "gain=2e-4"]),
        (NADIR, ["h_start_wheel=2e-3,0,0,0", "failed_coil=2", "failed_from=4000"]),
        (NADIR, ["h_start_wheel=-2e-3,1e-3,0,0", "drive=pulsed", "sample_time=10"]),
    ],
)
def test_no_run_takes_less_than_its_bound(tmp_path, facts: dict[str, Any], sets):
    owners = {"h_start_wheel": "wheels", "gain": "manager", "null_gain": "manager"}
    options = Options(
        stop=12000.0,
        sets=[
            f"{owners.get(x.partition('=')[0], 'torquers')}.{x}"
            for x in [*sets, "null_gain=0"]
        ],
    )
    write(tmp_path / "c", CraftFacts(**facts), "")
    run = execute(str(tmp_path / "c"), options)
    course, start, dipoles = coil_bound.course_of(run.manifest, run.results)
    wheels = run.results.values("wheels.h_wheel")
    axes = np.reshape(run.manifest.values_of("wheels")["axes_wheel"], (3, -1))
    shared = wheels @ axes.T @ np.linalg.pinv(axes).T
    along = offline.wheels(course, offline._along(course, start, dipoles))
    every = round(course.dt / run.manifest.step)
    ends = slice(every, every * len(along) + 1, every)
    assert along == pytest.approx(shared[ends], abs=1e-9), "the run is a candidate"
    energy_bound = coil_bound.of_run(run.manifest, run.results)
    assert energy_bound.least is not None
    assert 0.0 < energy_bound.least < energy_bound.energy
    assert energy_bound.above_percent == pytest.approx(
        100.0 * (energy_bound.energy / energy_bound.least - 1.0)
    )


def test_a_bound_above_the_run_is_no_bound(tmp_path, monkeypatch):
    write(tmp_path / "c", CraftFacts(**NADIR), "")
    options = Options(stop=6000.0, sets=["wheels.h_start_wheel=3e-3,-1e-3,2e-3,1e-3"])
    run = execute(str(tmp_path / "c"), options)
    most = offline.LeastEnergy(1e9, 0.0)
    monkeypatch.setattr(offline, "least_energy", lambda *_: most)
    with pytest.raises(coil_bound.DesatError, match=r"no bound: .* finds 1e\+09 A2"):
        coil_bound.of_run(run.manifest, run.results)
