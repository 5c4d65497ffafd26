"""The integrator of the rigid body: its methods, and the block against solutions that
are not its own."""

from __future__ import annotations

import math
from collections.abc import Callable
from fractions import Fraction
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import DOP853

from desat.components.blocks.spacecraft_rigid import SpacecraftRigid
from desat.components.contract.block import BlockError
from desat.components.maths import runge_kutta
from desat.components.maths.attitude import error_angle, matrix, normalise
from desat.components.maths.vector import (
    ZERO,
    add,
    cross,
    mat_t_vec,
    mat_vec,
    norm,
    scale,
    sub,
)
from desat.components.physics import (
    torques,
)
from desat.components.physics.gyrostat import (
    carrier_inertia,
    inverse_inertia,
    nutation,
    over_determinant,
)
from desat.components.physics.orbit import MU
from desat.components.physics.rigid_body import (
    STILL,
    course,
    integrate_ramp,
    peak,
    ramp,
    slopes,
)
from desat.components.physics.wheel_array import body_momentum
from tests.conftest import ROOT, cross3
from tests.contract.test_block import begin, fresh

# --- the methods ----------------------------------------------------------------------

METHODS = {
    4: (runge_kutta.step4, 4),
    6: (runge_kutta.step6, 7),
    8: (runge_kutta.step8, 12),
}


@cache
def tableau(order: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A, b, c as the step's own code has them: each stage in turn has the slope 1, the
    rest 0."""
    step, stages = METHODS[order]
    a, b, c = np.zeros((stages, stages)), np.zeros(stages), np.zeros(stages)
    for j in range(stages):
        i = 0

        def slope(e, y, j=j):
            nonlocal i
            c[i], a[i, j] = e, y[0]
            i += 1
            return (1.0 if i - 1 == j else 0.0,) * 7

        b[j] = step(slope, 0.0, (0.0,) * 7, 1.0, 1.0)[3]
        assert i == stages
    return a, b, c


@cache
def trees(size: int) -> frozenset[tuple]:
    """The rooted trees with so many nodes; a tree is the sorted tuple of its branches."""

    def forests(nodes: int, largest: int):
        if nodes == 0:
            yield ()
        for n in range(min(nodes, largest), 0, -1):
            for tree in trees(n):
                for rest in forests(nodes - n, n):
                    yield (tree, *rest)

    return frozenset(tuple(sorted(f)) for f in forests(size - 1, size - 1))


def nodes(tree: tuple) -> int:
    return 1 + sum(nodes(t) for t in tree)


def density(tree: tuple) -> int:
    """gamma(t): nodes times the densities of the branches."""
    return nodes(tree) * math.prod(density(t) for t in tree)


def weight(tree: tuple, a: np.ndarray) -> np.ndarray:
    """Phi_i(t) for each stage i."""
    product = np.ones(len(a))
    for branch in tree:
        product = product * (a @ weight(branch, a))
    return product


def test_number_of_trees():
    assert [len(trees(n)) for n in range(1, 9)] == [1, 1, 2, 4, 9, 20, 48, 115]


@pytest.mark.parametrize("order", METHODS)
def test_order_conditions(order):
    """sum b_i Phi_i(t) = 1 / gamma(t) for every tree up to the order, and not beyond
    it."""
    a, b, c = tableau(order)
    assert np.abs(a.sum(axis=1) - c).max() < 3e-15
    for n in range(1, order + 1):
        for tree in trees(n):
            assert b @ weight(tree, a) == pytest.approx(1.0 / density(tree), abs=1e-14)
    beyond = max(abs(b @ weight(t, a) - 1.0 / density(t)) for t in trees(order + 1))
    assert beyond > 1e-7


@pytest.mark.parametrize(
    ("order", "angle", "growth_rate"), [(8, 0.3, -1.3e-13), (6, 0.055, 5.5e-14)]
)
def test_growth_of_an_oscillation(order, angle, growth_rate):
    """|R(i a)| - 1, in exact arithmetic: what a step takes from an oscillation."""
    a, b, _ = tableau(order)

    def times(x, y):
        return x[0] * y[0] - x[1] * y[1], x[0] * y[1] + x[1] * y[0]

    z = (Fraction(0), Fraction(angle))
    stages: list[tuple[Fraction, Fraction]] = []
    for row in a:
        y = [Fraction(1), Fraction(0)]
        for x, k in zip(row, stages, strict=False):
            y = [y[0] + Fraction(x) * k[0], y[1] + Fraction(x) * k[1]]
        stages.append(times(z, y))
    end = [Fraction(1), Fraction(0)]
    for x, k in zip(b, stages, strict=True):
        end = [end[0] + Fraction(x) * k[0], end[1] + Fraction(x) * k[1]]
    growth = float((end[0] * end[0] + end[1] * end[1] - 1) / 2)
    assert growth == pytest.approx(growth_rate, rel=0.1)


# --- the equations of motion ----------------------------------------------------------

number = st.floats(-1, 1, allow_nan=False)
vec3 = st.tuples(number, number, number)


@given(
    st.tuples(number, number, number, number),
    vec3,
    vec3,
    vec3,
    vec3,
    vec3,
    st.floats(0, 1),
)
def test_slopes_are_the_equations(q, h, w, given_torque, dipole, r, e):
    """The written-out slope against the same in vector functions."""
    q = normalise((q[0], q[1], q[2], q[3] + 2.0))
    inertia = (3.0, 0.1, -0.2, 0.1, 2.5, 0.3, -0.2, 0.3, 2.0)
    inverse = inverse_inertia(inertia)
    place = course(
        add((7e6, 0.0, 0.0), scale(1e5, r)), scale(7e3, w), scale(8.0, h), 5.0
    )
    field = course(scale(3e-5, w), scale(1e-8, h), scale(1e-11, r), 5.0)
    wheels = integrate_ramp(w, ramp(h, r), 5.0)
    torque, m = ramp(given_torque, w), ramp(dipole, h)

    def at(p):
        return add(
            p[0], scale(e, add(p[1], scale(e, p[2] if len(p) > 2 else (0.0, 0.0, 0.0))))
        )

    def others(e, c):
        return mat_vec(c, (e, 2.0, 3.0))

    slope = slopes(
        inertia,
        tuple(0.5 * x for x in inverse),
        wheels,
        torque,
        m,
        field,
        place,
        others,
    )(e, (*q, *h))
    c = matrix(q)
    omega = mat_vec(inverse, sub(mat_vec(c, h), at(wheels)))
    x, y, z = omega
    turn = np.array([[0, z, -y, x], [-z, 0, x, y], [y, -x, 0, z], [-x, -y, -z, 0]])
    tau = add(at(torque), cross(at(m), mat_vec(c, at(field))))
    tau = add(tau, torques.gravity_gradient(mat_vec(c, at(place)), inertia))
    tau = add(tau, others(e, c))
    assert slope[:4] == pytest.approx(0.5 * turn @ np.array(q), abs=1e-14)
    assert slope[4:] == pytest.approx(mat_t_vec(c, tau), abs=1e-13)


@given(vec3, vec3, st.floats(0, 1))
def test_peak_bounds_a_ramp(mean, slope, e):
    a, b = ramp(mean, slope)
    assert norm(add(a, scale(e, b))) <= peak((a, b)) + 1e-15
    assert peak(STILL) == 0.0


def test_nutation_of_a_symmetric_body():
    """A body with moments A, A, C spinning at s about its axis nutates at C s / A."""
    a, c, s = 2.0, 3.0, 0.7
    inertia = (a, 0.0, 0.0, 0.0, a, 0.0, 0.0, 0.0, c)
    rate = nutation((0.0, 0.0, c * s), over_determinant(inertia))
    assert rate == pytest.approx(c * s / a, rel=1e-14)


# --- a light craft against a monolith -------------------------------------------------

THIRD = 1.0 / math.sqrt(3.0)
LIGHT = {
    "inertia": (3.0, 0.12, -0.08, 0.12, 2.4, 0.1, -0.08, 0.1, 1.9),
    "axes_wheel": tuple(
        THIRD * x
        for x in (1.0, -1.0, -1.0, 1.0, 1.0, 1.0, -1.0, -1.0, 1.0, 1.0, 1.0, 1.0)
    ),
    "inertia_wheel": (5e-4,) * 4,
    "h_wheel": (0.6, -0.4, 0.33, 0.25),
    "omega_start_body": (0.1, -0.08, 0.06),
    "q_start_bi": normalise((0.1, -0.2, 0.3, 0.9)),
}
"""3 kg m2 with products of inertia, 0.83 N m s in a pyramid, on an eccentric orbit."""

AUTHORITY = ROOT / "tests" / "authorities" / "plant_light.csv"
"""Of `monolith(6000)`: t (s) and q, every 100 s."""
SEMI_MAJOR_AXIS, ECCENTRICITY, INCLINATION = 7.2e6, 0.05, 1.2
HELD = 10.0
"""The wheels' torques are held for so long (s)."""


def kepler(t: float) -> tuple[np.ndarray, np.ndarray]:
    n = math.sqrt(MU / SEMI_MAJOR_AXIS**3)
    anomaly = mean = n * t
    for _ in range(20):
        fault = anomaly - ECCENTRICITY * math.sin(anomaly) - mean
        anomaly -= fault / (1 - ECCENTRICITY * math.cos(anomaly))
    s, c, b = math.sin(anomaly), math.cos(anomaly), math.sqrt(1 - ECCENTRICITY**2)
    p = np.array([1.0, 0.0, 0.0])
    q = np.array([0.0, math.cos(INCLINATION), math.sin(INCLINATION)])
    r = SEMI_MAJOR_AXIS * ((c - ECCENTRICITY) * p + b * s * q)
    return r, SEMI_MAJOR_AXIS * n / (1 - ECCENTRICITY * c) * (-s * p + b * c * q)


def motors(k: int) -> np.ndarray:
    """Torque on each rotor (N m) from k HELD to (k + 1) HELD."""
    return 1e-3 * np.sin(
        np.array([0.3, 0.2, 0.5, 0.35]) * k + np.array([0.0, 1.6, 1.0, 1.5])
    )


def monolith(stop: float) -> np.ndarray:
    """Rows of t (s) and q every 100 s: Euler's equations for the rate, by scipy's
    DOP853."""
    inertia = np.reshape(LIGHT["inertia"], (3, 3))
    axes, spin = (
        np.reshape(LIGHT["axes_wheel"], (3, 4)),
        np.array(LIGHT["inertia_wheel"]),
    )
    carrier = inertia - (axes * spin) @ axes.T
    inverse = np.linalg.inv(carrier)
    y = np.array([*LIGHT["q_start_bi"], *LIGHT["omega_start_body"]])
    h, rows = np.array(LIGHT["h_wheel"]), [[0.0, *y[:4]]]
    for k in range(round(stop / HELD)):
        torque, begin = motors(k), HELD * k

        def slope(t, y, torque=torque, begin=begin, h=h):
            vector, w, omega = y[:3], y[3], y[4:]
            u = kepler(t)[0]
            two = 2.0 * cross3(vector, u)
            u = u - w * two + cross3(vector, two)
            gravity = 3.0 * MU / (u @ u) ** 2.5 * cross3(u, inertia @ u)
            total = carrier @ omega + axes @ (h + torque * (t - begin))
            rate = inverse @ (gravity - axes @ torque - cross3(omega, total))
            vector_rate = 0.5 * (w * omega - cross3(omega, vector))
            return np.array([*vector_rate, -0.5 * omega @ vector, *rate])

        solver = DOP853(slope, begin, y, begin + HELD, rtol=1e-13, atol=1e-15)
        while solver.status == "running":
            solver.step()
        assert solver.status == "finished"
        y, h = solver.y.copy(), h + HELD * torque
        y[:4] /= np.linalg.norm(y[:4])
        if (k + 1) % 10 == 0:
            rows.append([begin + HELD, *y[:4]])
    return np.array(rows)


def rigid(**values) -> SpacecraftRigid:
    block = SpacecraftRigid()
    for name, value in values.items():
        setattr(block, name, value)
    block.check()
    block.start()
    block.output(0.0)
    return block


def run(
    block: SpacecraftRigid, stop: float, dt: float, before: Callable = lambda t: None
) -> None:
    for k in range(round(stop / dt)):
        before(k * dt)
        block.advance(k * dt, dt)
    block.output(stop)


@pytest.fixture(scope="module")
def truth() -> np.ndarray:
    return np.loadtxt(AUTHORITY, delimiter=",")


def test_authority_is_the_monolith(truth):
    """The file holds what the monolith gives: python -m tests.physics.test_rigid_body writes
    it."""
    again = monolith(100.0)
    assert len(again) == 2
    assert np.abs(again - truth[:2]).max() < 1e-12


@pytest.mark.parametrize(("dt", "stop"), [(10.0, 6000.0), (1.0, 6000.0), (0.1, 1500.0)])
def test_light_craft(truth, dt, stop):
    """The attitude within 2e-9 rad whatever the step."""
    block = rigid(**LIGHT, r_eci=tuple(kepler(0.0)[0].tolist()))

    def before(t):
        r, v = kepler(t)
        block.r_eci, block.v_eci = tuple(r.tolist()), tuple(v.tolist())
        block.tau_mean_wheel = tuple(motors(math.floor(t / HELD + 1e-6)).tolist())

    largest = 0.0
    for row in truth[1 : round(stop / 100.0) + 1]:
        begin = row[0] - 100.0
        run(block, 100.0, dt, lambda t, begin=begin: before(begin + t))
        largest = max(largest, error_angle(block.q_bi, tuple(row[1:])))
    assert largest < 2e-9


# --- torque-free, at rest, with surfaces ----------------------------------------------

SPINNING = {
    **LIGHT,
    "gravity_gradient": False,
    "h_wheel": (0.871, -0.232, -0.116, 0.552),
    "omega_start_body": (0.05, -0.04, 0.06),
}
"""1.3 N m s in all, nearly all of the body's energy in its nutation."""


def energy(block: SpacecraftRigid) -> float:
    carrier = carrier_inertia(block.inertia, block.axes_wheel, block.inertia_wheel)
    return 0.5 * float(
        np.dot(block.omega_bi_body, mat_vec(carrier, block.omega_bi_body))
    )


@pytest.mark.parametrize(
    ("angle_limit", "step", "a_day"),
    [(0.3, 10.0, 5e-8), (0.3, 0.09, 5e-8), (0.15, 10.0, 1e-10)],
)
def test_energy_without_torque(angle_limit, step, a_day):
    """Of the energy of nutation no more is lost in a day than promised (the loss is
    steady)."""
    block = rigid(**SPINNING, angle_limit=angle_limit)
    start, stop = energy(block), 900.0
    assert np.linalg.norm(block._momentum) == pytest.approx(1.3, abs=0.1)
    run(block, stop, step)
    assert abs(energy(block) / start - 1.0) < a_day * stop / 86400.0


def test_attitude_without_torque():
    """After an hour the same whatever the step: phase errors do not add up."""
    ends = []
    for dt, limit in ((10.0, 0.3), (1.0, 0.3), (10.0, 0.2)):
        block = rigid(**SPINNING, angle_limit=limit)
        run(block, 3600.0, dt)
        ends.append(block.q_bi)
    assert error_angle(ends[0], ends[2]) < 1e-9
    assert error_angle(ends[1], ends[2]) < 1e-9


@pytest.mark.parametrize("dt", [0.06, 0.22, 1.0])
@pytest.mark.parametrize("source", ["thruster", "wheel", "dipole"])
@pytest.mark.parametrize("angle", [3e-6, 3e-5, 2e-4, 1e-3, 3e-3])
def test_a_pulse_within_a_step(source, dt, angle):
    """The torque of a pulse at the end of a step, as mean and slope: the step taken at
    once gives the attitude of a hundred. It erred by 1.2e-11 rad: its torque changes
    sign within the step."""
    inertia = 14.0
    size = angle * inertia / dt**2
    mean, slope = (
        np.array((-0.6, 0.5, -0.62)) * size,
        np.array((-3.6, 3.0, -3.7)) * size,
    )
    values = {
        "inertia": (
            inertia,
            0.0,
            0.0,
            0.0,
            0.9 * inertia,
            0.0,
            0.0,
            0.0,
            0.7 * inertia,
        ),
        "gravity_gradient": False,
        "omega_start_body": (2e-4, -1.1e-3, 3e-4),
        "h_wheel": tuple(h / dt for h in (0.2, 0.2, -0.2, 0.1)),
    }
    if source == "dipole":
        values["b_eci"] = (2e-5, -3e-5, 1e-5)
    once, parts = rigid(**values), rigid(**values)
    name = {
        "thruster": "tau_{}_thruster_body",
        "wheel": "tau_{}_wheel",
        "dipole": "m_{}_body",
    }
    scale = 1.0 / 4e-5 if source == "dipole" else 1.0
    more = (0.0,) if source == "wheel" else ()

    def push(block, mean, slope):
        for kind, x in (("mean", mean), ("slope", slope)):
            setattr(block, name[source].format(kind), (*(scale * x).tolist(), *more))

    push(once, mean, slope)
    once.advance(0.0, dt)
    for k in range(100):
        push(parts, mean + ((k + 0.5) / 100 - 0.5) * slope, slope / 100)
        parts.advance(k * dt / 100, dt / 100)
    for block in (once, parts):
        block.output(dt)
    impulse = float(np.linalg.norm(mean)) * dt
    assert error_angle(once.q_bi, parts.q_bi) < 2e-12
    assert (
        np.linalg.norm(np.subtract(once.impulse_eci, parts.impulse_eci))
        < 1e-7 * impulse
    )


@pytest.mark.parametrize("source", ["thruster", "wheel", "dipole"])
def test_at_rest_under_torque(source):
    """A craft that stands still and is pushed with 50 mN m for 10 s: one step, or a
    hundred."""
    push = (0.03, -0.025, 0.031)
    values = {"inertia": LIGHT["inertia"], "gravity_gradient": False}
    if source == "thruster":
        values["tau_mean_thruster_body"] = push
    elif source == "wheel":
        values["tau_mean_wheel"] = (*push, 0.0)
    else:
        values |= {"b_eci": (2e-5, 3e-5, -1e-5), "m_mean_body": (900.0, -700.0, 1100.0)}
    ends = []
    for dt in (10.0, 0.1):
        block = rigid(**values)
        run(block, 10.0, dt)
        ends.append(block.q_bi)
    assert error_angle(ends[0], (0.0, 0.0, 0.0, 1.0)) > 0.5
    assert error_angle(*ends) < 1e-10


def test_one_axis_under_a_ramp():
    """About one axis the turn has a closed form: J phi'' = mean + slope (t / dt - 1/2)."""
    mean, slope, dt, moment = 0.04, 0.02, 10.0, 3.0
    block = rigid(
        inertia=(moment, 0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 1.0),
        inertia_wheel=(0.0,) * 4,
        gravity_gradient=False,
        tau_mean_thruster_body=(mean, 0.0, 0.0),
        tau_slope_thruster_body=(slope, 0.0, 0.0),
    )
    run(block, dt, dt)
    turn = dt * dt / moment * (0.5 * mean - slope / 12.0)
    assert block.omega_bi_body[0] == pytest.approx(mean * dt / moment, rel=1e-11)
    assert block.q_bi[0] == pytest.approx(math.sin(0.5 * turn), abs=1e-11)


BOX = tuple(
    x
    for normal, place in (
        ((1, 0, 0), (0.5, 0.1, 0.0)),
        ((-1, 0, 0), (-0.5, 0.1, 0.0)),
        ((0, 1, 0), (0.0, 0.4, 0.1)),
        ((0, -1, 0), (0.0, -0.4, 0.1)),
        ((0, 0, 1), (0.1, 0.0, 0.3)),
        ((0, 0, -1), (0.1, 0.0, -0.3)),
    )
    for x in (*normal, 1.2, *place, 0.3, 0.4)
)
AROUND = {
    "aerodynamics": 2,
    "radiation": 2,
    "plates": BOX + (0.0,) * (144 - len(BOX)),
    "density": 1e-11,
    "sun_eci": (0.6, 0.0, 0.8),
    "sunlight": 1.0,
    "r_eci": (6.8e6, 0.0, 0.0),
    "v_eci": (0.0, 5.0e3, 5.7e3),
}


def test_plates_of_a_tumbling_craft():
    """At 30 deg/s: drag and radiation in every stage, so that 10 s err little against
    0.1 s."""
    values = {**LIGHT, **AROUND, "omega_start_body": (0.3, 0.3, 0.3)}
    place, velocity = AROUND["r_eci"], AROUND["v_eci"]
    fall = scale(-MU / norm(place) ** 3, place)
    ends = []
    for dt, surfaces in ((10.0, True), (0.1, True), (0.1, False)):
        block = rigid(**values)
        if not surfaces:
            block.density = block.sunlight = 0.0

        def before(t, block=block):
            block.r_eci = add(place, add(scale(t, velocity), scale(0.5 * t * t, fall)))
            block.v_eci = add(velocity, scale(t, fall))

        run(block, 10.0, dt, before)
        ends.append(block.q_bi)
    coarse, fine, without = ends
    assert error_angle(fine, without) > 5e-4
    assert error_angle(fine, coarse) < 2e-8


def test_sixteen_plates_make_a_cylinder():
    """A ring of 16 plates about z, the flow across it: the drag of a cylinder, 2 R L,
    on a lever.

    What 16 plates of its surface project is within 1.3 % of that.
    """
    radius, length, offset = 0.5, 2.0, (0.0, 0.0, 0.7)
    area = 2.0 * math.pi * radius * length / 16
    rows = []
    for k in range(16):
        n = (math.cos(math.pi * k / 8), math.sin(math.pi * k / 8), 0.0)
        rows += [*n, area, *offset, 0.0, 0.0]
    plates = torques.plates_of(tuple(rows), ZERO)
    assert len(plates) == 16
    still = (ZERO,) * len(plates)
    for angle in (0.0, 0.1, 0.3):
        v = (7500.0 * math.cos(angle), 7500.0 * math.sin(angle), 0.0)
        cylinder_drag = torques.drag(v, 1e-12, 2.2 * 2.0 * radius * length, offset)
        plate_drag = torques.drag_on_plates(v, 1e-12, 2.2, plates, still)
        assert plate_drag == pytest.approx(cylinder_drag, rel=0.014, abs=1e-12)
    # exactly: sum over the facing half of cos, for a flow along one normal
    facing_area = area * sum(math.cos(math.pi * k / 8) for k in range(-3, 4))
    v = (7500.0, 0.0, 0.0)
    assert torques.drag_on_plates(v, 1e-12, 2.2, plates, still) == pytest.approx(
        torques.drag(v, 1e-12, 2.2 * facing_area, offset), rel=1e-12, abs=1e-18
    )


@pytest.mark.parametrize(
    ("row", "text"),
    [
        (
            (0, 0, 0, 1, 0, 0, 0, 0, 0),
            r"plates\[1,1..3\] = 0: a plate with an area needs a normal",
        ),
        (
            (1, 0, 0, -1, 0, 0, 0, 0, 0),
            r"plates\[1,4\] = -1.0 m2: an area is 0 or more",
        ),
        (
            (1, 0, 0, 1, 0, 0, 0, 0.7, 0.6),
            r"plates\[1,8..9\] = 0.7, 0.6: the specular and the dif",
        ),
    ],
)
def test_bad_plates_are_refused(row, text):
    with pytest.raises(BlockError, match=text):
        torques.plates_of(tuple(float(x) for x in row), ZERO)


# --- what cannot be integrated --------------------------------------------------------


@pytest.mark.parametrize(
    "wrong",
    [
        {"h_wheel": (1e9, 0.0, 0.0, 0.0)},
        {"tau_mean_wheel": (1e6, 0.0, 0.0, 0.0)},
        {"tau_mean_thruster_body": (math.nan, 0.0, 0.0)},
        {"tau_ext_body": (0.0, math.inf, 0.0)},
        {"h_wheel": (math.nan, 0.0, 0.0, 0.0)},
    ],
)
def test_too_much_for_a_step_is_refused(wrong):
    block = rigid(**{**LIGHT, **wrong})
    with pytest.raises(
        BlockError, match=r"in a step of 10 s body and nutation turn by .* rad, more"
    ):
        block.advance(0.0, 10.0)


@pytest.mark.parametrize("name", ["b_rate_eci", "v_eci", "r_eci", "sun_eci"])
def test_an_input_that_is_no_number_is_refused(name):
    values = {
        **LIGHT,
        **AROUND,
        "m_mean_body": (1.0, 0.0, 0.0),
        "b_eci": (0.0, 3e-5, 0.0),
    }
    block = rigid(**values)
    setattr(block, name, (0.0, math.nan, 0.0))
    with pytest.raises(
        BlockError, match=r"body and nutation turn by nan rad|is not finite after"
    ):
        block.advance(0.0, 1.0)


def test_more_than_many_small_parts_is_allowed():
    """Thousands of parts are slow, not wrong."""
    block = rigid(**{**LIGHT, "h_wheel": (60.0, 0.0, 0.0, 0.0)})
    run(block, 10.0, 10.0)
    assert block.impulse_eci == pytest.approx((0.0, 0.0, 0.0), abs=1e-3)


def test_body_momentum_is_what_the_wheels_gave():
    """In one step of 10 s with strong wheel torques: the inertial momentum stays, bit
    for bit."""
    block = rigid(**SPINNING, tau_mean_wheel=(0.01, -0.02, 0.005, 0.0))
    before = block._momentum
    run(block, 100.0, 10.0)
    assert block._momentum == before
    carrier = carrier_inertia(block.inertia, block.axes_wheel, block.inertia_wheel)
    total = add(
        mat_vec(carrier, block.omega_bi_body), body_momentum(block.axes_wheel, block._h)
    )
    assert mat_t_vec(matrix(block.q_bi), total) == pytest.approx(before, abs=1e-14)


if __name__ == "__main__":
    np.savetxt(AUTHORITY, monolith(6000.0), delimiter=",", fmt="%.17g")


def craft(**values):
    body = fresh("spacecraft_rigid")
    for key, value in values.items():
        assert hasattr(body, key)
        setattr(body, key, value)
    begin(body)
    return body


def test_the_field_bends_within_a_step():
    """A residual dipole in a field that accelerates from zero: the impulse is m x b''
    T^3 / 6."""
    body = craft(
        inertia=(1e6, 0.0, 0.0, 0.0, 1e6, 0.0, 0.0, 0.0, 1e6),
        gravity_gradient=False,
        residual_dipole_body=(0.0, 0.0, 2.0),
        b_accel_eci=(3e-8, 0.0, 0.0),
    )
    body.advance(0.0, 10.0)
    body.output(10.0)
    assert body.impulse_eci == pytest.approx(
        (0.0, 2.0 * 3e-8 * 1000.0 / 6.0, 0.0), rel=1e-9
    )


def test_the_place_falls_within_a_step():
    """Gravity gradient over a step of 100 s on a circle, against the same in steps of 1
    s."""
    mu, r = 3.986004418e14, 7e6
    n = math.sqrt(mu / r**3)
    inertia = (9e5, 0.0, 0.0, 0.0, 6e5, 0.0, 0.0, 0.0, 4e5)

    def impulse(dt):
        body = craft(inertia=inertia, q_start_bi=(0.1, 0.2, 0.3, 0.9))
        for k in range(round(100.0 / dt)):
            a = n * k * dt
            body.r_eci = (r * math.cos(a), r * math.sin(a), 0.0)
            body.v_eci = (-r * n * math.sin(a), r * n * math.cos(a), 0.0)
            body.advance(k * dt, dt)
        body.output(100.0)
        return np.array(body.impulse_eci)

    fine = impulse(1.0)
    straight = (
        np.linalg.norm(fine) * 0.5 * (n * 100.0) ** 2 / 3.0
    )  # of the order of a missing fall
    assert np.linalg.norm(impulse(100.0) - fine) < 0.1 * straight


def test_a_turning_body_keeps_its_energy():
    """A body that nothing acts on, its attitude far from upright, by the rotation
    matrix of its own equations. The rotors keep their momentum, 0, so that they do not
    turn with it."""
    block = fresh("spacecraft_rigid")
    block.inertia = (2.0, 0.1, 0.0, 0.1, 3.0, -0.2, 0.0, -0.2, 1.5)
    block.q_start_bi, block.omega_start_body = (
        (0.5, -0.5, 0.1, 0.7),
        (0.02, -0.03, 0.05),
    )
    block.gravity_gradient = False
    begin(block)
    axes = np.reshape(block.axes_wheel, (3, 4))
    carrier_inertia = (
        np.reshape(block.inertia, (3, 3)) - (axes * block.inertia_wheel) @ axes.T
    )
    energies = []
    for k in range(41):
        block.output(float(k))
        omega = np.array(block.omega_bi_body)
        energies.append(0.5 * omega @ carrier_inertia @ omega)
        block.advance(float(k), 1.0)
    assert energies == pytest.approx([energies[0]] * 41, rel=1e-13)
