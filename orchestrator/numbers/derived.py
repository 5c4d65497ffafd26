"""Derive quantities from several series, before numbers measure or plots draw them.

    derive = "euler"        # of a number or a plot whose signals are attitude and reference
    sequence = "321"

Each is a function of its series (rows, elements), and of `times` (rows,) if it has that
parameter.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Container, Iterator, Sequence
from dataclasses import dataclass
from functools import wraps
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from desat.components.contract.roles import HELD_ATTITUDE, WANTED_ATTITUDE

from ..system.errors import MisfitError, nearest

if TYPE_CHECKING:
    from ..language.scenario import Number, Plot

Array = NDArray[np.float64]
Derive = Callable[..., Array]
BLOCK = 1 << 15  # rows that are computed together, so that memory holds no more


@dataclass(frozen=True)
class DerivedQuantity:
    """Derived quantity: its function, the names of its elements, and its unit.

    An empty unit is that of its first series.
    """

    function: Callable[..., Array]
    names: tuple[str, ...]
    unit: str
    # parameters that it takes from the component of its first series
    extra_series: tuple[str, ...] = ()

    @property
    def series(self) -> list[str]:
        """Return the names of the series that it takes."""
        parameters = inspect.signature(self.function).parameters.values()
        other = ("times", *self.extra_series)
        return [
            p.name for p in parameters if p.default is p.empty and p.name not in other
        ]

    @property
    def is_sum(self) -> bool:
        """Return whether a row depends on those before: it takes the times, too."""
        return "times" in inspect.signature(self.function).parameters

    def rows(
        self, times: Array, series: Sequence[Array], options: dict[str, Any]
    ) -> Array:
        """Compute its rows (rows, elements); all series are cut to the shortest."""
        count = min(map(len, series))
        columns = [head(s, count) for s in series]
        if self.is_sum:
            columns = [times[:count], *map(np.asarray, columns)]
            values = self.function(*columns, **options)
        else:
            values = by_rows(len(columns))(self.function)(*columns, **options)
        return values if values.ndim > 1 else values[:, None]


def blocks(rows: int, more: int = 0) -> Iterator[slice]:
    """Yield the slices of blocks of rows; neighbours have `more` rows in common."""
    for first in range(0, max(rows - more, 1), BLOCK):
        yield slice(first, min(first + BLOCK + more, rows))


def head(column: Any, count: int) -> Any:
    """Return the first rows of an array or a series."""
    return column[:count] if isinstance(column, np.ndarray) else column.head(count)


def by_rows(count: int) -> Callable[[Derive], Derive]:
    """Make a function compute its rows in blocks.

    Its first `count` arguments have a row for each of its result. They may be series
    that are read as they are used.
    """

    def in_blocks(function: Derive) -> Derive:
        """Return the function that calls the given one for each block."""

        @wraps(function)
        def rows_of(*columns: Any, **options: Any) -> Array:
            """Return the rows of the result."""
            of_rows, others = columns[:count], columns[count:]
            length = len(of_rows[0])
            table = of_rows[0].shape[2:] if isinstance(of_rows[0], np.ndarray) else ()
            some = max(1, BLOCK // math.prod(table))
            if length <= some:
                return function(*map(np.asarray, of_rows), *others, **options)
            result = np.empty(0)
            for first in range(0, length, some):
                rows = slice(first, min(first + some, length))
                block = (np.asarray(c[rows]) for c in of_rows)
                part = function(*block, *others, **options)
                if first == 0:
                    result = np.empty((length, *part.shape[1:]), part.dtype)
                result[rows] = part
            return result

        return rows_of

    return in_blocks


QUANTITIES: dict[str, DerivedQuantity] = {}
# derived quantities that compare an attitude with a reference
ATTITUDE_ERRORS = ("pointing", "error_vector", "euler")


def quantity(
    *names: str, unit: str, elements: tuple[str, ...] = ()
) -> Callable[[Derive], Derive]:
    """Register a function as a quantity, with its elements, unit and parameters."""

    def known(function: Derive) -> Derive:
        """Register the function under its name."""
        QUANTITIES[function.__name__] = DerivedQuantity(function, names, unit, elements)
        return function

    return known


def of_entry(entry: Number | Plot) -> tuple[DerivedQuantity, dict[str, Any]] | None:
    """Return the quantity that a number or plot derives, and its options, or None.

    Raises
    ------
    MisfitError
        If there is no such quantity, or it takes other series or no sequence.
    """
    name = entry.derive
    if name and name not in QUANTITIES:
        raise MisfitError(f"no {name}{nearest(name, QUANTITIES)}", "derive")
    if entry.sequence and entry.derive not in ("euler", "euler_lvlh"):
        raise MisfitError('only with derive = "euler" or "euler_lvlh"', "sequence")
    if not name:
        return None
    quantity = QUANTITIES[name]
    if len(entry.signals) != len(quantity.series):
        raise MisfitError(
            f"{name} takes {len(quantity.series)} signals, {', '.join(quantity.series)}",
            "derive",
        )
    return quantity, {"sequence": entry.sequence} if entry.sequence else {}


@quantity("x", "y", "z", unit="", elements=("axes_wheel",))
def in_body(h: Array, axes_wheel: Sequence[float]) -> Array:
    """The sum of the wheels' momenta as a vector in body (rows, 3): of h_i along each
    axis, the columns of axes_wheel (3, n) row by row. Of numbers only: plots know no
    parameters.
    """
    return np.asarray(h @ np.reshape(axes_wheel, (3, -1)).T)


def cross(a: ArrayLike, b: ArrayLike) -> Array:
    """Compute a x b, row by row, for (rows, 3) or one vector (3,) for all rows.

    The result has the same bits as that of numpy, which copies its arguments first.
    """
    (ax, ay, az), (bx, by, bz) = np.asarray(a).T, np.asarray(b).T
    return _rows(ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx)


def rotate_back(q: Array, v: Array) -> Array:
    """Rotate vectors from body to eci, row by row.

    This is C(q)' v = v + w t + u x t with t = 2 u x v.
    """
    (x, y, z, w), (a, b, c) = q.T, v.T
    d, e, f = 2.0 * (y * c - z * b), 2.0 * (z * a - x * c), 2.0 * (x * b - y * a)
    return _rows(
        a + w * d + (y * f - z * e),
        b + w * e + (z * d - x * f),
        c + w * f + (x * e - y * d),
    )


def rotate(q: Array, v: Array) -> Array:
    """Rotate vectors from eci to body, row by row: C(q) v."""
    return rotate_back(q * np.array([-1.0, -1.0, -1.0, 1.0]), v)


def from_body(q: Array) -> Array:
    """Compute the matrices C(q)' (rows, 3, 3) from body to eci, by `rotate_back`."""
    return np.stack(
        [rotate_back(q, np.broadcast_to(e, (len(q), 3))) for e in np.eye(3)], axis=2
    )


def unit_rows(rows: Array) -> Array:
    """Normalise rows (n, k) to unit length."""
    return np.asarray(rows / np.linalg.norm(rows, axis=1, keepdims=True))


def _rows(*columns: Array) -> Array:
    """Combine columns (rows,) to an array (rows, columns)."""
    rows = np.empty((len(columns), *columns[0].shape)).T
    for i, column in enumerate(columns):
        rows[..., i] = column
    return rows


@quantity("x", "y", "z", unit="deg")
@by_rows(2)
def error_vector(q: Array, q_ref: Array) -> Array:
    """The rotation vectors from the reference to the attitude, body axes (deg)."""
    x, y, z, w = q.T
    a, b, c, d = q_ref.T
    vector = np.array(
        [
            x * d - w * a - z * b + y * c,
            y * d + z * a - w * b - x * c,
            z * d - y * a + x * b - w * c,
        ]
    ).T
    scalar = (q * q_ref).sum(axis=1)
    sign = np.where(scalar < 0.0, -1.0, 1.0)[:, None]
    half_sine = np.linalg.norm(vector, axis=1, keepdims=True)
    angle = 2.0 * np.arctan2(half_sine, np.abs(scalar)[:, None])
    direction = vector / np.where(half_sine > 0.0, half_sine, 1.0)
    return np.asarray(np.degrees(sign * angle * direction))


def sample_rows(times: Array, sample_time: float) -> NDArray[np.bool_]:
    """Return the rows (n,) at which a component of a sample time (s) has sampled.

    They are the first rows at or after its samples. All rows where it samples at every
    row, or its sample time is not known (0).
    """
    if len(times) < 2 or sample_time <= 1.001 * (times[1] - times[0]):
        return np.ones(len(times), bool)
    count = np.floor((times - times[0]) / sample_time + 1e-9)
    return np.asarray(np.diff(count, prepend=-1.0) > 0.0)


def reference_of(signals: Sequence[str], measure: str, derive: str) -> str:
    """Return the series of the reference that attitudes are compared with, or "".

    A reference holds between its samples, while the craft goes on turning, so that a
    difference there is none of pointing.
    """
    compares = measure.startswith("pointing_") or derive in ATTITUDE_ERRORS
    return signals[1] if compares and len(signals) > 1 else ""


def wanted_attitude(reference: str, recorded: Container[str]) -> str:
    """Return the series of the attitude that a guidance wants at every row.

    It is the reference itself where the guidance has no such output, or the series is
    not recorded.
    """
    owner, _, variable = reference.partition(".")
    series = f"{owner}.{WANTED_ATTITUDE}"
    is_held = variable == HELD_ATTITUDE and series in recorded
    return series if is_held else reference


def compared_signals(entry: Number | Plot, recorded: Container[str]) -> tuple[str, ...]:
    """Return the series of a number or plot, an attitude's reference as it is wanted."""
    reference = reference_of(entry.signals, getattr(entry, "measure", ""), entry.derive)
    return tuple(
        wanted_attitude(s, recorded) if s == reference else s for s in entry.signals
    )


@quantity("", unit="deg")
@by_rows(2)
def pointing(q: Array, q_ref: Array) -> Array:
    """The angle between attitudes (deg), row by row; exact for small ones."""
    sign = np.where((q * q_ref).sum(axis=1, keepdims=True) < 0.0, -1.0, 1.0)
    half_chord = np.linalg.norm(q - sign * q_ref, axis=1) / 2.0
    return np.asarray(np.degrees(4.0 * np.arcsin(np.clip(half_chord, 0.0, 1.0))))


@quantity("first", "second", "third", unit="deg")
def euler(q: Array, q_ref: Array, sequence: str = "321") -> Array:
    """Euler angles (rows, 3; deg) from a reference to an attitude: turns about body
    axes, first to last as in `sequence`.
    """
    with np.errstate(invalid="ignore"):  # an attitude may be a zero quaternion
        unit = [x / np.linalg.norm(x, axis=1, keepdims=True) for x in (q_ref, q)]
    return _angles(matrices(unit[0]), matrices(unit[1]), sequence)


@quantity("first", "second", "third", unit="deg")
def euler_lvlh(q: Array, r: Array, v: Array, sequence: str = "321") -> Array:
    """Euler angles (rows, 3; deg) from lvlh, by position and velocity in eci, to an
    attitude: as `euler`, with a reference that no guidance samples.
    """
    z = -r / np.linalg.norm(r, axis=1, keepdims=True)
    y = -np.cross(r, v)
    y /= np.linalg.norm(y, axis=1, keepdims=True)
    return _angles(np.stack([np.cross(y, z), y, z], axis=1), matrices(q), sequence)


def matrices(q: Array) -> Array:
    """Compute C(q) (rows, 3, 3) of attitudes (rows, 4), scalar last.

    It turns from the frame that the attitudes are relative to into body.
    """
    v, w = q[:, :3], q[:, 3]
    c = 2.0 * v[:, :, None] * v[:, None, :]
    c += (w**2 - (v**2).sum(axis=1))[:, None, None] * np.eye(3)
    x, y, z = 2.0 * w * v.T
    zero = np.zeros_like(w)
    return np.asarray(
        c + np.array([[zero, z, -y], [-z, zero, x], [y, -x, zero]]).transpose(2, 0, 1)
    )


def _angles(reference: Array, attitude: Array, sequence: str) -> Array:
    """Compute Euler angles (rows, 3; deg) between attitudes C (rows, 3, 3).

    Where first and third axis coincide the third angle is 0.
    """
    i, j, k = (int(axis) - 1 for axis in sequence)
    proper = i == k
    k = 3 - i - j if proper else k
    sign = 1.0 if (j - i) % 3 == 1 else -1.0  # +1 where i, j, k are in cyclic order
    m = np.einsum(
        "nai,nbi->nab", reference, attitude
    )  # columns: body axes in the reference
    if proper:
        across = np.hypot(m[:, j, i], m[:, k, i])
        second = np.arctan2(across, m[:, i, i])
        first = np.arctan2(m[:, j, i], -sign * m[:, k, i])
        third = np.arctan2(m[:, i, j], sign * m[:, i, k])
    else:
        across = np.hypot(m[:, i, i], m[:, i, j])
        second = np.arctan2(sign * m[:, i, k], across)
        first = np.arctan2(-sign * m[:, j, k], m[:, k, k])
        third = np.arctan2(-sign * m[:, i, j], m[:, i, i])
    together = across < 1e-7
    first = np.where(together, np.arctan2(sign * m[:, k, j], m[:, j, j]), first)
    third = np.where(together, 0.0, third)
    return np.asarray(np.degrees(np.stack([first, second, third], axis=1)))


@quantity("x", "y", "z", unit="1")
def nadir_body(q: Array, r: Array) -> Array:
    """The unit vector to nadir in body (rows, 3), by the position in eci; its z is the
    cosine of the tilt of the body's z axis.
    """
    return rotate(q, -unit_rows(r))


@quantity("", unit="deg")
def angle_between(a: Array, b: Array) -> Array:
    """The angle between the lines of two vectors (deg, 0 to 90), row by row."""
    across = np.linalg.norm(cross(a, b), axis=1)
    return np.asarray(np.degrees(np.arctan2(across, np.abs((a * b).sum(axis=1)))))


def coil_impulse(times: Array, b_eci: Array, q: Array, dipole: Array) -> Array:
    """Compute the impulse (rows, 3) of coils since the start (N m s, eci).

    Field and attitude are those at t_k, and the dipole is the mean over each step. The
    torque is taken at the middle of the step.
    """
    n = min(len(dipole), len(b_eci) - 1)
    b, halfway = (b_eci[:n] + b_eci[1 : n + 1]) / 2.0, q[:n] + q[1 : n + 1]
    m_eci = rotate_back(
        halfway / np.linalg.norm(halfway, axis=1, keepdims=True), dipole[:n]
    )
    steps = np.diff(times[: n + 1])[:, None]
    return np.vstack([np.zeros(3), np.cumsum(cross(m_eci, b) * steps, axis=0)])


@quantity("disturbances", "coils", "both", unit="")
def momentum_budget(
    times: Array, impulse: Array, b_eci: Array, q: Array, dipole: Array
) -> Array:
    """Sizes (rows, 3) of what disturbances, coils and both have given a craft since the
    start, as vectors in eci (N m s): the external impulse, and the coils'
    (`coil_impulse`).
    """
    coils = coil_impulse(times, b_eci, q, dipole)
    n = len(coils)
    parts = impulse[:n] - coils, coils, impulse[:n]
    return np.array([np.linalg.norm(p, axis=1) for p in parts]).T
