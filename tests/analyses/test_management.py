"""Numbers and findings of momentum management, of runs whose results are known."""

from __future__ import annotations

import numpy as np
import pytest

from desat.analyses import management
from desat.analyses.management import ManagementParts
from desat.analyses.manifest import Manifest
from desat.begin import craft as new_craft
from desat.begin.facts import CraftFacts
from desat.engine.recording.memory import File
from desat.engine.recording.results import Results
from desat.runs.prepare import prepare
from desat.system.model import Parameter
from desat.system.options import Options

DAY = "nadir_day/day-dipole"
UPRIGHT = (0.0, 0.0, 0.0, 1.0)
TIMES = np.linspace(0.0, 2000.0, 201)
PARTS = ManagementParts(
    spacecraft="craft",
    torquers="coils",
    wheels="wheels",
    field="environment.b_eci",
    target=(0.0, 0.0, 0.0),
    holds=True,
    reference="guidance.q_ref_bi",
    manager="law",
)
VALUES = {
    "wheels": {
        "axes_wheel": np.eye(3).ravel().tolist(),
        "inertia_wheel": [1e-3, 1e-3, 1e-3],
        "speed_limit": 1000.0,
    },
    "coils": {"m_limit": 2.0, "axes_coil": np.eye(3).ravel().tolist(), "drive": "mean"},
}


def manifest_of(parts: ManagementParts, **craft: object) -> Manifest:
    """Return the manifest of a completed run with wheels of 1 N m s and coils."""
    tables = {
        component: {name: Parameter(x, "") for name, x in values.items()}
        for component, values in {**VALUES, "craft": craft}.items()
    }
    return Manifest(
        algorithm="gauss_seidel",
        status="completed",
        step=10.0,
        parts={management.KEY: parts},
        parameters=tables,
    )


def results_of(**series: object) -> Results:
    """Return the results with a row of each series, `component__variable`, at TIMES."""
    file = File()
    file.create_dataset("time", dtype=float).append(TIMES)
    for name, rows in series.items():
        values = np.asarray(rows, float)
        if len(values) != len(TIMES):
            values = np.tile(values, (len(TIMES), 1))
        path = name.replace("__", "/")
        file.create_dataset(path, values.shape[1:], float).append(values)
    return Results(file)


def flight_of(first: float, left_rate: float, coils: float) -> Results:
    """Return a flight at rest whose coils take momentum about y.

    The wheels begin with `first` (N m s) about x. About y they gain `left_rate` (N m),
    and would gain `coils` (N m) more without the coils.
    """
    field = 4e-5  # T, about z: a dipole m about x gives the torque -m B about y
    impulse = np.outer(TIMES, (0.0, left_rate, 0.0))
    return results_of(
        craft__q_bi=UPRIGHT,
        craft__omega_bi_body=(0.0, 0.0, 0.0),
        craft__impulse_eci=impulse,
        craft__h_copy_wheel=impulse + np.array([first, 0.0, 0.0]),
        coils__m_mean_body=(coils / field, 0.0, 0.0),
        environment__b_eci=(0.0, 0.0, field),
        guidance__q_ref_bi=UPRIGHT,
    )


def removed_share_of(flight: Results) -> float | None:
    """Return the removed share of a flight by the momenta of its balance."""
    momenta = management.balance(manifest_of(PARTS), flight)
    incoming = max(float(momenta.distance[0]), momenta.largest_gain)
    return management.removed_share(
        momenta.times, incoming, momenta.largest_effect, management.SMALL
    )


# --- what is removed, and what is left ------------------------------------------------


@pytest.mark.parametrize(
    ("first", "left_rate", "coils", "share"),
    [
        (3e-3, 1e-6, 1e-6, 0.5),  # 4 mN m s come in after 3 at the start
        (5e-3, 1e-6, 1e-6, 0.4),  # 5 mN m s at the start are more than what comes in
        (0.0, 0.0, 1e-6, 1.0),
        (2e-3, 2e-6, 0.0, 0.0),
    ],
)
def test_the_removed_share_is_of_the_larger_incoming_momentum(
    first, left_rate, coils, share
):
    flight = flight_of(first, left_rate, coils)
    computed_share = removed_share_of(flight)
    assert computed_share == pytest.approx(share, abs=1e-12)


@pytest.mark.parametrize(("first", "is_known"), [(0.9e-3, False), (1.1e-3, True)])
def test_a_thousandth_of_the_capacity_counts_as_no_momentum(first, is_known):
    flight = flight_of(first, 0.0, 0.0)
    share = removed_share_of(flight)
    assert (share is not None) == is_known


def test_left_and_unmanaged_momentum_are_rms_of_the_second_half():
    """Momentum that grows from zero: its mean square from T/2 to T is 7/12 of the last."""
    remaining, without = management.compare(
        manifest_of(PARTS), flight_of(0.0, 1e-6, 3e-6)
    )
    assert remaining == pytest.approx(2e-3 * np.sqrt(7.0 / 12.0), rel=1e-4)
    assert without == pytest.approx(8e-3 * np.sqrt(7.0 / 12.0), rel=1e-4)


# Without management 40 mN m s would be left; 1 % of that and a thousandth of the
# capacity, 1.4 mN m s, are within the tolerance.
@pytest.mark.parametrize(("more", "lines"), [(1.3e-3, 0), (1.5e-3, 1), (20e-3, 1)])
def test_a_law_may_leave_a_thousandth_of_the_capacity_more(more, lines):
    """The wheels have 40 mN m s and `more` about x, which the coils have added."""
    impulse = np.outer(np.minimum(TIMES / 500.0, 1.0), (more, 0.0, 0.0))
    field = 4e-5
    dipole = np.where(TIMES < 500.0, more / 500.0 / field, 0.0)
    flight = results_of(
        craft__q_bi=UPRIGHT,
        craft__omega_bi_body=(0.0, 0.0, 0.0),
        craft__impulse_eci=impulse,
        craft__h_copy_wheel=impulse + np.array([40e-3, 0.0, 0.0]),
        coils__m_mean_body=np.outer(dipole, (0.0, 1.0, 0.0)),
        environment__b_eci=(0.0, 0.0, field),
        guidance__q_ref_bi=UPRIGHT,
    )
    manifest = manifest_of(PARTS)
    remaining, without = management.compare(manifest, flight)
    assert (remaining, without) == pytest.approx((40e-3 + more, 40e-3), rel=1e-9)
    assert len(management.unmet(manifest, flight)) == lines


# --- wheels, coils, braking -----------------------------------------------------------


def test_the_margin_is_that_of_the_fullest_wheel_at_its_fullest():
    momentum = np.array([[0.2, -1.4, 0.1], [0.5, 0.1, -0.3], [0.0, 0.0, 0.0]])
    margin = management.margin(momentum, np.array([1.0, 2.0, 4.0]))
    assert margin == pytest.approx(30.0)


def test_wheels_cross_zero_where_their_speed_changes_sign():
    """Two wheels with one and three changes; saturated from 1 to 3 s and from 7 s on."""
    times = np.array([0.0, 1.0, 3.0, 7.0, 8.0])
    speed = np.array([[5.0, 1.0], [2.0, -1.0], [-1.0, 1.0], [-2.0, -1.0], [-3.0, -2.0]])
    saturation = np.array([[0, 0], [1, 0], [0, 0], [1, 1], [0, 0]])
    assert management.of_wheels(times, saturation, speed) == (3.0, 4.0)


def test_the_numbers_of_a_run_are_those_of_its_wheels():
    """A wheel of 1 N m s that goes from 0.3 to -0.7 passes zero once."""
    momentum = np.zeros((len(TIMES), 3))
    momentum[:, 2] = np.linspace(0.3, -0.7, len(TIMES))
    flight = results_of(
        craft__h_copy_wheel=momentum,
        coils__m_mean_body=(0.5, -1.0, 0.0),
        wheels__speed_wheel=momentum / 1e-3,
        wheels__saturated_wheel=(0.0, 0.0, 0.0),
    )
    numbers = management.numbers(manifest_of(PARTS), flight)
    values = {name: number.value for name, number in numbers.items()}
    assert values == pytest.approx(
        {
            # of h that goes linearly from a to b: (a^2 + a b + b^2) / 3
            "sum_rms": np.sqrt((0.3**2 - 0.3 * 0.7 + 0.7**2) / 3.0),
            "sum_largest": 0.7,
            "null_rms": 0.0,
            "coil_duty": 25.0,
            "coil_limit_share": 0.0,
            "momentum_margin": 30.0,
            "limit_time": 0.0,
            "crossings": 1.0,
        },
        rel=1e-4,
        abs=1e-12,
    )


@pytest.mark.parametrize(("rate", "seconds"), [(0.075, 1250.0), (0.15, None)])
def test_the_shortest_braking_time_is_momentum_over_half_of_the_coils_torque(
    rate, seconds
):
    """Half of 3 coils of 2 A m2 in 4e-5 T is 1.2e-4 N m; |J omega| is 0.15 N m s."""
    parts = ManagementParts(
        spacecraft="craft", torquers="coils", field="environment.b_eci", brakes=True
    )
    inertia = np.diag([2.0, 1.5, 1.0]).ravel().tolist()
    flight = results_of(
        craft__omega_bi_body=(rate, 0.0, 0.0),
        environment__b_eci=(0.0, 4e-5, 0.0),
        craft__h_copy_wheel=(0.0, 0.0, 0.0, 0.0),
        coils__m_mean_body=(0.0, 0.0, 0.0),
    )
    numbers = management.numbers(manifest_of(parts, inertia=inertia), flight)
    if seconds is None:
        assert "least_braking" not in numbers, "the run is too short to brake it"
    else:
        assert numbers["least_braking"].value == pytest.approx(seconds, rel=1e-9)


# --- warnings about gains and samples -------------------------------------------------


@pytest.mark.parametrize(
    ("sample", "gain", "removed_share"),
    [(20.0, 0.0499, None), (20.0, 0.0501, 1.002), (20.0, 0.08, 1.6)],
)
def test_a_gain_is_too_large_from_all_momentum_in_a_sample_on(
    sample, gain, removed_share
):
    values = {"manager.sample_time": sample, "manager.gain": gain}
    system, _ = prepare(DAY, Options(blocks=True, values=values)).or_raise()
    lines = list(management.warnings(system))
    if removed_share is None:
        assert lines == []
    else:
        (line,) = lines
        assert f"it takes {removed_share:.3g} times the momentum out" in line


def test_a_sample_without_a_time_of_its_own_is_a_step():
    values = {"manager.sample_time": 0.0, "manager.gain": 2.0}
    system, _ = prepare(DAY, Options(blocks=True, values=values)).or_raise()
    (line,) = management.warnings(system)
    assert f"within a sample of {system.step:g} s" in line


@pytest.mark.parametrize(("rate", "lines"), [(22.4, 0), (22.6, 1)])
def test_b_dot_brakes_up_to_a_quarter_turn_in_its_longest_sample(tmp_path, rate, lines):
    """The magnetometer's 4 s count, at which 22.5 deg/s are 90 deg."""
    facts = CraftFacts(size="12U", rods="0.2")
    new_craft.write(tmp_path / "craft", facts, "desat new craft")
    values = {
        "magnetometer.sample_time": 4.0,
        "manager.sample_time": 2.0,
        "spacecraft.omega_start_body": [0.0, float(np.radians(rate)), 0.0],
    }
    target = str(tmp_path / "craft" / "detumbling.toml")
    system, _ = prepare(target, Options(values=values)).or_raise()
    warnings = list(management.warnings(system))
    assert len(warnings) == lines
    assert all("in a sample of 4 s" in line for line in warnings)
