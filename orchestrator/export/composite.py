"""Write a whole loop as one block in C: the operations of a master's plan.

The block's bytes are its own variables, the arrays that a master has (`live`, `fresh`,
inputs, windows, clocks), and after them the bytes of the blocks it consists of.
Initialisation, order, substeps and rates are those of the master, and so are the bits.
"""

from __future__ import annotations

import ctypes
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Any

import numpy as np

from desat.components.contract.block import Scalar
from desat.fmus.translate.value import c_text, number

from ..engine.instances.base import Array
from ..engine.master import Master
from ..engine.node import Node, Slot
from ..engine.operations import (
    Accumulate,
    Call,
    Gather,
    Length,
    Operation,
    Publish,
    Split,
    Tick,
)
from ..system.interface import KINDS, Kind, Signal

_TYPE: dict[Kind, str] = {"Real": "double", "Integer": "int32_t", "Boolean": "int32_t"}
# C type of a variable in a block
_OWN_TYPES: dict[Kind, str] = {
    "Real": "double",
    "Integer": "int64_t",
    "Boolean": "bool",
}


@dataclass(frozen=True)
class Scalars:
    """A variable of the loop: names, start values and origin of its elements."""

    name: str
    elements: tuple[str, ...]
    # by element, then component: the scalars that it stands for, several for a shared
    # parameter
    signals: tuple[tuple[tuple[str, Signal], ...], ...]
    starts: tuple[Scalar, ...]
    causality: str

    @property
    def kind(self) -> Kind:
        """Return the type of all its elements."""
        return self.signals[0][0][1].kind  # type: ignore[return-value]


class Composite:
    """C of an initialised master.

    `models` gives the block's name of each component in the loop. The outputs of all
    other components (`without`) are inputs of the loop, and their inputs its outputs.
    """

    def __init__(
        self,
        master: Master,
        models: Mapping[str, str],
        variables: Sequence[Scalars],
    ) -> None:
        self._master, self._models, self._variables = master, models, variables
        self._parts = {
            name: i for i, name in enumerate(n for n in master.members if n in models)
        }
        self._names = {name: f"in_{i}" for i, name in enumerate(master.members)}
        self._regions: list[tuple[int, int, int, str]] = []
        # body -> name of its function: equal operations share one
        self._functions: dict[str, str] = {}
        self._lay_out()

    # --- where the master's values are in the block -----------------------------------

    def _lay_out(self) -> None:
        """Assign a place in the block to each array of the master."""
        master, seen = self._master, set[int]()

        def add(array: Array, name: str, kind: str) -> str:
            """Register an array and return its C declaration, "" if empty or known."""
            at = int(array.ctypes.data)
            if not array.size or at in seen:
                return ""
            seen.add(at)
            self._regions.append(
                (at, at + array.nbytes, array.itemsize, f"self->{name}")
            )
            return f"{kind} {name.removeprefix('live.')}[{array.size}];"

        live = [add(master.live[k], f"live.{k[0].lower()}", _TYPE[k]) for k in KINDS]
        fields = [f"struct {{ {' '.join(filter(None, live))} }} live;"]
        for kind in KINDS:
            letter = kind[0].lower()
            fields += [
                add(master.memory()[f"fresh {kind}"], f"fresh_{letter}", _TYPE[kind]),
                add(master.row[kind], f"row_{letter}", _TYPE[kind]),
            ]
            for name, member in master.members.items():
                if kind in member.instance.inputs:
                    inputs = member.instance.inputs[kind]
                    fields.append(
                        add(inputs, f"{self._names[name]}_{letter}", _TYPE[kind])
                    )
        clocks = [x for k, x in master.memory().items() if k.startswith("clock ")]
        joins = [
            o.window
            for s in master.cycle
            for o in (*s.before, *s.after)
            if isinstance(o, Accumulate)
        ]
        clocks += [x for window in joins for x in (window.mean, window.slope)]
        fields += [add(array, f"kept_{i}", "double") for i, array in enumerate(clocks)]
        self._fields = [field for field in fields if field]

    def _at(self, of: Any) -> tuple[str, int]:
        """Return the block's array that holds a master's array, and its first index."""
        at = int(of.ctypes.data) if isinstance(of, np.ndarray) else ctypes.addressof(of)
        for first, end, size, name in self._regions:
            if first <= at < end:
                return name, (at - first) // size
        raise AssertionError("a value of the plan that the loop has not")

    def _element(self, of: Any, i: int = 0) -> str:
        """Return the C of element `i` of a master's array."""
        name, first = self._at(of)
        return f"{name}[{first + int(i)}]"

    def _variable(self, component: str, kind: str, reference: int) -> str:
        """Return the C of a variable of a part."""
        return f"DESAT_{kind.upper()}({self._parts[component]}, {reference})"

    # --- operations -------------------------------------------------------------------

    def _statements(self, operation: Operation) -> Iterator[str]:
        """Yield the C statements of an operation."""
        match operation:
            case Tick():
                for clock in operation.clocks:
                    k = f"((double)self->k + {number(operation.at)})"
                    step = number(operation.step)
                    yield f"{self._element(clock)} = self->start + {k} * {step};"
            case Length():
                yield f"{self._element(operation.of)} = {number(operation.value)};"
            case Gather():
                yield from self._gathered(operation)
            case Call():
                yield from self._called(operation)
            case Publish(live, fresh) if not fresh.size:
                pass
            case Publish(live, fresh):
                yield (
                    f"memcpy(&{self._element(live)}, &{self._element(fresh)}, {len(fresh)} * "
                    f"sizeof {self._element(live)});"
                )
            case Accumulate(window, i):
                yield from self._joined(window, i)
            case Split(part, i):
                yield from self._cut(part, i)
            case _:
                raise AssertionError(f"{type(operation).__name__} is not of a loop")

    def _gathered(self, g: Gather) -> Iterator[str]:
        """Yield the statements that gather inputs, converting units."""
        into = range(len(g.target)) if g.into is None else g.into.tolist()
        for k, (i, source) in enumerate(zip(into, g.index.tolist(), strict=True)):
            value = self._element(g.source, source)
            if g.conversion is not None:
                factor, offset = (number(float(x[k])) for x in g.conversion)
                value += f" * {factor} + {offset}"
            yield f"{self._element(g.target, i)} = {value};"

    def _called(self, call: Call) -> Iterator[str]:
        """Yield the statements of a call of an instance."""
        name = call.instance.name
        member = self._master.members[name]
        if name in self._parts:
            yield from getattr(self, f"_{call.verb}")(member)
        elif call.verb == "pull":
            yield from self._settings(member)

    def _push(self, member: Node) -> Iterator[str]:
        """Yield the statements that set a part's wired inputs."""
        signals, inputs = member.component.interface.signals, member.instance.inputs
        for kind, feeds in member.incoming.items():
            for i, (_, c) in enumerate(feeds):
                value = self._element(inputs[kind], i) + (
                    " != 0" if kind == "Boolean" else ""
                )
                target = self._variable(member.name, kind, signals[c.input].reference)
                yield f"{target} = {value};"

    def _opened(self, causality: str, name: str = "") -> Iterator[str]:
        """Yield the C statements that copy the loop's variables to its components.

        The variables are those of a causality. The components are the one of that
        `name`, or all without.
        """
        for n, v in enumerate(self._variables):
            if v.causality == causality:
                for i, of in enumerate(v.signals):
                    for component, signal in of:
                        if component in self._parts and name in ("", component):
                            target = self._variable(
                                component, signal.kind, signal.reference
                            )
                            yield f"{target} = self->v{n}[{i}];"

    def _step(self, member: Node) -> Iterator[str]:
        """Yield the statements that step a part."""
        yield from self._opened("input", member.name)
        state = self._master.memory()
        t, dt = (
            self._element(state[f"clock {member.every} {quantity}"])
            for quantity in ("t", "dt")
        )
        yield f"desat_stepped(c, {self._parts[member.name]}, {t}, {dt});"

    def _pull(self, member: Node) -> Iterator[str]:
        """Yield the statements that read a part's outputs."""
        for kind in KINDS:
            home = self._master.home(member, kind)
            for i, slot in enumerate(member.slots[kind]):
                value = self._variable(member.name, kind, slot.signal.reference)
                cast = "(int32_t)" if kind == "Integer" else ""
                yield f"{self._element(home, i)} = {cast}{value};"

    def _settings(self, member: Node) -> Iterator[str]:
        """Yield the statements that read the loop's inputs for an omitted component."""
        at = {
            (component, signal.name): f"self->v{n}[{i}]"
            for n, v in enumerate(self._variables)
            if v.causality == "input"
            for i, of in enumerate(v.signals)
            for component, signal in of
        }
        for kind in KINDS:
            home = self._master.home(member, kind)
            for i, slot in enumerate(member.slots[kind]):
                cast = "(int32_t)" if kind != "Real" else ""
                yield f"{self._element(home, i)} = {cast}{at[member.name, slot.signal.name]};"

    def _joined(self, window: Any, i: int) -> Iterator[str]:
        """Yield the statements that add part `i` to means and slopes over a step."""
        mean, slope, weights = window.mean, window.slope, window.weights[i]
        places = zip(
            window.source.means.tolist(), window.source.slopes.tolist(), strict=True
        )
        w, of_mean, of_slope = map(number, weights)
        for e, (m, s) in enumerate(places):
            a, b = self._element(mean, e), self._element(slope, e)
            if i == 0:
                yield f"{a} = {b} = 0.0;"
            of_m = self._element(window.live, m)
            of_s = self._element(window.live, s) if s >= 0 else "0.0"
            yield f"{a} += {w} * {of_m};"
            yield f"{b} += {of_mean} * {of_m} + {of_slope} * {of_s};"
        if i == len(window.weights) - 1:
            for e, (m, s) in enumerate(
                zip(
                    window.target.means.tolist(),
                    window.target.slopes.tolist(),
                    strict=True,
                )
            ):
                yield f"{self._element(window.into, m)} = {self._element(mean, e)};"
                if s >= 0:
                    yield f"{self._element(window.into, s)} = {self._element(slope, e)};"

    def _cut(self, part: Any, i: int) -> Iterator[str]:
        """Yield the statements that give part `i` of a step its means and slopes."""
        in_mean, in_slope = map(number, part.weights[i])
        source, target = part.source, part.target
        places = (source.means, source.slopes, target.means, target.slopes)
        for m, s, tm, ts in zip(*(x.tolist() for x in places), strict=True):
            of_s = self._element(part.live, s) if s >= 0 else "0.0"
            yield (
                f"{self._element(part.live, tm)} = {self._element(part.live, m)} + {in_mean} * "
                f"{of_s};"
            )
            if ts >= 0:
                yield f"{self._element(part.live, ts)} = {in_slope} * {of_s};"

    def _function(self, statements: Iterable[str], name: str) -> str:
        """Return the name of the function with these statements, "" without any."""
        text = "\n".join(f"    {line}" for line in statements)
        if not text:
            return ""
        if text not in self._functions:
            self._functions[text] = f"desat_do_{len(self._functions)}_{name}"
        return self._functions[text]

    def _calls(self, operations: Iterable[Operation]) -> Iterator[str]:
        """Yield the calls that run operations."""
        for operation in operations:
            kind = type(operation).__name__.lower()
            if isinstance(operation, Call):
                kind = f"{operation.verb}_{operation.instance.name}"
            if name := self._function(self._statements(operation), kind):
                yield f"    {name}(c);"

    # --- initialisation ---------------------------------------------------------------

    def _settling(self) -> Iterator[str]:
        """Yield the C statements of one exchange of values before the first step.

        As our master does in initialisation mode, each component in turn receives its
        inputs, computes its outputs and passes them on.
        """
        for name, member in self._master.members.items():
            gathers = member.gathers(
                self._master.live, lambda slot: True, started=False
            )
            yield from self._calls(gathers)
            if gathers and name in self._parts:
                push = self._function(self._push(member), f"push_{name}")
                yield f"    {push}(c);"
                yield f"    desat_begun(c, {self._parts[name]});"
            yield from self._pulled(member)

    def _pulled(self, member: Node) -> Iterator[str]:
        """Yield the calls that read a component's outputs and publish them at once."""
        pulled_values = (
            self._pull(member) if member.name in self._parts else self._settings(member)
        )
        if name := self._function(pulled_values, f"pull_{member.name}"):
            yield f"    {name}(c);"
        yield from self._calls(self._master.shown(member))

    def _parameters(self) -> Iterator[str]:
        """Yield the statements that set the parameters of all parts."""
        for name, i in self._parts.items():
            member = self._master.members[name]
            yield f"    desat_renewed(c, {i});"
            for key, value in self._master.parameters(member).items():
                signal = member.component.interface.signals[key]
                target = self._variable(name, signal.kind, signal.reference)
                shown = (
                    number(value) if isinstance(value, float) else str(value).lower()
                )
                if signal.kind == "Real":
                    shown = number(float(value))
                yield f"    {target} = {shown};"
        yield from (f"    {line}" for line in self._opened("parameter"))
        yield from (f"    {line}" for line in self._opened("input"))

    # --- text -------------------------------------------------------------------------

    def text(self, identifier: str, title: str) -> str:
        """Return the C source."""
        master, parts = self._master, list(self._parts)
        steps: list[list[str]] = [
            [*self._calls((*s.before, *s.after))] for s in master.cycle
        ]
        settling, shown = list(self._settling()), list(self._exported())
        final = [line for m in master.members.values() for line in self._pulled(m)]
        blocks = dict.fromkeys(self._models[n] for n in parts)
        lines = [
            f"/* {identifier}: {title}",
            "",
            f"   The components {', '.join(parts)}, and the operations of desat's master for a "
            "step, written out: generated, not to be changed. */",
            '#include "block.h"',
            "",
            "typedef struct desat_block desat_block;",
            f"enum {{ DESAT_PARTS = {len(parts)}, DESAT_LIVE = {len(master.live['Real'])}, "
            f"DESAT_STEPS = {len(steps)} }};",
            *(f"extern const block_description desat_{b}_block;" for b in blocks),
            "static const block_description *const desat_parts[DESAT_PARTS] = {",
            *(f"    &desat_{self._models[n]}_block," for n in parts),
            "};",
            "static const char *const desat_instances[DESAT_PARTS] = {",
            *(f"    {c_text(n)}," for n in parts),
            "};",
            "static const char *const desat_live_names[DESAT_LIVE] = {",
            *(
                f"    {c_text(f'{s.component}.{s.signal.name}')},"
                for s in master.slots
                if s.kind == "Real"
            ),
            "};",
            "",
            "struct desat_block {",
            "    const char *instance;",
            "    bool fault, begun;",
            "    int64_t k;",
            "    double start;",
            *(
                f"    {_OWN_TYPES[v.kind]} v{n}[{len(v.elements)}]; /* {v.name} */"
                for n, v in enumerate(self._variables)
            ),
            *(f"    {field}" for field in self._fields),
            "};",
            "",
            "static const desat_block desat_at_start = {",
            "    .fault = false,",
            *(
                f"    .v{n} = {{{', '.join(_text(x) for x in v.starts)}}},"
                for n, v in enumerate(self._variables)
                if v.causality != "output"
            ),
            "};",
            "",
            "static const block_variable desat_variables[] = {",
            "    {\"fault\", offsetof(desat_block, fault), 'B', 'o', NAN, NAN, \"\"},",
            *self._table(),
            "};",
            _ENGINE,
        ]
        for body, name in self._functions.items():
            lines += [
                f"static void {name}(desat_context *c)",
                "{",
                "    desat_block *self = c->self;",
                "    (void)self;",
                body,
                "}",
                "",
            ]
        for i, calls in enumerate(steps):
            lines += [
                f"static void desat_step_{i}(desat_context *c)",
                "{",
                *calls,
                "}",
                "",
            ]
        for name, statements in (
            ("desat_parameters", list(self._parameters())),
            ("desat_settling", settling),
            ("desat_ended", final),
            ("desat_shown", shown),
        ):
            lines += [
                f"static void {name}(desat_context *c)",
                "{",
                "    desat_block *self = c->self;",
                "    (void)self;",
                *statements,
                "}",
                "",
            ]
        lines += [
            "static void (*const desat_steps[DESAT_STEPS])(desat_context *) = {",
            *(f"    desat_step_{i}," for i in range(len(steps))),
            "};",
            "",
            f"#define DESAT_STEP {number(master.step_size)}",
            f"#define DESAT_PASSES {len(master.members) + 2}",
            _ENTRIES.replace("/*CLOCKS*/", "\n".join(self._clocks())).replace(
                "/*ROW*/", "\n".join(self._first_row())
            ),
            "const block_description desat_the_block = {",
            f'    .name = {c_text(identifier)}, .guid = "@GUID@",',
            "    .size = sizeof(desat_block), .at_start = &desat_at_start,",
            "    .parts = desat_parts, .part_count = DESAT_PARTS,",
            "    .variables = desat_variables,",
            "    .count = sizeof desat_variables / sizeof *desat_variables,",
            "    .fault = offsetof(desat_block, fault),",
            "    .start = desat_do_start, .output = desat_do_output, .advance = desat_do_advance,",
            "};",
        ]
        return "\n".join(lines) + "\n"

    def _first_row(self) -> Iterator[str]:
        """Yield the statements that set the row before the first step.

        There are none where the row is the live values.
        """
        for kind, live in self._master.live.items():
            if live is not self._master.row[kind] and live.size:
                row = self._element(self._master.row[kind])
                yield (
                    f"    memcpy(&{row}, &{self._element(live)}, {live.size} * sizeof {row});"
                )

    def _clocks(self) -> Iterator[str]:
        """Yield the statements that set the clocks before the first step."""
        state = self._master.memory()
        for member in {m.every: m for m in self._master.members.values()}.values():
            t, dt = (
                self._element(state[f"clock {member.every} {quantity}"])
                for quantity in ("t", "dt")
            )
            yield f"    {t} = t;"
            yield f"    {dt} = {number(self._master.length(member))};"

    def _table(self) -> Iterator[str]:
        """Yield the rows of the C table of variables."""
        for n, v in enumerate(self._variables):
            for i, (element, of) in enumerate(zip(v.elements, v.signals, strict=True)):
                s = of[0][1]
                bounds = (
                    (None, None) if v.causality == "output" else (s.minimum, s.maximum)
                )
                low, high = (
                    ("NAN", "None") if x is None else (number(float(x)), repr(x))
                    for x in bounds
                )
                yield (
                    f"    {{{c_text(element)}, offsetof(desat_block, v{n}) + {i} * "
                    f"sizeof({_OWN_TYPES[v.kind]}), '{v.kind[0]}', '{v.causality[0]}', {low[0]}, "
                    f"{high[0]}, {c_text(f'[{low[1]}, {high[1]}]')}}},"
                )

    def _exported(self) -> Iterator[str]:
        """Yield the statements that set the outputs of the loop.

        States are of the current time, interval values of the row.
        """
        places = {(s.component, s.signal.name): s for s in self._master.slots}
        for name, member in self._master.members.items():
            if name not in self._parts:
                yield from self._calls(
                    member.gathers(self._master.live, lambda slot: True, started=False)
                )
        for n, v in enumerate(self._variables):
            if v.causality != "output":
                continue
            for i, ((component, signal),) in enumerate(v.signals):
                if signal.causality == "input":  # of an omitted component
                    member = self._master.members[component]
                    feeds = member.incoming[v.kind]
                    k = next(
                        k for k, (_, c) in enumerate(feeds) if c.input == signal.name
                    )
                    value = self._element(member.instance.inputs[v.kind], k)
                else:
                    slot = places[component, signal.name]
                    of = self._master.row if slot.interval else self._master.live
                    value = self._element(of[v.kind], slot.index)
                expression = f"{value} != 0" if v.kind == "Boolean" else value
                yield f"    self->v{n}[{i}] = {expression};"


def depends(
    master: Master, without: Collection[str], variables: Sequence[Scalars]
) -> dict[str, set[str]]:
    """Return for each output of a loop the inputs it depends on within a step.

    The dependencies follow the graph of the master.
    """
    inputs = {
        (component, signal.name): v.name
        for v in variables
        if v.causality == "input"
        for of in v.signals
        for component, signal in of
    }
    reached = {name: set[str]() for name in master.members}
    for (component, _), name in inputs.items():
        if component not in without:
            reached[component].add(name)

    def of_slot(slot: Slot) -> set[str]:
        """Return the inputs of the loop that a slot depends on within a step."""
        if slot.component in without:
            return {inputs[slot.component, slot.signal.name]}
        return reached[slot.component] if slot.interval else set()

    for name, member in master.members.items():  # in stepping order
        for slot, _ in chain.from_iterable(member.incoming.values()):
            reached[name] |= of_slot(slot)
    slots = {(s.component, s.signal.name): s for s in master.slots}
    return {
        v.name: of_slot(_slot_of(v, master, slots))
        for v in variables
        if v.causality == "output"
    }


def _slot_of(
    variable: Scalars, master: Master, slots: Mapping[tuple[str, str], Slot]
) -> Slot:
    """Return the slot whose value an output of the loop has."""
    ((component, signal),) = variable.signals[0]
    if signal.causality != "input":
        return slots[component, signal.name]
    feeds = master.members[component].incoming[variable.kind]
    return next(slot for slot, c in feeds if c.input == signal.name)


def _text(x: Scalar) -> str:
    """Format a start value in C."""
    return (
        str(x).lower()
        if isinstance(x, bool)
        else number(x)
        if isinstance(x, float)
        else str(x)
    )


_ENGINE = """
typedef struct {
    desat_block *self;
    char *part[DESAT_PARTS];
    double t;
    bool failed[DESAT_PARTS];
    char said[400]; /* by the last part that failed to start */
} desat_context;

#define DESAT_AT(p, v) (c->part[p] + desat_parts[p]->variables[v].offset)
#define DESAT_REAL(p, v) (*(double *)DESAT_AT(p, v))
#define DESAT_INTEGER(p, v) (*(int64_t *)DESAT_AT(p, v))
#define DESAT_BOOLEAN(p, v) (*(bool *)DESAT_AT(p, v))

/* where the parts are, and their names, which are no part of a state */
static void desat_opened(desat_context *c, desat_block *self, double t)
{
    char *at = (char *)self + block_room(sizeof(desat_block));
    memset(c, 0, sizeof *c);
    c->self = self;
    c->t = t;
    for (int i = 0; i < DESAT_PARTS; i++) {
        c->part[i] = at;
        *(const char **)at = desat_instances[i];
        at += block_room(desat_parts[i]->size);
    }
}

static void desat_closed(desat_context *c)
{
    for (int i = 0; i < DESAT_PARTS; i++) *(const char **)c->part[i] = NULL;
}

static void desat_renewed(desat_context *c, int i)
{
    memcpy(c->part[i], desat_parts[i]->at_start, desat_parts[i]->size);
    *(const char **)c->part[i] = desat_instances[i];
}

static void desat_named(const char *instance, const char *what, const char *text)
{
    py_text_begin();
    py_text(instance);
    py_text(": ");
    py_text(what);
    py_text(*what ? ": " : "");
    py_text(text);
}

/* initialisation mode: the inputs may settle, so that a later start does not fail */
static void desat_begun(desat_context *c, int i)
{
    py_frame frame;
    if (PY_TRY(frame)) {
        desat_parts[i]->start(c->part[i]);
        desat_parts[i]->output(c->part[i], c->t);
        py_end_try();
        c->failed[i] = false;
    } else {
        c->failed[i] = true;
        desat_named(desat_instances[i], py_caught_name(), py_caught_text());
        strncpy(c->said, py_text_end(), sizeof c->said - 1);
    }
}

static void desat_stepped(desat_context *c, int i, double t, double dt)
{
    py_frame frame;
    if (PY_TRY(frame)) {
        desat_parts[i]->advance(c->part[i], t, dt);
        desat_parts[i]->output(c->part[i], t + dt);
        py_end_try();
        return;
    }
    desat_named(desat_instances[i], py_caught_name(), py_caught_text());
    py_raise(PY_BLOCK_ERROR, py_text_end());
}

static void desat_finite(const desat_block *self)
{
    double sum = 0.0;
    for (int i = 0; i < DESAT_LIVE; i++) sum += 0.0 * self->live.r[i];
    if (sum == 0.0) return;
    for (int i = 0; i < DESAT_LIVE; i++)
        if (!isfinite(self->live.r[i])) {
            py_text_begin();
            py_text(desat_live_names[i] != NULL ? desat_live_names[i] : "a mean");
            py_text(" = ");
            py_text_float(self->live.r[i]);
            py_raise(PY_BLOCK_ERROR, py_text_end());
        }
}
"""

_ENTRIES = """
static void desat_initialised(desat_context *c, double t)
{
    desat_block *self = c->self;
    char before[sizeof self->live];
    memset((char *)self + offsetof(desat_block, live), 0,
           sizeof(desat_block) - offsetof(desat_block, live));
    self->k = 0;
    self->start = t;
/*CLOCKS*/
    desat_parameters(c);
    for (int i = 0; i < DESAT_PARTS; i++) desat_begun(c, i);
    desat_ended(c);
    for (int pass = 0;; pass++) {
        if (pass == DESAT_PASSES) py_raise(PY_BLOCK_ERROR, "initialisation does not settle");
        memcpy(before, &self->live, sizeof before);
        desat_settling(c);
        if (memcmp(before, &self->live, sizeof before) == 0) break;
    }
    for (int i = 0; i < DESAT_PARTS; i++)
        if (c->failed[i]) py_raise(PY_BLOCK_ERROR, c->said);
    desat_ended(c);
    desat_finite(self);
/*ROW*/
    self->begun = true;
    desat_shown(c);
}

static void desat_do_start(void *self)
{
    ((desat_block *)self)->begun = false;
}

static void desat_do_output(void *self, double t)
{
    desat_context c;
    if (((desat_block *)self)->begun) return;
    desat_opened(&c, self, t);
    desat_initialised(&c, t);
    desat_closed(&c);
}

/* as many steps of the loop as there are in dt */
static void desat_do_advance(void *given, double t, double dt)
{
    desat_block *self = given;
    desat_context c;
    const double n = nearbyint(dt / DESAT_STEP);
    if (n < 1.0 || fabs(dt - n * DESAT_STEP) > 1e-6 * DESAT_STEP) {
        py_text_begin();
        py_text("a step of ");
        py_text_float(dt);
        py_text(" s, which is no multiple of ");
        py_text_float(DESAT_STEP);
        py_text(" s");
        py_raise(PY_RUNTIME_ERROR, py_text_end());
    }
    desat_opened(&c, self, t);
    for (int64_t i = 0; i < (int64_t)n; i++) {
        desat_steps[self->k % DESAT_STEPS](&c);
        self->k++;
        desat_finite(self);
    }
    desat_shown(&c);
    desat_closed(&c);
}
"""
