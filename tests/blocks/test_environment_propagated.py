"""The integrated orbit, its frames and what acts on it: own references and closed
forms."""

from __future__ import annotations

import math
from datetime import datetime

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from desat.components.bases import orbit_start
from desat.components.bases.near_earth import NODE_TIME
from desat.components.blocks.environment_kepler import EnvironmentKepler
from desat.components.blocks.environment_propagated import (
    EnvironmentPropagated,
    hermite,
)
from desat.components.blocks.environment_tle import EnvironmentTle
from desat.components.blocks.manager_receding_horizon import ManagerRecedingHorizon
from desat.components.contract.block import Block, BlockError, Vec3
from desat.components.maths.attitude import from_matrix, propagate, rotate, rotate_back
from desat.components.maths.vector import cross, norm
from desat.components.physics import averaging, earth, orbit
from desat.runs.run import Options, execute, prepare
from desat.system.errors import DesatError
from tests.conftest import cross3
from tests.physics import environments
from tests.physics.environments import at

DAY = 86400.0
ECCENTRIC = {
    "semi_major_axis": 7.5e6,
    "eccentricity": 0.08,
    "inclination": 0.9,
    "raan": 0.5,
    "argument_of_perigee": 1.0,
    "mean_anomaly": 0.2,
}
ORBITS = [{}, ECCENTRIC]


def begin(block: Block, **parameters: object) -> Block:
    """The block, checked and started, with its outputs at 0 s."""
    return at(environments.begin(block, **parameters), 0.0)


def propagation(**parameters: object) -> EnvironmentPropagated:
    values = {"field": "none", "atmosphere": "none", "orbit_start": "osculating"}
    return begin(EnvironmentPropagated(), **{**values, **parameters})


def run(
    block: EnvironmentPropagated, stop: float, dt: float, begin: float = 0.0
) -> None:
    for k in range(round((stop - begin) / dt)):
        block.advance(begin + k * dt, dt)
    block.output(stop)


def potential(r: np.ndarray, degree: int) -> float:
    """U = mu / r (1 - sum J_n (R / r)^n P_n(z / r)), with Legendre's polynomials of
    numpy."""
    size = math.sqrt(r @ r)
    series = [
        1.0,
        0.0,
        *(
            -j * (orbit.EARTH_RADIUS / size) ** n if n <= degree else 0.0
            for n, j in ((2, orbit.J2), (3, orbit.J3), (4, orbit.J4))
        ),
    ]
    return orbit.MU / size * np.polynomial.legendre.legval(r[2] / size, series)


def cowell(y, degree: int, stop: float, extra=lambda t, y: 0.0) -> np.ndarray:
    """Position and velocity after `stop` (s), by scipy's DOP853 in the gradient of
    `potential`, written for its derivatives by r and z."""
    legendre = np.polynomial.legendre.Legendre
    harmonics = [
        (n, j, legendre.basis(n), legendre.basis(n).deriv())
        for n, j in ((2, orbit.J2), (3, orbit.J3), (4, orbit.J4))
        if n <= degree
    ]

    def slopes(t, y):
        r = y[:3]
        size = math.sqrt(r @ r)
        up, s = r / size, r[2] / size
        by_r, by_s = -orbit.MU / size**2, 0.0
        for n, j, p, dp in harmonics:
            q = orbit.MU / size * j * (orbit.EARTH_RADIUS / size) ** n
            by_r += (n + 1) / size * q * p(s)
            by_s -= q * dp(s)
        a = by_r * up + by_s * (np.array([0.0, 0.0, 1.0]) - s * up) / size
        return np.concatenate([y[3:], a + extra(t, y)])

    return solve_ivp(slopes, (0.0, stop), y, "DOP853", rtol=1e-12, atol=1e-6).y[:, -1]


def state(block: Block) -> list[float]:
    return [*block.r_eci, *block.v_eci]


# --- gravity and propagation ----------------------------------------------------------


@pytest.mark.parametrize("degree", [1, 2, 3, 4])
@given(st.tuples(*(st.floats(-1.0, 1.0),) * 3).filter(lambda u: norm(u) > 0.1))
def test_gravity_is_the_gradient_of_its_potential(degree, u):
    r = 7e6 / norm(u) * np.array(u)
    h = 2e3
    expected = [
        (
            8 * (potential(r + h * e, degree) - potential(r - h * e, degree))
            - (potential(r + 2 * h * e, degree) - potential(r - 2 * h * e, degree))
        )
        / (12 * h)
        for e in np.eye(3)
    ]
    # the harmonics are down to 1e-5 m/s2
    assert orbit.gravity(tuple(r.tolist()), degree) == pytest.approx(
        expected, abs=1e-10
    )


@pytest.mark.parametrize("parameters", ORBITS)
def test_24_h_against_cowell(parameters):
    """Wanted are 100 m; it is below 1 mm, with J2 to J4."""
    block = propagation(**parameters)
    reference = cowell(state(block), 4, DAY)
    run(block, DAY, 60.0)
    assert math.dist(block.r_eci, reference[:3]) < 1e-3
    assert math.dist(block.v_eci, reference[3:]) < 1e-6


def test_the_orbit_does_not_depend_on_the_step():
    once = propagation(**ECCENTRIC)
    run(once, 3000.0, 0.5)
    for dt in (1.0, 7.5, 10.0, 100.0, 3000.0):
        again = propagation(**ECCENTRIC)
        run(again, 3000.0, dt)
        assert state(again) == state(once)
        again.output(1234.5)  # another time, also before: as integrated from here
        there = again.r_eci
        run(once := propagation(**ECCENTRIC), 1234.5, 0.5)
        assert math.dist(there, once.r_eci) < 1e-6
        run(once := propagation(**ECCENTRIC), 3000.0, 0.5)


def test_without_harmonics_it_is_keplers():
    block = propagation(zonals="none", **ECCENTRIC)
    kepler = begin(EnvironmentKepler(), field="none", **ECCENTRIC)
    for t in (3.3, 4000.0, 20000.0):
        run(block, t, t)
        kepler.output(t)
        assert math.dist(block.r_eci, kepler.r_eci) < 1e-4
        assert math.dist(block.v_eci, kepler.v_eci) < 1e-7


def test_energy_is_conserved():
    """1/2 v^2 - U, with the potential that gravity is the gradient of."""
    block = propagation(**ECCENTRIC)

    def energy() -> float:
        return np.dot(block.v_eci, block.v_eci) / 2 - potential(
            np.array(block.r_eci), 4
        )

    before = energy()
    run(block, DAY, 600.0)
    assert energy() == pytest.approx(before, rel=1e-13)


def test_velocity_is_the_derivative_of_position():
    block = propagation(**ECCENTRIC)
    for t in (0.4, 9.7, 10.0, 777.7):
        run(block, t, t)
        r, v = {}, block.v_eci
        for k in (-2, -1, 1, 2):
            block.output(t + 0.1 * k)
            r[k] = np.array(block.r_eci)
        assert (8 * (r[1] - r[-1]) - (r[2] - r[-2])) / 1.2 == pytest.approx(v, abs=1e-6)


def test_hermite():
    """Exact for degree five."""
    p = np.polynomial.Polynomial([3.0, -0.2, 0.05, 1e-3, -2e-4, 3e-6])
    ends = [q(s) for s in (0.0, NODE_TIME) for q in (p, p.deriv(), p.deriv(2))]
    assert hermite(*ends) == pytest.approx(p.coef, rel=1e-9)


def test_the_field_is_that_of_the_path():
    """The derivatives belong to the field along the integrated orbit."""
    block = begin(EnvironmentPropagated(), field="igrf", **ECCENTRIC)
    h = 0.5
    for t in (3.0, 1003.0):
        for k in range(round(t / 1.0)):
            block.advance(float(k), 1.0)
        b = {}
        for k in (-1, 1):
            r, _ = block.motion(t + k * h)
            b[k] = np.array(block.field_date(r, t + k * h, igrf=True))
        block.output(t)
        assert (
            math.dist(block.b_eci, block.field_eci(block.r_eci, t, igrf=True)) < 2e-14
        )
        assert (b[1] - b[-1]) / (2 * h) == pytest.approx(block.b_rate_eci, abs=1e-12)


# --- how an orbit is given ------------------------------------------------------------


@pytest.mark.parametrize("kind", [EnvironmentKepler, EnvironmentPropagated])
def test_a_state_is_its_osculating_elements(kind):
    by_elements = begin(kind(), field="none", orbit_start="osculating", **ECCENTRIC)
    r, v = by_elements.r_eci, by_elements.v_eci
    by_state = begin(kind(), field="none", orbit_start="state", r_start=r, v_start=v)
    for t in (0.0, 100.0):
        by_elements.output(t)
        by_state.output(t)
        assert math.dist(by_state.r_eci, by_elements.r_eci) < 1e-6
        assert math.dist(by_state.v_eci, by_elements.v_eci) < 1e-9


@pytest.mark.parametrize("parameters", ORBITS)
def test_osculating_elements_are_no_mean_elements(parameters):
    """After a revolution: tens of km off where given as mean ones to the mean drift of
    J2, its periodic part where averaged first, and nothing where integrated."""
    integrated = propagation(**parameters)
    period = math.tau / orbit.mean_motion(integrated.semi_major_axis)
    for revolutions in (1, 15):
        t = revolutions * period
        truth = cowell(state(propagation(**parameters)), 4, t)[:3]
        off = {}
        for form in ("mean", "osculating"):
            kepler = begin(
                EnvironmentKepler(),
                field="none",
                j2=True,
                **parameters,
                orbit_start=form,
            )
            kepler.output(t)
            off[form] = math.dist(kepler.r_eci, truth)
        assert off["mean"] > 49e3 * revolutions
        assert off["osculating"] < 7e3
    run(integrated, t, t)
    assert math.dist(integrated.r_eci, truth) < 1e-3


@pytest.mark.parametrize("parameters", ORBITS)
def test_mean_elements_are_those_of_the_other_block(parameters):
    """One block in the other's place: the same orbit up to its periodic part, for a
    day."""
    integrated = propagation(**{**parameters, "orbit_start": "mean"})
    drifting = begin(EnvironmentKepler(), field="none", j2=True, **parameters)
    for t in np.arange(0.0, DAY + 1.0, DAY / 16).tolist():
        run(integrated, t, DAY / 16, begin=max(t - DAY / 16, 0.0))
        drifting.output(t)
        assert math.dist(integrated.r_eci, drifting.r_eci) < 9e3


some_elements = st.builds(
    orbit.Elements,
    st.floats(6.7e6, 2e7),
    st.floats(0.0, 0.04),
    st.floats(0.0, 3.0),
    *(st.floats(-math.pi, math.pi),) * 3,
)


@settings(max_examples=10)
@given(some_elements)
def test_mean_and_osculating_elements_are_inverse(mean):
    osculating = averaging.osculating_elements(mean, 4, orbit.MU)
    again = averaging.mean_elements(osculating, 4, orbit.MU)
    here, there = (orbit.state_from_elements(e)[0] for e in (mean, again))
    assert math.dist(here, there) < 0.1
    # the difference is the periodic part: J2 (R/a)^2 of the orbit
    apart = math.dist(here, orbit.state_from_elements(osculating)[0])
    assert apart < 5 * orbit.J2 * orbit.EARTH_RADIUS**2 / mean.semi_major_axis


def test_mean_elements_of_a_sphere_are_the_elements():
    e = orbit.Elements(*(ECCENTRIC[n] for n in orbit.Elements._fields))
    assert averaging.mean_elements(e, 1, orbit.MU) == pytest.approx(e, rel=1e-9)


def test_a_mean_orbit_that_lies_backwards_in_the_equator_is_refused():
    with pytest.raises(BlockError, match=r"inclination = 3.14.*below 3.13"):
        begin(EnvironmentPropagated(), inclination=math.pi)


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        (
            {"orbit_start": "state", "v_start": (0.0, 2e4, 0.0)},
            r"v_start = .*: not on an ellipse",
        ),
        ({"orbit_start": "state", "r_start": (0.0, 0.0, 0.0)}, "not on an ellipse"),
        (
            {"orbit_start": "state", "v_start": (0.0, 5e3, 0.0)},
            "perigee at .* inside the Earth",
        ),
        (
            {"semi_major_axis": 7e6, "eccentricity": 0.1},
            "semi_major_axis = 7e.*inside the Earth",
        ),
    ],
)
def test_an_orbit_that_is_none_is_refused(parameters, message):
    with pytest.raises(BlockError, match=message):
        begin(EnvironmentKepler(), **parameters)


# --- frames ---------------------------------------------------------------------------

IN_2026 = (datetime(2026, 1, 1) - datetime(2000, 1, 1, 12)).total_seconds()


def test_precession():
    """SOFA's own test of pmat76: MJD 50123.9999."""
    expected = (
        0.9999995504328350733,
        0.8696632209480960785e-3,
        0.3779153474959888345e-3,
        -0.8696632209485112192e-3,
        0.9999996218428560614,
        -0.1643284776111886407e-6,
        -0.3779153474950335077e-3,
        -0.1643306746147366896e-6,
        0.9999999285899790119,
    )
    found = earth.precession((50123.9999 - 51544.5) * DAY)
    # the day is a float of seconds: 1e-8 s
    assert found == pytest.approx(expected, abs=2e-15)


def test_precession_by_2026():
    x_axis = earth.precession(IN_2026)[::3]
    apart = math.degrees(math.atan2(math.hypot(*x_axis[1:]), x_axis[0]))
    assert apart == pytest.approx(26 * 50.29 / 3600, rel=1e-3)  # 0.36 deg


def back(v: Vec3) -> np.ndarray:
    return np.array(earth.precession(IN_2026)).reshape(3, 3).T @ v


@pytest.mark.parametrize(
    "kind", [EnvironmentKepler, EnvironmentPropagated, EnvironmentTle]
)
def test_j2000_out(kind):
    """All outputs turn together; what is a number stays."""
    air = {"atmosphere": "activity", "epoch_j2000": IN_2026}
    if kind is EnvironmentTle:
        air["epoch_tle_j2000"] = IN_2026 - 1000.0
        of_date, j2000 = (begin(kind(), **air, eci_frame=f) for f in ("date", "j2000"))
    else:
        values = {
            **air,
            **ECCENTRIC,
            "orbit_frame": "date",
            "orbit_start": "osculating",
        }
        of_date, j2000 = (
            begin(kind(), **values, eci_frame=f) for f in ("date", "j2000")
        )
    for t in (0.0, 1234.5):
        of_date.output(t)
        j2000.output(t)
        for name in ("r_eci", "v_eci", "b_eci", "b_rate_eci", "b_accel_eci", "sun_eci"):
            expected = back(getattr(of_date, name))
            scale = norm(expected)
            assert getattr(j2000, name) == pytest.approx(expected, abs=2e-12 * scale), (
                name
            )
        assert j2000.density == pytest.approx(of_date.density, rel=1e-12)
        assert j2000.sunlight == of_date.sunlight
    assert math.dist(j2000.r_eci, of_date.r_eci) > 1e4


@pytest.mark.parametrize("form", ["elements", "state"])
@pytest.mark.parametrize("kind", [EnvironmentKepler, EnvironmentPropagated])
def test_j2000_in(kind, form):
    """The same orbit, given in either frame."""
    values = {
        "field": "none",
        "epoch_j2000": IN_2026,
        "orbit_start": "osculating",
        **ECCENTRIC,
    }
    of_date = begin(kind(), **values)
    if form == "state":
        r, v = tuple(back(of_date.r_eci).tolist()), tuple(back(of_date.v_eci).tolist())
        values |= {"orbit_start": "state", "r_start": r, "v_start": v}
    else:
        values |= orbit.rotate_elements(
            orbit.Elements(*(ECCENTRIC[n] for n in orbit.Elements._fields)),
            tuple(np.array(earth.precession(IN_2026)).reshape(3, 3).T.ravel().tolist()),
        )._asdict()
    in_j2000 = begin(kind(), **values, orbit_frame="j2000")
    for t in (0.0, 5000.0):
        of_date.output(t)
        in_j2000.output(t)
        assert math.dist(in_j2000.r_eci, of_date.r_eci) < 1e-5
        assert math.dist(in_j2000.v_eci, of_date.v_eci) < 1e-8
    both = begin(kind(), **values, eci_frame="j2000")  # eci itself: in and out
    assert both.r_eci == pytest.approx(back(of_date.motion(0.0)[0]), abs=1e-5)


@given(
    st.builds(
        orbit.Elements,
        st.floats(6.6e6, 4e7),
        st.floats(0.0, 0.9),
        st.floats(0.0, math.pi),
        *(st.floats(-math.pi, math.pi),) * 3,
    )
)
def test_turned_elements_are_of_the_turned_state(elements):
    c = earth.precession(IN_2026)

    def place(e: orbit.Elements) -> np.ndarray:
        p, q = orbit.perifocal_axes(e.inclination, e.raan, e.argument_of_perigee)
        r, v = orbit.ellipse_state(
            e.semi_major_axis, e.eccentricity, e.mean_anomaly, 1e-3, p, q
        )
        return np.array([r, v])

    expected = place(elements) @ np.array(c).reshape(3, 3).T
    assert place(orbit.rotate_elements(elements, c)) == pytest.approx(
        expected, abs=1e-8 * elements.semi_major_axis
    )


@pytest.mark.parametrize("frame", ["date", "j2000"])
def test_the_field_onboard_is_of_the_same_frame(frame):
    values = {"epoch_j2000": IN_2026, "eci_frame": frame}
    outside = begin(EnvironmentKepler(), **values)
    onboard = begin(
        ManagerRecedingHorizon(), sample_time=10.0, field_model="igrf", **values
    )
    outside.output(700.0)
    found = onboard.field_eci(outside.r_eci, 700.0, igrf=True)
    assert math.dist(found, outside.b_eci) < 2e-14


# --- drag and firings -----------------------------------------------------------------


def test_drag_lowers_a_circle():
    """da/dt = -rho C_d A / m sqrt(mu a) on a circle in air at rest."""
    a, area, mass = 6.728e6, 2.0, 50.0
    block = propagation(
        semi_major_axis=a,
        zonals="none",
        atmosphere="exponential",
        earth_rate=0.0,
        area_drag=area,
        mass=mass,
        density_base=1e-11,
        altitude_base=a - orbit.EARTH_RADIUS,
    )
    stop = 10 * math.tau / orbit.mean_motion(a)
    run(block, stop, stop)
    fallen = a - orbit.elements_from_state(block.r_eci, block.v_eci).semi_major_axis
    rate = 1e-11 * 2.2 * area / mass * math.sqrt(orbit.MU * a)
    # the density grows as it falls
    mean = -63822.0 * math.log(1 - rate * stop / 63822.0)
    assert fallen == pytest.approx(mean, rel=2e-3)
    assert fallen > 2000.0


def test_drag_without_air_is_refused():
    with pytest.raises(
        BlockError, match="area_drag = 2 m2 needs an atmosphere, which is none"
    ):
        propagation(area_drag=2.0)


def test_drag_against_cowell():
    """6 h at 400 km, in turning air."""
    block = propagation(
        semi_major_axis=6.778e6, atmosphere="exponential", area_drag=0.5, mass=100.0
    )
    free = propagation(semi_major_axis=6.778e6)

    def drag(t, y):
        w = y[3:] - cross3([0.0, 0.0, orbit.EARTH_RATE], y[:3])
        height = np.linalg.norm(y[:3]) - orbit.EARTH_RADIUS
        density = 6.967e-13 * math.exp((500e3 - height) / 63822.0)
        return -0.5 * density * 2.2 * 0.5 / 100.0 * np.linalg.norm(w) * w

    expected = cowell(state(block), 4, DAY / 4, drag)
    run(block, DAY / 4, 60.0)
    run(free, DAY / 4, 600.0)
    assert math.dist(block.r_eci, expected[:3]) < 1e-2
    assert math.dist(free.r_eci, expected[:3]) > 100.0


@pytest.mark.parametrize("dt", [0.5, 1.0, 4.0, 30.0])
@pytest.mark.parametrize("turning", [0.0, 0.01])
def test_a_firing_against_cowell(dt, turning):
    """300 s of 2 N on 50 kg, in a body that may turn: exact whatever the step."""
    force, mass, rate = (0.3, 2.0, -0.1), 50.0, (0.0, 0.6 * turning, 0.8 * turning)
    block = propagation(firings=True, mass=mass, **ECCENTRIC)
    attitude = (0.1, -0.2, 0.3, math.sqrt(0.86))

    def push(t, y):
        return np.array(rotate_back(propagate(attitude, rate, t), force)) / mass

    first = state(block)
    block.force_mean_thruster_body, block.omega_bi_body = force, rate
    for k in range(round(300.0 / dt)):
        block.q_bi = propagate(attitude, rate, k * dt)
        block.advance(k * dt, dt)
    block.output(300.0)
    expected = cowell(first, 4, 300.0, push)
    free = cowell(first, 4, 300.0)
    assert math.dist(expected[:3], free[:3]) > 500.0
    assert math.dist(block.r_eci, expected[:3]) < 1e-5
    assert math.dist(block.v_eci, expected[3:]) < 1e-8
    # and after it the orbit goes on
    block.force_mean_thruster_body = (0.0, 0.0, 0.0)
    run(block, 6000.0, 10.0, begin=300.0)
    later = cowell(expected, 4, 5700.0)
    assert math.dist(block.r_eci, later[:3]) < 1e-3


@pytest.mark.parametrize("dt", [1.0, 30.0])
def test_a_firing_takes_mass_with_it(dt):
    """300 s of 20 N on 50 kg by a specific impulse of 60 s: 10 kg go; against Cowell,
    by a force on less and less mass, and the rocket equation."""
    force, isp = 20.0, 60.0
    flow = force / (9.80665 * isp)
    block = propagation(firings=True, mass=50.0, specific_impulse=isp, **ECCENTRIC)
    first = state(block)
    block.force_mean_thruster_body = (0.0, force, 0.0)
    run(block, 300.0, dt)
    assert block.mass_left == pytest.approx(50.0 - 300.0 * flow, rel=1e-13)
    assert block.mass_left < 40.0
    expected = cowell(
        first, 4, 300.0, lambda t, y: np.array((0, force, 0)) / (50.0 - flow * t)
    )
    assert math.dist(block.r_eci, expected[:3]) < 1e-5
    assert math.dist(block.v_eci, expected[3:]) < 1e-8
    free = cowell(first, 4, 300.0)
    gained = 9.80665 * isp * math.log(50.0 / block.mass_left)
    assert math.dist(expected[3:], free[3:]) == pytest.approx(
        gained, rel=0.02
    )  # and gravity bends
    block.force_mean_thruster_body = (0.0, 30.0 * force, 0.0)
    with pytest.raises(
        BlockError, match=r"at 300 s the thrusters take .* and the craft has 39"
    ):
        block.advance(300.0, 60.0)
    with pytest.raises(
        BlockError, match="specific_impulse = 60 s needs firings = true"
    ):
        propagation(specific_impulse=isp)


def test_a_firing_along_the_velocity_raises_the_orbit():
    """da = 2 a^2 v dv / mu for a short firing."""
    a = 7.0e6
    block = propagation(firings=True, zonals="none", mass=100.0, semi_major_axis=a)
    # the body's x along the velocity: q_bi turns eci into it
    along = tuple(x / norm(block.v_eci) for x in block.v_eci)
    upright = tuple(x / norm(block.r_eci) for x in block.r_eci)
    block.q_bi = from_matrix((*along, *cross(upright, along), *upright))
    assert rotate(block.q_bi, along) == pytest.approx((1.0, 0.0, 0.0), abs=1e-12)
    block.force_mean_thruster_body = (10.0, 0.0, 0.0)
    run(block, 1.0, 1.0)
    found = orbit.elements_from_state(block.r_eci, block.v_eci).semi_major_axis
    assert found - a == pytest.approx(
        2 * a**2 * norm(block.v_eci) * 0.1 / orbit.MU, rel=1e-4
    )


@settings(max_examples=20)
@given(st.integers(1, 40), st.floats(0.01, 12.0))
def test_firings_that_are_off_or_nothing_change_no_bit(steps, dt):
    plain = propagation(**ECCENTRIC)
    idle = propagation(firings=True, **ECCENTRIC)
    off = propagation(**ECCENTRIC)
    off.force_mean_thruster_body = (1.0, 2.0, 3.0)
    for block in (plain, idle, off):
        run(block, steps * dt, dt)
    assert state(plain) == state(idle) == state(off)


# --- in a system ----------------------------------------------------------------------

CRAFT = """
stop = 200.0

[components]
environment = "environment_propagated"
spacecraft = "spacecraft_rigid"
thrusters = "thrusters"

[wiring]
{wiring}

[parameters.environment]
firings = true
field = "none"
mass = 80.0

[parameters.spacecraft]
gravity_gradient = false

[parameters.thrusters]
schedule_start = [20.3, 0, 0, 0, 0, 0, 0, 0]
schedule_duration = [60.0, 0, 0, 0, 0, 0, 0, 0]
schedule_force_body = [[4.0, -1.0, 2.0], [0, 0, 0], [0, 0, 0], [0, 0, 0], [0, 0, 0], [0, 0, 0],
                       [0, 0, 0], [0, 0, 0]]
"""
WIRES = """
"environment.force_mean_thruster_body" = "thrusters.force_mean_thruster_body"
"environment.q_bi" = "spacecraft.q_bi"
"environment.omega_bi_body" = "spacecraft.omega_bi_body"
"""
SCENARIO = 'title = "A firing"\ncraft = "craft.toml"\nstep = 1.0\nstop = 200.0\n'


def firing(folder, wiring: str) -> str:
    (folder / "craft.toml").write_text(CRAFT.format(wiring=wiring), encoding="utf-8")
    (folder / "mine.toml").write_text(SCENARIO, encoding="utf-8")
    return str(folder / "mine.toml")


def test_a_scheduled_firing_moves_the_orbit(tmp_path):
    result = execute(firing(tmp_path, WIRES), Options(blocks=True)).results
    r, v = (result.values(f"environment.{n}_eci")[[0, -1]] for n in "rv")

    parts = [*r[0], *v[0]]
    for duration, on in ((20.3, 0.0), (60.0, 1.0), (119.7, 0.0)):
        parts = cowell(
            parts,
            4,
            duration,
            lambda t, y, on=on: on * np.array([4.0, -1.0, 2.0]) / 80.0,
        )
    # the mean over a step knows no edge inside it: 0.06 m/s2 times 1 s2 / 8
    assert math.dist(r[1], parts[:3]) < 0.01
    assert math.dist(v[1], parts[3:]) < 2e-5
    used = result.values("thrusters.schedule_propellant")[-1]
    assert used == pytest.approx(math.sqrt(21.0) * 60.0 / (9.80665 * 68.0), rel=1e-12)


def test_firings_that_nothing_feeds_are_refused(tmp_path):
    with pytest.raises(DesatError, match=r"firings.* needs .*force_mean_thruster_body"):
        execute(firing(tmp_path, ""), Options(blocks=True))


def test_a_force_that_moves_no_orbit_is_said(tmp_path):
    """Of a block without the option, and of one that has it off."""
    (tmp_path / "mine.toml").write_text(SCENARIO, encoding="utf-8")
    craft = CRAFT.format(wiring=WIRES)
    off = craft.replace("firings = true", "firings = false")
    other = craft.replace("environment_propagated", "environment_kepler")
    other = other.replace("firings = true\n", "").replace("mass = 80.0\n", "")
    for text, line in (
        (craft, None),
        (off, "environment.firings is false, so the orbit"),
        (other, "has no firings; its orbit does not move by it"),
    ):
        (tmp_path / "craft.toml").write_text(text, encoding="utf-8")
        warnings = prepare(str(tmp_path / "mine.toml"), Options(blocks=True)).warnings
        messages = [
            w for w in warnings if w.startswith("environment.force_mean_thruster_body")
        ]
        assert [line in w for w in messages] == ([] if line is None else [True])


def test_orbit_start_knows_the_frames():
    """The numbers of the choices are those of the parameters."""
    names = {v.name: v.choices for v in EnvironmentPropagated.variables}
    assert names["orbit_start"].index("mean") == orbit_start.MEAN
    assert names["orbit_start"].index("osculating") == orbit_start.OSCULATING
    assert names["orbit_start"].index("state") == orbit_start.STATE
    assert names["orbit_frame"] == ("eci", "date", "j2000")
    assert names["eci_frame"] == ("date", "j2000")
