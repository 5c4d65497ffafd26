"""Take the law of a manager for the momentum-only model, from the manager's own block.

Where a law is a function of time and momentum alone, and affine in it, M = K(t) h +
c(t), its block gives K and c: it is sampled with the wheels' momentum at its target,
and beyond that by a momentum along each axis. No law is written down here, so a user's
own law serves as well. Any other law has no model (`UnsuitedError`) and can be judged
in the closed loop alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import pi
from typing import Any

import numpy as np
from numpy.typing import NDArray

from desat.components.bases.dumping import MomentumDumping, TorquerDumping
from desat.components.bases.momentum_management import MomentumManagement
from desat.components.contract.block import Block, BlockError, Vec3
from desat.components.maths.attitude import rotate
from desat.components.maths.vector import ZERO
from desat.components.physics.wheel_array import (
    body_momentum,
    pseudo_inverse,
    to_wheels,
)

from ..analyses.flight import TURN_ROWS, Flight, native_of
from ..engine.instances.fmu import rows_of
from ..system.model import Component
from .compatibility import law_name

Array = NDArray[Any]
ENDLESS = 1e30  # A m2: dipole limit that no law reaches
PROBES = 24  # samples from which the rate of a law is found
CHECKED = 100  # rows from one test of a law for memory and being affine to the next
UNITS: tuple[Vec3, Vec3, Vec3] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
Samples = tuple[list[float], dict[str, Array]]  # times (s), and inputs by name
OTHER: Vec3 = (0.6, -0.3, 0.8)  # N m s: momentum at which an affine law is tested
PROBED, MOMENTA = (*UNITS, ZERO), (*UNITS, OTHER, ZERO)
HEAD = 24  # rows in which a native FMU must give the bits of its block
AFFINE = 1e-9  # share of the largest dipole by which an affine law may miss another
VALID = {"enable", "valid_b", "valid_q", "valid_omega", "valid_h"}
STEP = 10.0  # s: samples of a slow law that are closer are combined
OTHERS_STEP = 40.0  # s: the same for laws that are compared with the craft's own
SLOW = 0.1  # maximum share of the momentum removed between two samples of the model


class UnsuitedError(Exception):
    """A manager whose law the model does not have; the text gives the reason."""


@dataclass(frozen=True)
class Law:
    """A law of momentum and time alone."""

    name: str
    block: MomentumDumping
    sample_time: float  # s; 0: at every step
    deadband: float  # N m s: no dipole up to this momentum beyond the target
    target: Array  # (3,) N m s, body
    # `each`: each body axis by itself; `whole`: the dipole in its own direction; `none`
    limit: str


@dataclass(frozen=True)
class LinearisedLaw:
    """A law at the rows of a flight: M = K (h - target) + c (A m2, body).

    h (N m s, body) is the momentum of the wheels.
    """

    gain: Array  # K (rows, 3, 3) 1/(T s)
    offset: Array  # c (rows, 3) A m2


def law_of(component: Component) -> Law:
    """Return the law of a manager with its parameters.

    Raises
    ------
    UnsuitedError
        If the model does not have it.
    """
    if component.block is None:
        raise UnsuitedError("it is no block of ours")
    values = {
        s.reference: component.values[s.name]
        for s in component.interface.signals.values()
        if s.causality == "parameter"
    }
    block = component.block()
    for reference, value in values.items():
        block.access([reference]).write([value])
    target = [component.values[f"h_target_body[{i}]"] for i in (1, 2, 3)]
    return law_by(block, law_name(component), np.array(target, float))


def law_by(block: Block, name: str, target: Array) -> Law:
    """Return the law of a block whose parameters are set.

    Raises
    ------
    UnsuitedError
        If the model does not have it.
    """
    if isinstance(block, TorquerDumping):
        limit = "each" if block.saturation else "none"
        block.saturation = False
    elif isinstance(block, MomentumManagement):
        limit, block.m_limit = "whole", ENDLESS
    else:
        raise UnsuitedError("it is no law of the momentum alone by coils alone")
    deadband = getattr(block, "h_deadband", 0.0)
    if deadband:
        vars(block)["h_deadband"] = 0.0
    vars(block).update(dict.fromkeys(VALID, True))
    return Law(name, block, block.sample_time, deadband, target, limit)


def ask(law: Law, flight: Flight, rows: Array) -> LinearisedLaw:
    """Evaluate K and c of a law at rows of a flight.

    Raises
    ------
    UnsuitedError
        If the block cannot start, or the law has memory or is not affine in the
        momentum.
    BlockError
        If the block refuses a sample.
    """
    try:
        law.block.start()
    except BlockError as error:
        raise UnsuitedError(str(error)) from error
    samples = _samples(law, flight, rows)
    dipoles = _ask_at_once(law, samples)
    if dipoles is None:
        dipoles = _ask_native(law, samples)
    if dipoles is None:
        dipoles = _ask_one_by_one(law, samples, PROBED)
    offset = dipoles[:, 3]
    gain = (dipoles[:, :3] - offset[:, None]).transpose(0, 2, 1)
    return LinearisedLaw(np.ascontiguousarray(gain), offset)


class _LawRows(np.ndarray):
    """Values of all rows, whose comparisons must come out alike in all of them."""

    def __bool__(self) -> bool:
        plain = self.view(np.ndarray)
        if plain.all():
            return True
        if plain.any():
            raise ValueError("rows take different branches")
        return False


def _ask_at_once(law: Law, samples: Samples) -> Array | None:
    """Return the dipoles (rows, 4, 3) at UNITS and ZERO, all rows in one call each.

    The block's own code runs on arrays. None where that is not possible: the law keeps
    something from sample to sample, its rows take different branches, or it calls a
    function of single numbers.
    """
    times, inputs = samples
    state = vars(law.block)
    before = dict(state)
    variable_names = {v.name for v in law.block.variables}
    try:
        state.update(_sample_of(inputs, 0))
        memory = {k: x for k, x in state.items() if k not in variable_names}
        law.block.dump(times[0], times[0], UNITS[0])
        if any(state[k] != x for k, x in memory.items()):
            return None
        columns = {
            k: tuple(c.view(_LawRows) for c in np.ascontiguousarray(x.T))
            for k, x in inputs.items()
        }
        answers = np.empty((len(times), 4, 3))
        for i, h in enumerate(PROBED):
            state.update(columns)
            dipole = law.block.dump(times[0], times[0], h)[1][0]
            for axis, values in enumerate(dipole):
                answers[:, i, axis] = values
        state.update(before)
        for k in _probed(len(times)):
            state.update(_sample_of(inputs, k))
            _check_sample(law, times[k])
            one = [law.block.dump(times[k], times[k], h)[1][0] for h in PROBED]
            if not np.array_equal(answers[k], np.array(one)):
                return None
    except (TypeError, ValueError):
        return None
    finally:
        state.update(before)
    return answers


def _ask_native(law: Law, samples: Samples) -> Array | None:
    """Return the dipoles (rows, 4, 3) at UNITS and ZERO by the block's native FMU.

    An instance flies along the rows for each momentum, so that a state that does not
    follow the momentum, as the field before, is that of the law. One more takes the
    momenta in turn, and differs where the law remembers them. None where there is no
    such FMU, or where it does not give the bits of the block in the first rows.

    Raises UnsuitedError if the law has memory or is not affine in the momentum.
    """
    times, inputs = samples
    component = native_of(law.block)
    if component is None or len(times) <= HEAD:
        return None
    axes = law.block.axes_wheel
    wheels = [to_wheels(pseudo_inverse(axes), h) for h in MOMENTA]
    momenta = [body_momentum(axes, h) for h in wheels]
    if not np.allclose(momenta, MOMENTA, rtol=0.0, atol=1e-9):
        return None  # the wheels do not span space
    signals, elements = component.interface.signals, component.interface.elements
    valid = dict.fromkeys(signals.keys() & VALID, True)
    component = replace(component, parameters={**component.parameters, **valid})
    names = [name for name in inputs if name in elements]
    input_signals = [s for name in ("h_wheel", *names) for s in elements[name]]
    measured = [inputs[name] for name in names]

    def fly(h: Array) -> Array | None:
        """Return the dipoles (rows, 3) with momenta h of the wheels (rows, n)."""
        values = np.hstack([h, *measured])
        return rows_of(component, times, elements["m_cmd_body"], input_signals, values)

    turns = np.arange(len(times)) % len(wheels)
    dipoles = [fly(np.tile(h, (len(times), 1))) for h in wheels]
    in_turn = fly(np.array(wheels)[turns])
    if in_turn is None or any(rows is None for rows in dipoles):
        return None
    answers = np.stack(dipoles, axis=1)  # type: ignore[arg-type]
    before = dict(vars(law.block))
    head = times[:HEAD], {name: x[:HEAD] for name, x in inputs.items()}
    of_block = _ask_one_by_one(law, head, momenta)
    vars(law.block).update(before)
    if not np.array_equal(answers[:HEAD], of_block):
        return None
    if not np.array_equal(in_turn, answers[np.arange(len(times)), turns]):
        raise UnsuitedError("it is a law with memory")
    offset = answers[:, -1:]
    at_units = np.linalg.solve(np.array(momenta[:3]), answers[:, :3] - offset)
    misses = answers[:, 3] - offset[:, 0] - np.array(momenta[3]) @ at_units
    if np.abs(misses).max() > AFFINE * np.abs(answers).max():
        raise UnsuitedError("it is not affine in the momentum")
    return np.concatenate([at_units + offset, offset], axis=1)


def _ask_one_by_one(law: Law, samples: Samples, momenta: Sequence[Vec3]) -> Array:
    """Return the dipoles (rows, momenta, 3), sample by sample; the last one is ZERO."""
    times, inputs = samples
    state, dump = vars(law.block), law.block.dump
    probed = set(_probed(len(times)))
    answers: list[list[Vec3]] = []
    for k, t in enumerate(times):
        state.update(_sample_of(inputs, k))
        if k in probed:
            _check_sample(law, t)
        before = dict(state)
        torques = []
        for h in momenta[:-1]:
            torques.append(dump(t, t, h)[1][0])
            state.update(before)
        # the state that this sample leaves, as the field before, is that of the next
        answers.append([*torques, dump(t, t, momenta[-1])[1][0]])
    return np.array(answers)


def _probed(rows: int) -> list[int]:
    """Return the rows at which a law is tested."""
    return [*range(0, rows, CHECKED), rows - 1]


def _check_sample(law: Law, t: float) -> None:
    """Raise UnsuitedError if a law has memory or is not affine in the momentum at t.

    The block's inputs are those of the sample; its state is as before afterwards.
    """
    state, variable_names = vars(law.block), {v.name for v in law.block.variables}
    before = dict(state)
    undeclared = [key for key in before if key not in variable_names]
    answers, memories = [], []
    for h in MOMENTA:
        answers.append(np.array(law.block.dump(t, t, h)[1][0]))
        memories.append([state[key] for key in undeclared])
        state.update(before)
    if any(memory != memories[0] for memory in memories):
        raise UnsuitedError("it is a law with memory")
    *first, other, rest = answers
    gain = (np.array(first) - rest).T
    miss = np.abs(other - gain @ np.array(OTHER) - rest).max()
    if miss > AFFINE * np.abs(answers).max():
        raise UnsuitedError("it is not affine in the momentum")


def _samples(law: Law, flight: Flight, rows: Array) -> Samples:
    """Return the times (s) and the measured inputs of rows, without errors."""
    q = flight.q[rows]
    fields = zip(q.tolist(), flight.b[rows].tolist(), strict=True)
    b_body = [rotate(tuple(a), tuple(b)) for a, b in fields]
    return flight.times[rows].tolist(), {
        "q_bi": np.asarray(q, float),
        "b_body": np.array(b_body, float).reshape(-1, 3),
        "r_eci": np.asarray(flight.r[rows], float),
        "v_eci": np.asarray(flight.v[rows], float),
        "omega_bi_body": np.asarray(flight.omega[rows], float),
    }


def _sample_of(inputs: dict[str, Array], k: int) -> dict[str, tuple[float, ...]]:
    """Return the inputs of row k, as a block has them."""
    return {name: tuple(x[k].tolist()) for name, x in inputs.items()}


def _fastest(flight: Flight) -> float:
    """Return the largest rate (rad/s) at which a craft turns between rows; 1e-12 or more."""
    q, steps = flight.q, np.diff(flight.times)
    along = np.abs((q[1:] * q[:-1]).sum(axis=1)).clip(max=1.0)
    return max(float((2.0 * np.arccos(along) / steps).max()), 1e-12)


def hold_of(law: Law, flight: Flight, most: float = STEP) -> int:
    """Return the number of rows of a flight between two samples of the model.

    It is the law's own, or combines several samples, up to `most` (s), where the law is
    slow compared with them.
    """
    step = float(flight.times[1] - flight.times[0])
    hold = max(1, round(law.sample_time / step)) if law.sample_time > 0.0 else 1
    rows = np.linspace(0, len(flight.times) - 1, PROBES).astype(int)
    linearised = ask(law, flight, rows)
    b = np.linalg.norm(flight.b[rows], axis=1)
    rate = float((np.linalg.norm(linearised.gain, ord=2, axis=(1, 2)) * b).max())
    longest = min(most, SLOW / rate) if rate > 0.0 else most
    longest = min(longest, 2.0 * pi / TURN_ROWS / _fastest(flight))
    return max(hold, int(longest / (hold * step) + 1e-9) * hold)
