"""Read data of a sizing from a craft's scenarios, and name what its model lacks."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from math import inf, pi

import numpy as np

from ..analyses import attitude_loop, plausibility, unmanaged_orbit
from ..analyses.flight import Flight, flight_of, series_for
from ..files.paths import NOMINAL
from ..files.scenario import Scenario
from ..language.content import content_of
from ..numbers.numbers import late
from ..runs.case import Case
from ..runs.prepare import read, resolved
from ..runs.run import simulate
from ..system.errors import DesatError
from ..system.expression import factor
from ..system.interface import role_classes
from ..system.model import System
from ..system.options import Options
from ..system.parameters import unit_of

# scenario beside the craft's own that recommended rods have to meet too
WORST = "worst.toml"
DETUMBLING = "detumbling.toml"
TIP_OFF = 5.0 * pi / 180.0  # rad/s, where no scenario gives it
# Parameters of other roles that act in the closed loop alone, besides all of
# `loop_roles`.
LOOP_PARAMETERS = {
    "wheels": {
        "motor_lag",
        "viscous",
        "coulomb",
        "friction_speed",
        "compensation",
        "stiction",
        "unbalance",
        "seed",
        "idle_power",
        "motor_constant",
        "h_start_wheel",
        "speed_gain",
        "speed_sample_time",
        "command_mode",
        "failed_from",
    },
    "spacecraft": {"q_start_bi", "omega_start_body", "start_frame", "angle_limit"},
    "tachometers": {
        "sample_time",
        "bias_wheel",
        "resolution",
        "full_scale",
        "fail_time",
        "seed",
    },
    "thrusters": {
        "sample_time",
        "placement",
        "carried",
        "least_on_time",
        "least_pulse",
        "schedule_start",
        "schedule_duration",
        "schedule_tau_body",
        "schedule_force_body",
    },
    "torquers": {
        "lag",
        "resistance",
        "area_turns",
        "failed_coil",
        "failed_from",
        "failed_share",
        "failure_known",
        "pulse_delay",
        "least_pulse",
    },
    "manager": {"delay", "wheel_sample_time", "null_gain", "gyroscopic", "feedforward"},
}


def doubts(system: System) -> list[str]:
    """Return warnings on improbable values of a craft, as `check` and `run` do."""
    checks = (plausibility, unmanaged_orbit, attitude_loop)
    return [line for of in checks for line in of.warnings(system)]


def closed_loop_only(system: System, options: Options) -> Iterator[str]:
    """Yield a line that names parameters set by options that the model lacks."""
    names_set = [x.partition("=")[0].strip() for x in options.sets] + [*options.values]
    names = []
    for name in dict.fromkeys(names_set):
        owner, _, parameter = name.partition(".")
        component = system.components.get(owner)
        role = owner if component is None else component.interface.role
        parameter = parameter.partition("[")[0]
        if role in loop_roles() or parameter in LOOP_PARAMETERS.get(role, ()):
            names.append(name)
    if names:
        yield f"{', '.join(names)}: affects the closed loop only, not the sizes"


def loop_roles() -> set[str]:
    """Return the roles whose parameters act in the closed loop alone.

    Tachometers are not among them: their noise is the noise of the momentum.
    """
    sensors = {role for role, block in role_classes().items() if block.is_sensor}
    return (sensors | {"controller"}) - {"tachometers"}


def find_tip_off(source: Scenario, options: Options) -> tuple[float, float]:
    """Return the rate after separation (rad/s), and the time (s) to be rid of it.

    They are those of the scenario `detumbling.toml` beside a user's own craft, or
    TIP_OFF and no limit.
    """
    there = source.file.parent / DETUMBLING
    if source.is_system_file or not there.is_file():
        return TIP_OFF, inf
    try:
        system, _ = resolved(str(there), replace(options, stop=None))
    except DesatError:
        return TIP_OFF, inf
    content = content_of(system.about)
    limits = [
        factor(unit_of(content.numbers[x.number].unit), "s", x.number) * x.max
        for x in content.requirements.values()
        if x.max is not None and x.number in late(content)
    ]
    rate = np.linalg.norm(system.components["spacecraft"].values["omega_start_body"])
    return float(rate), min(limits, default=inf)


def find_worst_scenario(source: Scenario) -> Scenario | None:
    """Return the worst scenario of a user's own craft, or None.

    The source has to be the craft's nominal scenario.
    """
    there = source.file.parent / WORST
    if source.is_system_file or source.file.name != NOMINAL or not there.is_file():
        return None
    return read(str(there))


def fly_case(case: Case, system: System) -> Flight:
    """Fly a prepared case and return its flight.

    Raises
    ------
    DesatError
        If the run does not complete.
    """
    return fly_and_settle(case, system)[0]


def fly_and_settle(case: Case, system: System) -> tuple[Flight, int]:
    """Fly a prepared case and return its flight and the substeps that it took.

    Runs of the same case with other rods take the same number.

    Raises
    ------
    DesatError
        If the run does not complete.
    """
    recording = replace(case.options, record=series_for(system), every=1)
    run = simulate(replace(case, options=recording)).or_raise(case.target)
    with run.results as results:
        return flight_of(system, results), run.manifest.substeps
