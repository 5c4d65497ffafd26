"""Translate a whole block to C99.

The source holds the block's functions for the types that they are called with, its
fields, its tables, and the description of its variables that the FMI wrapper needs.
"""

from __future__ import annotations

import ast
import inspect
import re
import typing
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from desat.components.contract.block import Block

from .expressions import UnknownYetError
from .function import Translation
from .order import fields_changed
from .source import Info, Nested, Spec
from .types import (
    BLOCK,
    NEVER,
    NONE,
    PREFIX,
    B,
    Callee,
    F,
    Function,
    I,
    List,
    Maybe,
    Names,
    Scalar,
    SubsetError,
    Tuple,
    Type,
    safe,
)
from .value import c_text, constant, number, uniform_constant

# folder of the modules that translate; a user's own block file translates too
COMPONENTS = Path(__file__).resolve().parents[2] / "components"
PASSES = 24
ENTRIES = {"start": (), "output": (F,), "advance": (F, F)}
KINDS = {"Real": F, "Integer": I, "Boolean": B}


def translate(block: type[Block], name: str, guid: str) -> str:
    """Translate a block to C.

    Parameters
    ----------
    block
        Class of the block.
    name
        Name of the FMU, which the C gives as its own.
    guid
        GUID of the FMU.

    Returns
    -------
    str
        C99 source of the block.

    Raises
    ------
    SubsetError
        If the block leaves the subset.
    """
    return Program(block).text(name, guid)


class Program:
    """Translation of a block.

    It makes passes over all functions that the block calls until no type changes.
    """

    def __init__(self, block: type[Block]) -> None:
        """Translate a block: declare its variables, then settle the types."""
        self.block = block
        self.file = Path(inspect.getfile(block)).resolve()
        self.declared_types: dict[str, Type] = {}
        self.field_bounds: dict[str, tuple[int | None, int | None]] = {}
        for v in block.variables:
            t: Type = KINDS[v.type]
            if v.type == "Integer":
                within = v.causality == "parameter" and v.minimum is not None
                self.field_bounds[v.name] = (
                    int(v.minimum) if within and v.minimum is not None else -(2**31),
                    int(v.maximum) if within and v.maximum is not None else 2**31 - 1,
                )
                if v.causality == "output":
                    del self.field_bounds[v.name]
            self.declared_types[v.name] = Tuple((t,) * v.size) if v.shape else t
        self.fields: dict[str, Type] = dict(self.declared_types)
        self.limits_needed: dict[str, int] = {}
        self.memory: dict[Any, Spec] = {}
        self.infos: dict[Any, Info] = {}
        self._nested_functions: dict[Any, Nested] = {}
        self.tables: dict[int, tuple[Any, str, str]] = {}
        self.table_names: dict[int, str] = {}
        self._translate()

    # --- passes -----------------------------------------------------------------------

    unsettled_name = ""

    def _translate(self) -> None:
        """Repeat passes over the block until types settle, or refuse it."""
        for _ in range(PASSES):
            self.types_changed = False
            self.names = Names()
            self.order: list[Spec] = []
            self.c_names: dict[str, int] = {}
            self.tables = {}
            self.later: UnknownYetError | None = None
            for spec in self.memory.values():
                spec.is_translated = spec.busy = False
            before = dict(self.fields)
            self.entries = [self._entry(name, types) for name, types in ENTRIES.items()]
            if (
                self.later is not None
                and not self.types_changed
                and before == self.fields
            ):
                raise self.later.reason
            if not self.types_changed and self.later is None:
                self._check_start()
                return
        raise SubsetError(
            f"{self.block.__name__}: the types of its variables do not settle: "
            f"{self.unsettled_name}"
        )

    def _check_start(self) -> None:
        """Refuse a field that may be read before it is assigned; in C it would be 0."""
        start_fields = fields_changed(self.block, "start")
        for name in self.fields:
            if name not in self.declared_types and f"self.{name}" not in start_fields:
                node = self.infos[self.block.start, True].node
                place = self.infos[self.block.start, True].place
                raise SubsetError(
                    f"{place}:{node.lineno}: start does not assign self.{name}: "
                    "assign it there"
                )

    def _entry(self, name: str, types: tuple[Type, ...]) -> Spec:
        """Specialise one of the block's entry methods for its argument types."""
        callee = Callee(getattr(self.block, name), is_method=True)
        try:
            return self.specialise(callee, types, (None,) * len(types), None)
        except UnknownYetError:
            return self.memory[callee, types, ("None",) * len(types)]

    def _display_path(self, path: Path) -> str:
        """Return a file's name for messages and comments, or "".

        It is "" for a file that does not translate.
        """
        if path.is_relative_to(COMPONENTS):
            return path.relative_to(COMPONENTS.parent).as_posix()
        return path.name if path == self.file else ""

    def info(self, callee: Callee) -> Info:
        """Return the declarations of a function."""
        key = (callee.function, callee.is_method)
        if key not in self.infos:
            function = getattr(callee.function, "__wrapped__", callee.function)
            display_path = ""
            if not isinstance(function, Nested):
                display_path = self._display_path(
                    Path(function.__code__.co_filename).resolve()
                )
                if not display_path:
                    raise SubsetError(
                        f"{self.block.__name__}: {function.__name__} of "
                        f"{function.__code__.co_filename}: functions of "
                        f"components/, or of {self.file.name}"
                    )
            self.infos[key] = Info(callee, display_path)
        return self.infos[key]

    def nested_function(self, node: ast.FunctionDef, spec: Spec) -> Nested:
        """Return a function within another one, the same object in every pass."""
        return self._nested_functions.setdefault(
            (id(node), spec.key), Nested(node, spec)
        )

    def specialise(
        self,
        callee: Callee,
        types: tuple[Type, ...],
        consts: tuple[Any, ...],
        caller: Any,
    ) -> Spec:
        """Return a function for these argument types, translating it if needed.

        It is translated at most once per pass.
        """
        info = self.info(callee)
        key = (callee, types, tuple(map(repr, consts)))
        if key not in self.memory:
            owner = None
            if callee.is_method:
                owner = next(
                    c for c in self.block.__mro__ if callee.function in vars(c).values()
                )
            self.memory[key] = Spec(key, info, callee, types, consts, owner, "")
        spec = self.memory[key]
        if spec.busy:
            spec.recursive = True
            spec.effects = spec.effects or callee.is_method
            return spec
        if not spec.is_translated:
            self._pass(spec)
        return spec

    def _pass(self, spec: Spec) -> None:
        """Translate a function until its variable types settle within this pass."""
        spec.busy = True
        spec.name = self._name(spec)
        before = (spec.result, spec.effects)
        try:
            for _ in range(PASSES):
                hoisted_names = set(spec.hoisted_names)
                one = Translation(spec, self)
                one.declared_names |= spec.hoisted_names
                one.copy_widened_parameters()
                flow_ended = one.block(spec.node.body)
                spec.effects = (
                    spec.effects
                    or one.effects
                    or bool(spec.changed_in_place & {n for n, _ in spec.arguments})
                )
                if not flow_ended:
                    spec.give(NONE, one, spec.node)
                if not one.types_changed and hoisted_names == spec.hoisted_names:
                    break
            for name, calls in one.kept_of.items():
                if calls > 1 or name in one.reached_memos:
                    construct = (
                        f"{name} is called again, which keeps but its last result"
                    )
                    raise one.refuse(
                        spec.node, construct, "a function of its own for each call"
                    )
            spec.reached_memos = one.reached_memos | set(one.kept_of)
            spec.is_translated = True
            spec.lines = one.out
            spec.end_reached = not flow_ended
            self.order.append(spec)
        except UnknownYetError as later:
            self.later = self.later or later
            raise
        except (
            SubsetError
        ) as reason:  # a type that becomes known later may remove the reason
            self.later = self.later or UnknownYetError(reason)
            raise self.later from None
        finally:
            spec.busy = False
        if before != (spec.result, spec.effects):
            self.unsettled_name = f"what {spec.info.name} returns"
            self.types_changed = True

    def _name(self, spec: Spec) -> str:
        """Choose a unique C name for a function."""
        stem = Path(spec.place).stem
        name = spec.info.name.strip("_")
        if isinstance(spec.callee.function, Nested):
            stem = spec.callee.function.spec.name
        base = f"{PREFIX}{stem.removeprefix(PREFIX)}_{name}"
        self.c_names[base] = self.c_names.get(base, 0) + 1
        n = self.c_names[base]
        return base if n == 1 else f"{base}_{n}"

    def most_of(self, annotation: ast.expr, scope: dict[str, Any]) -> int | None:
        """Return MOST of `Annotated[tuple[...], MOST]`, or None."""
        if "Annotated" not in ast.unparse(annotation):
            return None
        thing = eval(
            compile(ast.Expression(annotation), "annotation", "eval"), dict(scope)
        )
        for x in (thing, *typing.get_args(thing)):
            if typing.get_origin(x) is typing.Annotated:
                limits = [m for m in x.__metadata__ if isinstance(m, int)]
                if limits:
                    return limits[0]
        return None

    # --- tables -----------------------------------------------------------------------

    def table(self, const: Any, t: Type) -> str | None:
        """Return the C name of a constant table, or None where its rows differ."""
        if uniform_constant(const) != t or not isinstance(t, Tuple):
            return None
        key = id(const)
        if key not in self.tables:
            name = PREFIX + self.table_names.get(key, "table")
            taken_names = {n for _, n, _ in self.tables.values()}
            k = 1
            unique = name if key in self.table_names else f"{name}_of_1"
            while unique in taken_names:
                k += 1
                unique = f"{name}_of_{k}"
            text = f"static const {self.names(t)} {unique} = {initial(const, t)};"
            self.tables[key] = (const, unique, text)
        return self.tables[key][1]

    # --- text -------------------------------------------------------------------------

    def text(self, name: str, guid: str) -> str:
        """Return the C source of the block."""
        lines = [
            f"/* {name}: {(inspect.getdoc(self.block) or name).splitlines()[0]}",
            "",
            f"   Translated from {self._display_path(self.file)}; change that, not this.",
            "*/",
            '#include "block.h"',
            "",
            f"typedef struct {BLOCK} {BLOCK};",
        ]
        state = [
            (n, t)
            for n, t in self.fields.items()
            if n not in self.declared_types and not _is_nothing(t)
        ]
        for _, t in (*self.declared_types.items(), *state):
            self.names(t)
        functions: list[str] = []
        for spec in self.order:
            functions += ["", *self.function(spec)]
        lines += [*self.names.definitions, ""]
        lines += [f"struct {BLOCK} {{", "    const char *instance;"]
        for v in self.block.variables:
            comment = f"{v.unit}: {v.description}".replace("*/", "* /")
            lines.append(
                f"    {self.names(self.declared_types[v.name])} {safe(v.name)}; /* {comment} */"
            )
        lines += [f"    {self.names(t)} {safe(n)};" for n, t in state]
        lines += ["};", ""]
        lines += [text for _, _, text in self.tables.values()]
        lines += [f"{self.head(s)};" for s in self.order if s.recursive]
        lines += functions
        lines += ["", *self.description(name, guid)]
        return "\n".join(lines) + "\n"

    def head(self, spec: Spec) -> str:
        """Return the C declaration of a function."""
        arguments = []
        if spec.takes_self:
            arguments.append(f"{BLOCK} *self")
        if spec.callee.captures:
            arguments.append(f"const {self.names(Function((spec.callee,)))} *all")
        for k, (n, t) in enumerate(spec.arguments):
            if spec.consts[k] is not None:
                continue
            if (
                isinstance(t, Function)
                and len(t.callees) == 1
                and not t.callees[0].captures
            ):
                continue
            passing = spec.passing(k)
            text = self.names(t)
            const = "" if passing == "change" or text.startswith("const") else "const "
            star = "" if passing == "value" else "*"
            if passing == "value":
                const = ""
            suffix = "_given" if spec.variables.get(n, t) != t else ""
            arguments.append(f"{const}{text} {star}{safe(n)}{suffix}")
        result = spec.result
        kind = "void" if result in (NONE, NEVER) else self.names(result)
        if spec.memo:
            kind = f"const {kind} *"
        # not inlined: its lists, or the result before it is kept, would stay on the stack
        # while the caller runs
        apart = "PY_APART " if spec.changed_in_place or spec.memo else ""
        return f"static {apart}{kind} {spec.name}({', '.join(arguments) or 'void'})"

    def function(self, spec: Spec) -> Iterable[str]:
        """Yield the lines of a function in C, with its docstring as a comment."""
        yield from self._comment_lines(spec)
        yield self.head(spec)
        yield "{"
        if spec.self_captured:
            yield f"    {BLOCK} *self = all->self;"
        if spec.memo:
            yield from self._memo_lines(spec)
        for n in sorted(spec.hoisted_names):
            t = spec.variables[n]
            if not _is_nothing(t):
                zero = "0" if isinstance(t, Scalar) else "{0}"
                yield f"    {self.names(t)} {safe(n)} = {zero};"
        if spec.recursive:
            yield "    py_recursion();"
        yield from self._unused_argument_lines(spec)
        yield from spec.lines
        if spec.end_reached and spec.result not in (NONE, NEVER):
            yield f"    return ({self.names(spec.result)}){{0}};"
        yield "}"

    def _comment_lines(self, spec: Spec) -> Iterable[str]:
        """Yield the comment above a function: its place in Python and its docstring."""
        doc = ast.get_docstring(spec.node)
        place = f"{spec.place}:{spec.node.lineno}"
        if doc:
            text = doc.replace("*/", "* /").splitlines()
            yield f"/* {place}"
            yield from (f"   {line}".rstrip() for line in text)
            yield "*/"
        else:
            yield f"/* {place} */"

    def _memo_lines(self, spec: Spec) -> Iterable[str]:
        """Yield the lines that return the last result if the arguments are the same."""
        members = " ".join(f"{self.names(t)} {safe(n)};" for n, t in spec.arguments)
        kind = self.names(spec.result)
        yield f"    static PY_THREAD struct {{ bool known; {members} {kind} value; }} memo;"
        same = " && ".join(f"memo.{safe(n)} == {safe(n)}" for n, _ in spec.arguments)
        yield f"    if (memo.known && {same})"
        yield "        return &memo.value;"
        yield "    memo.known = false;"
        for n, _ in spec.arguments:
            yield f"    memo.{safe(n)} = {safe(n)};"

    def _unused_argument_lines(self, spec: Spec) -> Iterable[str]:
        """Yield a line for each argument that the C does not use, against a warning."""
        if spec.takes_self and not _stands("self", spec.lines):
            yield "    (void)self;"
        for k, (n, _) in enumerate(spec.arguments):
            if spec.consts[k] is None and not _stands(safe(n), spec.lines):
                t = spec.types[k]
                if not (isinstance(t, Function) and not t.callees[0].captures):
                    yield f"    (void){safe(n)};"

    def description(self, name: str, guid: str) -> Iterable[str]:
        """Yield the start values, the table of variables and the entry functions."""
        yield f"static const {BLOCK} {PREFIX}at_start = {{"
        for v in self.block.variables:
            yield f"    .{safe(v.name)} = {initial(v.start, self.declared_types[v.name])},"
        yield "};"
        yield ""
        yield f"static const block_variable {PREFIX}variables[] = {{"
        for v in self.block.variables:
            kind, cause = v.type[0], v.causality[0]
            low, high = (
                ("NAN", "None") if x is None else (number(float(x)), repr(x))
                for x in (v.minimum, v.maximum)
            )
            for k, element in enumerate(v.elements()):
                at = f"offsetof({BLOCK}, {safe(v.name)})"
                at += f" + {k} * sizeof({self.names(KINDS[v.type])})" if k else ""
                yield (
                    f"    {{{c_text(element)}, {at}, '{kind}', '{cause}', {low[0]}, {high[0]}, "
                    f"{c_text(f'[{low[1]}, {high[1]}]')}}},"
                )
        yield "};"
        yield ""
        for spec, (entry, types) in zip(self.entries, ENTRIES.items(), strict=True):
            parameter_text = "".join(f", double {n}" for n in ("t", "dt")[: len(types)])
            arguments = "".join(f", {n}" for n in ("t", "dt")[: len(types)])
            yield f"static void {PREFIX}do_{entry}(void *self{parameter_text})"
            yield "{"
            yield f"    {spec.name}(self{arguments});"
            yield "}"
            yield ""
        yield f"const block_description {PREFIX}the_block = {{"
        yield f"    .name = {c_text(name)}, .guid = {c_text(guid)},"
        table = f"{PREFIX}variables"
        yield f"    .size = sizeof({BLOCK}), .at_start = &{PREFIX}at_start,"
        yield f"    .variables = {table}, .count = sizeof {table} / sizeof *{table},"
        yield f"    .fault = offsetof({BLOCK}, fault),"
        yield "    " + " ".join(f".{entry} = {PREFIX}do_{entry}," for entry in ENTRIES)
        yield "};"


def initial(x: Any, t: Type) -> str:
    """Format a constant as a C initialiser."""
    if isinstance(t, Tuple):
        inside = ", ".join(initial(e, k) for e, k in zip(x, t.items, strict=True))
        return f"{{{{{inside}}}}}" if t.uniform else f"{{{inside}}}"
    if t == F:
        return number(float(x))
    value = constant(x)
    assert value is not None
    return value.code


def _stands(name: str, lines: Iterable[str]) -> bool:
    """Return whether a name occurs in lines of C."""
    return any(re.search(rf"(?<![.>])\b{name}\b", line) for line in lines)


def _is_nothing(t: Type) -> bool:
    """Return whether a type has no value to store."""
    return (
        t in (NONE, NEVER)
        or (isinstance(t, List) and t.item == NEVER)
        or (isinstance(t, Maybe) and _is_nothing(t.item))
    )
