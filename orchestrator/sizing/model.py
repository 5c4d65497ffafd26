"""Integrate the momentum-only model: momentum under disturbances and coils, vectorised.

Its state is the momentum H of wheels and body in eci, H' = disturbances + coils. The
coils follow the law (`law.py`) within the rods' limits, at the law's samples. The law
gets the momentum as the tachometers measure it: their noise, a stream of its own, makes
saturated coils do less and others work more. The model has no pointing errors,
detumbling and slews, and no saturation of one wheel by momentum in the null space.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..analyses.flight import Flight, Hardware
from ..numbers.derived import cross, from_body, rotate, rotate_back
from .law import Law, ask, hold_of

Array = NDArray[Any]
# Coils have little effect where the field is below this share of its largest, as far
# out on an ellipse: duty is over the rest.
USEFUL = 0.2
BLOCK = 512  # rows whose sizes are computed together
SEED = 1  # seed of the tachometers' noise, the same for all rods


class MomentumCourse(NamedTuple):
    """Momentum of the wheels over a flight, an element for each craft.

    The fields are its rms and largest size in body (N m s), the largest of one wheel in
    the second half, where the start no longer matters (N m s), the coils' duty where
    the field is `useful` (1), and the largest of one wheel over all (N m s).
    """

    rms: Array
    largest: Array
    wheel: Array
    duty: Array
    peak: Array


@dataclass(frozen=True)
class Track:
    """A law along a flight at its samples (n + 1 rows, n steps).

    Crafts on it differ in disturbances and rods.
    """

    times: Array
    start: Array  # (3,) N m s, eci: of wheels and body
    to_eci: Array  # (rows, 3, 3)
    body: Array  # (rows, 3) N m s, body
    external: Array  # (steps, disturbances, 3) N m s, eci
    push: Array  # (steps, coils, 3) N m s, eci: of each coil at 1 A m2
    gain: Array  # (rows, 3, 3), transposed
    offset: Array  # (rows, 3) A m2, body
    useful: Array  # (steps,) the field is large enough for coils to count


def useful(b: Array) -> Array:
    """Return the rows where a field b (rows, 3) T reaches USEFUL of its largest."""
    size = np.linalg.norm(b, axis=1)
    return np.asarray(size >= USEFUL * size.max(initial=0.0))


def track_of(
    flight: Flight,
    law: Law,
    hardware: Hardware,
    disturbances: Sequence[Array] | None = None,
    hold: int | None = None,
) -> Track:
    """Evaluate a law along a flight at the model's samples.

    Parameters
    ----------
    flight, law, hardware
        Flight, law and craft.
    disturbances
        Impulses (rows of the track, 3) N m s, eci, in place of the flight's.
    hold
        Rows of the flight between two samples; None: by `hold_of`.

    Raises
    ------
    UnsuitedError
        If the model does not have the law.
    """
    rows = np.arange(0, len(flight.times), hold or hold_of(law, flight))
    linearised = ask(law, flight, rows)
    q, b, times = flight.q[rows], flight.b[rows], flight.times[rows]
    each = [flight.disturbance[rows]] if disturbances is None else disturbances
    # coils turn with the craft from one sample to the next
    parts = slice(rows[-1] + 1)
    before, after = flight.q[parts][:-1], flight.q[parts][1:]
    signs = np.where((before * after).sum(axis=1) < 0.0, -1.0, 1.0)
    halfway = before + after * signs[:, None]
    halfway /= np.linalg.norm(halfway, axis=1, keepdims=True)
    field = 0.5 * (flight.b[parts][:-1] + flight.b[parts][1:])
    field *= np.diff(flight.times[parts])[:, None]  # T s
    push = [
        np.add.reduceat(
            cross(rotate_back(halfway, np.broadcast_to(a, (len(halfway), 3))), field),
            rows[:-1],
        )
        for a in hardware.axes_coil.T
    ]
    mean_b = (b[:-1] + b[1:]) / 2.0
    to_eci, body = from_body(q), flight.body[rows]
    return Track(
        times,
        to_eci[0] @ (flight.h_start + body[0]),
        to_eci,
        body,
        np.stack([np.diff(d, axis=0) for d in each], axis=1),
        np.stack(push, axis=1),
        linearised.gain.transpose(0, 2, 1),
        linearised.offset,
        useful(mean_b),
    )


def fly(
    tracks: Sequence[Track], law: Law, hardware: Hardware, rods: Sequence[float]
) -> MomentumCourse:
    """Integrate the model along tracks, for all disturbances and rods at once.

    Parameters
    ----------
    tracks
        Tracks with the same samples.
    law, hardware
        Law and craft.
    rods
        Sizes of rods (A m2).

    Returns
    -------
    Course
        (tracks, disturbances, rods) each.
    """
    m = np.asarray(rods, float)
    first = tracks[0]
    count, many = len(tracks), first.external.shape[1]
    shape = (count, many, len(m))
    most = np.tile(m, many)[None, :, None]
    reach = hardware.longest * most
    spare = np.linalg.pinv(hardware.axes_coil).T
    to_eci, body, gain, offset, push = (
        np.stack([getattr(t, name) for t in tracks], axis=1)
        for name in ("to_eci", "body", "gain", "offset", "push")
    )
    counts = np.stack([t.useful for t in tracks], axis=1)
    external = np.repeat(np.stack([t.external for t in tracks], axis=1), len(m), axis=2)
    total = np.stack(
        [np.broadcast_to(t.start, (many * len(m), 3)) for t in tracks]
    ).copy()
    axes = hardware.axes_wheel
    random = np.random.default_rng(SEED).normal(size=(len(push), axes.shape[1]))
    noise = hardware.noise * random @ axes.T
    away = (body + law.target)[:, :, None]
    body = body[:, :, None]
    rows, steps = len(first.times), len(push)
    sums = _Sums(total.shape[:2], steps, hardware)
    for begin in range(0, rows, BLOCK):
        end = min(begin + BLOCK, rows)
        momenta = np.empty((end - begin, *total.shape))
        dipoles = np.zeros((end - begin, *total.shape[:2], spare.shape[1]))
        for k in range(begin, end):
            total_eci = total @ to_eci[k]
            momenta[k - begin] = total_eci
            if k == steps:
                break
            excess = total_eci - away[k] + noise[k]
            command = excess @ gain[k] + offset[k][:, None]
            if law.deadband > 0.0:
                size = np.sqrt((excess * excess).sum(axis=2))
                command[size <= law.deadband] = 0.0
            if law.limit == "each":
                command = np.minimum(np.maximum(command, -most), most)
            coils = command @ spare
            if law.limit == "whole":
                largest = np.abs(coils).max(axis=2, keepdims=True)
                coils *= np.minimum(1.0, most / np.maximum(largest, 1e-300))
            coils = hardware.open * np.minimum(np.maximum(coils, -reach), reach)
            dipoles[k - begin] = coils
            total += external[k] + coils @ push[k]
        sums.add(begin, momenta - body[begin:end], dipoles, counts[begin:end])
    duty = sums.duty / (np.maximum(1, counts.sum(axis=0))[:, None] * most[:, :, 0])
    rms = np.sqrt(sums.squares / rows)
    columns = (rms, sums.largest, sums.wheel, duty, sums.peak)
    return MomentumCourse(*(x.reshape(shape) for x in columns))


class _Sums:
    """What a course comes to, block by block of its rows.

    Each array is (tracks, disturbances and rods).
    """

    def __init__(self, shape: tuple[int, ...], steps: int, hardware: Hardware) -> None:
        self.squares, self.largest, self.duty = (np.zeros(shape) for _ in range(3))
        self.wheel, self.peak = np.zeros(shape), np.zeros(shape)
        self._steps, self._hardware = steps, hardware

    def add(self, begin: int, h: Array, dipoles: Array, counts: Array) -> None:
        """Add rows from `begin` on.

        h: momenta of the wheels (rows, tracks, n, 3) N m s; dipoles of the coils (rows,
        tracks, n, 4) A m2; counts: weights of the steps (steps, tracks).
        """
        size = np.sqrt(np.einsum("rijk,rijk->rij", h, h))
        for row in size * size:  # one by one: the sum's bits must not follow the blocks
            self.squares += row
        np.maximum(self.largest, size.max(axis=0), out=self.largest)
        fullest = np.abs(self._hardware.of_wheels(h)).max(axis=3)
        np.maximum(self.peak, fullest.max(axis=0), out=self.peak)
        late = fullest[max(0, (self._steps + 1) // 2 - begin) :]
        if len(late):
            np.maximum(self.wheel, late.max(axis=0), out=self.wheel)
        mean = np.abs(dipoles).mean(axis=3)
        for row, weight in zip(mean[: len(counts)], counts, strict=True):
            self.duty += row * weight[:, None]


def in_body_of(flight: Flight, vectors: Array) -> Array:
    """Rotate vectors (rows, 3) from eci to body, at the rows of a flight."""
    return rotate(flight.q[: len(vectors)], vectors)
