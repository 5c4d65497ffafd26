"""Sample times against the run and the orbit; errors between the samples of a reference;
the coils' own field at the samples of a magnetometer."""

from __future__ import annotations

import numpy as np
import pytest

from desat.analyses import sampling
from desat.begin.craft import write
from desat.begin.facts import CraftFacts
from desat.components.maths.attitude import product
from desat.components.physics.orbit import lvlh_attitude
from desat.numbers.derived import pointing
from desat.runs.checking import check
from desat.runs.prepare import prepare
from desat.runs.run import Options, execute
from tests.conftest import started

FOREIGN = '''"""A guidance that gives a reference alone, as a foreign one does."""

from __future__ import annotations

from desat.components.contract.roles import Guidance
from desat.components.maths.vector import cross, dot, norm
from desat.components.physics.orbit import lvlh_attitude


class Mine(Guidance):
    """Nadir pointing of one's own"""

    def advance(self, t: float, dt: float) -> None:
        if self.due(t):
            r, v = self.r_eci, self.v_eci
            self.q_ref_bi = lvlh_attitude(r, v)
            self.omega_ref_body = (0.0, -norm(cross(r, v)) / dot(r, r), 0.0)
'''
COUPLED = "magnetometer.coil_coupling=1e-4,0,0,0,1e-4,0,0,0,1e-4"


@pytest.fixture(scope="module")
def craft(tmp_path_factory) -> str:
    """A 12U with coils, at nadir."""
    folder = tmp_path_factory.mktemp("sampling") / "leo"
    facts = {"size": "12U", "altitude": "500km", "inclination": "60deg", "rods": "0.2"}
    write(folder, CraftFacts(**facts), "")
    return str(folder)


# --- a slow reference -----------------------------------------------------------------


def test_an_error_does_not_hide_between_the_samples_of_a_reference(craft):
    """The guidance samples once; the craft stays where it pointed, and the Earth turns
    away: 360 deg in an orbit."""
    options = Options(stop=3000.0, sets=["guidance.sample_time=7000"])
    run = execute(craft, options)
    assert run.manifest.numbers["pointing"].value > 30.0
    q, r, v = (
        run.results.values(s)
        for s in ("spacecraft.q_bi", "environment.r_eci", "environment.v_eci")
    )
    rows = len(run.results.values("guidance.q_wanted_bi"))
    lvlh = np.array(
        [lvlh_attitude(tuple(a), tuple(b)) for a, b in zip(r, v, strict=True)]
    )
    error = pointing(q[:rows], lvlh[:rows])
    rms_error = float(np.sqrt((error**2).mean()))
    assert run.manifest.numbers["pointing"].value == pytest.approx(rms_error, rel=1e-9)
    assert run.manifest.numbers["pointing"].samples == rows
    assert any("attitude was lost" in line for line in run.manifest.unmet)


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("guidance_nadir", {"q_bo": (0.0, 0.6, 0.0, 0.8)}),
        ("guidance_sun", {}),
        ("guidance_yaw", {}),
        ("guidance_slew", {"q_end_bi": (0.0, 0.0, 1.0, 0.0), "t_end": 60.0}),
        ("guidance_inertial", {"q_target_bi": (0.0, 1.0, 0.0, -1.0)}),
    ],
)
def test_what_a_guidance_wants_is_its_law_at_every_step(name, values):
    fast, slow = started(name, **values), started(name, sample_time=40.0, **values)
    for k in range(100):
        angle = 1e-3 * k
        direction = np.cos(angle), np.sin(angle)
        for block in (fast, slow):
            block.r_eci = (7e6 * direction[0], 7e6 * direction[1], 0.0)
            block.v_eci = (-7.5e3 * direction[1], 7.5e3 * direction[0], 0.0)
            block.sun_eci = (0.6, 0.0, 0.8)
            block.advance(float(k), 1.0)
        assert slow.q_wanted_bi == fast.q_wanted_bi
        assert fast.q_ref_bi == pytest.approx(fast.q_wanted_bi, abs=1e-15)
        if k % 40 == 0:
            assert slow.q_ref_bi == pytest.approx(fast.q_ref_bi, abs=1e-15)
            first_reference = slow.q_ref_bi
        assert slow.q_ref_bi == first_reference
    assert product(first_reference, (0.0, 0.0, 0.0, 1.0)) == first_reference


@pytest.mark.parametrize(
    ("sample_time", "stop", "has_verdict"), [(10.0, 300.0, True), (100.0, 300.0, False)]
)
def test_a_foreign_reference_counts_at_its_samples(
    craft, tmp_path, quick_builds, sample_time, stop, has_verdict
):
    file = tmp_path / "mine.py"
    file.write_text(FOREIGN)
    options = Options(
        stop=stop,
        sources=[f"guidance={file}"],
        sets=[f"guidance.sample_time={sample_time}"],
    )
    manifest = execute(craft, options).manifest
    pointing, count = manifest.numbers["pointing"], round(stop / sample_time)
    assert pointing.samples == count
    assert pointing.note == f"at {count} samples of the reference"
    assert ("pointing" in manifest.verdicts) == has_verdict
    if not has_verdict:
        assert manifest.not_checked["pointing"] == f"{count} samples"


@pytest.mark.parametrize(
    ("sets", "message"),
    [
        (
            ["guidance.sample_time=7000"],
            "guidance.sample_time = 7000 s is longer than the run",
        ),
        (
            ["manager.sample_time=600"],
            "= 600 s is longer than a tenth of the orbit of 5",
        ),
        (
            ["tachometers.sample_time=1000"],
            "tachometers.sample_time = 1000 s is longer than a",
        ),
        (["tachometers.sample_time=560"], ""),
    ],
)
def test_a_sample_time_is_held_against_run_and_orbit(craft, sets, message):
    system, _ = prepare(craft, Options(sets=sets, stop=6000.0)).or_raise()
    lines = [x for x in sampling.warnings(system) if "longer" in x]
    assert [message in x for x in lines] == ([True] if message else [])


# --- the coils' own field ---------------------------------------------------------------


@pytest.mark.parametrize(
    ("sets", "share"),
    [
        ([], 2.0e-5 * np.sqrt(3.0) * np.exp(-10.0)),  # 0.2 s, and a lag of 20 ms
        (["torquers.quiet_time=0.05"], 2.0e-5 * np.sqrt(3.0) * np.exp(-2.5)),
        (["torquers.quiet_time=0"], 2.0e-5 * np.sqrt(3.0)),
        (
            ["torquers.sample_time=4"],
            2.0e-5 * np.sqrt(3.0),
        ),
    ],
)
def test_the_coils_own_field_is_told(craft, sets, share):
    """K = 1e-4 T/(A m2) and three coils of 0.2 A m2, against 3e-5 T in the mean."""
    target = f"{craft}/detumbling.toml"
    case = check(target, Options(sets=[COUPLED, *sets]))
    lines = [x for x in [*case.notes, *case.warnings] if "full dipoles" in x]
    (line,) = lines
    assert f"add up to {share:.2g} T" in line
    percent = float(line.partition(" T, ")[2].partition(" %")[0])
    assert 100.0 * share / percent == pytest.approx(3.8e-5, rel=0.1)
    assert (line in case.warnings) == (percent > 5.0)


def test_a_craft_with_coupled_coils_is_braked(craft):
    """B-dot with a field that holds two thirds of the coils' own, but for their pause."""
    options = Options(stop=3000.0, sets=[COUPLED])
    run = execute(f"{craft}/detumbling.toml", options)
    alone = execute(f"{craft}/detumbling.toml", Options(stop=3000.0))
    rates = [x.manifest.numbers["last_rate"].value for x in (run, alone)]
    assert rates[0] == pytest.approx(rates[1], rel=0.2)
