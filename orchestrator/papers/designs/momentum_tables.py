"""Compute tables for momentum management (paper 001).

They are H_NOM, and the feedback and costate of the preview.

    [design]
    peak_weight = 3e5             # preview: A2 m4, of (wheel momentum / peak_momentum)^8
    peak_momentum = 20.0          # preview: N m s
    peak_share = 0.9              # preview: instead of it, over the largest wheel
                                  # momentum of the course without a peak_weight;
                                  # peak_weight is then over that course's mean
                                  # squared dipoles
    momentum_weight = [q, q, q]   # preview: of |H|^2, eci, 1/(T2 s2)
    hold_weight = 15000.0         # preview: 1/(T2 s2), stiffness that holds the course
    lost_momentum_weight = [q, q, q]  # learning preview: the same for the courses with
                                      # a coil lost,
    lost_peak_share = 1.6             # peaks over those of the course with all coils;
    lost_effort = 2e6                 # A2 m4: a course that takes less has coils to
                                      # spare: peak_weight is then over this, and the
                                      # share falls with the fourth root

The tables are made for the manager's own inertia, coils and weighting, the attitudes of
guidance and the field of the environment (with `assume`: another), from zero momentum
on.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from dataclasses import replace
from math import ceil
from typing import Any

import numpy as np

from desat.components.bases.momentum_management import CAPACITY, LEAST_EIGENVALUE_RATIO
from desat.components.laws import momentum_management as laws
from desat.components.laws import momentum_offline as offline
from desat.components.maths.attitude import matrix, normalise
from desat.components.physics.orbit import elements_from_state, mean_motion
from desat.components.physics.torques import gravity_gradient

from ...files.scenario import Scenario
from ...system.errors import DesatError
from ...system.model import Component, System
from ...system.options import Options
from ...system.parameters import bare_block
from . import MadeDesign, Parameters
from .origin import case_for
from .origin import design_of as asked_of

# Desaturation period (s) of H_NOM, half an orbit of 500 km in whole samples of 50 s;
# and spacing (s) of rows, of which it is a multiple.
HALF_ORBIT, SPACING = 2850.0, 150.0
# s: extent of the tables beyond the run, for the next target of an open-loop law
BEYOND = 600.0
LEARNING = "manager_preview_learning"
PREVIEW, PROFILE = (
    ("manager_preview", LEARNING),
    ("manager_mixed_mode", "manager_open_loop"),
)
# Parameters of an environment that a course depends on; field models belong to the law.
ORBIT = (
    "orbit_start",
    "orbit_frame",
    "semi_major_axis",
    "eccentricity",
    "inclination",
    "raan",
    "argument_of_perigee",
    "mean_anomaly",
    "r_start",
    "v_start",
    "j2",
    "epoch_j2000",
    "eci_frame",
)
KEYS = (
    "peak_weight",
    "peak_momentum",
    "peak_share",
    "hold_weight",
    "momentum_weight",
    "lost_momentum_weight",
    "lost_peak_share",
    "lost_effort",
)


def applies(system: System) -> bool:
    """Return whether the manager is a block with such tables."""
    manager = system.components.get("manager")
    return manager is not None and manager.model in (*PREVIEW, *PROFILE)


def make(scenario: Scenario, options: Options) -> MadeDesign:
    """Compute the tables of a scenario's manager."""
    system, _ = case_for(scenario, options).or_raise()
    manager = system.components["manager"]
    dt = float(_value(manager, "sample_time"))
    period = round(HALF_ORBIT / dt)
    if abs(period * dt - HALF_ORBIT) > 1e-6:
        raise DesatError(
            f"{scenario.name}: design: sample_time = {dt:g} s does not divide the desaturation "
            f"period of {HALF_ORBIT:g} s"
        )
    nodes = ceil((system.stop + BEYOND) / SPACING) + 1
    if nodes > CAPACITY:
        raise DesatError(
            f"{scenario.name}: design: a run of {system.stop:g} s takes {nodes} rows of "
            f"{SPACING:g} s; a table has {CAPACITY}"
        )
    preview = manager.model in PREVIEW
    # a preview looks an orbit beyond the end; otherwise control would cease there
    span = (nodes - 1) * SPACING + (2.0 * HALF_ORBIT if preview else dt)
    course, rate, turns = _course(system, dt, ceil(span / HALF_ORBIT) * period)
    times = SPACING * np.arange(nodes)
    common = {
        "table_nodes": nodes,
        "table_spacing": SPACING,
        "made_for": made_for(system),
    }
    if preview:
        lost_courses = (
            _courses_without_coil(manager, course, turns)
            if manager.model == LEARNING
            else []
        )
        tables, reached = _preview(scenario, course, times, lost_courses)
    else:
        tables, reached = _profile(manager, course, times, rate, period)
    return MadeDesign("manager", {**common, **tables}, reached)


def _profile(
    manager: Component, course: offline.Course, times: Any, rate: float, period: int
) -> tuple[Parameters, dict[str, tuple[Any, str]]]:
    """Compute H_NOM as a table, and its interpolation error."""
    ends = offline.periodic_ends(course, rate, period)
    values, conditions = offline.profile(course, ends, period, np.zeros(3))
    rows = offline.at_rows(values, course.dt, times, period)
    every = round(period * course.dt / SPACING)
    table = tuple(_padded(rows).ravel())
    errors = []
    for k, value in enumerate(values):
        if k * course.dt <= times[-1]:
            i, share = laws.place(len(times), SPACING, k * course.dt)
            errors.append(
                np.subtract(laws.profile3(table, len(times), every, i, share), value)
            )
    return (
        {"table_period": every, "profile_table": _rounded(rows)},
        {
            "interpolation_error": (
                float(np.linalg.norm(errors, axis=1).max()),
                "N.m.s",
            ),
            "largest_condition": (float(conditions.max()), "1"),
            "mean": ([float(x) for x in values.mean(axis=0)], "N.m.s"),
        },
    )


def _preview(
    scenario: Scenario,
    course: offline.Course,
    times: Any,
    lost_courses: list[offline.Course | None],
) -> tuple[Parameters, dict[str, tuple[Any, str]]]:
    """Compute the tables K and g of the preview.

    They hold the cheapest course; g is also computed for the courses with a coil lost.
    """
    settings, weight = asked_of(scenario), _weight(scenario, "momentum_weight")
    peak, unit, steps = (
        settings.peak_momentum or 20.0,
        1.0,
        round(times[-1] / course.dt),
    )
    if settings.peak_share:
        if settings.peak_momentum:
            raise DesatError(
                f"{scenario.name}: design: peak_momentum and peak_share: one of them"
            )
        plain = offline.cheapest(course, weight, 0.0, 1.0, np.zeros(3))
        largest = float(np.abs(offline.wheels(course, plain)[:steps]).max())
        unit = float(_coils(course, plain)[:steps].mean())
        peak = settings.peak_share * largest
    of_peak = unit * settings.peak_weight
    best = offline.cheapest(course, weight, of_peak, peak, np.zeros(3))
    gain = offline.feedback(
        course, np.full(3, settings.hold_weight or float(weight.max()))
    )

    def offset(x: offline.Optimum) -> Any:
        """Return g at the rows of the table."""
        held = -x.costate - np.einsum("kab,kb->ka", gain, x.momentum[:-1])
        return offline.at_rows(held, course.dt, times)

    tables = {
        "feedback_table": _rounded(
            offline.at_rows(gain, course.dt, times)[:, *np.triu_indices(3)]
        ),
        "costate_table": _rounded(offset(best)),
    }
    if lost_courses:
        if not settings.peak_share:
            raise DesatError(
                f"{scenario.name}: design: peak_share is needed, for lost_peak_share"
            )
        effort = max(unit, settings.lost_effort)
        share = (settings.lost_peak_share or settings.peak_share) * (
            unit / effort
        ) ** 0.25
        of_peak, key = effort * settings.peak_weight, "lost_momentum_weight"
        of = _weight(scenario, key) if settings.lost_momentum_weight else weight
        rows = [
            np.zeros((len(times), 3))
            if x is None
            else offset(offline.cheapest(x, of, of_peak, share * largest, np.zeros(3)))
            for x in lost_courses
        ]
        tables["lost_table"] = _rounded(np.hstack(rows))
    return tables, {
        "predicted_energy": (
            float(_coils(course, best)[:steps].sum() * course.dt),
            "A2.m4.s",
        ),
        "predicted_wheel": (
            float(np.abs(offline.wheels(course, best)[:steps]).max()),
            "N.m.s",
        ),
    }


def _weight(scenario: Scenario, key: str) -> Any:
    """Return a weight (3,) of the design, or raise DesatError if not positive."""
    weight = np.array(getattr(asked_of(scenario), key) or (1000.0,) * 3, float)
    if weight.min() <= 0.0:
        raise DesatError(
            f"{scenario.name}: design: {key} = {weight.tolist()}: above 0 is needed"
        )
    return weight


def _coils(course: offline.Course, x: offline.Optimum) -> Any:
    """Return the coils' sum of squared dipoles (A2 m4) of each sample."""
    return np.einsum(
        "ki,kij,kj->k", x.dipole, np.linalg.inv(course.weighting), x.dipole
    )


def _courses_without_coil(
    manager: Component, course: offline.Course, turns: Any
) -> list[offline.Course | None]:
    """Return the course with coil 1, 2, 3 or 4 lost.

    None where the remaining coils do not span space, or the weighting is not of coils.
    """
    if manager.choice("weighting") != "coils":
        return [None] * 4
    courses: list[offline.Course | None] = []
    known = laws.without(
        _value(manager, "axes_coil"), int(_value(manager, "dead_coil"))
    )
    for coil in range(1, 5):
        s = laws.weighting(laws.without(known, coil))
        spans = laws.condition(s) <= 1.0 / LEAST_EIGENVALUE_RATIO
        weighting = turns.transpose(0, 2, 1) @ np.reshape(s, (3, 3)) @ turns
        courses.append(replace(course, weighting=weighting) if spans else None)
    return courses


def _course(system: System, dt: float, count: int) -> tuple[offline.Course, float, Any]:
    """Predict the course for `count` samples of `dt` (s).

    Returns the course in eci, the orbital rate (rad/s), and the samples' attitudes
    (count, 3, 3), eci to body.
    """
    manager = system.components["manager"]
    environment, guidance = (
        _started(system.components[n]) for n in ("environment", "guidance")
    )
    scaled = _value(manager, "inertia_scale") * np.array(_value(manager, "inertia"))
    inertia: Any = tuple(float(x) for x in scaled)
    live = laws.without(_value(manager, "axes_coil"), int(_value(manager, "dead_coil")))
    kind, axes_wheel = manager.choice("weighting"), _value(manager, "axes_wheel")
    axes = axes_wheel if kind == "wheels" else live
    s = np.eye(3) if kind == "identity" else np.reshape(laws.weighting(axes), (3, 3))
    size, wheels = 2 * count + 1, np.linalg.pinv(np.reshape(axes_wheel, (3, 4)))
    field, gravity, turns = (
        np.empty((size, 3)),
        np.empty((size, 3)),
        np.empty((size, 3, 3)),
    )
    rate, igrf = 0.0, system.components["environment"].choice("field") == "igrf"
    for k in range(size):  # begin, middle and end of each sample
        t = system.start + 0.5 * k * dt
        r, v = (environment.to_eci(x) for x in environment.motion(t))
        guidance.r_eci, guidance.v_eci = r, v
        guidance.advance(t, 0.5 * dt)
        c = np.reshape(matrix(normalise(guidance.q_ref_bi)), (3, 3))
        x, y, z = (float(p) for p in c @ r)
        field[k] = environment.field_eci(r, t, igrf)
        gravity[k] = c.T @ gravity_gradient((x, y, z), inertia)
        turns[k] = c
        rate = rate or mean_motion(elements_from_state(r, v)[0])
    middle = turns[1::2]
    weighting = middle.transpose(0, 2, 1) @ s @ middle
    means = _mean(field), _mean(gravity)
    return offline.Course(dt, *means, weighting, wheels @ turns[2::2]), rate, middle


def _mean(x: Any) -> Any:
    """Return means over the samples by Simpson's rule.

    The middles alone err by 5e-4, which accumulates.
    """
    return (x[:-1:2] + 4.0 * x[1::2] + x[2::2]) / 6.0


def _started(component: Component) -> Any:
    """Return the started block of a component."""
    block = bare_block(component)
    block.start()
    return block


def _value(component: Component, name: str) -> Any:
    """Return a parameter; an array as a tuple."""
    value = component.values.get(name, ())
    return tuple(value) if isinstance(value, list) else value


def _padded(rows: Any) -> Any:
    """Pad rows with zeros to CAPACITY rows."""
    return np.vstack((rows, np.zeros((CAPACITY - len(rows), rows.shape[1]))))


def _rounded(rows: Any) -> list[list[float]]:
    """Return a padded table with seven digits.

    1e-7 of a momentum is far below the interpolation error between rows.
    """
    return [[float(f"{x:.7g}") for x in row] for row in _padded(rows)]


# --- before a run ---------------------------------------------------------------------


def made_for(system: System) -> float:
    """Compute a number that identifies orbit, epoch and attitude of tables."""
    about: dict[str, Any] = {"start": system.start}
    for name, kind in (("environment", ORBIT), ("guidance", None)):
        component = system.components.get(name)
        if component is None:
            continue
        for signal in component.interface.parameters:
            base = signal.array
            if base in kind if kind is not None else base != "sample_time":
                about[f"{name}.{signal.name}"] = component.values[signal.name]
    digest = hashlib.sha256(json.dumps(about, sort_keys=True).encode()).hexdigest()
    return float(int(digest[:12], 16))


def problems(system: System) -> Iterator[str]:
    """Yield a line for each problem of a system's tables.

    They are missing, of another orbit or attitude, or shorter than the run.
    """
    for c in system.components.values():
        if "made_for" not in c.interface.signals:
            continue
        stored_orbit, place = (
            _value(c, "made_for"),
            f"{system.place}: {c.name}.made_for",
        )
        if stored_orbit == 0.0:
            yield f"{place} = 0: its tables are missing; `desat design` makes them"
        elif stored_orbit != made_for(system):
            yield (
                f"{place} = {stored_orbit:.0f}: its tables are of another orbit, epoch or attitude, "
                f"which would be {made_for(system):.0f}; --design now makes them"
            )
        end = (_value(c, "table_nodes") - 1) * _value(c, "table_spacing")
        if stored_orbit != 0.0 and end < system.stop * (1.0 - 1e-12):
            yield (
                f"{system.place}: {c.name}.table_nodes = {_value(c, 'table_nodes')}: its tables "
                f"end at {end:g} s, the run at {system.stop:g} s"
            )
