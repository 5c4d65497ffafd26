"""Compute what no momentum management law changes: field, attitude and disturbances.

They come from a run that was flown (`flight_of`), or without one from the environment's
own block at the attitude that a run has shown (`Attitude`), at another date or on
another orbit. Torques are those of `analyses/motion.py`, which computes them from the
parameters of our spacecraft.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import ceil, inf, pi
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from desat.components.contract.block import Block, BlockError
from desat.components.laws.integrated import null_vector
from desat.components.maths.attitude import inverse, normalise, product
from desat.components.physics.gyrostat import carrier_inertia
from desat.components.physics.orbit import lvlh_attitude
from desat.components.physics.rod import warm
from desat.fmus.registry import names

from ..engine.instances.fmu import rows_of
from ..files import library
from ..numbers.derived import coil_impulse, cross, from_body, rotate_back
from ..numbers.spline import Spline
from ..system.errors import DesatError
from ..system.model import Component, Parameter, System, Values, table
from ..system.parameters import bare_block
from ..system.wheels import axes_of, capacities, existing
from . import motion

Array = NDArray[Any]
ROLES = ("environment", "spacecraft", "manager")
SOURCES = ("gravity gradient", "drag", "radiation", "residual dipole")
TABLE_TORQUE = (
    "given torque"  # source that stands for a component of the role disturbance
)
SERIES = (
    "spacecraft.q_bi",
    "spacecraft.omega_bi_body",
    "spacecraft.impulse_eci",
    "spacecraft.h_copy_wheel",
    "environment.b_eci",
    "environment.r_eci",
    "environment.v_eci",
    "environment.density",
    "environment.sun_eci",
    "environment.sunlight",
    "torquers.m_mean_body",
    "thrusters.tau_mean_thruster_body",
    "wheels.h_wheel",
    "disturbance.tau_ext_body",
)
# rad: an attitude that stays this near to its mean for 95 % of the time can be flown on
# another orbit
WANDERS = 0.1
NODES = 1440  # minimum number of rows of a day or orbit
NODE_TIME = 10.0  # s, between the rows of the sources of a recorded run
# Guidances whose attitude follows from the positions of craft and Sun, and its kind.
GUIDED = {"guidance_sun": "sun", "guidance_yaw": "yaw", "guidance_plan": "plan"}
TURN_ROWS = 12  # rows of a turn of a craft that spins
# integrates its orbit, so it cannot begin at another date
_MOVES = "environment_propagated"


# Parameters of a craft without torquers.
NO_COILS: Values = {"axes_coil": np.zeros((3, 0)), "m_limit": 0.0, "drive": "limited"}


@dataclass(frozen=True)
class Hardware:
    """Actuators and inertia with which a craft stores and moves momentum."""

    axes_wheel: Array  # (3, n)
    capacity: Array  # (n,) N m s; 0: there is no wheel, inf: it has no limit
    torque_limit: float  # N m, of a wheel; inf: no limit
    axes_coil: Array  # (3, c)
    m_limit: float  # A m2, of each coil
    # largest mean dipole of a coil as a share of m_limit (pulses); inf: no limit
    longest: float
    # share of the time in which a coil is not kept off for the magnetometer
    open: float
    inertia: Array  # (3, 3) kg m2, of the whole craft
    carrier: Array  # (3, 3) kg m2, without the rotors along their axes
    arm: float | None  # m, of the thrusters; None: there are none, or it is not known
    specific_impulse: float | None  # s
    # N m s, standard deviation of each wheel's measured momentum at each sample
    noise: float = 0.0
    # (n,) N m s, that the wheels keep against each other; empty: nothing
    bias: tuple[float, ...] = ()

    def spread(self) -> Array:
        """Return the least-squares matrix (n, 3) that shares momentum among wheels."""
        return np.asarray(np.linalg.pinv(self.axes_wheel))

    def of_wheels(self, momentum: Array) -> Array:
        """Return the momentum of each wheel (..., n) N m s for a sum (..., 3), body."""
        each = momentum @ self.spread().T
        return np.asarray(each + self.bias if self.bias else each)


@dataclass(frozen=True)
class Flight:
    """Quantities that no law changes, at times t_k (n + 1)."""

    times: Array  # (n + 1,) s
    period: float  # s, of the orbit
    # (n + 1, 3) N m s, eci: impulse since the start of all torques except those of
    # coils and thrusters
    disturbance: Array
    q: Array  # (n + 1, 4) attitude
    b: Array  # (n + 1, 3) T, eci
    body: Array  # (n + 1, 3) N m s, body: momentum of the body without the wheels
    h_start: Array  # (3,) N m s, body: of all wheels at the start
    # name -> impulse (rows, 3) N m s, eci, at source_times
    sources: Mapping[str, Array]
    source_times: Array  # (rows,) s
    r: Array  # (n + 1, 3) m, eci
    v: Array  # (n + 1, 3) m/s, eci
    omega: Array  # (n + 1, 3) rad/s, body
    # inputs of the spacecraft and its attitude `q_bi` (rows, elements) at source_times;
    # empty: they are not known
    inputs: Mapping[str, Array] = field(default_factory=dict)

    @property
    def orbits_duration(self) -> float:
        """Return the duration of all complete orbits (s)."""
        since = float(self.times[-1] - self.times[0])
        return self.period * int(since / self.period * (1.0 + 1e-12))


def secular(
    flight: Flight, times: Array | None = None, impulse: Array | None = None
) -> tuple[Array, Array]:
    """Compute the secular torque (3,) N m, eci, and the cyclic impulse (rows, 3) N m s.

    Both are over as many whole orbits as the flight has: of its disturbance, or of an
    `impulse` (rows, 3; N m s, eci) at other `times` (s).
    """
    if times is None or impulse is None:
        times, impulse = flight.times, flight.disturbance
    since, duration = times - times[0], flight.orbits_duration
    rows = since <= duration * (1.0 + 1e-12)
    end = np.array([np.interp(duration, since, x) for x in impulse.T])
    torque = (end - impulse[0]) / duration
    return torque, impulse[rows] - impulse[0] - np.outer(since[rows], torque)


class Attitude(NamedTuple):
    """Pointing of a craft."""

    # `nadir`: q_bo relative to lvlh is constant; `inertial`: q_bi is constant; `sun`,
    # `yaw`: defined by the guidance; `moving`: none of these
    kind: str
    q: tuple[float, float, float, float]  # the constant attitude
    wanders: float  # rad: 95 % quantile of the angle from q


def values_of(system: System) -> Mapping[str, Values]:
    """Return the parameter values of all components: role -> parameter -> value.

    Raises
    ------
    DesatError
        If the system lacks a role that is needed.
    """
    lacking = [r for r in ROLES if r not in system.components]
    if not lacking and not {"torquers", "thrusters"} & system.components.keys():
        lacking = ["torquers"]
    if lacking:
        raise DesatError(
            f"{system.name}: no {lacking[0]}: a craft with {', '.join(ROLES)} and "
            "torquers or thrusters is needed"
        )
    every = system.parameters
    return {role: {k: p.value for k, p in rows.items()} for role, rows in every.items()}


def hardware_of(system: System) -> Hardware:
    """Return the wheels, coils, thrusters and inertia of a system.

    Raises
    ------
    DesatError
        If the spacecraft has no inertia.
    """
    values = values_of(system)
    craft, coils = values["spacecraft"], values.get("torquers", NO_COILS)
    wheels, thrusters = values.get("wheels", {}), values.get("thrusters", {})
    if "inertia" not in craft:
        raise DesatError(
            f"{system.name}: spacecraft has no inertia: a rigid body is needed"
        )
    inertia = np.reshape(craft["inertia"], (3, 3))
    # a craft without wheel axes has ideal wheels inside, one along each body axis
    axes = axes_of(craft)
    rotors = np.broadcast_to(craft.get("inertia_wheel", 0.0), axes.shape[1])
    flat = (tuple(np.ravel(x).tolist()) for x in (inertia, axes, rotors))
    carrier = np.reshape(carrier_inertia(*flat), (3, 3))
    capacity = capacities({"axes_wheel": axes, **wheels})
    works = existing(wheels or {"axes_wheel": axes}) & ~_failed(system, axes.shape[1])
    axes, capacity = axes * works, capacity * works
    axes_coil = np.reshape(coils["axes_coil"], (3, -1))
    period, quiet = coils.get("sample_time", 0.0), coils.get("quiet_time", 0.0)
    drive = str(coils.get("drive"))
    longest = (
        float(coils["duty_max"])
        if drive == "pulsed"
        else inf
        if drive == "ideal"
        else 1.0
    )
    return Hardware(
        axes,
        capacity,
        float(wheels.get("torque_limit", inf)),
        axes_coil[:, np.linalg.norm(axes_coil, axis=0) > 0.0],
        _largest_dipole(coils),
        longest,
        1.0 - quiet / period if period and drive != "pulsed" else 1.0,
        inertia,
        carrier,
        thrusters.get("arm"),
        thrusters.get("specific_impulse"),
        float(values.get("tachometers", {}).get("noise", 0.0)),
        _null_bias(values.get("manager", {}), axes),
    )


def _null_bias(manager: Values, axes: Array) -> tuple[float, ...]:
    """Return what the wheels (n,) keep against each other (N m s)."""
    size = float(manager.get("h_null", 0.0))
    if size == 0.0:
        return ()
    return tuple(size * x for x in null_vector(tuple(np.ravel(axes).tolist())))


def _failed(system: System, count: int) -> NDArray[np.bool_]:
    """Return which of `count` wheels fail before the run ends."""
    wheels, failed = system.roles.get("wheels"), np.zeros(count, bool)
    if wheels is None or "failed" not in wheels.values or wheels.block is None:
        return failed
    failed_name = wheels.choice("failed")
    if failed_name != "none" and wheels.values.get("failed_from", 0.0) < system.stop:
        failed[[int(x) - 1 for x in failed_name.split("+")]] = True
    return failed


def _largest_dipole(coils: Values) -> float:
    """Return the largest dipole that a coil can hold (A m2).

    It is its limit, or what its supply drives through the warm coil where that is less.
    """
    limit, voltage = float(coils["m_limit"]), coils.get("supply_voltage", 0.0)
    if voltage == 0.0:
        return limit
    cold = coils["resistance"]
    ohm = warm(cold, coils["temperature"], coils["temperature_coefficient"])
    share = cold / ohm if coils["regulation"] == "voltage" else 1.0
    return float(min(share * limit, coils["area_turns"] * voltage / ohm))


# --- of a run -------------------------------------------------------------------------


def series_for(system: System) -> tuple[str, ...]:
    """Return the series that a run has to record for `flight_of`."""
    feeds = motion.feeds(system, "spacecraft") or {}
    more = {x for x in feeds.values() if isinstance(x, str)}
    return tuple(
        sorted({s for s in SERIES if s.partition(".")[0] in system.components} | more)
    )


def flight_of(system: System, results: Any) -> Flight:
    """Build the flight from a run that has recorded each step.

    Raises
    ------
    DesatError
        If the run is shorter than an orbit, or thrusters fire and the spacecraft is not
        ours, so that their impulse cannot be separated from the disturbances.
    """
    hardware = hardware_of(system)
    series_names = set(results.names())
    q, omega, impulse, b, r, v, dipole = (
        results.values(s) for s in SERIES[:3] + SERIES[4:7] + SERIES[10:11]
    )
    times = results.times()
    n = min(len(times), len(q), len(dipole) + 1)
    times, q, omega, impulse, b, r, v = (
        x[:n] for x in (times, q, omega, impulse, b, r, v)
    )
    h = results.values(
        "wheels.h_wheel" if "wheels.h_wheel" in series_names else SERIES[3]
    )
    period = motion.period_of(r[0], v[0], motion.mu_of(system))
    if times[-1] - times[0] < period:
        raise DesatError(
            f"{system.name}: the run lasts {times[-1] - times[0]:g} s, an orbit "
            f"{period:.0f} s: at least one is needed (--stop)"
        )
    disturbance = impulse - coil_impulse(times, b, q, dipole[: n - 1])
    every = max(1, round(NODE_TIME / float(times[1] - times[0])))
    rows = slice(0, n - 1)
    feeds = motion.feeds(system, "spacecraft")
    inputs = motion.recorded_inputs(results, feeds, rows) if feeds else None
    at, sources, some = times[rows][::every], {}, {}
    if inputs is not None:
        some = {k: x[::every] for k, x in inputs.items()}
        sources = impulses(system, some, q[rows][::every], at)
        if SERIES[13] in series_names:
            torque = results.values(SERIES[13], rows)[::every]
            sources[TABLE_TORQUE] = integral(rotate_back(q[rows][::every], torque), at)
    if SERIES[11] in series_names:
        # pulses of thrusters are shorter than rows, so sum up the disturbances instead
        if not sources:
            raise DesatError(
                f"{system.name}: thrusters fire, and the disturbances of a spacecraft "
                "that is not ours cannot be told from them"
            )
        total = np.sum(list(sources.values()), axis=0)
        disturbance = np.stack([np.interp(times, at, x) for x in total.T], axis=1)
    body = omega @ hardware.carrier.T
    return Flight(
        times,
        period,
        disturbance,
        q,
        b,
        body,
        hardware.axes_wheel @ h[0],
        sources,
        at,
        r,
        v,
        omega,
        some and some | {"q_bi": q[rows][::every]},
    )


def torques(
    system: System,
    inputs: Mapping[str, Array],
    q: Array,
    changes: Values | None = None,
    only: str | None = None,
) -> dict[str, Array]:
    """Compute the torque (rows, 3) N m, eci, of each source on a spacecraft of ours.

    The inputs are (rows, elements) each. `changes` are values of parameters in place of
    the craft's, and `only` is the single source that is wanted.
    """
    parameters = dict(table([system.components["spacecraft"]])["spacecraft"])
    for name, value in (changes or {}).items():
        parameters[name] = replace(parameters[name], value=value)
    off: Values = {
        "gravity_gradient": False,
        "aerodynamics": "none",
        "radiation": "none",
        "residual_dipole_body": [0.0, 0.0, 0.0],
        "tau_disturbance_body": [0.0, 0.0, 0.0],
    }
    still = {k: Parameter(x, "1") for k, x in off.items()}
    quiet = dict(inputs)
    for name in (
        "m_mean_body",
        "m_slope_body",
        "tau_mean_thruster_body",
        "b_rate_eci",
        "tau_slope_thruster_body",
        "tau_ext_body",
        "b_accel_eci",
    ):
        quiet[name] = np.zeros((len(q), 3))
    keys = dict(zip(SOURCES, list(off)[:4], strict=True))
    contributions = {}
    for name, key in keys.items():
        if only not in (None, name):
            continue
        on = {key: parameters[key]} if key in parameters else {}
        if key == "gravity_gradient" and key not in parameters:
            on = {key: Parameter(True, "1")}  # the body has no switch: it always acts
        contributions[name] = rotate_back(
            q, motion.torque({**parameters, **still, **on}, quiet, 0.0)(0.0, q)
        )
    constant = np.asarray(parameters["tau_disturbance_body"].value, float)
    if constant.any() and only in (None, "constant"):
        contributions["constant"] = rotate_back(
            q, np.broadcast_to(constant, (len(q), 3))
        )
    return contributions


def impulses(
    system: System, inputs: dict[str, Array], q: Array, times: Array
) -> dict[str, Array]:
    """Compute the impulse (rows, 3) N m s, eci, of each source since the start.

    The sources are those of `torques`.
    """
    return {name: integral(x, times) for name, x in torques(system, inputs, q).items()}


def integral(torque: Array, times: Array) -> Array:
    """Integrate a torque (rows, 3), N m, since the start by the trapezoidal rule.

    The impulse (rows, 3), N m s, is in the frame of the torque.
    """
    steps = np.diff(times)[:, None]
    parts = 0.5 * (torque[1:] + torque[:-1]) * steps
    return np.vstack([np.zeros(3), np.cumsum(parts, axis=0)])


# --- without a run --------------------------------------------------------------------


def attitude_of(system: System, q: Array, r: Array, v: Array) -> Attitude:
    """Determine how a craft points, from its guidance or from its attitudes.

    Where the guidance does not define it, the last three quarters of the attitudes q
    (n, 4) at r (n, 3) m with v (n, 3) m/s are used.
    """
    guide = system.roles.get("guidance")
    if guide is not None and (kind := GUIDED.get(guide.model)):
        return Attitude(kind, (0.0, 0.0, 0.0, 1.0), 0.0)
    count = min(len(q), len(r), len(v))
    rows = slice(count // 4, count, max(1, count // 2000))
    q = q[rows]
    lvlh = np.array(
        [
            lvlh_attitude(tuple(r), tuple(v))
            for r, v in zip(r[rows].tolist(), v[rows].tolist(), strict=True)
        ]
    )
    relative = np.array(
        [
            product(tuple(a), inverse(tuple(b)))
            for a, b in zip(q.tolist(), lvlh.tolist(), strict=True)
        ]
    )
    attitudes = []
    for kind, each in (("nadir", relative), ("inertial", q)):
        mean = each[-1] + 0.0
        for _ in range(2):
            signs = np.where(each @ mean < 0.0, -1.0, 1.0)[:, None]
            mean = (each * signs).mean(axis=0)
            mean /= np.linalg.norm(mean)
        angle = 2.0 * np.arccos(np.clip(np.abs(each @ mean), 0.0, 1.0))
        x, y, z, w = mean.tolist()
        attitudes.append(Attitude(kind, (x, y, z, w), float(np.quantile(angle, 0.95))))
    best = min(attitudes, key=lambda a: a.wanders)
    return best if best.wanders <= WANDERS else best._replace(kind="moving")


def wanted_attitude(system: System) -> Attitude:
    """Return the reference attitude of the guidance.

    Raises
    ------
    DesatError
        If the guidance is none of the supported ones, so that the attitude moves
        otherwise.
    """
    guide = system.roles.get("guidance")
    guidance = {
        "guidance_nadir": ("nadir", "q_bo"),
        "guidance_inertial": ("inertial", "q_target_bi"),
    }
    model = "" if guide is None else guide.model
    if guide is not None and model in GUIDED:
        return Attitude(GUIDED[model], (0.0, 0.0, 0.0, 1.0), 0.0)
    if guide is None or model not in guidance:
        raise DesatError(
            f"{system.name}: guidance: one of {', '.join((*guidance, *GUIDED))} is needed"
        )
    kind, name = guidance[model]
    x, y, z, w = guide.values[name]
    if not any((x, y, z, w)):
        raise DesatError(f"{system.name}: guidance: {name} is zero")
    return Attitude(kind, normalise((x, y, z, w)), 0.0)


def environment_block(component: Component, changes: Values | None = None) -> Block:
    """Build the bare block of an environment with its parameters, some of them changed.

    Raises
    ------
    DesatError
        If the environment cannot be flown by itself: it is not our block, it integrates
        its orbit, or it lacks a parameter that is changed.
    """
    model = component.model
    if model not in names() or model == _MOVES:
        reason = (
            "it integrates its orbit" if model == _MOVES else "it is no block of ours"
        )
        raise DesatError(
            f"{model}: {reason}, so it cannot be evaluated at other dates and on other orbits"
        )
    block: Block = bare_block(component)
    for name, value in (changes or {}).items():
        if not hasattr(block, name):
            raise DesatError(f"{model} has no {name}")
        setattr(block, name, value)
    block.check()
    block.start()
    return block


def needless(system: System) -> dict[str, int]:
    """Return the changes of parameters that leave out an unused part of an environment.

    A craft without coils and residual dipole needs no field, which takes most of the
    computing time.
    """
    craft = system.roles.get("spacecraft")
    dipole = (
        np.any(craft.values.get("residual_dipole_body", 0.0))
        if craft is not None
        else True
    )
    if dipole or "torquers" in system.roles:
        return {}
    return without_field(system.roles["environment"])


def without_field(environment: Component) -> dict[str, int]:
    """Return the parameter change that switches an environment's field off, if any."""
    field = environment.interface.signals.get("field")
    if field is None or "none" not in field.choices:
        return {}
    return {"field": field.choices.index("none")}


def guided(
    component: Component, inputs: Mapping[str, Array], times: Array
) -> tuple[Array, Array]:
    """Compute reference attitude (n, 4) and rate (n, 3) rad/s of a guidance of ours."""
    block = bare_block(component)
    q, omega, last = [], [], None
    for k, t in enumerate(times.tolist()):
        for name in ("r_eci", "v_eci", "sun_eci"):
            setattr(block, name, tuple(inputs[name][k].tolist()))
        if last is None:
            block.check()
            block.start()
            block.advance(t, 0.0)
        else:
            block.advance(t, t - last)
        last = t
        q.append(block.q_wanted_bi)
        omega.append(block.omega_ref_body)
    return np.array(q), np.array(omega)


def _given_torque(
    component: Component, inputs: Mapping[str, Array], q: Array, times: Array
) -> Array:
    """Compute the impulse (n, 3) N m s, eci, of a torque table since the first time."""
    block = bare_block(component)
    block.check()
    block.start()
    total = [np.zeros(3)]
    for k, (t, then) in enumerate(
        zip(times[:-1].tolist(), times[1:].tolist(), strict=True)
    ):
        block.q_bi = tuple(q[k].tolist())
        block.r_eci, block.v_eci = (
            tuple(inputs[n][k].tolist()) for n in ("r_eci", "v_eci")
        )
        block.advance(t, then - t)
        mean = rotate_back(q[k : k + 1], np.array([block.tau_ext_body]))[0]
        total.append(total[-1] + (then - t) * mean)
    return np.array(total)


ENVIRONMENT_OUTPUTS = ("r_eci", "v_eci", "b_eci", "sun_eci", "sunlight", "density")


def inputs_at(block: Block, times: Sequence[float]) -> dict[str, Array]:
    """Compute the outputs of an environment at successive times (s).

    Each is (times, elements). The native FMU of the block makes them where there is
    one, which gives the same bits in a tenth of the time.

    Raises
    ------
    DesatError
        If the environment does not cover a time.
    """
    rows = None
    if (component := native_of(block)) is not None:
        elements = component.interface.elements
        outputs = [s for name in ENVIRONMENT_OUTPUTS for s in elements[name]]
        rows = rows_of(component, times, outputs)
    if rows is None:  # there is none, or it failed: then the Python says why
        rows = _rows_of_block(block, times)
    columns, first = {}, 0
    for name in ENVIRONMENT_OUTPUTS:
        size = np.size(getattr(block, name))
        columns[name] = rows[:, first : first + size]
        first += size
    return columns


def _rows_of_block(block: Block, times: Sequence[float]) -> Array:
    """Compute the outputs of an environment, (times, elements), by its Python."""
    rows, last = [], None
    try:
        for t in times:
            if last is not None:
                block.advance(last, t - last)
            block.output(t)
            last = t
            rows.append(np.hstack([getattr(block, n) for n in ENVIRONMENT_OUTPUTS]))
    except BlockError as error:
        raise DesatError(str(error)) from error
    return np.array(rows, float)


def native_of(block: Block) -> Component | None:
    """Return the native FMU of a block, with the block's parameters.

    None where there is no such FMU.
    """
    model = type(block).__module__.rpartition(".")[2]
    sizes = tuple(sorted(block.sizes.items()))
    fmu = library.of_block(model, sizes) if model in names() else None
    if fmu is None or fmu.path.parent.name != "native":
        return None
    signals = fmu.interface.signals.values()
    parameters = [s for s in signals if s.causality == "parameter"]
    values = block.access([s.reference for s in parameters]).read()
    by_name = dict(zip((s.name for s in parameters), values, strict=True))
    return Component(model, fmu.path.name, fmu.interface, by_name, fmu)


def between(inputs: dict[str, Array], nodes: Array, times: Array) -> dict[str, Array]:
    """Interpolate outputs of an environment at `nodes` (s) to `times` (s) between them.

    Cubic splines are used, and linear interpolation for sunlight and density. With
    nodes every 120 s of a low orbit the field errs by 1e-5, and by 1e-4 in the first
    and last interval.
    """
    inputs_between = {
        k: Spline(nodes, inputs[k])(times)
        for k in ("r_eci", "v_eci", "b_eci", "sun_eci")
    }
    for name in ("sunlight", "density"):
        inputs_between[name] = np.interp(times, nodes, inputs[name][:, 0])[:, None]
    return inputs_between


def flown_at(
    system: System, attitude: Attitude, inputs: dict[str, Array], times: Array
) -> Flight:
    """Build the flight of a craft at a constant or guided attitude, wheels at rest.

    The environment has given `inputs` at `times` (s).
    """
    r, v = inputs["r_eci"], inputs["v_eci"]
    pairs = list(zip(map(tuple, r.tolist()), map(tuple, v.tolist()), strict=True))
    if attitude.kind == "nadir":
        q = np.array([product(attitude.q, lvlh_attitude(*pair)) for pair in pairs])
        rate = np.linalg.norm(cross(r, v), axis=1) / (r * r).sum(axis=1)
        c = from_body(np.array([attitude.q]))[0].T
        omega = -rate[:, None] * c[:, 1]
    elif attitude.kind in GUIDED.values():
        q, omega = guided(system.roles["guidance"], inputs, times)
    else:
        q = np.broadcast_to(np.array(attitude.q), (len(times), 4))
        omega = np.zeros((len(times), 3))
    return flight_at(system, q, omega, inputs, times)


def flight_at(
    system: System, q: Array, omega: Array, inputs: dict[str, Array], times: Array
) -> Flight:
    """Build the flight of a craft at attitudes q (n, 4), wheels at rest.

    The body turns with `omega` (n, 3) rad/s, body, and the environment has given
    `inputs` at `times` (n,) s.
    """
    r, v = inputs["r_eci"], inputs["v_eci"]
    feeds = motion.feeds(system, "spacecraft") or {}
    loose = {
        k: np.broadcast_to(np.array(x, float), (len(times), len(x)))
        for k, x in feeds.items()
        if not isinstance(x, str) and k in inputs
    }
    sources = impulses(system, inputs | loose, q, times)
    if (disturbance := system.roles.get("disturbance")) is not None:
        sources[TABLE_TORQUE] = _given_torque(disturbance, inputs, q, times)
    hardware = hardware_of(system)
    return Flight(
        times,
        motion.period_of(r[0], v[0], motion.mu_of(system)),
        np.sum(list(sources.values()), axis=0),
        q,
        inputs["b_eci"],
        omega @ hardware.carrier.T,
        np.zeros(3),
        sources,
        times,
        r,
        v,
        omega,
        {**inputs, **loose, "q_bi": q},
    )


def turn_of(system: System) -> float:
    """Return the time (s) of a turn of a craft that spins; inf: it does not."""
    guide = system.roles.get("guidance")
    rate = 0.0 if guide is None else float(guide.values.get("spin_rate", 0.0))
    return 2.0 * pi / abs(rate) if rate != 0.0 else inf


def fly_days(system: System, attitude: Attitude, since: float = 0.0) -> Flight:
    """Fly whole orbits at the wanted attitude, `since` (s) after the start.

    They take about a day, or one orbit if that is longer.
    """
    begin = system.start + since
    block = environment_block(system.components["environment"], needless(system))
    first = inputs_at(block, [begin])
    period = motion.period_of(
        first["r_eci"][0], first["v_eci"][0], motion.mu_of(system)
    )
    orbits = max(1, round(86400.0 / period))
    turns = orbits * period / turn_of(system)
    rows = max(orbits * 90, NODES, ceil(TURN_ROWS * turns))
    times = begin + np.linspace(0.0, orbits * period, rows + 1)
    block = environment_block(system.components["environment"], needless(system))
    return flown_at(system, attitude, inputs_at(block, times.tolist()), times)
