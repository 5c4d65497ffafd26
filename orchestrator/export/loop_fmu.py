"""Export the loop of a scenario as one native FMU (`desat export fmu`)."""

from __future__ import annotations

import re
import zipfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase
from importlib.metadata import version
from pathlib import Path

from desat.components.contract.block import Block, Scalar, Variable
from desat.fmus import fmi3, native
from desat.fmus.compiler import NoCompilerError
from desat.fmus.description import (
    DATE,
    documentation,
    licence,
    model_description,
)

from ..engine.master import Master
from ..files import io, library
from ..language.content import content_of
from ..runs import substep_choice
from ..runs.prepare import prepare
from ..system.errors import DesatError, nearest
from ..system.interface import KINDS, Signal
from ..system.model import Component, System
from ..system.options import Options
from ..system.schedule import schedule
from .composite import Composite, Scalars, depends


@dataclass(frozen=True)
class LoopEnds:
    """Variables of a loop that are visible from outside.

    Each is `component.variable`, where `*` and `?` match as in file names.
    """

    outputs: Sequence[str] = ()  # empty: those that the scenario plots
    inputs: Sequence[str] = ()  # inputs that nothing in the loop feeds
    parameters: Sequence[str] = ()  # also `shared.NAME`, in all components that have it
    # omitted components: their outputs become inputs, their inputs outputs
    without: Sequence[str] = field(default=())
    reals: bool = False  # Real outputs alone, for hosts that know no other type


def export(
    target: str,
    options: Options,
    ends: LoopEnds,
    file: Path | None,
    platforms: str = "",
    third: bool = False,
) -> Path:
    """Write a scenario's loop as one FMU and return its path.

    Parameters
    ----------
    target, options
        The scenario.
    ends
        Variables that are visible from outside.
    file
        Path of the FMU; default: NAME.fmu in the current folder.
    platforms
        As in `native.targets_of`.
    third
        Write FMI 3.0 instead of FMI 2.0.

    Raises
    ------
    DesatError
        If a component has no C, or a name is not of the loop.
    """
    if file is not None:
        io.place_of(file, "--out")
    try:
        targets = native.targets_of(platforms)
    except (NoCompilerError, ValueError) as error:
        raise DesatError(str(error)) from error
    case = prepare(target, options)
    system, _ = case.or_raise()
    choice = substep_choice.choose(target, system, options)
    system = system if choice is None else replace(system, substeps=choice.substeps)
    return _archive(system, ends, written_out(system, ends), file, targets, third)


@dataclass(frozen=True)
class LoopSource:
    """A loop as C."""

    identifier: str
    loop: str  # its own C, with `@GUID@` in place of the GUID
    blocks: dict[str, str]  # C of each block, by name
    variables: tuple[Scalars, ...]  # after `fault`, in this order
    interval: frozenset[str]  # names of the outputs that are interval outputs
    on: dict[str, set[str]]  # inputs that each output depends on within a step


def written_out(system: System, ends: LoopEnds) -> LoopSource:
    """Translate the loop of a checked system, whose substeps are chosen, to C.

    Raises
    ------
    DesatError
        If a component has no C, or a name is not of the loop.
    """
    for name in ends.without:
        if name not in system.components:
            raise DesatError(
                f"--without {name}: {system.name} has no such component"
                f"{nearest(name, system.components)}"
            )
    units = {
        name: _unit(c)
        for name, c in system.components.items()
        if name not in ends.without
    }
    outputs = _outputs_of(system, ends)
    watched = {(c, s.name) for c, s in outputs}
    with Master(
        system,
        schedule(system),
        watched=lambda name, signal: (name, signal.name) in watched,
    ) as master:
        master.initialise()
        variables = tuple(_variables(master, system, ends, outputs))
        identifier = re.sub(r"\W", "_", system.name, flags=re.ASCII)
        title = content_of(system.about).title or system.name
        composite = Composite(
            master, {n: model for n, (model, _) in units.items()}, variables
        )
        interval = {
            f"{s.component}.{s.signal.array}" for s in master.slots if s.interval
        }
        return LoopSource(
            identifier,
            composite.text(identifier, title),
            dict(units.values()),
            variables,
            frozenset(interval & {v.name for v in variables}),
            depends(master, ends.without, variables),
        )


def _archive(
    system: System,
    ends: LoopEnds,
    source: LoopSource,
    file: Path | None,
    targets: Sequence[native.Target],
    third: bool,
) -> Path:
    """Compile and pack the FMU of a loop and return its path."""
    identifier, variables, on = source.identifier, source.variables, source.on
    sources = {f"{model}.c": text for model, text in source.blocks.items()}
    sources |= {f"{identifier}.c": source.loop}
    block = _block(system, ends, variables, on)
    experiment = {
        "startTime": system.start,
        "stopTime": system.stop,
        "stepSize": system.step,
    }

    def described(guid: str) -> bytes:
        """Return the model description with this GUID."""
        return model_description(
            block,
            identifier,
            guid,
            DATE,
            version("desat"),
            sorted(sources),
            on,
            experiment,
        )

    files, guid = native.with_wrapper(sources, described(""))
    target = file or Path(f"{identifier}.fmu")
    try:
        with library.own_temporary_folder() as shared:
            native.compile_wrapper(shared, targets)
            page = documentation(block, identifier)
            archive = shared / "loop.fmu"
            native.assemble(
                files,
                identifier,
                described(guid),
                page,
                shared,
                archive,
                targets,
                licence(block),
            )
            if third:
                archive = fmi3.repack(
                    archive, block, shared / "loop3.fmu", on, experiment
                )
            io.replace_text(target, archive.read_bytes())
    except NoCompilerError as error:
        raise DesatError(str(error)) from error
    return target


def _unit(component: Component) -> tuple[str, str]:
    """Return the name and the C of a component's block, from its native FMU.

    Raises DesatError where it has none.
    """
    fmu, name = component.fmu, component.name
    instead = f"`--without {name}` leaves it out"
    if fmu is None or not fmu.ours:
        raise DesatError(
            f"{name}: {component.source} is no FMU of ours, whose C is known; {instead}"
        )
    model, stem = component.model, fmu.path.stem
    if library.sizes_in(stem)[1]:  # a block of ours of another length
        model = stem
    with zipfile.ZipFile(fmu.path) as archive:
        if f"sources/{model}.c" not in archive.namelist():
            raise DesatError(
                f"{name}: {model} is a block of Python without a translation to C; {instead}"
            )
        text = archive.read(f"sources/{model}.c").decode()
    return model, text.replace("desat_the_block", f"desat_{model}_block")


def _block(
    system: System,
    ends: LoopEnds,
    variables: Sequence[Scalars],
    on: dict[str, set[str]],
) -> type[Block]:
    """Return a block class that declares the variables of the loop."""
    content = content_of(system.about)
    without_text = f" without {', '.join(ends.without)}" if ends.without else ""
    substeps = f", {system.parts} substeps" if system.parts > 1 else ""
    doc = (
        f"{content.title or system.name}{without_text}\n\n{content.description}\n\nThe loop `{system.name}`"
        f"{without_text} in one FMU, in steps of {system.step!r} s{substeps}, or several of them: "
        f"{', '.join(c for c in system.components if c not in ends.without)}.\n"
    )
    loop: type[Block] = type("Loop", (Block,), {"__doc__": doc})
    inputs = tuple(v.name for v in variables if v.causality == "input")
    always = loop.variables
    if ends.reals:  # `fault` is still there, for hosts that read what is local
        always = tuple(replace(v, causality="local") for v in always)
    loop.variables = (*always, *(_declared(v, inputs, on) for v in variables))
    return loop


_OF_STEP = "after a step: of the step that has just ended"
_OF_END = "after a step: of its end"


def _declared(v: Scalars, inputs: tuple[str, ...], on: dict[str, set[str]]) -> Variable:
    """Declare a variable of the exported loop's FMU, as blocks declare theirs.

    `inputs` are the loop's inputs, from which its outputs start. `on` has the inputs on
    which each output depends.
    """
    signal = v.signals[0][0][1]
    index = v.elements[-1].removeprefix(v.name)
    low, high = (
        x if x is None or v.kind == "Real" else int(x)
        for x in (signal.minimum, signal.maximum)
    )
    shape = tuple(int(n) for n in index[1:-1].split(",")) if index else ()
    text = (
        signal.description.partition(": 0 = ")[0]
        if signal.choices
        else signal.description
    )
    if v.causality == "output":
        text += f"; {_OF_STEP if signal.output_class == 'interval' else _OF_END}"
    return Variable(
        v.name,
        v.causality,  # type: ignore[arg-type]
        v.kind,  # type: ignore[arg-type]
        shape,
        signal.unit_name or "1",
        text,
        v.starts if shape else v.starts[0],
        low,
        high,
        signal.choices,
        interval=bool(on.get(v.name)),
        starts_from=inputs if v.causality == "output" else (),
    )


# --- which variables ------------------------------------------------------------------


def _outputs_of(system: System, ends: LoopEnds) -> list[tuple[str, Signal]]:
    """Return the requested outputs, or those of the scenario's plots."""
    names = list(ends.outputs)
    if not names:
        plotted = dict.fromkeys(
            s for p in content_of(system.about).plots.values() for s in p.signals
        )
        names = [n for n in plotted if n.partition(".")[0] in system.components]
        names = [n for n in names if n.partition(".")[0] not in ends.without]
    outputs = _matching(system, names, "output", "--outputs", ends.without)
    if not ends.reals:
        return outputs
    plain_names = {n for n in ends.outputs if not set(n) & set("*?[")}
    for component, signal in outputs:
        if signal.kind != "Real" and f"{component}.{signal.array}" in plain_names:
            raise DesatError(
                f"--reals: {component}.{signal.array} is of type {signal.kind}"
            )
    outputs = [(name, signal) for name, signal in outputs if signal.kind == "Real"]
    if not outputs:
        raise DesatError(f"--reals: {system.name} has no Real among these outputs")
    return outputs


def _matching(
    system: System,
    patterns: Sequence[str],
    causality: str,
    option: str,
    without: Sequence[str],
) -> list[tuple[str, Signal]]:
    """Return the scalars that names and patterns match, in order.

    Raises DesatError for one that matches none.
    """
    known_names = [
        (name, s)
        for name, c in system.components.items()
        if name not in without
        for s in c.interface.of(causality)
        if s.kind in KINDS and s.name != "fault"
    ]  # a failing part ends the loop, whose own `fault` reports it
    signals: dict[tuple[str, str], Signal] = {}
    for pattern in patterns:
        hits = [
            (n, s) for n, s in known_names if fnmatchcase(f"{n}.{s.array}", pattern)
        ]
        if not hits:
            names = dict.fromkeys(f"{n}.{s.array}" for n, s in known_names)
            raise DesatError(
                f"{option} {pattern}: {system.name} has no {causality} of this name"
                f"{nearest(pattern, names)}"
            )
        signals |= {(n, s.name): s for n, s in hits}
    return [(name, s) for (name, _), s in signals.items()]


def _of_kind(signal: Signal, number: float) -> Scalar:
    """Convert a number to the kind of a signal."""
    if signal.kind == "Real":
        return number
    return bool(number) if signal.kind == "Boolean" else int(number)


def _variables(
    master: Master, system: System, ends: LoopEnds, outputs: list[tuple[str, Signal]]
) -> Iterator[Scalars]:
    """Yield the variables of the loop, parameters last as in a block."""
    fed_inputs = {(c.target, c.input) for c in system.connections}
    live = {
        (s.component, s.signal.name): master.live[s.kind][s.index] for s in master.slots
    }
    inputs: list[tuple[str, Signal]] = []
    inputs_taken: list[tuple[str, Signal]] = []
    for name in ends.without:
        member = master.members[name]
        inputs += [(name, slot.signal) for of in member.slots.values() for slot in of]
        signals = member.component.interface.signals
        inputs_taken += [
            (name, signals[c.input]) for of in member.incoming.values() for _, c in of
        ]
    for name, signal in inputs_taken if ends.reals else ():
        if signal.kind != "Real":
            raise DesatError(
                f"--reals: {name}.{signal.array}, which --without makes an output, is of "
                f"type {signal.kind}"
            )
    open_ = _matching(system, ends.inputs, "input", "--inputs", ends.without)
    for name, signal in open_:
        if (name, signal.name) in fed_inputs:
            raise DesatError(
                f"--inputs {name}.{signal.array}: something in the loop feeds it"
            )

    def start(name: str, signal: Signal) -> Scalar:
        """Return the start value of a scalar."""
        if (name, signal.name) in live:
            value = live[name, signal.name].item()
        else:
            value = system.components[name].values[signal.name]
        return _of_kind(signal, float(value or 0))

    def grouped(of: list[tuple[str, Signal]], causality: str) -> Iterator[Scalars]:
        """Yield scalars grouped to arrays."""
        arrays: dict[str, list[tuple[str, Signal]]] = {}
        for name, signal in of:
            arrays.setdefault(f"{name}.{signal.array}", []).append((name, signal))
        for array, elements in arrays.items():
            elements.sort(key=lambda e: e[1].reference)
            yield Scalars(
                array,
                tuple(f"{n}.{s.name}" for n, s in elements),
                tuple(((n, s),) for n, s in elements),
                tuple(start(n, s) if causality != "output" else 0 for n, s in elements),
                causality,
            )

    yield from grouped([*inputs, *open_], "input")
    yield from grouped([*inputs_taken, *outputs], "output")
    plain = [p for p in ends.parameters if not p.startswith("shared.")]
    yield from grouped(
        _matching(system, plain, "parameter", "--parameters", ends.without),
        "parameter",
    )
    for pattern in ends.parameters:
        if pattern.startswith("shared."):
            yield _shared(system, pattern, ends.without, start)


def _shared(
    system: System,
    name: str,
    without: Sequence[str],
    start: Callable[[str, Signal], Scalar],
) -> Scalars:
    """Return a parameter that components share as one variable."""
    base = name.removeprefix("shared.")
    owners = [
        (n, c)
        for n, c in system.components.items()
        if n not in without
        and any(s.array == base and s.shared for s in c.interface.parameters)
    ]
    if not owners:
        known = {
            f"shared.{s.array}"
            for c in system.components.values()
            for s in c.interface.parameters
            if s.shared
        }
        raise DesatError(
            f"--parameters {name}: no component shares it{nearest(name, known)}"
        )
    first = sorted(
        owners[0][1].interface.elements.get(base, ()), key=lambda s: s.reference
    )
    return Scalars(
        name,
        tuple(f"shared.{s.name}" for s in first),
        tuple(
            tuple((n, c.interface.signals[s.name]) for n, c in owners) for s in first
        ),
        tuple(start(owners[0][0], s) for s in first),
        "parameter",
    )
