"""Define the block contract: a block declares each variable once and has three methods.

A block is a class with typed declarations:

    class Magnetometer(Block):
        b_eci: Vec3 = Input("T", "geomagnetic field, eci")
        sample_time: float = Parameter("s", "sample time", start=1.0, min=0.0)
        b_body: Vec3 = Output("T", "measured field, body", interval=True)

The annotation gives type and shape; the declaration gives unit, meaning, start value
and bounds. On an instance each name is a plain attribute (a float, int, bool, or a flat
tuple in row-major order).

- `start()` sets the state to its start values. Initialisation mode calls it again
  whenever an input or a parameter has changed.
- `output(t)` sets the *state* outputs from state and time. It reads no input.
- `advance(t, dt)` moves the state from t to t + dt with the inputs at t and assigns the
  *interval* outputs, which are valid on [t, t + dt).

`instance` is the block's name in its system. An FMU takes the name given at
instantiation, a bare block the name of its component; until that is set, it is the name
of the role. Noise is keyed by it.

All state of a block is held in attributes that are immutable and JSON-able (float, int,
bool, str, None, tuples and named tuples of these), so that a copy of its `__dict__` is
its whole state.
"""

from __future__ import annotations

import json
import math
import operator
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any, ClassVar, Literal, NoReturn, Self

from .units import unit_of

TURN = (-6.2832, 6.2832)  # rad: usual range of an angle, a full turn either way
SPIN = (-3.1416, 3.1416)  # rad/s: usual range of a craft's rate, half a turn per second
SMALL_ANGLE = (-0.35, 0.35)  # rad: usual range of an angular error, 20 deg

_NAMED = "named tuple"  # key of a named tuple among the values of a saved state

Vec3 = tuple[float, float, float]
Vec4 = tuple[float, float, float, float]
Mat33 = tuple[float, float, float, float, float, float, float, float, float]
Mat34 = tuple[float, ...]
Table = tuple[float, ...]
PerWheel = tuple[float, ...]
WheelColumns = tuple[float, ...]
WheelFlags = tuple[bool, ...]


class Size(int):
    """Length of an array that another craft may have another of, such as its wheels.

    A subclass of a block gives it: `class WheelsOf6(Wheels, wheels=6)`. Methods take
    the length of their arrays, not this number.
    """

    kind: str

    def __new__(cls, kind: str, usual: int) -> Self:
        """Return the usual length of a kind."""
        size = super().__new__(cls, usual)
        size.kind = kind
        return size


WHEELS = Size("wheels", 4)
MOST_WHEELS = 8
NOZZLES = Size("nozzles", 8)
MOST_NOZZLES = 16

_SHAPES: dict[
    str, tuple[Literal["Real", "Integer", "Boolean"], tuple[int, ...] | None]
] = {
    "float": ("Real", ()),
    "int": ("Integer", ()),
    "bool": ("Boolean", ()),
    "Vec3": ("Real", (3,)),
    "Vec4": ("Real", (4,)),
    "Mat33": ("Real", (3, 3)),
    "Mat34": ("Real", (3, 4)),
    "Table": ("Real", None),
    "PerWheel": ("Real", (WHEELS,)),
    "WheelColumns": ("Real", (3, WHEELS)),
    "WheelFlags": ("Boolean", (WHEELS,)),
}

Scalar = float | int | bool
Value = Scalar | tuple[Scalar, ...]


class BlockError(ValueError):
    """Error of parameters or inputs that are invalid.

    The text says which value is invalid and what is allowed.
    """


@dataclass(frozen=True)
class Variable:
    """Declared variable: a scalar, or an array of scalars of one type and unit."""

    name: str
    causality: Literal["input", "output", "parameter", "local"]
    type: Literal["Real", "Integer", "Boolean"]
    shape: tuple[int, ...]
    unit: str
    description: str
    start: Value
    minimum: float | None = None
    maximum: float | None = None
    choices: tuple[str, ...] = ()
    interval: bool = False
    mean: bool = False
    slope: str = ""
    starts_from: tuple[str, ...] = ()
    shared: bool = False
    source: tuple[str, ...] = ()
    initial: bool = False
    only_if_needed: bool = False
    needs: tuple[str, ...] = ()
    needed_by: tuple[str, ...] = ()
    follows: str = ""
    usual: tuple[float, float] | None = None
    groups: bool = False  # its choices are none and all groups of wheels

    @property
    def size(self) -> int:
        """Return the number of scalars."""
        return math.prod(self.shape)

    def elements(self) -> list[str]:
        """Return the FMI names of the scalars: `b_eci[1]`, `axes_wheel[3,4]`.

        Indices are 1-based.
        """
        if not self.shape:
            return [self.name]
        if len(self.shape) == 1:
            return [f"{self.name}[{i + 1}]" for i in range(self.shape[0])]
        rows, columns = self.shape
        return [
            f"{self.name}[{i + 1},{j + 1}]" for i in range(rows) for j in range(columns)
        ]

    @property
    def sizes(self) -> dict[str, int]:
        """Return the lengths of its shape that a craft may change, by their kind."""
        return {n.kind: int(n) for n in self.shape if isinstance(n, Size)}

    def with_sizes(self, sizes: Mapping[str, int]) -> Variable:
        """Return the variable with other lengths.

        Of a start value of different numbers the rest is cut off, or is zero.
        """
        if self.groups and "wheels" in sizes:
            choices = wheel_groups(sizes["wheels"])
            return replace(self, choices=choices, maximum=len(choices) - 1)
        if not self.sizes.keys() & sizes.keys():
            return self
        shape = tuple(
            Size(n.kind, sizes.get(n.kind, n)) if isinstance(n, Size) else n
            for n in self.shape
        )
        flat = self.flat_start()
        (rows, columns), (rows_before, before) = (
            (math.prod(x[:-1]), x[-1]) for x in (shape, self.shape)
        )
        start = flat[:1] * math.prod(shape)
        if len(set(flat)) > 1:
            start = tuple(
                flat[before * i + j]
                if i < rows_before and j < before
                else type(flat[0])(0)
                for i in range(rows)
                for j in range(columns)
            )
        return replace(self, shape=shape, start=start)

    def flat_start(self) -> tuple[Scalar, ...]:
        """Return the start value as a flat tuple of `size` scalars."""
        return self.start if isinstance(self.start, tuple) else (self.start,)


def wheel_groups(count: int) -> tuple[str, ...]:
    """Return "none" and each group of `count` wheels, as "1+3", small ones first."""
    numbers = range(1, count + 1)
    groups = (x for size in numbers for x in combinations(numbers, size))
    return ("none", *("+".join(map(str, group)) for group in groups))


def group_of(choice: int, count: int) -> WheelFlags:
    """Return which of MOST_WHEELS wheels a choice of `wheel_groups(count)` has.

    As numbers in base two whose first digit is wheel 1, groups of a size decrease.
    """
    highest = 1
    for _ in range(count):
        highest *= 2
    group, remaining = 0, choice
    for size in range(1, count + 1):
        for mask in range(highest - 1, 0, -1):
            digits, rest = 0, mask
            for _ in range(count):
                digits, rest = digits + rest % 2, rest // 2
            if digits == size:
                remaining -= 1
                if remaining == 0:
                    group = mask
    fails = [False] * MOST_WHEELS
    for i in range(count):
        fails[count - 1 - i], group = group % 2 == 1, group // 2
    return tuple(fails)


class _Declaration:
    """Declaration that waits for the name and annotation that its class gives it."""

    def __init__(
        self, causality: Any, unit: str, description: str, **options: Any
    ) -> None:
        self.causality, self.unit, self.description = causality, unit, description
        self.options = options

    def variable(self, owner: type, name: str) -> Variable:
        """Build the variable `name` of the class `owner` from this declaration.

        Raise TypeError if annotation, unit, shape or start value do not fit.
        """
        annotation = owner.__annotations__.get(name)
        place = f"{owner.__name__}.{name}"
        if annotation is not None and not isinstance(annotation, str):
            raise TypeError(
                f"{place}: annotations are read as text: its file needs the line "
                "`from __future__ import annotations` at its head"
            )
        if annotation not in _SHAPES:
            raise TypeError(f"{place}: annotate it with one of {', '.join(_SHAPES)}")
        try:
            unit_of(self.unit)
        except ValueError as error:
            raise TypeError(f"{place}: unit {self.unit!r}: {error}") from error
        kind, shape = _SHAPES[annotation]
        options = dict(self.options)
        declared_shape = options.pop("shape", None)
        shape = declared_shape if shape is None else shape
        if shape is None:
            raise TypeError(
                f"{place}: a Table needs a shape, as Parameter(..., shape=(5,))"
            )
        choices = tuple(options.pop("choices", ()))
        if options.get("groups"):
            choices = wheel_groups(WHEELS)
        size = math.prod(shape)
        start = options.pop("start", None)
        if choices:
            start = choices.index(start) if start is not None else 0
            options.update(minimum=0, maximum=len(choices) - 1)
        cast = {"Real": float, "Integer": int, "Boolean": bool}[kind]
        value: Value
        if shape:
            flat = _flatten(start if start is not None else 0)
            flat = flat * size if len(flat) == 1 else flat
            if len(flat) != size:
                raise TypeError(
                    f"{place}: start has {len(flat)} values, the shape needs {size}"
                )
            value = tuple(cast(x) for x in flat)
        else:
            value = cast(start if start is not None else 0)
        usual = options.get("usual")
        if usual and not all(usual[0] <= x <= usual[1] for x in _flatten(value)):
            raise TypeError(f"{place}: its start value is not within what is usual")
        return Variable(
            name,
            self.causality,
            kind,
            shape,
            self.unit,
            self.description,
            value,
            choices=choices,
            **options,
        )


def _flatten(value: Any) -> list[Any]:
    """Flatten nested lists and tuples into one list."""
    if isinstance(value, (list, tuple)):
        return [x for item in value for x in _flatten(item)]
    return [value]


def Input(
    unit: str,
    description: str,
    *,
    start: Any = None,
    min: float | None = None,
    max: float | None = None,
    needs: tuple[str, ...] = (),
    source: str | tuple[str, ...] = (),
    initial: bool = False,
    only_if_needed: bool = False,
) -> Any:
    """Declare an input: unit, meaning with frame and sign, value while unconnected.

    `initial` marks an input that is read in initialisation mode only. `source` names
    the outputs (`role.output`) that usually feed it, the best one first. `only_if_needed`
    restricts this wiring to blocks that need the input, since most blocks of the role
    do not read it. `needs` names other variables without which it has no effect, as for
    a parameter; this counts where the input is wired.
    """
    usual = (source,) if isinstance(source, str) else source
    return _Declaration(
        "input",
        unit,
        description,
        start=start,
        minimum=min,
        maximum=max,
        needs=needs,
        source=usual,
        initial=initial,
        only_if_needed=only_if_needed,
    )


def Output(
    unit: str,
    description: str,
    *,
    interval: bool = False,
    mean: bool = False,
    slope: str = "",
    starts_from: tuple[str, ...] = (),
    choices: tuple[str, ...] = (),
    shape: tuple[int, ...] | None = None,
) -> Any:
    """Declare an output: *state* (set in `output`) or *interval* (set in `advance`).

    `mean` marks an interval output that is the mean over the step of a quantity whose
    integral counts (a torque, a dipole). `slope` names the output that holds its slope
    and makes the two a pair. A master transfers the integral whatever the rates of the
    two sides; it samples any other interval output at the rate of a slower receiver.
    `starts_from` names the inputs that its value in initialisation mode depends on.
    `choices` names its integer values, with `-` for a value that never occurs; where a
    role declares the output, each block declares it again with its own choices.
    """
    return _Declaration(
        "output",
        unit,
        description,
        interval=interval or mean or bool(slope),
        mean=mean or bool(slope),
        slope=slope,
        starts_from=starts_from,
        choices=choices,
        shape=shape,
    )


def Parameter(
    unit: str,
    description: str,
    *,
    start: Any = None,
    min: float | None = None,
    max: float | None = None,
    choices: tuple[str, ...] = (),
    shape: tuple[int, ...] | None = None,
    shared: bool = False,
    needs: tuple[str, ...] = (),
    follows: str = "",
    usual: tuple[float, float] | None = None,
    groups: bool = False,
) -> Any:
    """Declare a parameter, which is fixed once the simulation runs.

    `choices` names its integer values; with `groups` they are none and all groups of
    wheels. `shared`: all blocks of a system that have a
    parameter of this name must have the same value; that of a flight computer may be in
    error. `needs` names the block's inputs that must be wired or set, and the outputs
    that must be read by a component, unless the parameter is off: 0, false, its first
    choice, or all elements so. `desat check` enforces this. `follows` names the
    property of the craft that it usually equals, a product of parameters
    (`role.parameter`) as a scenario may give it; where it differs, a check warns that
    it may belong to another craft. `usual` is the range outside of which a value is
    allowed but is more likely a mistake, for instance of units, and causes a warning.
    """
    return _Declaration(
        "parameter",
        unit,
        description,
        start=start,
        minimum=min,
        maximum=max,
        choices=choices,
        shape=shape,
        shared=shared,
        needs=needs,
        follows=follows,
        usual=usual,
        groups=groups,
    )


class Access:
    """Fixed selection of a block's scalars, read and written as one flat list.

    Vectors that are selected completely are copied as a whole.
    """

    def __init__(self, block: Block, positions: Sequence[int]) -> None:
        """Select the scalars at these positions of `scalars()`, in their order."""
        scalars = block.scalars()
        self._values = vars(block)
        self._steps: list[
            tuple[str, int | None, int, int]
        ] = []  # name, index, first, last
        k = 0
        while k < len(positions):
            variable, index = scalars[positions[k]]
            size = variable.size
            consecutive = list(range(positions[k], positions[k] + size))
            if index == 0 and list(positions[k : k + size]) == consecutive:
                self._steps.append((variable.name, None, k, k + size))
                k += size
            else:
                self._steps.append(
                    (variable.name, -1 if index is None else index, k, k + 1)
                )
                k += 1
        self.size = k

    def read(self) -> list[Any]:
        """Return the values as a flat list.

        Raises
        ------
        ValueError
            If an array has a length other than its declared one.
        """
        values = self._values
        result: list[Any] = []
        for name, index, _, _ in self._steps:
            if index is None:
                result += values[name]
            elif index < 0:
                result.append(values[name])
            else:
                result.append(values[name][index])
        if len(result) != self.size:
            raise ValueError("an array has lost its length")
        return result

    def write(self, new: Sequence[Any]) -> None:
        """Set the values from a flat list."""
        values = self._values
        for name, index, first, last in self._steps:
            if index is None:
                values[name] = tuple(new[first:last])
            elif index < 0:
                values[name] = new[first]
            else:
                old = values[name]
                values[name] = (*old[:index], new[first], *old[index + 1 :])


def _to_json(value: Any) -> Any:
    """Return a value of a block's state in types of JSON.

    JSON has no tuples: a named one becomes its module, class and values.
    """
    if isinstance(value, dict):
        return {name: _to_json(x) for name, x in value.items()}
    if not isinstance(value, (tuple, list)):
        return value
    values = [_to_json(x) for x in value]
    if not hasattr(value, "_fields"):
        return values
    return {_NAMED: [type(value).__module__, type(value).__qualname__, values]}


def _from_json(value: Any) -> Any:
    """Return the value that `_to_json` has described, with lists as tuples."""
    if isinstance(value, list):
        return tuple(_from_json(x) for x in value)
    if not isinstance(value, dict):
        return value
    if _NAMED not in value:
        return {name: _from_json(x) for name, x in value.items()}
    module, name, values = value[_NAMED]
    class_ = operator.attrgetter(name)(sys.modules[module])
    if not hasattr(class_, "_fields"):  # bytes from outside make nothing else
        raise TypeError(f"{module}.{name} is no named tuple")
    return class_(*map(_from_json, values))


class Block:
    """Base of all blocks.

    The docstring of a block is its page: Markdown, with the title in the first line.
    """

    role: ClassVar[str] = ""  # also the instance name of its block in a scenario
    role_title: ClassVar[str] = ""  # title of the role for people
    typical_block: ClassVar[str] = ""  # template of a new block of the role
    is_sensor: ClassVar[bool] = False  # true: a health check reads the role's `valid`

    variables: ClassVar[tuple[Variable, ...]] = ()
    sizes: ClassVar[Mapping[str, int]] = {}  # lengths that are not the usual ones

    fault: bool = Output(
        "1", "true: the block has failed and stands still; see the log"
    )

    def __init_subclass__(cls, **sizes: int) -> None:
        """Collect the declared variables of the class and check their consistency.

        `sizes` are the lengths of its arrays that are not the usual ones. Raise
        TypeError if a variable contradicts its role, or `needs` or `slope` name none.
        """
        variable_of = {
            v.name: v for base in cls.__bases__ for v in getattr(base, "variables", ())
        }
        for name, declaration in list(vars(cls).items()):
            if not isinstance(declaration, _Declaration):
                continue
            variable = declaration.variable(cls, name)
            older = variable_of.get(name)
            if older and (older.causality, older.type, older.shape, older.unit) != (
                variable.causality,
                variable.type,
                variable.shape,
                variable.unit,
            ):
                raise TypeError(f"{cls.__name__}.{name} changes what its role declares")
            variable_of[name] = variable
            delattr(cls, name)
        for name in {n for v in variable_of.values() for n in v.needs}:
            if name not in variable_of or variable_of[name].causality == "parameter":
                raise TypeError(
                    f"{cls.__name__}: needs {name!r}, which is no input or output"
                )
        for v in variable_of.values():
            other = variable_of.get(v.slope) if v.slope else None
            if v.slope and (
                other is None or not other.interval or other.shape != v.shape
            ):
                raise TypeError(
                    f"{cls.__name__}.{v.name}: its slope {v.slope!r} is no such output"
                )
        cls.sizes = {**cls.sizes, **sizes}
        cls.variables = tuple(
            replace(
                v.with_sizes(cls.sizes),
                needed_by=tuple(n for n, w in variable_of.items() if v.name in w.needs),
            )
            for v in variable_of.values()
        )

    def __init__(self) -> None:
        self.instance = self.role
        for variable in self.variables:
            setattr(self, variable.name, variable.start)

    @classmethod
    def scalars(cls) -> list[tuple[Variable, int | None]]:
        """Return every scalar of every variable in order: (variable, index or None).

        The index counts within the variable; it is None for a scalar variable.
        """
        return [
            (v, i if v.shape else None) for v in cls.variables for i in range(v.size)
        ]

    def access(self, positions: Sequence[int]) -> Access:
        """Return an accessor to the scalars at these positions of `scalars()`.

        The accessor reads and writes them in the order of the positions.
        """
        return Access(self, positions)

    @staticmethod
    def encode(state: Mapping[str, Any]) -> bytes:
        """Return a state, whose values may be named tuples, as bytes of JSON."""
        return json.dumps({name: _to_json(x) for name, x in state.items()}).encode()

    @staticmethod
    def decode(data: bytes) -> dict[str, Any]:
        """Return the state that `encode` has written, with the types of its tuples."""
        return {name: _from_json(x) for name, x in json.loads(data).items()}

    def check(self) -> None:
        """Check that every parameter is finite and within its declared bounds.

        Raises
        ------
        BlockError
            If a parameter is outside its declared bounds or is not finite.
        """
        for v in self.variables:
            if v.causality != "parameter":
                continue
            value = getattr(self, v.name)
            for name, x in zip(
                v.elements(), value if v.shape else (value,), strict=True
            ):
                if not math.isfinite(x):
                    raise BlockError(f"{name} = {x} is not a finite number")
                if (v.minimum is not None and x < v.minimum) or (
                    v.maximum is not None and x > v.maximum
                ):
                    raise BlockError(
                        f"{name} = {x} is outside [{v.minimum}, {v.maximum}]"
                    )

    def fail(self, text: str) -> NoReturn:
        """Raise BlockError: these parameters or inputs are invalid."""
        raise BlockError(text)

    def foresee(
        self, begin: float, end: float, wired_names: frozenset[str]
    ) -> Iterator[str]:
        """Yield the problems that are known before a run from begin to end (s).

        Each line names a condition that makes the results doubtful or the block
        useless, and begins with the variable that it concerns. `desat check` calls this
        on a block that has its parameters and has started; no host does. `wired_names` holds
        the inputs that are fed or set, and the outputs that a component reads.

        Raises
        ------
        BlockError
            If the run would fail before its end.
        """
        yield from ()

    def start(self) -> None:
        """Set the state to its start values; may be called again."""

    def output(self, t: float) -> None:
        """Set the state outputs from state and time t (s)."""

    def advance(self, t: float, dt: float) -> None:
        """Move the state from t to t + dt (s) and assign the interval outputs."""


Block.__init_subclass__.__func__(Block)  # type: ignore[attr-defined]  # for `fault`


class Sampled(Block):
    """Block that takes samples: base of sensors, computers and pulsed actuators."""

    sample_time: float = Parameter(
        "s",
        "time between samples, a multiple of the step; 0: at every step",
        start=0.0,
        min=0.0,
    )

    def start(self) -> None:
        self._sample = -1

    def due(self, t: float) -> bool:
        """Return whether a sample falls on the step that starts at t (s).

        It advances the count of samples, so call it once per step.
        """
        if self.sample_time <= 0.0:
            self._sample += 1
            return True
        sample = math.floor(t / self.sample_time + 1e-6)
        if sample <= self._sample:
            return False
        self._sample = sample
        return True
