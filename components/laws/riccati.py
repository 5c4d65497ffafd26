"""The infinite-horizon gain of a small linear system, from its Hamiltonian matrix. Needs numpy.

For x' = W x + N_con + B u with the cost 1/2 int x'F x + u'R u dt, S = B R^-1 B', the best u is
-R^-1 B' (K x - g). Units are those of the caller; s and f scale the problem inside.
"""

from __future__ import annotations

from math import sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating[Any]]

LEAST_DECAY = 1e-6
"""Of the slowest closed-loop mode, as a share of sqrt(|S| |F|): below it the system counts as one
that cannot be stabilised."""


def infinite_gain(w: Array, s: Array, f: Array) -> Array | None:
    """K of W'K + K W - K S K + F = 0 for which W - S K is stable; None where there is none.

    w, s, f: (n, n), s and f symmetric without negative eigenvalues. The columns of [X; Y] are the
    stable eigenvectors of the Hamiltonian [[W, -S], [-F, -W']] and K = Y X^-1 (paper 000, section
    III.A). It is scaled so that S and F are of size 1.
    """
    largest_s, largest_f = np.linalg.norm(s, 2), np.linalg.norm(f, 2)
    rate = sqrt(largest_s * largest_f)
    if rate == 0.0:
        return None
    n = len(w)
    a = w / rate
    values, vectors = np.linalg.eig(np.block([[a, -s / largest_s], [-f / largest_f, -a.T]]))
    stable = np.argsort(values.real)[:n]
    if values.real[stable[-1]] > -LEAST_DECAY:
        return None
    x, y = vectors[:n, stable], vectors[n:, stable]
    k = np.linalg.solve(x.T, y.T).real
    return np.asarray(0.5 * sqrt(largest_f / largest_s) * (k + k.T))


def infinite_offset(k: Array, w: Array, s: Array, n_con: Array) -> Array:
    """g = (W - S K)^-T K N_con (n,): eq. 11 of paper 000 at rest, for a constant N_con (n,)."""
    return np.linalg.solve((w - s @ k).T, k @ n_con)
