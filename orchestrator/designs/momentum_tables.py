"""Tables for momentum management (paper 001): H_NOM, and the preview's feedback and costate.

[design]
peak_weight = 3e5             # preview: A2 m4, of (wheel momentum / peak_momentum)^8
peak_momentum = 20.0          # preview: N m s
momentum_weight = [q, q, q]   # preview: of |H|^2, eci, 1/(T2 s2)
hold_weight = 15000.0         # preview: 1/(T2 s2), of how stiffly the course is held

Made for the manager's own inertia, coils and weighting, the attitudes of guidance and the field of
the environment (with `assume`: another), from momentum zero on.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from math import ceil
from typing import Any

import numpy as np

from desat.components.bases.momentum_management import CAPACITY
from desat.components.contract.block import Block
from desat.components.laws import momentum_management as laws
from desat.components.laws import momentum_offline as offline
from desat.components.maths.attitude import matrix, normalised
from desat.components.physics.orbit import elements_from_state, mean_motion
from desat.components.physics.torques import gravity_gradient
from desat.fmus.registry import block_class

from ..files.scenario import Scenario
from ..study.options import Options
from ..system.check import check
from ..system.errors import DesatError
from ..system.interface import base_name
from ..system.model import Component, System
from ..system.parameters import choice_of, value_of
from . import Design
from .origin import draft_of

HALF_ORBIT, SPACING = 2850.0, 150.0
"""The desaturation period of H_NOM, half an orbit of 500 km in whole samples of 50 s; and the time
between rows (s), of which it is a multiple."""
BEYOND = 600.0
"""What the tables reach beyond the run (s): an open-loop law's next target."""
PREVIEW, PROFILE = "manager_preview", ("manager_mixed_mode", "manager_open_loop")
ORBIT = (
    "orbit_start", "orbit_frame", "semi_major_axis", "eccentricity", "inclination", "raan",
    "argument_of_perigee", "mean_anomaly", "r_start", "v_start", "j2", "epoch_j2000", "eci_frame",
)  # fmt: skip
"""Parameters of an environment that a course depends on; field models are the law's own affair."""


KEYS = ("peak_weight", "peak_momentum", "hold_weight", "momentum_weight")


def applies(system: System) -> bool:
    """For the blocks with such tables."""
    manager = system.components.get("manager")
    return manager is not None and manager.interface.model in (PREVIEW, *PROFILE)


def make(scenario: Scenario, options: Options) -> Design:
    """The tables of its manager."""
    system, _ = check(draft_of(scenario, options)).or_raise()
    about, manager = scenario.data["design"], system.components["manager"]
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
    preview = manager.interface.model == PREVIEW
    # a preview looks an orbit beyond the end, else it would let go there
    span = (nodes - 1) * SPACING + (2.0 * HALF_ORBIT if preview else dt)
    course, rate = _course(system, dt, ceil(span / HALF_ORBIT) * period)
    times = SPACING * np.arange(nodes)
    common = {
        "table_nodes": nodes,
        "table_spacing": SPACING,
        "made_for": made_for(system),
    }
    if preview:
        tables, reached = _preview(about, course, times)
    else:
        tables, reached = _profile(manager, course, times, rate, period)
    return Design("manager", {**common, **tables}, reached)


def _profile(
    manager: Component, course: offline.Course, times: Any, rate: float, period: int
) -> tuple[dict[str, Any], dict[str, tuple[Any, str]]]:
    """H_NOM as a table, and what its rows leave out."""
    ends = offline.periodic_ends(course, rate, period)
    values, conditions = offline.profile(course, ends, period, np.zeros(3))
    rows = offline.at_rows(values, course.dt, times, period)
    every = round(period * course.dt / SPACING)
    table = tuple(_padded(rows).ravel())
    errors = []
    for k, value in enumerate(values):
        if k * course.dt <= times[-1]:
            i, share = laws.place(len(times), SPACING, k * course.dt)
            errors.append(np.subtract(laws.profile3(table, len(times), every, i, share), value))
    return (
        {"table_period": every, "profile_table": _kept(rows)},
        {
            "interpolation_error": (float(np.linalg.norm(errors, axis=1).max()), "N.m.s"),
            "largest_condition": (float(conditions.max()), "1"),
            "mean": ([float(x) for x in values.mean(axis=0)], "N.m.s"),
        },
    )


def _preview(
    about: dict[str, Any], course: offline.Course, times: Any
) -> tuple[dict[str, Any], dict[str, tuple[Any, str]]]:
    """K and g as tables: the cheapest course, held."""
    weight = np.array(about.get("momentum_weight", (1000.0,) * 3), float)
    if weight.min() <= 0.0:
        raise DesatError(f"design: momentum_weight = {weight.tolist()}: above 0 is needed")
    best = offline.cheapest(
        course, weight, about.get("peak_weight", 0.0), about.get("peak_momentum", 20.0),
        np.zeros(3),
    )  # fmt: skip
    hold = about.get("hold_weight", float(weight.max()))
    gain = offline.feedback(course, np.full(3, hold))
    held = -best.costate - np.einsum("kab,kb->ka", gain, best.momentum[:-1])
    rows = offline.at_rows(gain, course.dt, times)
    coils = np.einsum("ki,kij,kj->k", best.dipole, np.linalg.inv(course.weighting), best.dipole)
    flown = round(times[-1] / course.dt)
    wheels = np.einsum("kwi,ki->kw", course.to_wheels, best.momentum[1:])
    return (
        {
            "feedback_table": _kept(rows[:, *np.triu_indices(3)]),
            "costate_table": _kept(offline.at_rows(held, course.dt, times)),
        },
        {
            "predicted_energy": (float(coils[:flown].sum() * course.dt), "A2.m4.s"),
            "predicted_wheel": (
                float(np.abs(wheels[:flown]).max()), "N.m.s",
            ),
        },
    )  # fmt: skip


def _course(system: System, dt: float, count: int) -> tuple[offline.Course, float]:
    """What is predicted for so many samples, in eci, and the orbital rate (rad/s)."""
    manager = system.components["manager"]
    environment, guidance = (_bare(system.components[n]) for n in ("environment", "guidance"))
    scaled = _value(manager, "inertia_scale") * np.array(_value(manager, "inertia"))
    inertia: Any = tuple(float(x) for x in scaled)
    live = laws.without(_value(manager, "axes_coil"), int(_value(manager, "dead_coil")))
    kind = choice_of(manager, "weighting")
    axes = _value(manager, "axes_wheel") if kind == "wheels" else live
    s = np.eye(3) if kind == "identity" else np.reshape(laws.weighting(axes), (3, 3))
    size, wheels = 2 * count + 1, np.linalg.pinv(np.reshape(_value(manager, "axes_wheel"), (3, 4)))
    field, gravity, weighting = np.empty((size, 3)), np.empty((size, 3)), np.empty((size, 3, 3))
    to_wheels = np.empty((size, 4, 3))
    rate, igrf = 0.0, choice_of(system.components["environment"], "field") == "igrf"
    for k in range(size):  # begin, middle and end of each sample
        t = system.start + 0.5 * k * dt
        r, v = (environment.to_eci(x) for x in environment.motion(t))
        guidance.r_eci, guidance.v_eci = r, v
        guidance.advance(t, 0.5 * dt)
        c = np.reshape(matrix(normalised(guidance.q_ref_bi)), (3, 3))
        x, y, z = (float(p) for p in c @ r)
        field[k] = environment.field_eci(r, t, igrf)
        gravity[k] = c.T @ gravity_gradient((x, y, z), inertia)
        weighting[k], to_wheels[k] = c.T @ s @ c, wheels @ c
        rate = rate or mean_motion(elements_from_state(r, v)[0])
    return offline.Course(dt, _mean(field), _mean(gravity), weighting[1::2], to_wheels[2::2]), rate


def _mean(x: Any) -> Any:
    """Means over the samples, by Simpson's rule: those of their middles err by 5e-4, and along the
    field that adds up."""
    return (x[:-1:2] + 4.0 * x[1::2] + x[2::2]) / 6.0


def _bare(component: Component) -> Any:
    """The block of a component with its parameters, started."""
    block: Block = block_class(component.interface.model)()
    signals = component.interface.signals
    block.access([signals[n].reference for n in component.parameters]).write(
        list(component.parameters.values())
    )
    block.check()
    block.start()
    return block


def _value(component: Component, name: str) -> Any:
    """A parameter; an array as a tuple."""
    values = tuple(value_of(component, s.name) for s in component.interface.elements(name))
    return values[0] if values and component.interface.elements(name)[0].name == name else values


def _padded(rows: Any) -> Any:
    table = np.zeros((CAPACITY, rows.shape[1]))
    table[: len(rows)] = rows
    return table


def _kept(rows: Any) -> list[list[float]]:
    """A whole table, of seven digits: 1e-7 of a momentum is far below what is between rows."""
    return [[float(f"{x:.7g}") for x in row] for row in _padded(rows)]


# --- before a run -----------------------------------------------------------------------------


def made_for(system: System) -> float:
    """A number of orbit, epoch and attitude, that tables are good for."""
    about: dict[str, Any] = {"start": system.start}
    for name, wanted in (("environment", ORBIT), ("guidance", None)):
        component = system.components.get(name)
        if component is None:
            continue
        for signal in component.interface.of("parameter"):
            base = base_name(signal.name)
            if base in wanted if wanted is not None else base != "sample_time":
                about[f"{name}.{signal.name}"] = value_of(component, signal.name)
    digest = hashlib.sha256(json.dumps(about, sort_keys=True).encode()).hexdigest()
    return float(int(digest[:12], 16))


def problems(system: System) -> Iterator[str]:
    """What is wrong with the tables of a system, a line each: none, of another orbit or attitude,
    shorter than the run."""
    for c in system.components.values():
        if "made_for" not in c.interface.signals:
            continue
        made, where = _value(c, "made_for"), f"{system.where}: {c.name}.made_for"
        if made == 0.0:
            yield f"{where} = 0: its tables are missing; `desat design` makes them"
        elif made != made_for(system):
            yield (f"{where} = {made:.0f}: its tables are of another orbit, epoch or attitude, "
                   f"which would be {made_for(system):.0f}; --design now makes them")  # fmt: skip
        end = (_value(c, "table_nodes") - 1) * _value(c, "table_spacing")
        if made != 0.0 and end < system.stop * (1.0 - 1e-12):
            yield (f"{system.where}: {c.name}.table_nodes = {_value(c, 'table_nodes')}: its tables "
                   f"end at {end:g} s, the run at {system.stop:g} s")  # fmt: skip
