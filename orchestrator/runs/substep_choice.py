"""Choose the number of substeps of a run with `substeps = "auto"`.

The system flies beforehand, unrecorded, with 1, 2, 4, ... substeps on the FMUs and the
loop of the run. The coarse one of two such flights errs by about their difference,
because its error falls with the third power of the substeps (with the first, where an
event hides inside a step). `FACTOR` times the difference is the estimate. The first
count whose estimate is below the system's `accuracy` is compared also with a flight of
`FAR` times as many substeps, because two flights may err alike (a wheel's friction is
integrated in parts of its own). If that confirms it, it is chosen.

A flight covers the whole run if `LONGEST` steps, and `FREE` substeps, are enough.
Otherwise the estimate is extrapolated: with an accuracy from `LOOSE` on by the trend of
the differences, which a short flight shows; with a finer one in the proportion in which
that of fewer substeps has grown from there to the end of the run, or, if no flight has
reached that, with the power of time by which it has grown so far. Such a run is checked again when it
is over. Where its body turned faster, was accelerated more, or its torques changed more
than in the flights, these are repeated from the state recorded there. If they need more
substeps, the run is repeated from its start.

An accuracy from `LOOSE` on takes shorter ways. One substep is chosen by a short flight
with one and two, where its error is far below the accuracy, or by a longer one, where
it is below the accuracy. A run that leaves the range of its flights has its estimate
raised in proportion, as long as that stays below the accuracy and there are no
thrusters, whose pulses end inside a step. The fastest passage of each wheel through
zero is flown again, as friction makes an error of the first power there, and so is a
strong pulse of thrusters. If no count suffices, the run is made with `FALLBACK`
substeps and states its error.

The cases of a campaign begin with one choice for all (`choose_for_cases`).

Nothing depends on a clock: the choice for a system is the same everywhere.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import astuple, dataclass, replace
from functools import partial
from itertools import pairwise
from math import inf, isfinite, lcm, log2
from typing import TypeVar

import numpy as np

from desat.components.contract.block import Scalar

from ..analyses import coverage, residual
from ..analyses.coverage import Array, Reached, WheeledBody, body_of, reached_by
from ..analyses.manifest import Slow, SubstepChoice
from ..engine.child import CAN, apart
from ..engine.ending import NEVER
from ..engine.instances.base import ComponentError
from ..engine.loop import stepping
from ..engine.master import Master
from ..engine.recording.recorder import Recorder
from ..engine.recording.results import Results
from ..files import library
from ..files.scenario import Scenario
from ..numbers.derived import pointing
from ..system.errors import DesatError
from ..system.model import AUTO, MOST_SUBSTEPS, Component, System, Values
from ..system.options import Options
from ..system.schedule import schedule
from .case import Case
from .cases import Cases
from .isolation import isolated_in, to_isolate
from .prepare import prepare

T = TypeVar("T")

# Estimate over difference. An estimate must not be below the error, and the error of a
# flight is once to twice its difference from the next.
FACTOR = 2.0
LEVELS = tuple(2**i for i in range(10))  # counts to choose from
# Factor of the substeps of the flight that confirms a count, and their upper limit.
FAR, FARTHEST = 4, 2 * LEVELS[-1]
LEAST_FAR = 16  # lower limit of the substeps of the flight that confirms a count
FREE, LONGEST = 120_000, 6_000  # limits of the substeps, and of the steps, of a flight
QUICK = 4_000  # limit of the steps of the first flights, with one and two substeps
# Limit of the steps of the next flights with one and two substeps, where the error of the
# first is small and only its trend is not.
LONGER = 24_000
LOOSE = 1e-6  # rad: accuracy from which short flights and raised estimates suffice
# With such an accuracy: largest count, and the count where none is accurate enough, as
# of a craft that loses its attitude. The run then states the error.
MOST_LOOSE, FALLBACK = 64, 8
CROSSING = 40  # steps of a flight through a wheel's zero
LOOK = 1_000  # limit of the steps of a flight when a run is checked again
CARRIED = 2.0  # factor on an estimate that is extrapolated beyond its flight
BY_TREND = 2.0  # factor on an estimate that is extrapolated by its trend
ROUGH = 1.5  # estimate over difference, where one of two flights is much finer
GAIN = 1.2  # a run leaves the range of its flights beyond this factor
FAR_BELOW = 0.15  # An estimate below this share of the accuracy needs no confirmation.
# Factor on such an estimate: with it the error may fall with the first power.
UNCONFIRMED = 2.25
SAMPLES = 4  # cases from which the substeps of many cases are chosen
AGAIN = 3  # largest number of times that a run is made
STEEPEST = 3.0  # largest power of time for the extrapolation of an estimate


def choose(
    target: str, system: System, options: Options, *, for_others: bool = False
) -> SubstepChoice | None:
    """Choose the substeps of a checked system; None where they are given.

    With `for_others` the choice has the range of its flights even if these cover the
    run, because other cases may go beyond it.

    Where flights are impossible or a component fails in one, and with foreign FMUs
    where no count is accurate enough, the choice is one substep, with the reason.

    Raises
    ------
    DesatError
        If no count of `LEVELS` is accurate enough for an accuracy below `LOOSE`; it
        gives the reason.
    """
    if system.substeps != AUTO:
        return None
    if reason := _not_flown(system, options):
        return SubstepChoice(1, system.accuracy, why=reason)
    try:
        return _apart(
            system,
            options,
            partial(_choice_of, target, system, options, for_others),
        )
    except ComponentError as error:
        return SubstepChoice(
            1, system.accuracy, why=f"a flight beforehand failed: {error}"
        )
    except DesatError as error:
        if not to_isolate(system, replace(options, isolate="foreign")):
            raise
        # a foreign FMU may behave differently in a second flight
        return SubstepChoice(1, system.accuracy, why=str(error))


def _choice_of(
    target: str, system: System, options: Options, for_others: bool
) -> SubstepChoice:
    """Choose by short flights where these are far below the accuracy, else by long."""
    quick = None
    if system.accuracy >= LOOSE:
        flights = _Flights(system, options, 1, QUICK, for_others)
        quick = flights.choice_of_first(FAR_BELOW * system.accuracy)
        if quick is None and flights.first_error <= system.accuracy:
            # a trend over a short flight may be a passage of a wheel through zero
            longer = _Flights(system, options, 1, LONGER, for_others)
            quick = longer.choice_of_first(system.accuracy)
    return quick or _Flights(system, options, 1, LONGEST, for_others).choice(target)


def choose_for_cases(
    case: Case, cases: Cases, options: Options, values_of: Callable[[int], Values]
) -> SubstepChoice | None:
    """Choose the substeps that a case begins with, one of many with drawn values.

    They are chosen once a process for all cases of the source, from the first `SAMPLES`
    cases, of which `values_of` gives the values: the largest count with the largest
    estimate, and the range of all their flights. A case that goes beyond this range is
    checked again like any run. None where the substeps are given, and where each case
    chooses for itself: with an accuracy finer than `LOOSE`, and where one of these
    cases has no estimate.
    """
    if case.or_raise()[0].substeps != AUTO:
        return None
    key = repr((options, [sorted(values_of(k).items()) for k in range(SAMPLES)]))
    if key not in cases.substep_choices:
        samples = [
            replace(options, values={**options.values, **values_of(k)})
            for k in range(SAMPLES)
        ]
        cases.substep_choices[key] = _choice_for_all(cases.scenario, samples)
    return cases.substep_choices[key]


def _choice_for_all(
    scenario: Scenario, samples: Sequence[Options]
) -> SubstepChoice | None:
    """Choose what suffices for all of these cases; None where one has no estimate."""
    choices: list[SubstepChoice] = []
    for options in samples:
        try:
            system, _ = prepare(scenario, options).or_raise()
            if system.accuracy < LOOSE:
                return None
            choice = choose(scenario.target, system, options, for_others=True)
        except DesatError:  # the other cases may be valid
            return None
        if choice is None or choice.why or choice.estimate is None:
            return None
        choices.append(choice)
    largest = max(choices, key=lambda c: c.substeps)
    ranges = [c.reached for c in choices if c.reached is not None]
    return replace(
        largest,
        # with more substeps the errors of the others fall, at least in proportion
        estimate=max(
            (c.estimate or 0.0) * c.substeps / largest.substeps for c in choices
        ),
        steps=0,  # none of these steps is a case's
        reached=tuple(map(max, *ranges)),
        crossed=tuple(map(max, *(c.crossed for c in choices))),
        flown=sum(c.flown for c in choices),
        seconds=sum(c.seconds for c in choices),
    )


def _apart(system: System, options: Options, flying: Callable[[], T]) -> T:
    """Fly in the process of the run's steps: in a watched one, if the options say so.

    Raises ComponentError where a component fails, or ends that process.
    """
    if not (options.supervised and CAN):
        return flying()
    library.unpack(_on_natives(system))
    order = schedule(replace(system, substeps=1), options.breaks_loops).order
    return apart(flying, order, options.call_limit)


def settled(target: str, system: System) -> System:
    """Return a checked system with the substeps that a run of it begins with.

    Raises DesatError as `choose` does.
    """
    choice = choose(target, system, Options())
    return system if choice is None else replace(system, substeps=choice.substeps)


def choose_again(
    target: str,
    system: System,
    options: Options,
    choice: SubstepChoice,
    results: Results,
) -> SubstepChoice | None:
    """Choose again for a run that has left the range of its flights.

    None where it has not, or where the flights need no more substeps. `system` is as
    before the choice. Raises DesatError as `choose` does.
    """
    parts = coverage.applies(system)
    if choice.reached is None or parts is None:
        return None
    reached_rows = coverage.of_run(parts, results)
    if reached_rows is None:
        return None
    beyond = _beyond(reached_rows, choice.reached)
    is_loose, fires = system.accuracy >= LOOSE, "thrusters" in system.roles
    grown = _grown(choice, reached_rows) if beyond and is_loose and not fires else None
    more = choice if grown is None else grown
    looks = [(k, text, LOOK) for k, text in beyond] if grown is None else []
    if is_loose:
        h, impulse = (results.values(name) for name in parts.series[2:4])
        crossings = _crossings(h, choice.steps, choice.crossed)
        pulses = _pulses(impulse, choice.steps) if fires else []
        looks += [
            (k, f"at t = {reached_rows.times[k]:g} s {text}", CROSSING)
            for k, text in (
                *((k, "a wheel passes zero") for k in crossings),
                *((k, "a thruster fires") for k in pulses),
            )
            if k < len(reached_rows.times)
        ]
    # The second power, not the third, to be safe; the first where pulses end in a step.
    power = 1 if fires else 2
    looks_there = [
        (_there(system, parts.series, results, reached_rows, k, steps), text, steps)
        for k, text, steps in looks
    ]
    if looks_there:
        flying = partial(_look_again, target, options, more, looks_there, power)
        with suppress(ComponentError):  # where the flights have ended their process
            more = _apart(system, options, flying)
    if more == choice:
        return None
    reached = tuple(map(max, more.reached or choice.reached, reached_rows.largest()))
    return replace(more, reached=reached)  # type: ignore[arg-type]


def _look_again(
    target: str,
    options: Options,
    choice: SubstepChoice,
    looks: Sequence[tuple[System, str, int]],
    power: int,
) -> SubstepChoice:
    """Return the choice after flights of systems that begin within the run.

    `looks` has the systems, a text for each and the steps of its flights. One whose
    components fail in a flight is left out. The error of the choice is taken to fall
    with this power of the substeps.
    """
    for system, text, steps in looks:
        try:
            there = _choice_there(target, system, options, choice.substeps, steps)
        except ComponentError:
            continue
        share = (choice.estimate or 0.0) * (choice.substeps / there.substeps) ** power
        again = list(choice.again)
        if there.substeps > choice.substeps:
            again.append(text)
        choice = replace(
            choice,
            substeps=there.substeps,
            estimate=max(share, there.estimate or 0.0),
            again=again,
            flown=choice.flown + there.flown,
            seconds=choice.seconds + there.seconds,
        )
    return choice


def _there(
    system: System,
    series: Sequence[str],
    results: Results,
    reached_rows: Reached,
    row: int,
    steps: int,
) -> System:
    """Return the system as it begins two steps before a row of a run."""
    k = max(0, row - 2)
    state = [results.values(name)[k] for name in series[:3]]
    there = begin_at(system, float(reached_rows.times[k]), state)
    if steps == CROSSING:  # its error is at its largest there, and then decays
        there = replace(
            there, stop=min(there.stop, there.start + CROSSING * there.step)
        )
    return there


def switches(system: System, results: Results) -> dict[str, int]:
    """Count the changes of the momentum manager's recorded modes and flags.

    Those that do not change are left out.
    """
    manager = system.roles.get("manager")
    if manager is None:
        return {}
    counts = {}
    for signal in manager.interface.outputs:
        series = f"{manager.name}.{signal.series}"
        is_discrete = signal.kind == "Boolean" or bool(signal.choices)
        if is_discrete and series in results.names():
            values = np.asarray(results.values(series))
            counts[series] = int(np.count_nonzero(values[1:] != values[:-1]))
    return {name: count for name, count in counts.items() if count}


def decimated(system: System, options: Options) -> Slow | None:
    """Estimate the errors due to components that do not step at every step.

    These are components that pass on means, or feed such components. The errors are
    those of attitude (rad) and of a wheel's momentum (N m s), the largest over the
    first `LONGEST` steps: `ROUGH` times the difference of two flights, one of them
    without these step ratios. None where all components step at every step, or the
    errors cannot be estimated. `system` has its substeps.
    """
    names = system.components
    full_rate = replace(
        system,
        substeps=2,
        components={name: replace(c, step_ratio=1) for name, c in names.items()},
    )
    if options.algorithm == "jacobi" or residual.rigid_body(system) is None:
        return None
    if all(c.step_ratio == 1 for c in names.values()):
        return None
    try:
        every = schedule(full_rate).rates.every
        slow = [n for n, c in names.items() if c.step_ratio > 1 and every[n] == 1]
        if not slow or _foreign(system, options, every):
            return None
        quick = {
            n: replace(c, step_ratio=1) if n in slow else c for n, c in names.items()
        }

        def both() -> list[_SubstepFlight]:
            """Fly with the step ratios, and without those of the slow components."""
            systems = (replace(system, components=of) for of in (names, quick))
            return [_Flights(s, options, 1, LONGEST).fly(system.parts) for s in systems]

        coarse, fine = _apart(system, options, both)
    except (ComponentError, DesatError):
        return None
    # a slow body's states are held between its steps: compare at its own steps only
    rows = slice(None, None, lcm(*(names[n].step_ratio for n in slow)))
    angle, gap = pointing(coarse.q[rows], fine.q[rows]), np.abs(coarse.h - fine.h)[rows]
    return Slow(
        ROUGH * float(np.radians(angle).max()),
        ROUGH * float(gap.max()),
        float(coarse.times[-1]),
        ", ".join(sorted(slow)),
    )


def _choice_there(
    target: str, system: System, options: Options, least: int, steps: int
) -> SubstepChoice:
    """Choose at least so many substeps by flights of so many steps."""
    if steps == CROSSING:
        flights = _Flights(system, options, least, steps)
        if (first := flights.choice_of_first(system.accuracy)) is not None:
            return first
    return _Flights(system, options, least, steps).choice(target)


def _grown(choice: SubstepChoice, reached_rows: Reached) -> SubstepChoice | None:
    """Return the choice with its estimate raised to what a run has reached.

    A substep's error is proportional to how fast the body turns and to how much its
    torques change (`analyses/coverage.py`). None where the raised estimate is not below
    the accuracy.
    """
    if choice.estimate is None or choice.reached is None:
        return None
    estimate = choice.estimate
    for now, seen in zip(reached_rows.largest(), choice.reached, strict=True):
        estimate *= max(1.0, now / max(seen, 1e-15))
    if estimate > choice.accuracy:
        return None
    reached = tuple(map(max, choice.reached, reached_rows.largest()))
    return replace(choice, estimate=estimate, reached=reached)  # type: ignore[arg-type]


def _crossings(h: Array, after: int, seen: Sequence[float] = ()) -> list[int]:
    """Find rows, later than `after`, from which a wheel passes zero (h: N m s).

    At most one of each wheel: the one where its momentum changes fastest, unless the
    wheel was seen to pass zero about as fast (N m s a step).
    """
    rows = []
    for wheel, (row, change) in enumerate(_fastest_crossings(h[after:])):
        if change > GAIN * (seen[wheel] if wheel < len(seen) else 0.0):
            rows.append(after + row)
    return sorted(set(rows))


def _pulses(impulse: Array, after: int) -> list[int]:
    """Find the row, later than `after`, of the first of the strongest pulses.

    `impulse` (n, 3) N m s is the external impulse until each row. The first one, because
    a manager that starts there has no dump under way.
    """
    gained = np.linalg.norm(np.diff(impulse[after:], axis=0), axis=1)
    if len(gained) == 0:
        return []
    return [after + int(np.argmax(gained > 0.5 * gained.max()))]


def _fastest_crossings(h: Array) -> Iterator[tuple[int, float]]:
    """Yield for each wheel the row before its fastest passage through zero.

    With the change of momentum (N m s) in the step; both are 0 where there is none.
    """
    for wheel in h.T:
        passing = np.flatnonzero(wheel[:-1] * wheel[1:] < 0.0)
        changes = np.abs(np.diff(wheel)[passing])
        if len(passing):
            yield int(passing[changes.argmax()]), float(changes.max())
        else:
            yield 0, 0.0


def _beyond(
    reached_rows: Reached, seen: tuple[float, float, float]
) -> list[tuple[int, str]]:
    """Find the rows where a run went furthest beyond its flights, with a text each."""
    rows = []
    looks = (
        ("turns at {:.3g} rad/s", reached_rows.turning),
        ("is accelerated by {:.3g} rad/s2", reached_rows.pushed),
        ("has its acceleration changed by {:.3g} rad/s2", reached_rows.changed),
    )
    for (text, values), most in zip(looks, seen, strict=True):
        k = int(values.argmax()) if len(values) else 0
        if len(values) and values[k] > GAIN * most + 1e-12:
            finding = text.format(float(values[k]))
            rows.append(
                (
                    k,
                    f"at t = {reached_rows.times[k]:g} s the body {finding}, by {most:.3g} at most in "
                    "the flights beforehand",
                )
            )
    return rows


def begin_at(system: System, t: float, state: list[Array]) -> System:
    """Return a system that begins at t (s) with its body in a given state.

    The state is the attitude from eci to body, the rate (rad/s, body) and the wheel
    momenta (N m s).
    """
    parts = residual.rigid_body(system)
    assert parts is not None
    q, omega, h = (x.tolist() for x in state)
    body = system.components[parts.spacecraft]
    wheels = system.components[parts.wheels.partition(".")[0]]
    changes = {"q_start_bi": q, "omega_start_body": omega, "start_frame": [0]}
    changed = {
        body.name: _with(body, changes),
        wheels.name: _with(wheels, {"h_start_wheel": h}),
    }
    return replace(system, start=t, components={**system.components, **changed})


def _with(component: Component, changes: dict[str, list[Scalar]]) -> Component:
    """Return a component with other values of some parameters."""
    values = dict(component.parameters)
    for name, elements in changes.items():
        signals = component.interface.elements.get(name, ())
        values |= {s.name: x for s, x in zip(signals, elements, strict=bool(signals))}
    return replace(component, parameters=values)


def _not_flown(system: System, options: Options) -> str:
    """Return the reason why a system makes one substep without flights, else ""."""
    if options.algorithm == "jacobi":
        return "jacobi takes no substeps"
    if residual.rigid_body(system) is None:
        return "there is no rigid body with wheels to judge by"
    try:
        every = schedule(replace(system, substeps=2)).rates.every
    except DesatError as error:
        return str(error).splitlines()[0]
    return _foreign(system, options, every)


def _foreign(system: System, options: Options, every: Mapping[str, int]) -> str:
    """Return the reason why foreign FMUs are not flown beforehand, else "".

    `every` is as in `Rates`.
    """
    for name in sorted(to_isolate(system, replace(options, isolate="foreign"))):
        component = system.components[name]
        assert component.fmu is not None
        if name not in isolated_in(system, options):
            return f"{name} is a foreign FMU without a process of its own: it is not run twice"
        of = component.fmu.description.coSimulation
        if every[name] == 1 and not of.canHandleVariableCommunicationStepSize:
            return (
                f"{name}: {component.fmu.path.name} takes steps of one length only "
                "(canHandleVariableCommunicationStepSize)"
            )
    return ""


@dataclass(frozen=True)
class _SubstepFlight:
    """States after each step of a flight.

    These are times (n,; s), attitude (n, 4), rate (n, 3; rad/s), momenta of the wheels
    (n, k; N m s) and external impulse (n, 3; N m s, eci).
    """

    times: Array
    q: Array
    omega: Array
    h: Array
    impulse: Array


class _Flights:
    """Flights of a system with more and more substeps.

    They begin with `least` substeps and have at most `longest` steps.
    """

    def __init__(
        self,
        system: System,
        options: Options,
        least: int,
        longest: int,
        for_others: bool = False,
    ) -> None:
        """Prepare flights of a system from `least` substeps on, of at most `longest` steps."""
        self._for_others = for_others
        self._system, self._options, self._longest = (
            _on_natives(system),
            options,
            longest,
        )
        most = MOST_LOOSE if system.accuracy >= LOOSE else LEVELS[-1]
        self._levels = [n for n in LEVELS if least <= n <= max(most, least)]
        parts, body = coverage.applies(system), body_of(system)
        assert parts is not None
        assert body is not None
        self._series: list[str] = parts.series
        self._body: WheeledBody = body
        self._longest_error: Array | None = None
        # estimated error (rad) of the first count within its flight
        self.first_error = inf
        self._steps = 0

    def choice_of_first(self, limit: float) -> SubstepChoice | None:
        """Return the choice of the first count, if its error is below `limit` (rad).

        No third flight confirms the estimate, which is larger for that.
        """
        began, n = time.process_time(), self._levels[0]
        coarse = self.fly(n)
        estimate, error = self._estimate(coarse, self.fly(2 * n))
        estimate *= UNCONFIRMED
        self.first_error = UNCONFIRMED * FACTOR * float(error[-1])
        if estimate > limit:
            return None
        return self._chosen(n, {n: estimate}, coarse, len(error), began)

    def choice(self, target: str) -> SubstepChoice:
        """Find the first count that is accurate enough.

        Raises DesatError, with the reason, where there is none.
        """
        tried: dict[int, float] = {}
        began = time.process_time()
        coarse = self.fly(self._levels[0])
        for n in self._levels:
            fine = self.fly(2 * n)
            tried[n], error = self._estimate(coarse, fine)
            far = min(max(FAR * n, LEAST_FAR), FARTHEST)
            if tried[n] <= self._system.accuracy and far > 2 * n:
                sure, seen_far = self._estimate(coarse, self.fly(far, FREE // 3))
                short = len(seen_far) < len(error)
                tried[n] = max(tried[n], sure) if short else sure
            if tried[n] <= self._system.accuracy:
                return self._chosen(n, tried, coarse, len(error), began)
            coarse = fine
        if self._system.accuracy >= LOOSE:
            reason = self._reason(tried, error)
            count = max(FALLBACK, self._levels[0])
            return SubstepChoice(
                count, self._system.accuracy, tried[count], reason, tried=tried
            )
        raise DesatError(
            f"{target}: substeps = auto: {self._reason(tried, error)}; take a larger "
            "--accuracy, or a shorter --step"
        )

    def _chosen(
        self,
        n: int,
        tried: dict[int, float],
        flight: _SubstepFlight,
        rows: int,
        began: float,
    ) -> SubstepChoice:
        """Return the choice of n substeps by a flight of so many rows."""
        seen = None
        crossed: tuple[float, ...] = ()
        if self._system.accuracy >= LOOSE:
            crossed = tuple(x for _, x in _fastest_crossings(flight.h[:rows]))
        if rows <= self._system.steps or self._for_others:
            seen = reached_by(
                self._body, *(x[:rows] for x in astuple(flight))
            ).largest()
        return SubstepChoice(
            n,
            self._system.accuracy,
            tried[n],
            steps=rows - 1,
            tried=tried,
            reached=seen,
            crossed=crossed,
            flown=self._steps,
            seconds=time.process_time() - began,
        )

    def fly(self, substeps: int, free: int = FREE) -> _SubstepFlight:
        """Fly with this number of substeps, as long as `free` substeps last."""
        steps = min(self._system.steps, max(8, min(free // substeps, self._longest)))
        self._steps += steps * substeps
        system = replace(self._system, substeps=substeps)
        columns = {tuple(name.rsplit(".", 1)) for name in self._series}
        master = Master(
            system,
            schedule(system, self._options.breaks_loops),
            watched=lambda c, s: (c, s.series) in columns,
            isolated=isolated_in(system, self._options),
            limit=self._options.call_limit,
        )
        with master:
            master.initialise()
            recorder = Recorder(None, master, self._series)
            if self._options.algorithm == "jacobi":
                recorder.record(0, master.live)
            loop = stepping(master, recorder, NEVER, self._options.loop)
            while master.k < steps:
                loop.some(steps - master.k)
            master.terminate()
            results = recorder.finish(master)
        times = system.start + system.step * np.arange(steps + 1)
        return _SubstepFlight(times, *(results.values(name) for name in self._series))

    def _estimate(
        self, coarse: _SubstepFlight, fine: _SubstepFlight
    ) -> tuple[float, Array]:
        """Estimate a flight's error (rad) at the run's end, by one with more substeps.

        The second value is the largest difference up to each of the rows that both have
        (rad).
        """
        many = min(len(coarse.q), len(fine.q))
        differences = np.radians(pointing(coarse.q[:many], fine.q[:many]))
        error = np.maximum.accumulate(differences)
        if self._system.accuracy >= LOOSE:
            return FACTOR * self._carried_by_trend(differences), error
        if self._longest_error is None or many == self._system.steps + 1:
            self._longest_error = error
        return FACTOR * self._carried(error, self._longest_error), error

    def _carried_by_trend(self, differences: Array) -> float:
        """Extrapolate the largest of a flight's differences (rad) to the run's end.

        With the power of time by which their median has grown from the first half of
        the flight to the second. A controller holds it where it is, and a single event,
        as a wheel's passage through zero, is no trend.
        """
        largest, last = float(differences.max()), len(differences) - 1
        if last >= self._system.steps or largest == 0.0:
            return largest
        half = len(differences) // 2
        first, second = (
            float(np.median(x)) for x in (differences[1:half], differences[half:])
        )
        power = log2(second / first) if min(first, second) > 0.0 else 0.0
        growth = (self._system.steps / last) ** min(max(power, 0.0), STEEPEST)
        return float(BY_TREND * largest * growth)

    def _carried(self, error: Array, error_so_far: Array) -> float:
        """Extrapolate the largest error of a flight to the end of the run (rad)."""
        here, steps = float(error[-1]), self._system.steps
        if len(error) == steps + 1 or here == 0.0:
            return here
        if len(error_so_far) > len(error):
            here *= float(error_so_far[-1]) / max(
                float(error_so_far[len(error) - 1]), 1e-300
            )
            error = error_so_far
        here *= CARRIED
        if (last := len(error) - 1) == steps:
            return here
        half = float(error[last // 2])
        power = log2(float(error[-1]) / half) if half > 0.0 else STEEPEST
        return float(here * (steps / last) ** min(max(power, 0.0), STEEPEST))

    def _reason(self, tried: dict[int, float], error: Array) -> str:
        """Explain why no count was accurate enough."""
        last = max(tried)
        text = (
            f"with {last} substeps, of {MOST_SUBSTEPS} at most, the attitude would still err "
            f"by {tried[last]:.2e} rad, accuracy is {self._system.accuracy:g} rad"
        )
        risen = float(error[-1]) / max(float(error[len(error) // 2]), 1e-15)
        if not isfinite(tried[last]):
            return f"{text}: its states are not finite"
        if risen > 100.0:
            return f"{text}: the motion amplifies any error, {risen:.0e} times in its second half"
        ratios = [a / b for a, b in pairwise(list(tried.values())[-4:]) if b > 0.0]
        bound = coverage.bound(
            replace(self._system, substeps=last)
        ) or coverage.StepCriteria(0.0, 0.0)
        return (
            f"{text}; twice the substeps divide that by {min(ratios, default=inf):.2g} only "
            f"(in one: turn {bound.turn:.2g} rad, kick {bound.kick:.2g} rad)"
        )


def _on_natives(system: System) -> System:
    """Return the system on native FMUs, which give the same bits.

    They replace Python FMUs and bare blocks of ours.
    """
    components = {}
    for name, c in system.components.items():
        fmu = (
            library.of_ours(c.source)
            if c.fmu is None
            else library.of_kind(c.fmu, "native")
        )
        components[name] = replace(c, fmu=fmu)
    return replace(system, components=components)
