"""Monitor a rigid body from outside: check the balance of its energy and its impulse.

The kinetic energy of the body without the wheels' axial part, E = 1/2 omega . J_r
omega, changes by

    dE/dt = P = omega . (tau_ext - A tau_wheel)

(the wheels' own energy, h^2 / 2 J_s, changes by tau_wheel . h / J_s, which the momentum
of each wheel fulfils by itself; the sum of both is tau_ext . omega + tau_wheel .
Omega). The integrals of work and of impulse are taken over each of the body's own
steps: from the rows if these hold every step, otherwise while the body runs
(`OnlineBalance`). Between the ends of a step `motion.py` computes the body and the
external torque from the body's inputs, exactly except for terms of order 6 in nutation
times step. Where that torque is not known, its mean from the body's own impulse serves
for the work, which then errs by order 2 where the torque changes within a step.

The remainder of the energy is what the integrator adds or removes. The remainder of the
impulse is a torque that the body has computed differently.

Neither detects what the exchange leaves out, because both compare the body with the
torques that it received. The hidden work estimates this. The change dE less Simpson's
rule for P, from the two ends of a step and its middle, measures the bend of P within
the step, and is of order 5 in its length. The curvature of the motors' torque that mean
and slope do not carry is of the same order, and the attitude error follows it:

    hidden work = max over steps of  dt^2 |dE - dt/6 (P_0 + 4 P_1/2 + P_1)| / (tr J_r / 3)

in units of the energy that a turn of 1 rad in the step would take. It does not grow
with the length of a run, and is the same for a craft whose inertia scales with its
torques, or whose motion is as much slower as its steps are longer. The page of
`ssp/gyrostat` shows what it distinguishes.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..engine.master import Master
from ..engine.node import StepRecording
from ..numbers.derived import rotate, rotate_back
from ..numbers.shapes import shape_of
from ..numbers.text import Value
from ..system.expression import Table
from ..system.interface import Signal
from ..system.model import Component, System
from ..system.schedule import graded
from ..system.typed import JsonObject
from ..system.wheels import axes_of
from . import motion, not_checked, residual
from .manifest import Manifest
from .motion import NODES, WEIGHTS, Array, Steps

if TYPE_CHECKING:
    from ..engine.recording.results import Results
    from ..figures.canvas import Figure


KEY = "energy"
# default of impulse_bound: impulse mismatch as a share of the largest momentum
BOUND = 1e-6
ENERGY_BOUND = 2e-8  # default of energy_bound: limit of the hidden work
NUMBERS = ("energy_mismatch", "hidden_work", "impulse_mismatch")
BOUND_KEYS = ("impulse_bound", "energy_bound")
# steps that are computed at once, so that intermediate results fit the cache
BLOCK = 8192
PAIR = ("tau_mean_wheel", "tau_slope_wheel")
# J: output by which a spacecraft declares its energy without the wheels'
DECLARED = "energy"


@dataclass(frozen=True)
class EnergyParts(residual.RigidBodyParts):
    """Parts of the momentum residual, and the sources of the wheels' torques."""

    tau_mean_wheel: str | None = None
    tau_slope_wheel: str | None = None
    feeds: motion.Feeds | None = None
    # Whether a row holds one step of the body and all its inputs; None: an older run,
    # where the number of substeps decides.
    rows: bool | None = None
    why: str = ""  # reason why there is no balance
    # series of the energy that a body which is not ours declares
    declared: str | None = None

    @property
    def pair(self) -> list[str]:
        """Return the series of the torques' means and slopes."""
        return [x for x in (self.tau_mean_wheel, self.tau_slope_wheel) if x is not None]


PARTS = EnergyParts


def applies(system: System) -> EnergyParts | None:
    """Find the parts of the balance, as for the momentum residual, or None.

    A body that is not ours may have moving parts: its energy is that of an output
    `energy` (J), if it has one.
    """
    parts = residual.rigid_body(system)
    if parts is None:
        return None
    body = system.components[parts.spacecraft]
    if body.model != residual.BLOCK:
        reason = f"{body.name} is no {residual.BLOCK} of ours: its energy and torques are not known"
        declared = (
            f"{body.name}.{DECLARED}" if DECLARED in body.interface.signals else None
        )
        mean = _mean_torque(system, body)
        return EnergyParts(
            parts.spacecraft,
            parts.wheels,
            tau_mean_wheel=mean,
            rows=True,
            why=reason,
            declared=declared if mean else None,
        )
    wheels = system.components[parts.wheels.partition(".")[0]]
    pair: dict[str, str] = {}
    rows, reason = system.parts == 1 and body.step_ratio == 1, ""
    for name in PAIR:
        feeds = [
            c
            for c in system.connections
            if c.target == body.name and c.input_array == name
        ]
        series = {f"{c.source}.{c.output.partition('[')[0]}" for c in feeds}
        if len(series) != 1 or len(feeds) != len(body.interface.elements.get(name, ())):
            reason = reason or f"{body.name}.{name} does not come from one component"
            continue
        pair[name] = series.pop()
        same = all((c.factor, c.offset) == (1.0, 0.0) for c in feeds)
        rows = rows and same and system.components[feeds[0].source].step_ratio == 1
    if body.step_ratio % wheels.step_ratio:
        reason = (
            reason
            or f"{wheels.name} is slower than {body.name}: its momentum is not known there"
        )
    fed = motion.feeds(system, body.name)
    rows = rows and (fed is not None or not motion.is_known_body(system, body.name))
    return EnergyParts(
        parts.spacecraft, parts.wheels, **pair, feeds=fed, rows=rows, why=reason
    )


def _mean_torque(system: System, body: Component) -> str | None:
    """Return the series of the wheels' mean torque on a body, or None without one."""
    feeds = [
        c
        for c in system.connections
        if c.target == body.name and c.input_array == PAIR[0]
    ]
    series = {f"{c.source}.{c.output_array}" for c in feeds}
    return series.pop() if len(series) == 1 else None


def warnings(system: System) -> list[str]:
    """Return a line for each reason why runs of a system have no balance."""
    parts = applies(system)
    if parts is None:
        return []
    if parts.why:
        names = NUMBERS[1:] if parts.declared else NUMBERS
        return not_checked(dict.fromkeys(names, parts.why))
    if motion.is_known_body(system, parts.spacecraft):
        return []
    return not_checked({"impulse_mismatch": _foreign(parts)})


def _foreign(parts: EnergyParts) -> str:
    """Return the reason why the torques on a body are not known."""
    return (
        f"what torques act on {parts.spacecraft} is known of our {motion.BLOCK} alone"
    )


def blocks_of(manifest: Manifest, results: Results) -> Iterator[Steps]:
    """Yield the steps of a run, a block at a time.

    Yields nothing where the rows do not hold every step: `_not_of_rows`.
    """
    parts: EnergyParts | None = manifest.parts.get(KEY)
    if parts is None or _not_of_rows(manifest, results):
        return
    parameters, states, pair = (
        manifest.parameters[parts.spacecraft],
        residual.body_series(parts),
        parts.pair,
    )
    n = min(results.count(pair[0]), results.count(states[0]) - 1)
    carrier, axes = residual.carrier_of(parameters)
    dt = manifest.step
    for first in range(0, n, BLOCK):
        rows = slice(first, min(first + BLOCK, n))
        ends = slice(first, rows.stop + 1)
        q, omega, impulse, h = (results.values(s, ends) for s in states)
        mean, slope = (results.values(s, rows) for s in pair)
        reach = parts.feeds and motion.recorded_inputs(results, parts.feeds, rows)
        torque = reach and motion.torque(parameters, reach, dt)
        yield Steps(
            dt, carrier, axes, q, omega, impulse, h, mean, slope, torque or None
        )


def _not_of_rows(manifest: Manifest, results: Results) -> str:
    """Return the reason why the rows of a run do not hold its steps, else ""."""
    parts: EnergyParts = manifest.parts[KEY]
    if manifest.algorithm != "gauss_seidel":
        return f"under {manifest.algorithm} torques act a step late"
    if parts.why:
        return parts.why
    if lacking := residual.missing(of_work(parts), results):
        return lacking
    states, pair = residual.body_series(parts), parts.pair
    if min(results.count(pair[0]), results.count(states[0]) - 1) < 1:
        return "there is no whole step"
    times = results.times(states[0])
    rows = manifest.substeps == 1 if parts.rows is None else parts.rows
    if not rows or abs(times[1] - times[0] - manifest.step) > 1e-9 * manifest.step:
        return "its rows do not have each step of the body, and it ended before it could say more"
    return ""


class Block(NamedTuple):
    """Integrals over a number of steps.

    These are the energy (J) at the ends of the steps (steps + 1,), and in each step the
    work (J) and impulse (N m s, eci) of the torques, and the hidden work.
    """

    energy: Array
    work: Array
    impulse: Array
    hidden: Array


def sums(steps: Steps) -> Block:
    """Integrate work and impulse over each step, and compute the hidden work."""
    dt = np.broadcast_to(np.reshape(steps.dt, (-1, 1)), (len(steps.mean), 1))
    ends = sum(
        (omega * (torque - steps.motors(e))).sum(axis=1)
        for e, omega, torque in zip(
            (0.0, 1.0), (steps.omega[:-1], steps.omega[1:]), steps.ends, strict=True
        )
    )
    work, turned = WEIGHTS[0] * ends, WEIGHTS[0] * (steps.turned[0] + steps.turned[1])
    simpson = ends / 6.0
    for e, weight in zip(NODES[1:-1], WEIGHTS[1:-1], strict=True):
        q = steps.attitude(e)
        torque = steps.torque(e, q)
        power = (steps.rate(e, q) * (torque - steps.motors(e))).sum(axis=1)
        work = work + weight * power
        turned = turned + weight * rotate_back(q, torque)
        simpson = simpson + 2.0 / 3.0 * power if e == 0.5 else simpson
    energy = 0.5 * np.einsum("ij,jk,ik->i", steps.omega, steps.carrier, steps.omega)
    hidden = np.abs(np.diff(energy) - dt[:, 0] * simpson)
    hidden *= dt[:, 0] ** 2 / (np.trace(steps.carrier) / 3.0)
    return Block(energy, dt[:, 0] * work, dt * turned, hidden)


@dataclass
class Totals:
    """Totals of a run, summed up block by block; all of it can be written as JSON.

    Energies and work are in J, impulses in N m s, eci.
    """

    start: float | None = None
    work: float = 0.0
    given: tuple[float, ...] = (0.0, 0.0, 0.0)
    began: tuple[float, ...] = (0.0, 0.0, 0.0)  # the body's own impulse at the start
    energy: float = 0.0  # J, the largest; the fields below are largest values, too
    worked: float = 0.0
    mismatch: float = 0.0
    hidden: float = 0.0
    impulse: float | None = None  # None: the external torque is not known

    def add(self, steps: Steps) -> tuple[Array, Array]:
        """Add further steps; return the energy mismatch and energy at each end (J)."""
        block = sums(steps)
        if self.start is None:
            self.start = self.energy = float(block.energy[0])
            self.began = tuple(steps.impulse[0].tolist())
            self.impulse = None if steps.outer is None else 0.0
        work = np.cumsum([self.work, *block.work])[1:]
        impulses = np.cumsum([self.given, *block.impulse], axis=0)[1:]
        mismatch = block.energy[1:] - self.start - work
        self.work, self.given = float(work[-1]), tuple(impulses[-1].tolist())
        self.energy = max(self.energy, float(block.energy.max()))
        self.worked = max(self.worked, float(np.abs(work).max()))
        self.mismatch = max(self.mismatch, float(np.abs(mismatch).max()))
        self.hidden = max(self.hidden, float(block.hidden.max()))
        if self.impulse is not None:
            off = np.linalg.norm(steps.impulse[1:] - self.began - impulses, axis=1)
            self.impulse = max(self.impulse, float(off.max()))
        return mismatch, block.energy[1:]


class EnergyBalance(NamedTuple):
    """Balance of a run: totals, and energy beyond the work (n, 1; J) at times (s).

    These are as a plot shows them, and stand for so many rows.
    """

    totals: Totals
    times: Array
    mismatch: Array
    rows: int


def balance(manifest: Manifest, results: Results) -> EnergyBalance | None:
    """Compute the energy balance of a run from its rows, once.

    None as for `blocks_of`.
    """
    return results.once(KEY, lambda: _balance(manifest, results))


def _balance(manifest: Manifest, results: Results) -> EnergyBalance | None:
    """Compute the energy balance of a run from its rows.

    The mismatch is energy (J) less the work of all torques since the start.
    """
    totals, mismatch = Totals(), [np.zeros(1)]
    for steps in blocks_of(manifest, results):
        mismatch.append(totals.add(steps)[0])
    if totals.start is None:
        return None
    rows = np.concatenate(mismatch)
    times = manifest.start + manifest.step * np.arange(len(rows), dtype=np.float64)
    return EnergyBalance(totals, *shape_of(times, rows.__getitem__))


def totals_of(manifest: Manifest, results: Results) -> Totals | None:
    """Return the totals of a run, or None where there are none.

    They are those that were computed while it ran, or else follow from its rows.
    """
    if totals := manifest.balance:
        return Totals(**totals)
    computed = balance(manifest, results)
    return computed and computed.totals


def of_work(parts: EnergyParts) -> list[str]:
    """Return the series that the work, and so any balance, needs."""
    return [*residual.body_series(parts), *parts.pair]


def balanced(parts: EnergyParts) -> list[str]:
    """Return the series that the balance is computed from."""
    if parts.declared and parts.tau_mean_wheel:
        series = [f"{parts.spacecraft}.{n}" for n in _STATES]
        return [parts.declared, *series, parts.tau_mean_wheel]
    if parts.why:
        return residual.body_series(parts)
    feeds = parts.feeds or {}
    outer = [x for x in feeds.values() if isinstance(x, str)]
    return [*of_work(parts), *outer]


def numbers(manifest: Manifest, results: Results) -> dict[str, Value]:
    """Compute the energy mismatch, the hidden work and the impulse mismatch (N m s).

    Each is the largest of the run. The energy mismatch is a share of the largest energy
    of the body, or of the largest work on it.
    """
    parts: EnergyParts | None = manifest.parts.get(KEY)
    if parts is not None and parts.declared:
        return _declared_numbers(parts, manifest, results)
    totals = totals_of(manifest, results)
    if totals is None:
        return {}
    rows: dict[str, Value] = {}
    if (scale := max(totals.energy, totals.worked)) > 0.0:
        rows["energy_mismatch"] = Value(
            "Largest energy mismatch",
            totals.mismatch / scale,
            "1",
            "relative to the body's largest energy or work",
        )
    rows["hidden_work"] = Value(
        "Largest unresolved work within a step",
        totals.hidden,
        "1",
        "relative to the energy of a turn of 1 rad in it",
    )
    if totals.impulse is not None:
        title = (
            "Largest difference of the external impulse from one computed independently"
        )
        rows["impulse_mismatch"] = Value(title, totals.impulse, "N.m.s")
    return rows


def _declared_numbers(
    parts: EnergyParts, manifest: Manifest, results: Results
) -> dict[str, Value]:
    """Compute the energy mismatch of a body that declares its energy.

    The work is that of the mean external torque, by the body's own impulse, and of the
    wheels' mean torque, by the trapezoidal rule: it errs by order 2 in the step.
    """
    series = [
        parts.declared,
        *(f"{parts.spacecraft}.{n}" for n in _STATES),
        parts.tau_mean_wheel,
    ]
    names = [name for name in series if name is not None]
    if residual.missing(names, results):
        return {}
    energy, q, omega, impulse, mean = (results.values(name) for name in names)
    steps = min(len(mean), len(omega) - 1)
    if steps < 1:
        return {}
    axes = axes_of(manifest.values_of(parts.spacecraft))
    gained = np.diff(impulse[: steps + 1], axis=0)
    taken = manifest.step * mean[:steps] @ axes.T
    ends = (
        (omega[k : steps + k] * (rotate(q[k : steps + k], gained) - taken)).sum(axis=1)
        for k in (0, 1)
    )
    work = np.concatenate([[0.0], np.cumsum(0.5 * np.sum(list(ends), axis=0))])
    values = np.ravel(energy)[: steps + 1]
    largest = float(max(np.abs(values).max(), np.abs(work).max()))
    if largest == 0.0:
        return {}
    mismatch = float(np.abs(values - values[0] - work).max()) / largest
    return {
        "energy_mismatch": Value(
            "Largest energy mismatch",
            mismatch,
            "1",
            "relative to the body's largest energy or work",
        )
    }


def unchecked(manifest: Manifest, results: Results) -> dict[str, str]:
    """Return the reason why there is no balance, by the names of the numbers."""
    parts: EnergyParts = manifest.parts[KEY]
    if parts.declared:
        return dict.fromkeys(NUMBERS[1:], parts.why)
    totals = totals_of(manifest, results)
    if totals is None:
        reason = _not_of_rows(manifest, results)
        return dict.fromkeys(NUMBERS, reason)
    if totals.impulse is not None:
        return {}
    lacking = parts.feeds and residual.missing(balanced(parts), results)
    return {"impulse_mismatch": lacking or _foreign(parts)}


def unmet(manifest: Manifest, results: Results) -> list[str]:
    """Return a line for each bound of the balance that a run exceeds.

    The external impulse has to be that of the torques from outside the body, and a step
    must not hide too much work.
    """
    numbers, lines = manifest.numbers, []
    bound = manifest.about.get("energy_bound", ENERGY_BOUND)
    hidden = numbers["hidden_work"].value if "hidden_work" in numbers else None
    if hidden is not None and hidden > bound:
        lines.append(
            f"hidden_work = {hidden:.2g}: above energy_bound = {bound:g}: "
            "the torques vary too much within a step for their mean and slope: use more substeps "
            "(--substeps)"
        )
    mismatch = numbers.get("impulse_mismatch")
    series = residual.momentum(manifest, results)
    if mismatch is not None and series is not None:
        bound = manifest.about.get("impulse_bound", BOUND)
        lines += residual.beyond(
            "impulse_mismatch", mismatch, "impulse_bound", bound, series.largest
        )
    return lines


def figures(manifest: Manifest, results: Results) -> list[tuple[str, Figure]]:
    """Draw the energy mismatch over time."""
    balanced = balance(manifest, results)
    if balanced is None:
        return []
    from ..figures.plots import timeline  # slow import, needed for a report only
    from ..figures.style import COLOURS, SMALL_HEIGHT, figure, time_axis

    fig, ax = figure(SMALL_HEIGHT)
    seconds, unit = time_axis(balanced.times)
    x, y = balanced.times / seconds, balanced.mismatch[:, 0]
    ax.plot(x, y, COLOURS[0], name="mismatch", rows=balanced.rows)
    timeline(ax, seconds, unit)
    ax.y.label = "energy mismatch [J]"
    caption = "Energy mismatch: energy gained beyond the work of the torques"
    return [(caption, fig)]


# --- Balances during a run ------------------------------------------------------------
# They serve where the rows do not hold every step of the body: with substeps, step
# ratios or decimated rows.
#
# The balances need the inputs of the body at each of its own steps. `engine/node.py`
# keeps them for some thousands of steps at a time, so that memory does not grow with
# the length of a run.


_STATES = ("q_bi", "omega_bi_body", "impulse_eci")


class OnlineBalance:
    """Balances of a system's rigid body during a run.

    `parts` are as `applies` returns them, `parameters` as a manifest has them.
    """

    def __init__(self, system: System, parts: EnergyParts, parameters: Table) -> None:
        """Choose the states that a balance needs at each substep of a run."""
        assert isinstance(system.substeps, int), "it is chosen when a run begins"
        self._step, self._inner = system.step, system.substeps
        self._parameters = parameters[parts.spacecraft]
        self._body = system.components[parts.spacecraft]
        self._carrier, self._axes = residual.carrier_of(self._parameters)
        wheels, _, momentum = parts.wheels.partition(".")
        names = [(self._body.name, n) for n in _STATES] + [(wheels, momentum)]
        outputs = [
            (owner, s.name)
            for owner, n in names
            for s in system.components[owner].interface.elements.get(n, ())
        ]
        self.recorded = StepRecording(self._body.name, outputs)
        self._known = motion.is_known_body(system, self._body.name)
        self._totals, self._steps = Totals(), 0

    def needs(self, component: str, signal: Signal) -> bool:
        """Return whether an output must be read."""
        return (component, signal.name) in self.recorded.outputs

    @property
    def steps_before_look(self) -> int:
        """Return the number of master steps that may be made before the next `look`."""
        return self.recorded.steps_before_look

    def look(self) -> None:
        """Add the steps that were made, as far as they fill a piece."""
        while piece := self.recorded.take():
            self._add(*piece)

    def _add(self, starts: Array, inputs: Array) -> None:
        """Add steps from the body's states at their starts and its inputs."""
        q, omega, impulse, h = np.split(starts, (4, 7, 10), axis=1)
        x = self._inputs(inputs)
        dt = self._lengths(len(inputs))
        mean, slope = (x[name] for name in PAIR)
        torque = motion.torque(self._parameters, x, dt) if self._known else None
        self._totals.add(
            Steps(
                dt, self._carrier, self._axes, q, omega, impulse, h, mean, slope, torque
            )
        )
        self._steps += len(inputs)

    def _inputs(self, rows: Array) -> dict[str, Array]:
        """Return the body's inputs, (steps, elements) each.

        Those that the steps do not record are constant.
        """
        columns = {name: i for i, name in enumerate(self.recorded.inputs)}
        inputs: dict[str, Array] = {}
        for name in dict.fromkeys(s.array for s in self._body.interface.inputs):
            elements = [s.name for s in self._body.interface.elements.get(name, ())]
            if self._body.interface.signals[elements[0]].kind != "Real":
                continue
            columns_of_it = [
                rows[:, columns[e]]
                if e in columns
                else np.full(len(rows), self._body.values[e], float)
                for e in elements
            ]
            inputs[name] = np.column_stack(columns_of_it)
        return inputs

    def _lengths(self, n: int) -> Array:
        """Compute the lengths (n, 1) s of the next n steps of the body."""
        step, substeps = self._step, self._inner
        if self.recorded.every > 1 or substeps == 1:
            return np.full((n, 1), step * self.recorded.every / substeps)
        parts = np.array([w * step for _, w in graded(substeps)])
        return parts[(self._steps + np.arange(n)) % substeps][:, None]

    def finish(self, master: Master, failed: bool) -> JsonObject | None:
        """Return the totals at the end of a run, or None if the body made no step.

        The run `failed` within a step, or ended after one.
        """
        if not failed:
            self.recorded.end(master.k)
        self.look()
        if rest := self.recorded.take(rest=True):
            self._add(*rest)
        return None if self._totals.start is None else asdict(self._totals)

    def state(self) -> JsonObject:
        """Return as JSON the state that the continuation depends on, besides `recorded`."""
        return {"totals": asdict(self._totals), "steps": self._steps}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Continue from a saved state."""
        self._totals, self._steps = Totals(**state["totals"]), state["steps"]
