"""Sensors: statistics of their errors, frames, quantisation, range, validity.

Bounds on estimates are four to five of their standard deviations; seeds are fixed.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

import desat
from desat.components.bases import sensing
from desat.components.maths import attitude, noise
from desat.runs.run import Options, prepare
from tests.contract.test_block import begin, fresh

Q = attitude.normalise((0.3, -0.5, 0.2, 0.8))
N = 20000

# block -> its input, its output, a value of the input
SENSORS = {
    "magnetometer": ("b_eci", "b_body", (2e-5, -1e-5, 3e-5)),
    "tachometers": ("h_wheel", "h_meas_wheel", (0.1, -0.2, 0.3, 0.0)),
    "rate_gyro": ("omega_bi_body", "omega_meas_body", (1e-3, -2e-3, 3e-3)),
    "attitude_determination": ("q_bi", "q_meas_bi", Q),
    "sun_sensor": ("sun_eci", "sun_meas_body", (0.6, 0.0, 0.8)),
    "star_tracker": ("q_bi", "q_meas_bi", Q),
}
# parameters with every random error switched on
NOISY = {
    "magnetometer": {"noise": 1e-7},
    "tachometers": {"noise": 1e-4},
    "rate_gyro": {"noise": 1e-5, "angle_random_walk": 1e-5, "bias_walk": 1e-6},
    "attitude_determination": {
        "noise": 1e-3,
        "markov_sigma": 1e-2,
        "misalignment_norm": 1e-2,
    },
    "sun_sensor": {"noise": 1e-3},
    "star_tracker": {
        "noise_cross": 1e-4,
        "noise_about": 1e-3,
        "drift_cross": 1e-4,
        "drift_about": 1e-3,
    },
}


def sensor(name, **values):
    block = fresh(name)
    setattr(block, SENSORS[name][0], SENSORS[name][2])
    for key, value in values.items():
        assert hasattr(block, key)
        setattr(block, key, value)
    return begin(block)


def samples(block, output, count, dt=1.0):
    """The output after each of some steps."""
    rows = []
    for k in range(count):
        block.advance(k * dt, dt)
        rows.append(getattr(block, output))
    return np.array(rows)


def errors(block, count, dt=1.0):
    """The rotation vectors of the errors of an attitude determination."""
    inverse = attitude.inverse(block.q_bi)
    rows = []
    for q in samples(block, "q_meas_bi", count, dt):
        x, y, z, w = attitude.product(tuple(q), inverse)
        s = math.hypot(x, y, z)
        angle = 2 * math.atan2(s, w)
        rows.append((x * angle / s, y * angle / s, z * angle / s))
    return np.array(rows)


def is_white(x, sigma):
    """Zero mean, this deviation, no correlation in time or between axes."""
    n = len(x)
    assert np.abs(x.mean(axis=0)).max() < 4 * sigma / math.sqrt(n)
    assert x.std(axis=0) == pytest.approx(sigma, rel=4 / math.sqrt(2 * n))
    z = x / sigma
    for lag in (1, 2, 7):
        assert np.abs(z[lag:].T @ z[:-lag] / n).max() < 5 / math.sqrt(n)
    assert np.abs(z.T @ z / n - np.eye(z.shape[1])).max() < 6 / math.sqrt(n)


# --- random numbers -------------------------------------------------------------------


def test_six_numbers_are_those_of_three_pairs():
    draws = np.array([np.concatenate(noise.normal6(3, i, 10)) for i in range(N)])
    is_white(draws, 1.0)
    a, b = noise.normal6(3, 5, 10)
    pairs = [noise.normal_pair(3, 5, c) for c in (10, 12, 14)]
    assert (*a, *b) == (*pairs[0], *pairs[1], *pairs[2])


# one scenario of each craft that has noise
NOISY_SCENARIOS = [
    "integrated/mil-nadir",
    "uosat12/flight-ocdc-1",
    "uosat12/table3-ocdc-ilqr-1",
    "nadir_day/day-igrf",
]


@pytest.mark.parametrize("scenario", NOISY_SCENARIOS)
def test_no_two_channels_of_a_scenario_correlate(scenario):
    """Under the seeds that ship, all equal; once 1.0 between magnetometer and
    tachometers."""
    system, _ = prepare(scenario, Options(blocks=True)).or_raise()
    n, channels, keys = 2500, [], []
    for name, component in system.components.items():
        model = component.interface.model
        if model == "wheels":
            keys.append(noise.stream(name, "tau_jitter_body", component.values["seed"]))
            channels += [
                [noise.uniform(keys[-1], k, i) for k in range(n)] for i in range(4)
            ]
        if model not in SENSORS:
            continue
        block = fresh(model)
        block.instance, block.seed, block.noise = name, component.values["seed"], 1e-4
        if model != "attitude_determination":  # its components are the errors' at q = 1
            setattr(block, SENSORS[model][0], SENSORS[model][2])
        begin(block)
        keys.append(block._noise)
        values = samples(block, SENSORS[model][1], n).T
        channels += list(values[:3] if model == "attitude_determination" else values)
    assert len(set(keys)) == len(keys) >= 2
    r = np.corrcoef(channels)
    assert np.abs(r - np.eye(len(r))).max() < 5 / math.sqrt(n)


def test_two_of_a_kind_draw_apart():
    one, other = fresh("magnetometer"), fresh("magnetometer")
    other.instance = "magnetometer_2"
    for block in (one, other):
        block.noise = 1.0
        begin(block)
    r = np.corrcoef(samples(one, "b_body", N).T, samples(other, "b_body", N).T)
    assert np.abs(r - np.eye(6)).max() < 5 / math.sqrt(N)


@pytest.mark.parametrize("name", ["magnetometer", "tachometers", "rate_gyro"])
def test_noise_is_white_with_its_deviation(name):
    _, output, value = SENSORS[name]
    block = sensor(name, noise=1e-4)
    if name == "magnetometer":
        value = attitude.rotate(block.q_bi, value)
    is_white(samples(block, output, N) - np.array(value), 1e-4)


def test_determination_noise_is_white_with_its_deviation():
    is_white(errors(sensor("attitude_determination", noise=1e-3), N), 1e-3)


def test_sun_noise_is_an_angle_across_the_direction():
    block = sensor("sun_sensor", noise=1e-3, q_bi=Q)
    x = samples(block, "sun_meas_body", N)
    assert np.linalg.norm(x, axis=1) == pytest.approx(1, abs=1e-14)
    s = np.array(attitude.rotate(Q, block.sun_eci))
    across = np.linalg.svd(s[None])[2][1:]
    is_white(x @ across.T, 1e-3)
    assert np.abs(x @ s - 1).max() < 2e-5


@pytest.mark.parametrize("name", SENSORS)
def test_without_errors_a_sensor_is_exact(name):
    _, output, value = SENSORS[name]
    block = sensor(name)
    block.advance(0.0, 1.0)
    assert getattr(block, output) == pytest.approx(value, abs=1e-16)
    assert block.valid


@pytest.mark.parametrize("name", SENSORS)
@pytest.mark.parametrize("dt", [1.0, 0.25, 0.1])
def test_samples_do_not_depend_on_the_step(name, dt):
    """The same value at the same sample index, held in between, whatever the step."""
    output = SENSORS[name][1]
    every = samples(sensor(name, sample_time=1.0, **NOISY[name]), output, 50)
    assert len(np.unique(every[:, 0])) == 50
    per_sample = round(1 / dt)
    finer = samples(
        sensor(name, sample_time=1.0, **NOISY[name]), output, 50 * per_sample, dt
    )
    for offset in (0, per_sample - 1):
        assert (finer[offset::per_sample] == every).all()


@pytest.mark.parametrize("name", SENSORS)
def test_seeds_differ(name):
    a, b = (sensor(name, seed=s, sample_time=1.0, **NOISY[name]) for s in (1, 2))
    assert getattr(a, SENSORS[name][1]) != getattr(b, SENSORS[name][1])


@pytest.mark.parametrize("name", SENSORS)
def test_the_first_sample_is_that_of_the_start(name):
    block = sensor(name, sample_time=1.0, **NOISY[name])
    first = getattr(block, SENSORS[name][1])
    block.advance(0.0, 1.0)
    assert getattr(block, SENSORS[name][1]) == first


# --- quantisation, range, validity ----------------------------------------------------


def test_digital():
    assert sensing.digital(0.34, 0.1, 0.0) == pytest.approx(0.3)
    assert sensing.digital(-0.36, 0.1, 0.0) == pytest.approx(-0.4)
    assert sensing.digital(-7.0, 0.0, 2.5) == -2.5
    assert sensing.digital(7.3, 1.0, 6.5) == 6.5
    assert sensing.digital(7.3, 0.0, 0.0) == 7.3


@pytest.mark.parametrize("name", ["magnetometer", "tachometers", "rate_gyro"])
def test_quantisation_and_range(name):
    _, output, value = SENSORS[name]
    size = max(map(abs, value))
    block = sensor(name, noise=size / 10, resolution=size / 50, full_scale=0.8 * size)
    x = samples(block, output, 2000)
    steps = x / (size / 50)
    assert np.abs(steps - np.round(steps)).max() < 1e-9
    assert np.abs(x).max() == pytest.approx(0.8 * size, rel=1e-15)
    assert block.valid, "a limited value stays valid"
    # rounding errors are uniform: their variance is resolution^2 / 12
    exact = samples(sensor(name, noise=size / 10), output, 2000)
    inside = np.abs(exact) < 0.79 * size
    assert (x - exact)[inside].std() == pytest.approx(
        size / 50 / math.sqrt(12), rel=0.05
    )


@pytest.mark.parametrize("name", ["magnetometer", "tachometers", "rate_gyro"])
def test_without_noise_a_quantised_value_is_the_nearest(name):
    _, output, value = SENSORS[name]
    q = max(map(abs, value)) / 7.3
    measurement = getattr(sensor(name, resolution=q), output)
    assert np.abs(np.array(measurement) - value).max() <= q / 2
    assert measurement == pytest.approx([q * round(x / q) for x in value], abs=1e-18)


@pytest.mark.parametrize("name", SENSORS)
def test_a_failed_sensor_is_invalid_and_holds(name):
    output = SENSORS[name][1]
    block = sensor(name, fail_time=3.0, sample_time=1.0, **NOISY[name])
    rows, valid = [], []
    for k in range(0, 12):
        block.advance(k * 0.5, 0.5)
        rows.append(getattr(block, output))
        valid.append(block.valid)
    assert valid == [True] * 6 + [False] * 6
    last_valid = (0.0, 0.0, 0.0) if name == "sun_sensor" else rows[5]
    assert rows[6:] == [last_valid] * 6
    assert rows[5] != rows[3]


@pytest.mark.parametrize("name", SENSORS)
def test_failed_from_the_start_and_never(name):
    dead = sensor(name, fail_time=0.0)
    assert not dead.valid
    dead.advance(0.0, 1.0)
    assert not dead.valid
    alive = sensor(name)
    alive.advance(1e9, 1.0)
    assert alive.valid


def test_failure_time_on_a_sample_is_not_missed_by_rounding():
    assert 3 * 0.7 < 2.1
    assert sensing.has_failed(3 * 0.7, 2.1)
    assert not sensing.has_failed(2 * 0.7, 2.1)


# --- magnetometer, tachometers --------------------------------------------------------


def test_magnetometer_measures_in_the_body_frame():
    # body turned by +90 deg about z: the body's x axis points along the inertial y axis
    q = (0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5))
    block = sensor(
        "magnetometer", q_bi=q, b_eci=(0.0, 3e-5, 1e-5), bias_body=(1e-6, 0.0, 0.0)
    )
    assert block.b_body == pytest.approx((3.1e-5, 0.0, 1e-5), abs=1e-18)


def test_tachometer_bias_is_added():
    block = sensor("tachometers", bias_wheel=(0.01, 0.0, -0.02, 0.03))
    assert block.h_meas_wheel == pytest.approx((0.11, -0.2, 0.28, 0.03))


def test_magnetometer_and_tachometers_draw_from_streams_of_their_own():
    """The results of scenarios depend on these numbers."""
    block = sensor("magnetometer", noise=1.0, b_eci=(0.0, 0.0, 0.0))
    key = noise.stream("magnetometer", "b_body", 1)
    assert key == 0xF4B51802DC0C13FD
    assert block.b_body == noise.normal3(key, 0)
    block = sensor("tachometers", noise=1.0, h_wheel=(0.0,) * 4)
    key = noise.stream("tachometers", "h_meas_wheel", 1)
    assert block.h_meas_wheel == (
        *noise.normal_pair(key, 0),
        *noise.normal_pair(key, 0, 2),
    )


# --- rate gyro ------------------------------------------------------------------------


def test_magnetometer_turned_and_scaled():
    """A sensor turned about z by a reads C(a) b, to a^2; its x axis 10 % too long."""
    a, (x, y, z) = 1e-4, SENSORS["magnetometer"][2]
    rotated_sensor = sensor(
        "magnetometer", response_error=(0.0, a, 0.0, -a, 0.0, 0.0, 0.0, 0.0, 0.0)
    )
    c, s = math.cos(a), math.sin(a)
    assert rotated_sensor.b_body == pytest.approx(
        (c * x + s * y, c * y - s * x, z), abs=a * a * 4e-5
    )
    bias = (3e-6, 0.0, 0.0)  # what is read in no field: not scaled
    scaled_sensor = sensor(
        "magnetometer", response_error=(0.1, *(0.0,) * 8), bias_body=bias
    )
    assert scaled_sensor.b_body == pytest.approx((1.1 * x + 3e-6, y, z), rel=1e-14)


def test_gyro_bias_and_scale_error():
    block = sensor(
        "rate_gyro", bias_body=(1e-4, 0.0, -1e-4), scale_error=(0.1, -0.1, 0.0)
    )
    assert block.omega_meas_body == pytest.approx((1.2e-3, -1.8e-3, 2.9e-3), abs=1e-18)


@pytest.mark.parametrize("sample_time", [0.1, 0.5])
def test_gyro_angle_random_walk_does_not_depend_on_the_sample_time(sample_time):
    block = sensor(
        "rate_gyro",
        angle_random_walk=1e-4,
        sample_time=sample_time,
        omega_bi_body=(0.0,) * 3,
    )
    x = samples(block, "omega_meas_body", N, sample_time)
    is_white(x, 1e-4 / math.sqrt(sample_time))
    per_second = round(1 / sample_time)
    angles = x.reshape(-1, per_second, 3).sum(axis=1) * sample_time
    assert angles.std() == pytest.approx(1e-4, rel=4 / math.sqrt(2 * angles.size))


@pytest.mark.parametrize("sample_time", [0.0, 2.0])
def test_gyro_bias_is_a_random_walk(sample_time):
    """sample_time 0: at every step, here of 0.5 s."""
    dt = 0.5
    block = sensor(
        "rate_gyro",
        bias_walk=1e-6,
        bias_body=(1e-3, 0.0, 0.0),
        omega_bi_body=(0.0,) * 3,
        sample_time=sample_time,
    )
    stride = round((sample_time or dt) / dt)
    x = samples(block, "omega_meas_body", 4000 * stride, dt)[::stride]
    assert tuple(x[0]) == (1e-3, 0.0, 0.0)
    is_white(np.diff(x, axis=0), 1e-6 * math.sqrt(sample_time or dt))


def test_gyro_bias_spreads_with_the_root_of_time():
    ends = []
    for seed in range(400):
        block = sensor("rate_gyro", bias_walk=1e-6, seed=seed, omega_bi_body=(0.0,) * 3)
        ends.append(samples(block, "omega_meas_body", 101)[-1])
    assert np.std(ends) == pytest.approx(1e-6 * math.sqrt(100), rel=4 / math.sqrt(2400))


def allan_variance(rate, n):
    """Overlapping Allan variance over n samples, mean of the axes (IEEE Std 952-1997,
    annex C)."""
    angle = np.vstack([np.zeros(3), np.cumsum(rate, axis=0)]) / n
    return float(((angle[2 * n :] - 2 * angle[n:-n] + angle[: -2 * n]) ** 2).mean() / 2)


def test_gyro_has_the_allan_deviation_of_its_walks():
    """N^2 / tau + K^2 tau / 3: both coefficients come out of the record within 10 %."""
    angle_walk, rate_walk = 1e-4, 1e-5
    block = sensor(
        "rate_gyro",
        angle_random_walk=angle_walk,
        bias_walk=rate_walk,
        sample_time=1.0,
        omega_bi_body=(1e-3, 0.0, 0.0),
    )
    x = samples(block, "omega_meas_body", N)
    terms = np.array([[1 / tau, tau / 3] for tau in (1, 100)])
    coefficients = np.sqrt(
        np.linalg.solve(terms, [allan_variance(x, tau) for tau in (1, 100)])
    )
    assert coefficients == pytest.approx([angle_walk, rate_walk], rel=0.1)


def test_gyro_has_the_floor_of_its_bias_instability():
    """Alone, at 1.89 correlation times, and below it to either side; stationary from
    the start."""
    floor = 2e-6
    block = sensor(
        "rate_gyro",
        bias_instability=floor,
        instability_time=10.0,
        sample_time=1.0,
        omega_bi_body=(0.0, 0.0, 0.0),
    )
    x = samples(block, "omega_meas_body", N)
    at = {n: math.sqrt(allan_variance(x, n)) for n in (2, 19, 200)}
    assert at[19] == pytest.approx(floor, rel=0.1)
    assert at[2] < 0.75 * floor
    assert at[200] < 0.75 * floor
    assert x[:1000].std() == pytest.approx(floor / 0.61736, rel=0.25)


def test_gyro_turned_by_a_small_angle():
    a, (x, y, z) = 1e-4, (1e-3, 2e-3, -3e-3)
    block = sensor(
        "rate_gyro", misalignment_body=(0.0, 0.0, a), omega_bi_body=(x, y, z)
    )
    c, s = math.cos(a), math.sin(a)
    rotated_rate = (c * x + s * y, c * y - s * x, z)
    assert block.omega_meas_body == pytest.approx(rotated_rate, abs=a * a * 3e-3)


def test_gyro_bias_instability_needs_a_time():
    with pytest.raises(
        ValueError, match="bias_instability needs an instability_time above 0"
    ):
        sensor("rate_gyro", bias_instability=1e-6, instability_time=0.0)


def test_gyro_angle_random_walk_needs_a_sample_time():
    with pytest.raises(
        ValueError, match="angle_random_walk needs a sample_time above 0"
    ):
        sensor("rate_gyro", angle_random_walk=1e-4)


# --- attitude determination -----------------------------------------------------------


def test_misalignment_turns_the_measured_frame_about_the_bodys_axis():
    a = 0.2
    block = sensor("attitude_determination", misalignment_body=(0.0, 0.0, a))
    v = attitude.rotate_back(Q, (1.0, 0.0, 0.0))  # along the true x axis
    measured_vector = attitude.rotate(block.q_meas_bi, v)
    assert measured_vector == pytest.approx((math.cos(a), -math.sin(a), 0.0), abs=1e-15)
    rotated_attitude = attitude.product((0.0, 0.0, math.sin(a / 2), math.cos(a / 2)), Q)
    assert block.q_meas_bi == pytest.approx(rotated_attitude, abs=1e-15)


@pytest.mark.parametrize(
    ("sample_time", "correlation_time"), [(1.0, 20.0), (10.0, 40.0)]
)
def test_drift_is_a_gauss_markov_process(sample_time, correlation_time):
    sigma, n = 1e-2, 40000
    block = sensor(
        "attitude_determination",
        markov_sigma=sigma,
        correlation_time=correlation_time,
        sample_time=sample_time,
    )
    x = errors(block, n, sample_time) / sigma
    independent = 3 * n * sample_time / (2 * correlation_time)
    assert np.abs(x.mean()) < 4 / math.sqrt(independent / 2)
    assert (x * x).mean() == pytest.approx(1, abs=4 * math.sqrt(2 / independent))
    for lag in (1, 2, 5, 20, 100):
        correlation = math.exp(-lag * sample_time / correlation_time)
        autocorrelation = (x[lag:] * x[:-lag]).mean()
        assert autocorrelation == pytest.approx(
            correlation, abs=4 * math.sqrt(2 / independent)
        )
    decay = math.exp(-sample_time / correlation_time)
    is_white(x[1:] - decay * x[:-1], math.sqrt(1 - decay**2))  # its driving noise


def test_drift_without_correlation_is_white():
    block = sensor("attitude_determination", markov_sigma=1e-2, correlation_time=0.0)
    is_white(errors(block, N), 1e-2)


def test_drift_starts_stationary():
    """From any seed, the start and a later time are spread alike."""
    first, later = [], []
    for seed in range(2000):
        block = sensor(
            "attitude_determination", markov_sigma=1e-2, seed=seed, sample_time=10.0
        )
        x = errors(block, 4, 10.0)
        first.append(x[0])
        later.append(x[3])
    is_white(np.array(first), 1e-2)
    is_white(np.array(later), 1e-2)


@pytest.mark.parametrize("white", [0.0, 0.02])
def test_average_determination_error_of_3_deg(white):
    """Paper 004, Table 1."""
    sigma = sensing.sigma_of_mean_norm(math.radians(3))
    assert sigma == pytest.approx(0.032812, abs=1e-6)  # as the block's page says
    markov = math.sqrt(sigma**2 - white**2)
    angles = []
    for seed in range(4000):
        block = sensor(
            "attitude_determination", markov_sigma=markov, noise=white, seed=seed
        )
        angles.append(attitude.error_angle(block.q_meas_bi, block.q_bi))
    # a Maxwell variable: deviation / mean = 0.42
    assert math.degrees(np.mean(angles)) == pytest.approx(
        3, rel=4 * 0.42 / math.sqrt(4000)
    )


def test_error_of_constant_norm_in_a_drawn_direction():
    norm, directions = math.radians(3), []
    for seed in range(4000):
        block = sensor("attitude_determination", misalignment_norm=norm, seed=seed)
        (error,) = errors(block, 1)
        assert np.linalg.norm(error) == pytest.approx(norm, rel=1e-12)
        directions.append(error / norm)
    assert np.abs(np.mean(directions, axis=0)).max() < 4 / math.sqrt(3 * 4000)
    outer = np.array(directions).T @ np.array(directions) / 4000
    assert np.abs(outer - np.eye(3) / 3).max() < 0.02
    steady = errors(block, 20)
    assert np.ptp(steady, axis=0).max() < 1e-15


# --- Sun sensor -----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("angle", "is_visible"), [(0.0, True), (59.99, True), (60.01, False)]
)
def test_sun_is_seen_within_the_field_of_view(angle, is_visible):
    a = math.radians(angle)
    block = sensor(
        "sun_sensor",
        sun_eci=(math.cos(a), math.sin(a), 0.0),
        half_angle=math.radians(60),
        boresight_body=(2.0, 0.0, 0.0),
    )
    assert block.valid == is_visible
    direction = (math.cos(a), math.sin(a), 0.0) if is_visible else (0.0, 0.0, 0.0)
    assert block.sun_meas_body == pytest.approx(direction, abs=1e-15)


def test_sun_direction_is_in_the_body_frame():
    q = (0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5))  # body x along inertial y
    block = sensor("sun_sensor", q_bi=q, sun_eci=(0.0, 1.0, 0.0))
    assert block.sun_meas_body == pytest.approx((1.0, 0.0, 0.0), abs=1e-15)


def test_a_field_of_view_of_pi_sees_everywhere():
    rng = np.random.default_rng(1)
    for v in rng.normal(size=(500, 3)):
        s = tuple(float(x) for x in v / np.linalg.norm(v))
        assert sensor(
            "sun_sensor", sun_eci=s, boresight_body=tuple(-x for x in s)
        ).valid


@pytest.mark.parametrize(
    ("sunlight", "is_visible"), [(1.0, True), (0.3, True), (0.29, False), (0, False)]
)
def test_no_sun_in_eclipse(sunlight, is_visible):
    block = sensor("sun_sensor", sunlight=sunlight, sunlight_min=0.3)
    block.advance(0.0, 1.0)
    assert block.valid == is_visible
    assert any(block.sun_meas_body) == is_visible


def test_no_sun_where_none_is_modelled():
    block = sensor("sun_sensor", sun_eci=(0.0, 0.0, 0.0), noise=1e-3)
    assert not block.valid
    assert block.sun_meas_body == (0.0, 0.0, 0.0)


def test_boresight_must_be_a_direction():
    with pytest.raises(ValueError, match="boresight_body is zero"):
        sensor("sun_sensor", boresight_body=(0.0, 0.0, 0.0))


# --- star tracker ---------------------------------------------------------------------


def test_star_tracker_is_noisier_about_its_boresight():
    e = np.array((2.0, -1.0, 2.0)) / 3
    block = sensor(
        "star_tracker",
        boresight_body=(2.0, -1.0, 2.0),
        noise_cross=1e-5,
        noise_about=8e-5,
    )
    x = errors(block, N)
    about = x @ e
    is_white(about[:, None], 8e-5)
    across = x - about[:, None] * e
    u = np.cross(e, (1.0, 0.0, 0.0)) / np.linalg.norm(np.cross(e, (1.0, 0.0, 0.0)))
    is_white(np.stack([across @ u, across @ np.cross(e, u)], axis=1), 1e-5)


def test_star_tracker_drifts_with_its_correlation_time():
    block = sensor("star_tracker", drift_cross=1e-4, drift_about=5e-4, drift_time=5.0)
    x = errors(block, N)
    # a mean over N correlated samples counts as N tanh(1 / 10) independent ones
    count = N * math.tanh(0.1)
    assert x.std(axis=0) == pytest.approx(
        [1e-4, 1e-4, 5e-4], rel=5 / math.sqrt(2 * count)
    )
    for axis in x.T:
        for lag in (1, 5):
            correlation = (axis[:-lag] * axis[lag:]).mean() / axis.var()
            assert correlation == pytest.approx(
                math.exp(-lag / 5), abs=5 / math.sqrt(count)
            )


@pytest.mark.parametrize(
    ("angle", "light", "reason"), [(39.9, 1.0, 1), (40.1, 1.0, 0), (39.9, 0.0, 0)]
)
def test_star_tracker_is_blinded_by_a_lit_sun(angle, light, reason):
    a = math.radians(angle)
    sun = attitude.rotate_back(
        Q, (math.sin(a), 0.0, math.cos(a))
    )  # in body axes, boresight z
    block = sensor(
        "star_tracker", sun_exclusion=math.radians(40), sun_eci=sun, sunlight=light
    )
    assert (block.lost_to, block.valid) == (reason, reason == 0)
    assert sensor("star_tracker", sun_eci=sun).valid, "off by default"


@pytest.mark.parametrize(("beyond", "reason"), [(19.9, 2), (20.1, 0), (-30.0, 2)])
def test_star_tracker_is_blinded_by_the_earth_up_to_its_limb(beyond, reason):
    r = 6378137.0 / math.sin(
        math.radians(64.0)
    )  # from where the Earth fills a cone of 64 deg
    a = math.radians(64.0 + beyond)
    up = attitude.rotate_back(Q, (math.sin(a), 0.0, -math.cos(a)))
    place = tuple(r * x for x in up)
    block = sensor("star_tracker", earth_exclusion=math.radians(20), r_eci=place)
    assert (block.lost_to, block.valid) == (reason, reason == 0)


@pytest.mark.parametrize(("rate", "reason"), [(0.0199, 0), (0.0201, 3)])
def test_star_tracker_loses_the_stars_above_its_rate(rate, reason):
    omega = (0.6 * rate, 0.0, -0.8 * rate)
    assert (
        sensor("star_tracker", rate_limit=0.02, omega_bi_body=omega).lost_to == reason
    )
    assert sensor("star_tracker", omega_bi_body=omega).valid


def test_star_tracker_holds_until_the_stars_are_acquired_again():
    block = sensor(
        "star_tracker", rate_limit=0.02, reacquisition_time=3.0, sample_time=1.0
    )
    reasons, attitudes = [], []
    for k in range(10):
        block.omega_bi_body = (0.03, 0.0, 0.0) if k in (2, 3) else (0.0, 0.0, 0.0)
        block.q_bi = attitude.propagate(Q, (0.01, 0.0, 0.0), k)
        block.advance(float(k), 1.0)
        reasons.append(block.lost_to)
        attitudes.append(block.q_meas_bi)
    assert reasons == [0, 0, 3, 3, 5, 5, 0, 0, 0, 0]
    assert attitudes[1] == attitudes[2] == attitudes[5] != attitudes[6]


def test_star_tracker_drops_out_at_its_mean_interval():
    block = sensor("star_tracker", dropout_interval=50.0, sample_time=2.0)
    missing = samples(block, "lost_to", N, 2.0) == 4
    share = 1 - math.exp(-2.0 / 50.0)
    assert missing.mean() == pytest.approx(share, abs=5 * math.sqrt(share / N))
    gaps = np.diff(np.flatnonzero(missing))  # geometric: as scattered as they are long
    assert gaps.std() == pytest.approx(math.sqrt(1 - share) / share, rel=0.15)


def test_star_tracker_is_late_by_its_delay():
    rate = (0.0, 1e-3, 2e-3)
    block = sensor("star_tracker", sample_time=0.5, delay=1.5)
    assert (block.valid, block.lost_to) == (False, 6), "nothing can have come out yet"
    for k in range(12):
        block.q_bi = attitude.propagate(Q, rate, 0.5 * k)
        block.advance(0.5 * k, 0.5)
        assert block.valid == (k >= 3)
        if block.valid:
            late = attitude.error_angle(block.q_bi, block.q_meas_bi)
            assert late == pytest.approx(1.5 * math.hypot(*rate), rel=1e-9)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"boresight_body": (0.0, 0.0, 0.0)}, "boresight_body is zero"),
        ({"delay": 1.0}, "delay = 1.0 s is not 1 to 16 times sample_time = 0.0 s"),
        ({"delay": 0.7, "sample_time": 0.5}, "delay = 0.7 s is not 1 to 16 times"),
        ({"delay": 17.0, "sample_time": 1.0}, "delay = 17.0 s is not 1 to 16 times"),
        (
            {"sun_exclusion": 0.5, "sun_eci": (0.0, 0.0, 0.0)},
            "needs sun_eci, which is zero",
        ),
        ({"earth_exclusion": 0.5, "r_eci": (1.0, 0.0, 0.0)}, "below its surface"),
        ({"sun_exclusion": 3.2}, "sun_exclusion"),
        ({"noise_cross": -1.0}, "noise_cross"),
    ],
)
def test_star_tracker_refuses_what_cannot_be(values, message):
    with pytest.raises(ValueError, match=message):
        sensor("star_tracker", **values)


@pytest.mark.parametrize(
    ("parameter", "input_name"),
    [
        ("sun_exclusion", "sun_eci"),
        ("earth_exclusion", "r_eci"),
        ("rate_limit", "omega_bi_body"),
    ],
)
def test_star_tracker_refuses_a_blinding_that_it_cannot_see(parameter, input_name):
    block = sensor("star_tracker", sun_eci=(1.0, 0.0, 0.0), **{parameter: 0.1})
    wires = {"q_bi", "sun_eci", "r_eci", "omega_bi_body"}
    assert not list(block.foresee(0.0, 10.0, frozenset(wires)))
    with pytest.raises(ValueError, match=f"needs {input_name}, which has no wire"):
        list(block.foresee(0.0, 10.0, frozenset(wires - {input_name})))


def test_star_tracker_flies_a_craft_without_determination():
    """The share of time without stars is that of its drop-outs, and a delay turns a
    craft that points to nadir by what the orbit turns meanwhile."""

    def number(run, name):
        return run.manifest["numbers"][name]["value"]

    prompt = desat.run("nadir_day/star-tracker-prompt")
    late = desat.run("nadir_day/star-tracker-late")
    missing = prompt.results.values("star_tracker.lost_to")
    assert set(np.unique(missing)) == {0, 4, 5}, (
        "neither Sun nor Earth, where it is mounted"
    )
    dropouts = int((missing == 4).sum())
    assert dropouts == pytest.approx(24, abs=4 * math.sqrt(24))
    assert (missing == 5).sum() == pytest.approx(9 * dropouts, abs=9)
    assert 100 * (missing == 0).mean() == pytest.approx(
        number(prompt, "seen"), abs=0.01
    )
    assert prompt.results.values("controller.tau_ctrl_body")[missing == 4].any() == 0
    orbit = 360.0 / 5739.0  # deg/s
    pointing_mean = number(late, "pointing_mean")
    assert pointing_mean == pytest.approx(orbit, rel=2e-3)
    assert number(prompt, "pointing_mean") < 0.2 * orbit


def test_star_tracker_mounted_towards_the_earth_sees_no_stars():
    down = desat.run(
        "nadir_day/star-tracker-prompt",
        {"star_tracker.boresight_body": [0.0, 0.0, 1.0]},
        stop=60.0,
    )
    assert (down.results.values("star_tracker.lost_to")[:60] == 2).all()
    assert not down.results.values("controller.tau_ctrl_body").any()


def test_star_tracker_has_the_bits_of_its_python_where_it_is_blinded_and_late():
    values = {
        "star_tracker.delay": 3.0,
        "star_tracker.earth_exclusion": 0.98,
        "star_tracker.dropout_interval": 30.0,
        "star_tracker.reacquisition_time": 4.0,
        "spacecraft.omega_start_body": [0.015, -1e-3, 5e-4],
    }
    native, python = (
        desat.run("nadir_day/star-tracker-late", values, stop=1500.0, fmus=kind)
        for kind in ("native", "python")
    )
    reasons = native.results.values("star_tracker.lost_to")
    assert set(np.unique(reasons)) == {0, 1, 2, 4, 5, 6}
    for signal in ("star_tracker.lost_to", "star_tracker.q_meas_bi", "spacecraft.q_bi"):
        np.testing.assert_array_equal(
            native.results.values(signal), python.results.values(signal)
        )
