"""The Earth's field against references from outside, and the reference trajectory.

`authorities/environment_reference.csv`, `parameters.json` and `gyrostat.json` are those
of the project's reference trajectories; of the first every tenth row is kept.
"""

from __future__ import annotations

import csv
import json
import math
import random
from datetime import datetime

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from desat.components.bases import near_earth
from desat.components.blocks.environment_kepler import EnvironmentKepler
from desat.components.blocks.environment_tle import EnvironmentTle
from desat.components.contract.block import Block, BlockError, Vec3
from desat.components.maths.vector import norm
from desat.components.physics import earth, geomagnetic, igrf14, orbit
from desat.fmus import build
from tests.conftest import ROOT
from tests.physics.environments import at, begin, epoch, kepler

AUTHORITIES = ROOT / "tests" / "authorities"
OUTPUTS = [v.name for v in EnvironmentKepler.variables if v.causality == "output"]
FIELDS = ("none", "dipole", "igrf")


def on_the_way(block: Block, t: float, dt: float = 1.0) -> Block:
    """The block at t as a master has it, through `advance`."""
    block.advance(t - dt, dt)
    return at(block, t)


# --- orbit ----------------------------------------------------------------------------

angle = st.floats(-math.pi, math.pi)


# --- the reference trajectory ---------------------------------------------------------


COLUMNS = {
    "t": 0,
    "r": slice(1, 4),
    "fixed": slice(13, 16),
    "rotating": slice(16, 19),
    "wmm": slice(19, 22),
    "density": 22,
}


def reference_rows() -> list[list[float]]:
    with open(AUTHORITIES / "environment_reference.csv", encoding="utf-8") as f:
        return [[float(x) for x in row] for row in list(csv.reader(f))[1:]]


def reference_block(**overrides: object) -> EnvironmentKepler:
    p = json.loads((AUTHORITIES / "parameters.json").read_text(encoding="utf-8"))
    d, air = p["dipole"], p["atmosphere"]
    parameters = {
        **orbit.elements_from_state(p["r0_N"], p["v0_N"], p["mu"])._asdict(),
        "mu": p["mu"],
        "field": "dipole",
        "dipole_earth": tuple(d[k] * d["R"] ** 3 for k in ("g11", "h11", "g10")),
        "earth_rate": p["earth_rotation"]["rate"],
        "earth_angle": "given",
        "earth_angle_start": p["earth_rotation"]["gmst0"],
        "atmosphere": "exponential",
        "density_base": air["rho_500km"],
        "altitude_base": 500e3,
        "scale_height": air["H_m"],
        "atmosphere_radius": air["Re_m"],
    }
    return kepler(**{**parameters, **overrides})


@pytest.mark.parametrize(
    ("column", "overrides"), [("fixed", {"earth_rate": 0.0}), ("rotating", {})]
)
def test_reference_trajectory(column, overrides):
    block = reference_block(**overrides)
    for row in reference_rows():
        on_the_way(block, row[COLUMNS["t"]])
        assert math.dist(block.r_eci, row[COLUMNS["r"]]) < 1e-5
        assert math.dist(block.b_eci, row[COLUMNS[column]]) < 1e-12
        assert block.density == pytest.approx(row[COLUMNS["density"]], rel=1e-9)


def test_reference_trajectory_in_the_world_magnetic_model():
    """IGRF-14 at 2026.0 is another model than WMM2025, of the same field: 100 nT, 0.3
    %."""
    block = reference_block(field="igrf", epoch_j2000=epoch(2026, 1, 1))
    for row in reference_rows():
        on_the_way(block, row[COLUMNS["t"]])
        assert math.dist(block.b_eci, row[COLUMNS["wmm"]]) < 1e-7


def test_field_of_the_gyrostat_reference():
    case = json.loads((AUTHORITIES / "gyrostat.json").read_text(encoding="utf-8"))
    path, f = case["orbit"], case["field"]
    a, i, tilt = path["radius"], math.radians(path["inclination_deg"]), f["tilt_rad"]
    block = kepler(
        mu=path["mu"],
        semi_major_axis=a,
        inclination=i,
        field="dipole",
        dipole_earth=(
            f["dipole_T_m3"] * math.sin(tilt),
            0.0,
            -f["dipole_T_m3"] * math.cos(tilt),
        ),
        earth_rate=f["earth_rate"],
        earth_angle="given",
        earth_angle_start=f["phase_rad"],
    )
    n = math.sqrt(path["mu"] / a**3)
    for t in np.arange(0.0, 601.0, 1.7):
        ph = f["earth_rate"] * t + f["phase_rad"]
        m = np.array(
            [
                math.sin(tilt) * math.cos(ph),
                math.sin(tilt) * math.sin(ph),
                -math.cos(tilt),
            ]
        )
        u = np.array(
            [
                math.cos(n * t),
                math.sin(n * t) * math.cos(i),
                math.sin(n * t) * math.sin(i),
            ]
        )
        dipole_field = f["dipole_T_m3"] / a**3 * (3 * (m @ u) * u - m)
        on_the_way(block, float(t))
        assert math.dist(block.r_eci, a * u) < 1e-7
        assert math.dist(block.b_eci, dipole_field) < 1e-16


# --- field ----------------------------------------------------------------------------


def ppigrf_field(r: Vec3, date: datetime) -> Vec3:
    ppigrf = pytest.importorskip(
        "ppigrf", reason="the oracle of IGRF-14 is the package ppigrf"
    )
    size = norm(r)
    theta, phi = math.atan2(math.hypot(r[0], r[1]), r[2]), math.atan2(r[1], r[0])
    components = ppigrf.igrf_gc(
        size / 1e3, math.degrees(theta), math.degrees(phi), date
    )
    up, south, east = (1e-9 * float(np.squeeze(x)) for x in components)
    st, ct, sp, cp = math.sin(theta), math.cos(theta), math.sin(phi), math.cos(phi)
    return (
        up * st * cp + south * ct * cp - east * sp,
        up * st * sp + south * ct * sp + east * cp,
        up * ct - south * st,
    )


@pytest.mark.parametrize(
    ("date", "tolerance"),
    # between two years ppigrf counts days, we, as IGRF, years: up to half a day of
    # change
    [
        ((1900, 1, 1), 1e-17),
        ((1905, 7, 2), 1e-9),
        ((1999, 12, 31), 1e-9),
        ((2005, 1, 1), 1e-17),
        ((2020, 1, 1), 1e-17),
        ((2025, 1, 1), 1e-17),
        ((2026, 1, 1), 1e-9),
        ((2030, 1, 1), 1e-17),
    ],
)
def test_igrf(date, tolerance):
    year = earth.decimal_year(epoch(*date))
    rng = random.Random(1)
    for k in range(25):
        latitude = (90, -90, 89.9999, -89.99, 0)[k] if k < 5 else rng.uniform(-90, 90)
        phi, theta = rng.uniform(-math.pi, math.pi), math.radians(90 - latitude)
        size = geomagnetic.REFERENCE_RADIUS + rng.uniform(0, 2e6)
        r = (
            size * math.sin(theta) * math.cos(phi),
            size * math.sin(theta) * math.sin(phi),
            size * math.cos(theta),
        )
        # ppigrf divides by the sine of the colatitude
        reference_field = ppigrf_field(
            r if k > 1 else (1.0, 1.0, r[2]), datetime(*date)
        )
        assert math.dist(geomagnetic.igrf(r, year), reference_field) < (
            tolerance if k > 1 else 1e-9
        )


@given(
    st.floats(-1.0, 1.0),
    st.floats(-math.pi, math.pi),
    st.floats(6.45e6, 2e7),
    st.floats(2000.0, 2029.0),
)
@settings(max_examples=300)
def test_the_earths_field_is_plausible_everywhere(sine, longitude, radius, year):
    cosine = math.sqrt(1.0 - sine * sine)
    x, y = cosine * math.cos(longitude), cosine * math.sin(longitude)
    b = math.hypot(*geomagnetic.igrf((radius * x, radius * y, radius * sine), year))
    moment = 29.7e-6 * geomagnetic.REFERENCE_RADIUS**3
    assert geomagnetic.is_plausible(b, moment, radius)
    assert not geomagnetic.is_plausible(4.5 * b, moment, radius)
    assert not geomagnetic.is_plausible(0.2 * b, moment, radius)


def test_igrf_at_the_poles_themselves():
    for z in (6.8e6, -6.8e6):
        here, neighbour = geomagnetic.igrf((0.0, 0.0, z), 2025.0), (1e-3, 2e-3, z)
        assert here == pytest.approx(geomagnetic.igrf(neighbour, 2025.0), abs=1e-13)


@pytest.mark.parametrize("degree", [1, 2, 7, 13])
def test_igrf_degree(degree):
    """Every degree is a potential field: no divergence, no curl; and of its own power
    of r."""

    def field_of_degree(*r: float) -> np.ndarray:
        b = np.array(geomagnetic.igrf(r, 2025.0, degree))
        return b - geomagnetic.igrf(r, 2025.0, degree - 1) if degree > 1 else b

    r = np.array([3.1e6, -4.2e6, 4.4e6])
    assert field_of_degree(*(2 * r)) == pytest.approx(
        field_of_degree(*r) / 2 ** (degree + 2), rel=1e-9, abs=1e-20
    )
    h = 1e3
    slope = np.array(
        [
            (field_of_degree(*(r + h * e)) - field_of_degree(*(r - h * e))) / (2 * h)
            for e in np.eye(3)
        ]
    )
    assert abs(np.trace(slope)) < 1e-4 * np.abs(slope).max()
    assert np.abs(slope - slope.T).max() < 1e-4 * np.abs(slope).max()


def test_the_dipole_is_degree_one():
    """The start value of `dipole_earth` is IGRF-14 at 2025.0."""
    m = EnvironmentKepler().dipole_earth
    for r in ((7e6, 0.0, 0.0), (1e6, -5e6, 4e6), (0.0, 0.0, -7e6)):
        first_degree = geomagnetic.igrf(r, 2025.0, 1)
        assert geomagnetic.dipole(r, m) == pytest.approx(first_degree, abs=1e-19)
    assert geomagnetic.dipole((0.0, 0.0, 7e6), m)[2] < 0, (
        "at the north pole B points down"
    )


def test_igrf_coefficients():
    """Models five years apart; after 2025 the published secular variation."""
    assert [
        igrf14.model_year(igrf14.model_of(y)) for y in (1900.0, 2024.99, 2025.0, 2030.0)
    ] == [
        1900.0,
        2020.0,
        2025.0,
        2025.0,
    ]
    now, change = igrf14.model(igrf14.model_of(2027.0))
    assert len(now) == len(change) == 13 * 15
    assert len(igrf14.model(25, 1)[0]) == 3
    g10, dg10 = now[0], change[0]
    assert g10 + 2 * dg10 == pytest.approx(1e-9 * (-29350.0 + 2 * 12.6), rel=1e-12)


@pytest.mark.parametrize("date", [(1899, 12, 31), (2030, 1, 2)])
def test_an_epoch_that_igrf_does_not_cover_is_refused(date):
    with pytest.raises(
        BlockError, match=r"epoch_j2000 = .* s: .* outside \[1900, 2030\]"
    ):
        kepler(field="igrf", epoch_j2000=epoch(*date))
    kepler(field="dipole", epoch_j2000=epoch(*date))


def test_the_coefficients_travel_with_the_fmu():
    for name in ("environment_kepler", "environment_tle"):
        assert "physics/igrf14.json" in build.contents(name)


LOW = {"semi_major_axis": 6.63e6, "eccentricity": 0.01, "inclination": 1.7, "raan": 0.4}
CASES = [
    (EnvironmentKepler, {"field": "dipole", **LOW}),
    (EnvironmentKepler, {"field": "igrf", **LOW}),
    (EnvironmentKepler, {"field": "igrf", "j2": True, **LOW}),
    (
        EnvironmentKepler,
        {"field": "igrf", "semi_major_axis": 2.4e7, "eccentricity": 0.73},
    ),
    (EnvironmentTle, {"field": "dipole"}),
    (EnvironmentTle, {"field": "igrf"}),
]


def field_now(block: EnvironmentKepler | EnvironmentTle, t: float) -> Vec3:
    """The field itself where the block is at t, without nodes."""
    angle = block.earth_rate * t + earth.earth_angle(block.epoch_j2000)
    c, s = math.cos(angle), math.sin(angle)
    x, y, z = block.motion(t)[0]
    r = (c * x + s * y, c * y - s * x, z)
    if block.field == FIELDS.index("dipole"):
        bx, by, bz = geomagnetic.dipole(r, block.dipole_earth)
    else:
        bx, by, bz = geomagnetic.igrf(r, earth.decimal_year(block.epoch_j2000 + t))
    return (c * bx - s * by, s * bx + c * by, bz)


@pytest.mark.parametrize(("kind", "parameters"), CASES)
def test_field_and_its_derivatives(kind, parameters):
    block = begin(kind(), **parameters)
    h = 0.5
    for t in np.arange(0.0, 6000.0, 13.7).tolist():
        b = {k: np.array(field_now(block, t + k * h)) for k in (-2, -1, 0, 1, 2)}
        on_the_way(block, t)
        assert math.dist(block.b_eci, b[0]) < 2e-14
        first = (8 * (b[1] - b[-1]) - (b[2] - b[-2])) / (12 * h)
        second = (16 * (b[1] + b[-1]) - b[2] - b[-2] - 30 * b[0]) / (12 * h**2)
        assert math.dist(block.b_rate_eci, first) < 1e-14
        assert math.dist(block.b_accel_eci, second) < 5e-15
        after = b[0] + np.array(block.b_rate_eci) + np.array(block.b_accel_eci) / 2
        assert math.dist(after, b[2]) < 1e-12


def test_polynomial_and_its_derivatives():
    """Exact for degree five."""
    p = np.polynomial.Polynomial([3.0, -0.2, 0.05, 1e-3, -2e-4, 3e-6])
    c = near_earth.quintic(tuple(p(near_earth.NODE_TIME * k) for k in range(-2, 4)))
    for s in (0.0, 3.3, 10.0):
        polynomial_values = (p(s), p.deriv()(s), p.deriv(2)(s))
        assert near_earth.derivatives(c, s) == pytest.approx(
            polynomial_values, rel=1e-11
        )


def still(**parameters: object) -> EnvironmentKepler:
    """An environment whose Earth does not turn: only the coefficients move."""
    return kepler(earth_rate=0.0, earth_angle="given", **parameters)


def test_the_coefficients_move_in_a_long_run():
    """After 30 days the field of a run is that of one that begins then: 4 nT from the
    one before in the median at 550 km, 12 nT at the most."""
    start, month = epoch(2026, 3, 1), 30 * 86400.0
    long, then = still(epoch_j2000=start), still(epoch_j2000=start + month)
    field_changes = []
    for u in np.random.default_rng(2).normal(size=(300, 3)):
        r = tuple((6.928137e6 * u / np.linalg.norm(u)).tolist())
        now = long.field_date(r, month, igrf=True)
        assert math.dist(now, then.field_date(r, 0.0, igrf=True)) < 1e-18
        field_changes.append(math.dist(now, long.field_date(r, 0.0, igrf=True)))
        # the secular variation is linear
        half = long.field_date(r, month / 2, igrf=True)
        before = long.field_date(r, 0.0, igrf=True)
        assert [2 * x for x in half] == pytest.approx(np.add(now, before), abs=1e-18)
    assert np.median(field_changes) == pytest.approx(4e-9, rel=0.3)
    assert max(field_changes) == pytest.approx(12e-9, rel=0.2)


def test_a_run_across_two_models_is_continuous():
    """At 2025.0 the secular variation changes, the field does not."""
    block, r = still(epoch_j2000=epoch(2024, 12, 31)), (5e6, -3e6, 4e6)
    before, at, after = (
        np.array(block.field_date(r, 86400.0 + s, igrf=True)) for s in (-1.0, 0.0, 1.0)
    )
    assert np.abs(at - before).max() < 1e-14
    assert np.abs(after - at).max() < 1e-14
    assert at == pytest.approx(geomagnetic.igrf(r, 2025.0), abs=1e-19)


def test_a_run_that_leaves_igrf_is_an_error():
    block = kepler(field="igrf", epoch_j2000=epoch(2029, 12, 31, 12))
    at(block, 43200.0 - 60.0)
    with pytest.raises(BlockError, match=r"the year 2030.00 is outside \[1900, 2030\]"):
        at(block, 43200.0 + 600.0)


# --- calls ----------------------------------------------------------------------------


@pytest.mark.parametrize("field", FIELDS)
@pytest.mark.parametrize("kind", [EnvironmentKepler, EnvironmentTle])
def test_outputs_are_a_function_of_time(kind, field):
    """The same bits whatever was called before: forward, in any order, with jumps,
    restarted."""
    block = begin(kind(), field=field)

    def outputs() -> str:
        return repr([getattr(block, name) for name in OUTPUTS])

    forward = {}
    for k in range(100):
        forward[k] = outputs() if k and not block.output(float(k)) else ""
        block.advance(float(k), 1.0)
    times = [*range(1, 100)]
    random.Random(3).shuffle(times)
    for restart in (False, True):
        for k in times:
            if restart:
                block.start()
            block.output(float(k))
            assert outputs() == forward[k]
    block.start()
    for step in (7.0, 31.0, 1.0):  # some nodes serve again, or none
        for k in range(int(99 / step)):
            block.advance(k * step, step)
            block.output((k + 1) * step)
            assert outputs() == forward[int((k + 1) * step)]


def test_no_field_no_air():
    block = at(kepler(field="none", atmosphere="none"), 10.0)
    assert block.b_eci == block.b_rate_eci == block.b_accel_eci == (0.0, 0.0, 0.0)
    assert block.density == 0.0
