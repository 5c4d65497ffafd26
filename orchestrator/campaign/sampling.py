"""Draw the values of a scenario's dispersions.

    [dispersions]
    "spacecraft.h_start_body" = { normal = [0.0, 1.3] }      # each element: mean, deviation
    "wheels.h_start_wheel" = { normal = [0.0, 0.6], within = [-2.0, 2.0] }   # truncated
    "environment.phase" = { uniform = [0.0, 6.283] }         # each element: low, high
    "spacecraft.omega_start_body" = { direction = 0.17 }     # random direction, this size
    "spacecraft.q_start_bi" = { attitude = "random" }        # uniform over all attitudes
    "spacecraft.h_start_body" = { signs = [0.1, 0.1, 0.1] }  # each element: plus or minus this
    "environment.phase" = { one_of = [0.0, 1.5, 3.0] }       # one of these, with equal probability
    "*.seed" = { seed = true }                               # every component that has a seed
    "spacecraft.drag_coefficient" = { factor = 2.2 }         # its value, times or divided by it (90 %)
    "spacecraft.residual_dipole_body" = { direction = 0.1, factor = 3.0 }    # the same of the size
    "spacecraft.offset_plates_body" = { plus_minus = 0.01 }  # each element: more or less (90 %)
    "spacecraft.offset_plates_body" = { plus_minus = [0.01, 0.02, 0.01] }  # a width for each

A factor is the same for all elements. Of a matrix of inertia each of its second moments
has its own, so that a body can have the moments that are drawn. Of plates it is that of
their areas.

A drawn value depends on seed, draw and name alone, not on the order of the lines. With
a sampling that spreads its points evenly, it also depends on their number
(latin-hypercube, saltelli) and on the other names. Seeds are always random. An element
beyond `within` is drawn again from the same stream, so that a draw without such an
element is the same as without a limit.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable, Mapping
from functools import lru_cache
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from desat.components.physics.torques import PLATE_COLUMNS

from ..files.draft import Draft
from ..language.content import dispersions_of
from ..language.scenario import Dispersion
from ..system.errors import DesatError, nearest, require
from ..system.model import System

Sampling = Literal["random", "latin-hypercube", "sobol", "saltelli"]
SAMPLINGS: tuple[str, ...] = get_args(Sampling)
# Samplings whose points depend on their number.
FIXED: tuple[str, ...] = ("latin-hypercube", "saltelli")
# A drawn value: a choice is its name, an array is a list.
Drawn = float | int | str | list[float]
# Table of plates of a spacecraft, and its column of areas.
PLATES, AREA = "plates", 3
NINETY = 1.6448536269514722  # deviations of a normal number that 90 % are within
# limit of the points of these samplings, which are in memory all at once
MOST = 10_000_000


def draw_of(
    system: Draft, seed: int, draw: int, sampling: Sampling = "random", count: int = 0
) -> dict[str, Drawn]:
    """Draw the values of the system's dispersions: `component.variable` -> value.

    The number of draws `count` matters only for the samplings in `FIXED`.
    """
    if sampling == "random":
        spread = dispersions_of(system)
        return {n: draw_one(system, n, spec, seed, draw) for n, spec in spread.items()}
    names, sizes = axes(system)
    unit = iter(_points(sampling, seed, count, tuple(names), tuple(sizes))(draw))
    values: dict[str, Drawn] = {}
    for name, size in zip(names, sizes, strict=True):
        spec = dispersions_of(system)[name]
        point = np.array([next(unit) for _ in range(size)])
        values[name] = _place(system, name, spec, point)
    return {
        name: values[name]
        if name in values
        else draw_one(system, name, spec, seed, draw)
        for name, spec in dispersions_of(system).items()
    }


def axes(system: Draft) -> tuple[list[str], list[int]]:
    """Return the sorted names that a sampling spreads, and their uniform numbers.

    These are all names except seeds, each with the number of uniform numbers that it
    takes.
    """
    spread = {
        n: spec
        for n, spec in sorted(dispersions_of(system).items())
        if spec.kind != "seed"
    }
    return list(spread), [_axes_of(system, n, s) for n, s in spread.items()]


def describe_parameter(system: Draft | System, name: str) -> tuple[str, str]:
    """Describe a parameter, as `wheels: axial momentum at the start, 2`, with its unit.

    Its own name stands for one without a description.
    """
    owner, _, variable = name.partition(".")
    variable, _, element = variable.partition("[")
    component = system.components.get(owner)
    interface = None if component is None else component.interface
    signals = interface.elements.get(variable, ()) if interface is not None else ()
    if not signals or not signals[0].description:
        return name, ""
    text = (
        f"{owner}: {signals[0].description}{', ' * bool(element)}{element.rstrip(']')}"
    )
    return text, signals[0].unit_name


def _axes_of(system: Draft | System, name: str, spec: Dispersion) -> int:
    """Return how many uniform numbers a drawn value takes."""
    size = _size(system, name)
    if spec.one_of:
        return 1
    if spec.kind == "factor":
        owner, _, variable = name.partition(".")
        unit = system.components[owner].interface.elements[variable][0].unit_name
        return 3 if size == 9 and unit == "kg.m2" else 1
    return size + (spec.factor is not None)


def _size(system: Draft | System, name: str) -> int:
    """Count the elements of a dispersed parameter; raise DesatError without one."""
    owner, _, variable = name.partition(".")
    require(owner, system.components, f"{system.place}: dispersions: no component")
    interface = system.components[owner].interface
    if size := len(interface.elements.get(variable, ())):
        return size
    raise DesatError(
        f"{system.place}: dispersions: {name}: no such parameter"
        f"{nearest(variable, {s.array for s in interface.parameters})}"
    )


def draw_one(
    system: Draft | System, name: str, spec: Dispersion, seed: int, draw: int
) -> Any:
    """Draw a value from a random stream of its own."""
    size, kind = _size(system, name), spec.kind
    stream = np.random.default_rng([seed, draw, zlib.crc32(name.encode())])
    numbers = getattr(spec, kind)
    if spec.factor is not None or kind == "plus_minus":
        normal = stream.normal(size=_axes_of(system, name, spec))
        return _around(system, name, spec, normal)
    if kind == "normal":
        low, high = spec.within or (-np.inf, np.inf)
        values = stream.normal(numbers[0], numbers[1], size)
        while (beyond := (values < low) | (values > high)).any():
            values[beyond] = stream.normal(numbers[0], numbers[1], beyond.sum())
        return [float(x) for x in values]
    if kind == "uniform":
        return [float(x) for x in stream.uniform(numbers[0], numbers[1], size)]
    if kind == "signs":
        return [
            float(x)
            for x in stream.choice([-1.0, 1.0], len(numbers)) * np.array(numbers)
        ]
    if kind == "one_of":
        return numbers[int(stream.integers(len(numbers)))]
    if kind == "seed":
        return int(stream.integers(1, 2**31 - 1))
    return _directed(kind, numbers, stream.normal(size=size))


def _place(
    system: Draft, name: str, spec: Dispersion, unit: NDArray[np.float64]
) -> Any:
    """Compute a value from uniform numbers (size,) in (0, 1)."""
    from scipy.special import ndtr, ndtri

    kind = spec.kind
    numbers = getattr(spec, kind)
    if spec.factor is not None or kind == "plus_minus":
        return _around(system, name, spec, ndtri(unit))
    if kind == "normal":
        if spec.within and numbers[1]:
            low, high = ndtr((np.array(spec.within) - numbers[0]) / numbers[1])
            unit = low + (high - low) * unit
        return [float(numbers[0] + numbers[1] * x) for x in ndtri(unit)]
    if kind == "uniform":
        return [float(numbers[0] + (numbers[1] - numbers[0]) * x) for x in unit]
    if kind == "signs":
        return [
            float(size if x < 0.5 else -size)
            for size, x in zip(numbers, unit, strict=True)
        ]
    if kind == "one_of":
        return numbers[min(int(unit[0] * len(numbers)), len(numbers) - 1)]
    return _directed(kind, numbers, ndtri(unit))


def _around(
    system: Draft | System, name: str, spec: Dispersion, normal: NDArray[np.float64]
) -> Any:
    """Compute a value around that of the scenario from normal numbers (size,).

    Raises DesatError if the scenario's value follows from others, or widths are not one
    for each element.
    """
    owner, _, variable = name.partition(".")
    component = system.components[owner]
    if variable in component.references:
        raise DesatError(
            f"{system.place}: dispersions: {name} = {component.references[variable]!r} "
            f"follows from others: {spec.kind} needs a value of its own"
        )
    signals = component.interface.elements[variable]
    value = np.array(
        [component.parameters.get(s.name, s.start) for s in signals], float
    )
    if variable == PLATES and spec.kind == "factor":
        rows = value.reshape(-1, PLATE_COLUMNS).copy()
        rows[:, AREA] = change_value(spec, rows[:, AREA], normal)
        return rows.ravel().tolist()
    widths = np.atleast_1d(spec.plus_minus or 0.0)
    if len(widths) not in (1, len(value)):
        raise DesatError(
            f"{system.place}: dispersions: {name}: plus_minus has {len(widths)} widths; "
            f"{len(value)} are needed, or one for all"
        )
    return change_value(spec, value, normal)


def change_value(
    spec: Dispersion, value: NDArray[np.float64], normal: NDArray[np.float64]
) -> Any:
    """Return a value (elements,) as `factor` or `plus_minus` of a dispersion change it.

    The normal numbers (n,) are of deviation 1.
    """
    if spec.plus_minus is not None:
        return (value + np.array(spec.plus_minus) / NINETY * normal).tolist()
    width = math.log(spec.factor or 1.0) / NINETY
    if spec.direction is not None:
        size = spec.direction * math.exp(width * normal[-1])
        return _directed("direction", size, normal[:-1])
    if len(normal) == 1:
        return (math.exp(width * normal[0]) * value).tolist()
    inertia = value.reshape(3, 3)
    second = 0.5 * np.trace(inertia) * np.eye(3) - inertia
    scale = np.exp(0.5 * width * normal)
    second *= np.outer(scale, scale)
    return (np.trace(second) * np.eye(3) - second).ravel().tolist()


def _directed(kind: str, numbers: Any, normal: NDArray[np.float64]) -> list[float]:
    """Compute a random direction from normal numbers; its size is 1 for an attitude."""
    vector = normal / np.linalg.norm(normal)
    return [float(x) for x in (vector if kind == "attitude" else numbers * vector)]


def allowed(sampling: Sampling, count: int, system: Draft) -> None:
    """Raise DesatError if a sampling cannot have this number of points."""
    if sampling in FIXED and count > MOST:
        raise DesatError(f"{sampling}: -n {count}: at most {MOST}")
    if sampling == "sobol" and sum(axes(system)[1]) > 21201:
        raise DesatError("sobol has at most 21201 axes")
    if sampling != "saltelli":
        return
    width = sum(axes(system)[1]) + 2
    if not width - 2:
        raise DesatError("saltelli: nothing is drawn but seeds")
    base = 2 ** max(0, round(np.log2(max(count, 1) / width)))
    if count != base * width:
        raise DesatError(
            f"saltelli: -n {count}: with {width - 2} numbers drawn it is a power of "
            f"two times {width}, such as {base * width}"
        )


@lru_cache(maxsize=4)
def _points(
    sampling: Sampling,
    seed: int,
    count: int,
    names: tuple[str, ...],
    sizes: tuple[int, ...],
) -> Callable[[int], NDArray[np.float64]]:
    """Build the function from a draw to its uniform numbers in (0, 1), of all axes."""
    width = sum(sizes)
    if sampling == "latin-hypercube":
        keys = [
            (zlib.crc32(n.encode()), i)
            for n, k in zip(names, sizes, strict=True)
            for i in range(k)
        ]
        strata = [
            np.random.default_rng([seed, *key]).permutation(count) for key in keys
        ]

        def point(draw: int) -> NDArray[np.float64]:
            jitter = np.random.default_rng([seed, draw]).random(len(strata))
            return _open((np.array([s[draw] for s in strata]) + jitter) / count)

    elif sampling == "sobol":
        from scipy.stats.qmc import Sobol

        engine = Sobol(max(width, 1), scramble=True, rng=np.random.default_rng(seed))

        def point(draw: int) -> NDArray[np.float64]:
            engine.reset()
            if draw:
                engine.fast_forward(draw)
            return _open(engine.random(1)[0][:width])

    else:
        table = saltelli(seed, count, width)

        def point(draw: int) -> NDArray[np.float64]:
            return _open(table[draw])

    return point


def saltelli(seed: int, count: int, width: int) -> NDArray[np.float64]:
    """Sample points (count, width) of the unit cube for Sobol indices, by SALib.

    The indices are of first and total order (Saltelli et al., Comput. Phys. Commun. 181
    (2010) 259).

    Raises
    ------
    DesatError
        If SALib is not installed.
    """
    sample = sensitivity("sample")
    cube = sample(
        unit_cube(width), count // (width + 2), calc_second_order=False, seed=seed
    )
    return np.asarray(cube, dtype=float)


def sensitivity(function: Literal["sample", "analyze"]) -> Callable[..., Any]:
    """Import SALib's function for Sobol indices; raise DesatError without SALib."""
    try:
        from SALib.analyze import sobol as analyze
        from SALib.sample import sobol as sample
    except ImportError as error:
        raise DesatError(
            "sampling saltelli needs SALib: pip install 'desat[cluster]'"
        ) from error
    return sample.sample if function == "sample" else analyze.analyze  # type: ignore[no-any-return]


def unit_cube(width: int) -> Mapping[str, Any]:
    """Return SALib's description of the unit cube."""
    return {
        "num_vars": width,
        "names": [str(i) for i in range(width)],
        "bounds": [[0, 1]] * width,
    }


def _open(unit: NDArray[np.float64]) -> NDArray[np.float64]:
    """Clip numbers of [0, 1] to the open interval."""
    return np.clip(unit, 2.0**-53, 1.0 - 2.0**-53)
