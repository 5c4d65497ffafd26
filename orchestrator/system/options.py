"""Define what the command line, or a program, may change about a run."""

from __future__ import annotations

import re
import shlex
from collections.abc import Mapping
from dataclasses import Field, asdict, dataclass, field, fields, replace
from numbers import Real
from pathlib import Path
from typing import Any, TypedDict, get_args

from .choices import MOST_ACCURACY, Algorithm, Fmus, Isolate, Loop
from .errors import DesatError
from .model import AUTO, MOST_SUBSTEPS, Substeps
from .typed import JsonObject

NOW = "now"  # `--design now`: computed for the run, and not stored


def as_json(target: str, options: Options) -> JsonObject:
    """Convert target and options to JSON.

    It includes the folder to which relative paths in them refer.
    """
    values = {**asdict(options), "trusted": options.trusted and sorted(options.trusted)}
    return {"target": target, "options": values, "from": str(Path.cwd())}


def from_json(document: JsonObject) -> Options:
    """Rebuild the options from the JSON of `as_json`."""
    values = dict(document["options"])
    values["record"] = tuple(values["record"])
    values["trusted"] = values["trusted"] and frozenset(values["trusted"])
    return Options(**values)


def sets_of(options: Options) -> list[str]:
    """Return the `--set` arguments for `sets` and `values`, each parameter once.

    A value in `values` is applied after `sets`, so it replaces one in `sets`.
    """
    later = [f"{name}={_as_text(value)}" for name, value in options.values.items()]
    earlier = [x for x in options.sets if _name_of(x) not in options.values]
    return earlier + later


def with_assignment(options: Options, text: str) -> Options:
    """Return options in which `NAME=VALUE` replaces values of that parameter."""
    name = _name_of(text)
    sets = [x for x in options.sets if _name_of(x) != name]
    values = {key: value for key, value in options.values.items() if key != name}
    return replace(options, sets=[*sets, text], values=values)


def _name_of(assignment: str) -> str:
    """Return the name of the parameter that an assignment sets."""
    return assignment.partition("=")[0].strip()


def _as_text(value: Any) -> str:
    """Format a value as on the command line."""
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_as_text, value))}]"
    if isinstance(value, bool):
        return str(value).lower()
    return value if isinstance(value, str) else str(value)


def as_arguments(options: Options) -> str:
    """Format the options that differ from their defaults as a command line.

    Each option follows a blank, and `values` are written as `--set`. The file of
    trusted hashes is no longer known: FILE stands for it.
    """
    assignments = [("set", x) for x in sets_of(options)]
    for f in fields(options):
        value, option = getattr(options, f.name), _option_of(f)
        if not option or value in (f.default, [], {}):
            continue
        if value is True:
            assignments.append((option, ""))
        elif isinstance(value, Mapping):
            assignments += [(option, f"{name}={x}") for name, x in value.items()]
        elif isinstance(value, (list, tuple)):
            assignments += [(option, x) for x in value]
        else:
            assignments.append((option, "FILE" if f.name == "trusted" else str(value)))
    texts = (
        f" --{name} {shlex.quote(text)}" if text else f" --{name}"
        for name, text in assignments
    )
    return "".join(texts)


def _option_of(declared: Field[Any]) -> str:
    """Return the option of `run` that sets a field of `Options`; empty if none does."""
    option: str = declared.metadata.get("option", declared.name.replace("_", "-"))
    return option


ALGORITHMS: tuple[Algorithm, ...] = get_args(Algorithm)
_CHOICES = {"fmus": Fmus, "loop": Loop, "isolate": Isolate}
_ORBITS = re.compile(r"\s*(\d+\.?\d*|\.\d+)\s*orbits?\s*")


def orbits(text: str) -> float | None:
    """Parse a stop time in orbits: `1orbit`, `2.5 orbits`.

    The result is None for any other text.
    """
    match = _ORBITS.fullmatch(text)
    return float(match[1]) if match and float(match[1]) > 0.0 else None


_TIMES = ("stop", "step", "time_limit", "call_limit", "checkpoint")


class RunOptions(TypedDict, total=False):
    """Fields of `Options` that a program may give by name.

    Those that are separate arguments (`stop`, `step`, `sets`, `values`) are left out.
    """

    sources: list[str] | Mapping[str, str]
    substeps: Substeps | None
    accuracy: float | None
    algorithm: Algorithm
    solve_loops: bool
    blocks: bool
    fmus: Fmus
    record: tuple[str, ...]
    every: int
    shortens: bool
    output_classes: Mapping[str, Any]
    design: str | None
    trusted: frozenset[str] | None
    outside: bool
    strict: bool
    time_limit: float | None
    loop: Loop
    supervised: bool
    call_limit: float
    isolate: Isolate
    halvings: int
    checkpoint: float | None


RESOLVED = {"aside": "in the resolved system"}
SAME_BITS = {"aside": "the same bits"}
PERMISSION = {"aside": "whether it runs at all"}
ENDS = {"aside": "ends a run that takes long; it is then not completed"}
NO_OPTION = {"option": ""}  # set by no option of `run`, or by `--set`
# Reasons why a field of `Options` is in no digest (`digest.py`); with COUNTS it is in one.
COUNTS = {"aside": ""}


@dataclass
class Options:
    """Changes to a run that the command line allows."""

    sets: list[str] = field(default_factory=list, metadata=RESOLVED | NO_OPTION)
    sources: list[str] = field(
        default_factory=list, metadata=RESOLVED | {"option": "source"}
    )
    """`component=FMU`: a file, or a name of ours, to replace a component."""
    stop: float | str | None = field(default=None, metadata=RESOLVED)
    """Stop time (s), or a number of orbits: "2 orbits" (`runs/prepare.py`,
    `with_stop`)."""
    step: float | None = field(default=None, metadata=RESOLVED)
    substeps: Substeps | None = field(default=None, metadata=RESOLVED)
    """Substeps within each step (`system/schedule.py`); `auto`: chosen by the run."""
    accuracy: float | None = field(default=None, metadata=RESOLVED)
    """Upper bound of the attitude error (rad) for `auto`."""
    algorithm: Algorithm = field(default="gauss_seidel", metadata=COUNTS)
    solve_loops: bool = field(default=False, metadata=COUNTS)
    """Whether algebraic loops are solved at each communication point."""
    blocks: bool = field(default=False, metadata=SAME_BITS)
    fmus: Fmus = field(default="native", metadata=SAME_BITS)
    """Which of our FMUs run, with the same bits. Without a native one Python's runs."""
    record: tuple[str, ...] = field(
        default=("*",),
        metadata={"aside": "which series are kept; what numbers are made of is"},
    )
    every: int = field(default=1, metadata=COUNTS)
    shortens: bool = field(
        default=False,
        metadata={"aside": "which rows are kept; numbers are made of all"} | NO_OPTION,
    )
    """Whether the file of a long run keeps some rows, and extremes between them."""
    output_classes: Mapping[str, Any] = field(
        default_factory=dict, metadata=RESOLVED | {"option": "output-class"}
    )
    values: Mapping[str, Any] = field(
        default_factory=dict, metadata=RESOLVED | NO_OPTION
    )
    """`component.variable` -> value, besides `sets`, for programs that call this."""
    design: str | None = field(default=None, metadata=RESOLVED)
    """File with another [design] than the scenario's, or `now`: for these values."""
    trusted: frozenset[str] | None = field(
        default=None, metadata=PERMISSION | {"option": "trust"}
    )
    """sha256 of the FMUs that may run besides ours; None: all may."""
    outside: bool = field(
        default=False, metadata=PERMISSION | {"option": "allow-outside"}
    )
    """Whether an SSP may name files outside its folder."""
    strict: bool = field(default=False, metadata=PERMISSION)
    """Whether to refuse a foreign FMU whose model description violates the standard."""
    time_limit: float | None = field(default=None, metadata=ENDS)
    """Wall time (s) that stepping may take; the run ends between two steps."""
    loop: Loop = field(default="compiled", metadata=SAME_BITS)
    """The stepping loop; the compiled one is used only if it is available."""
    supervised: bool = field(default=False, metadata=SAME_BITS | NO_OPTION)
    """Whether to run in a separate process, if the platform allows it (POSIX)."""
    call_limit: float = field(default=300.0, metadata=ENDS)
    """Wall time (s) that a call of a supervised or isolated component may take."""
    isolate: Isolate = field(default="foreign", metadata=SAME_BITS)
    """Which FMUs run in a process each, if the platform allows it (POSIX)."""
    halvings: int = field(default=0, metadata=COUNTS | {"option": "halve"})
    """Maximum number of times that a step which a foreign FMU discards is halved."""
    checkpoint: float | None = field(default=None, metadata=SAME_BITS)
    """Simulated time (s) between checkpoints, from which `runs/run.py` resumes."""

    @property
    def breaks_loops(self) -> bool:
        """Return whether outputs may depend on each other in a cycle."""
        return self.solve_loops or self.algorithm == "jacobi"

    def __post_init__(self) -> None:
        """Raise DesatError if a choice or a time given by a program is invalid."""
        for name, choices in _CHOICES.items():
            if (value := getattr(self, name)) not in get_args(choices):
                raise DesatError(
                    f"{name} = {value!r}: there is {', '.join(get_args(choices))}"
                )
        for name in _TIMES:
            value = getattr(self, name)
            if name == "stop" and isinstance(value, str) and orbits(value):
                continue
            if value is not None and (
                not isinstance(value, int | float) or isinstance(value, bool)
            ):
                raise DesatError(f"{name} = {value!r}: a time in s is needed")
        is_integer = isinstance(self.substeps, int) and not isinstance(
            self.substeps, bool
        )
        if self.substeps not in (None, AUTO) and not (
            is_integer and 1 <= self.substeps <= MOST_SUBSTEPS
        ):
            raise DesatError(
                f"substeps = {self.substeps!r}: {AUTO} is needed, or an integer from "
                f"1 to {MOST_SUBSTEPS}"
            )
        is_angle = isinstance(self.accuracy, Real) and (
            0.0 < float(self.accuracy) <= MOST_ACCURACY
        )
        if self.accuracy is not None and not is_angle:
            raise DesatError(
                f"accuracy = {self.accuracy!r}: an angle above 0 rad is needed, "
                f"{MOST_ACCURACY:g} rad at most"
            )
