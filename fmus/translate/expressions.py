"""Translate expressions of the subset to C.

They are names, arithmetic, comparisons, tuples, indices and text.
"""

from __future__ import annotations

import ast
import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from types import BuiltinFunctionType, FunctionType, ModuleType
from typing import Any

from .types import (
    NEVER,
    NONE,
    Array,
    B,
    Callee,
    F,
    Function,
    I,
    JoinError,
    List,
    Maybe,
    S,
    Scalar,
    SubsetError,
    Tuple,
    Type,
    U,
    element,
    join,
    most,
    type_text,
)
from .value import (
    ADD,
    AND,
    AND_BITS,
    ATOM,
    COND,
    EQUAL,
    LESS,
    MUL,
    OR,
    OR_BITS,
    SHIFT,
    UNARY,
    UNKNOWN,
    XOR,
    Value,
    constant,
    uniform_constant,
)

MASK = (1 << 64) - 1
ARITHMETIC = {ast.Add: ("+", ADD), ast.Sub: ("-", ADD), ast.Mult: ("*", MUL)}
COMPARISONS = {
    ast.Eq: "==",
    ast.NotEq: "!=",
    ast.Lt: "<",
    ast.LtE: "<=",
    ast.Gt: ">",
    ast.GtE: ">=",
}
EXACT = 1 << 53


# Constructs that do not translate, and the replacement that the message suggests.
INSTEAD: dict[type[ast.expr], tuple[str, str]] = {
    ast.Dict: ("a dict", "a tuple and an index, or `if` for each key"),
    ast.DictComp: ("a dict", "a tuple and an index"),
    ast.Set: ("a set", "a tuple of truth values"),
    ast.SetComp: ("a set", "a tuple of truth values"),
    ast.Yield: ("yield", "return a tuple"),
    ast.YieldFrom: ("yield", "return a tuple"),
    ast.NamedExpr: (":=", "an assignment of its own line"),
}


class Known:
    """A Python object that exists only during translation.

    It is a module, a class, a function of the library, a range or a generator.
    """

    def __init__(self, thing: Any) -> None:
        self.thing = thing


class Expressions(ABC):
    """Translation of a function's expressions to C."""

    program: Any
    spec: Any
    out: list[str]
    level: int

    # --- places -----------------------------------------------------------------------

    def refuse(self, node: ast.AST, construct: str, instead: str) -> SubsetError:
        """Return a `SubsetError` that names the line and suggests a replacement."""
        line = getattr(node, "lineno", 0)
        return SubsetError(f"{self.spec.place}:{line}: {construct}: {instead}")

    def line(self, text: str) -> None:
        """Append a line of C at the current indentation."""
        self.out.append("    " * self.level + text)

    def temporary(self, value: Value, at: int | None = None, hint: str = "") -> Value:
        """Store the value in a C variable, so that its code may be repeated.

        The declaration is inserted at line `at` of the output, or appended where `at`
        is None. A value whose code may be repeated already is returned unchanged.
        """
        if value.again or value.type in (NONE, NEVER) or isinstance(value.type, Known):
            return value
        if value.parts is not None:
            parts = tuple(self.temporary(p, at) for p in value.parts)
            return replace(value, parts=parts, again=all(p.again for p in parts))
        name = self.fresh(hint or "part")
        text = f"const {self.program.names(value.type)} {name} = {self.code(value)};"
        text = text.replace("const const", "const")
        if at is None:
            self.line(text)
        else:
            self.out.insert(at, "    " * self.level + text)
        return replace(value, code=name, binds=ATOM, again=True, as_float=None)

    def fresh(self, hint: str) -> str:
        """Return a new C name that no local variable of the function has."""
        while True:
            self.counts[hint] = self.counts.get(hint, 0) + 1
            if (name := f"{hint}_{self.counts[hint]}") not in self.spec.locals_names:
                return name

    counts: dict[str, int]

    def in_order(self, nodes: Sequence[ast.expr | Callable[[], Value]]) -> list[Value]:
        """Evaluate expressions in their order and return their values.

        Where an expression needs statements first, earlier values that these could
        change are stored in temporaries before them.
        """
        values: list[Value] = []
        marks: list[int] = []
        for node in nodes:
            mark = len(self.out)
            value = node() if callable(node) else self.expression(node)
            if len(self.out) > mark:
                shift = 0
                for k, earlier in enumerate(values):
                    if (
                        earlier.is_const
                        or isinstance(earlier.type, Known)
                        or (earlier.again and self.is_fixed(earlier))
                    ):
                        continue
                    before = len(self.out)
                    pinned_value = self.pin_earlier(earlier, mark + shift)
                    shift += len(self.out) - before
                    values[k] = pinned_value
            values.append(value)
            marks.append(mark)
        return values

    def pin_earlier(self, value: Value, at: int) -> Value:
        """Store the value in a temporary at an earlier place `at` of the output."""
        if value.parts is not None:
            parts = []
            for p in value.parts:
                before = len(self.out)
                parts.append(
                    p if p.is_const or self.is_fixed(p) else self.pin_earlier(p, at)
                )
                at += len(self.out) - before
            return replace(value, parts=tuple(parts))
        return self.temporary(replace(value, again=False), at)

    def is_fixed(self, value: Value) -> bool:
        """Return whether no statement can change the value (constant or temporary)."""
        if value.parts is not None:
            return all(p.is_const or self.is_fixed(p) for p in value.parts)
        root = re.match(r"\w+", value.code)
        return root is not None and value.again and root[0] in self.temporaries

    @property
    def temporaries(self) -> set[str]:
        """Return the names of all temporaries that the translation has made."""
        temporaries = {
            f"{h}_{k}" for h, n in self.counts.items() for k in range(1, n + 1)
        }
        return temporaries.difference(self.spec.locals_names)

    # --- conversion -------------------------------------------------------------------

    def code(self, value: Value) -> str:
        """Return the C expression of a value of any type."""
        if value.parts is not None and not value.code:
            if value.is_const and len(value.parts) > 4:
                table: str | None = self.program.table(value.const, value.type)
                if table:
                    return table
            return self.compound_literal(value.type, value.parts)
        return value.code

    def compound_literal(self, t: Type, parts: Sequence[Value]) -> str:
        """Return the C compound literal of a tuple or list with these parts."""
        name = self.program.names(t)
        if isinstance(t, List):
            inside = ", ".join(self.convert(p, t.item) for p in parts)
            return (
                f"({name}){{{len(parts)}, {{{inside}}}}}" if parts else f"({name}){{0}}"
            )
        assert isinstance(t, Tuple)
        inside = ", ".join(
            self.convert(p, x) for p, x in zip(parts, t.items, strict=True)
        )
        return f"({name}){{{{{inside}}}}}" if t.uniform else f"({name}){{{inside}}}"

    def convert(self, value: Value, t: Type, node: ast.AST | None = None) -> str:
        """Return the C expression of a value, converted to type `t`.

        Statements that the conversion needs are appended to the output. A `SubsetError`
        is raised where the types do not agree.
        """
        v = value.type
        if isinstance(v, Known):
            raise self.refuse(
                node or self.spec.node,
                f"a {type(v.thing).__name__} as a value",
                "use it where it stands",
            )
        if v == t:
            return self.code(value)
        number_code = self._convert_number(value, t)
        if number_code is not None:
            return number_code
        if isinstance(t, Maybe):
            return self._convert_to_optional(value, t, node)
        if isinstance(v, Maybe):
            x = self.temporary(value)
            self.line(f"py_some({x.code}.some);")
            some = Value(v.item, f"{x.code}.v", again=True)
            return self.convert(some, t, node)
        if isinstance(t, (Tuple, List)) and isinstance(v, (Tuple, List, Array)):
            return self._convert_sequence(value, t, node)
        if isinstance(t, Function) and isinstance(v, Function) and len(v.callees) == 1:
            return f"({self.program.names(t)}){{{t.callees.index(v.callees[0])}}}"
        raise self.refuse(
            node or self.spec.node,
            f"{type_text(v)} where {type_text(t)} is needed",
            "keep to one type",
        )

    def _convert_number(self, value: Value, t: Type) -> str | None:
        """Return the C of a number as the wider type `t`, or None if it is none."""
        v = value.type
        if t == F and v in (I, B, U):
            if value.is_const:
                return constant(float(value.const)).code  # type: ignore[union-attr]
            return value.as_float or f"(double){value.within(UNARY)}"
        if t == I and v == B:
            return value.code
        if t == U and v == I:
            if value.is_const and value.const >= 0:
                return f"UINT64_C({value.const})"
            return f"py_mask({value.code})"
        return None

    def _convert_to_optional(self, value: Value, t: Maybe, node: ast.AST | None) -> str:
        """Return the C of a value, or of None, as a type that admits None."""
        v = value.type
        name = self.program.names(t)
        if v == NONE:
            return f"({name}){{0}}"
        if isinstance(v, Maybe):
            x = self.temporary(value)
            inner = Value(v.item, f"{x.code}.v", again=True)
            return f"({name}){{{x.code}.some, {self.convert(inner, t.item, node)}}}"
        return f"({name}){{true, {self.convert(value, t.item, node)}}}"

    def _convert_sequence(
        self, value: Value, t: Tuple | List, node: ast.AST | None
    ) -> str:
        """Return the C of a tuple or list as another tuple or list type."""
        v = value.type
        if isinstance(t, Tuple):
            if isinstance(v, List) and v.most == 0 and t.items:
                raise self.refuse(
                    node or self.spec.node, "an empty tuple here", "give its values"
                )
            parts = self.elements(value, len(t.items), node)
            if isinstance(v, Tuple) and v.items == t.items:
                return self.code(value)
            return self.compound_literal(t, parts)
        if isinstance(v, List):
            return self._copy_list(value, t, node)
        return self.compound_literal(t, self.elements(value, most(v), node))

    def _copy_list(self, value: Value, t: List, node: ast.AST | None) -> str:
        """Write a loop that converts each element; return the name of the copy."""
        v = value.type
        if v.item == NEVER or v.most == 0:
            return f"({self.program.names(t)}){{0}}"
        x = self.temporary(value)
        name = self.fresh("copy")
        self.line(f"{self.program.names(t)} {name} = {{0}};")
        self.line(f"{name}.n = py_length({x.code}.n, {t.most});")
        k = self.fresh("k")
        item = Value(v.item, f"{x.code}.e[{k}]", again=True)
        self.line(f"for (int64_t {k} = 0; {k} < {name}.n; {k}++)")
        self.line(f"    {name}.e[{k}] = {self.convert(item, t.item, node)};")
        return name

    def elements(
        self, value: Value, n: int, node: ast.AST | None = None
    ) -> list[Value]:
        """Return the `n` elements of a tuple or list.

        A `SubsetError` is raised where the length is known and differs from `n`. Where
        it is known only at run time, the C checks it.
        """
        t = value.type
        if isinstance(t, Maybe):
            return self.elements(self.some(value), n, node)
        if value.parts is not None:
            if len(value.parts) != n:
                raise self.refuse(
                    node or self.spec.node,
                    f"{len(value.parts)} values for {n}",
                    "give as many",
                )
            return list(value.parts)
        if not isinstance(t, (Tuple, List, Array)):
            raise self.refuse(
                node or self.spec.node, f"{type_text(t)} is taken apart", "a tuple"
            )
        if not isinstance(t, List) and most(t) != n:
            raise self.refuse(
                node or self.spec.node, f"{most(t)} values for {n}", "give as many"
            )
        x = self.temporary(value, hint="all")
        if isinstance(t, List):
            self.line(f"py_unpack({x.code}.n, {n});")
            return [Value(t.item, f"{x.code}.e[{k}]", again=True) for k in range(n)]
        return [self.element_at(x, k) for k in range(n)]

    def element_at(self, x: Value, k: int) -> Value:
        """Return element `k` of a tuple whose code may be repeated."""
        if x.parts is not None:
            return x.parts[k]
        t = x.type
        if isinstance(t, Tuple) and not t.uniform:
            return Value(t.items[k], f"{x.code}.x{k}", again=True)
        return Value(element(t), f"{x.code}.e[{k}]", again=True)

    def some(self, value: Value) -> Value:
        """Return the value inside an optional one.

        The C checks at run time that it is not None, unless the translation has shown
        that already.
        """
        if not isinstance(value.type, Maybe):
            return value
        x = self.temporary(value)
        self.line(f"py_some({x.code}.some);")
        return Value(value.type.item, f"{x.code}.v", again=x.again)

    def truth(self, value: Value, node: ast.AST) -> Value:
        """Return the truth of a value as a condition."""
        t = value.type
        if value.is_const:
            return constant(bool(value.const))  # type: ignore[return-value]
        if t == B:
            return value
        if t == NONE:
            return constant(False)  # type: ignore[return-value]
        if t == F:
            return Value(B, f"{value.within(EQUAL)} != 0.0", EQUAL)
        if t in (I, U):
            return Value(B, f"{value.within(EQUAL)} != 0", EQUAL)
        if isinstance(t, Maybe):
            x = self.temporary(value)
            if isinstance(t.item, (Tuple, Function)):
                return Value(B, f"{x.code}.some")
            inner = self.truth(Value(t.item, f"{x.code}.v", again=True), node)
            return Value(B, f"{x.code}.some && {inner.within(AND)}", AND)
        if isinstance(t, List):
            x = self.temporary(value)
            return Value(B, f"{x.code}.n != 0", EQUAL)
        if isinstance(t, (Tuple, Function)):
            return constant(True)  # type: ignore[return-value]
        raise self.refuse(node, f"{type_text(t)} as a condition", "compare it")

    # --- expressions ------------------------------------------------------------------

    def expression(self, node: ast.expr) -> Value:
        """Translate an expression; statements that it needs are appended to `out`."""
        method = getattr(self, f"_{type(node).__name__.lower()}", None)
        if method is None:
            raise self.refuse(
                node,
                *INSTEAD.get(
                    type(node),
                    (
                        type(node).__name__,
                        "what translates is listed in docs/translation.md",
                    ),
                ),
            )
        try:
            result: Value = method(node)
        except JoinError as error:
            raise self.refuse(node, str(error), "one type; 1.0 is a float") from None
        return result

    def _constant(self, node: ast.Constant) -> Value:
        value = constant(node.value)
        if value is None:
            raise self.refuse(
                node, repr(node.value), "numbers, truth values, text and None"
            )
        return value

    def _name(self, node: ast.Name) -> Value:
        """Return the value of a name: bound, local variable, or of the module."""
        name = node.id
        if name in self.bindings:
            return self.bindings[name]
        if name in self.types:
            t = self.types[name]
            value = Value(t, self.local(name), again=True)
            low, high = self.bounds.get(name, (None, None))
            value = value.with_bounds(low, high)
            if isinstance(t, Maybe) and name in self.sure:
                return Value(t.item, f"{value.code}.v", again=True)
            return value
        return self.outside(node, name)

    bindings: dict[str, Value]
    types: dict[str, Type]
    bounds: dict[str, tuple[int | None, int | None]]
    sure: set[str]

    @abstractmethod
    def local(self, name: str) -> str:
        """Return the C name of a local variable."""

    def outside(self, node: ast.AST, name: str) -> Value:
        """Return the value of a name of the module or of Python's builtins."""
        scope = self.spec.globals
        builtins = scope["__builtins__"]
        builtins = builtins if isinstance(builtins, dict) else vars(builtins)
        if name in self.spec.locals_names and name not in scope:
            raise self.refuse(
                node, f"{name} may have no value here", "assign it on every way"
            )
        if name not in scope and name not in builtins:
            raise self.refuse(node, f"{name} is not known", "define it in the module")
        if isinstance(scope.get(name), tuple):
            stem = str(scope["__name__"]).rpartition(".")[2]
            self.program.table_names[id(scope[name])] = f"{stem}_{name}"
        return self.thing(scope[name] if name in scope else builtins[name], node)

    def thing(self, x: Any, node: ast.AST) -> Value:
        """Return a Python object that is known during translation as a value."""
        value = constant(x)
        if value is not None:
            return value
        if isinstance(x, FunctionType) or hasattr(x, "__wrapped__"):
            return Value(Function((Callee(x),)), "", again=True)
        if isinstance(x, (ModuleType, BuiltinFunctionType, type)) or callable(x):
            return Value(Known(x), "", const=UNKNOWN, again=True)
        raise self.refuse(
            node, f"a {type(x).__name__} of the module", "numbers and tuples of them"
        )

    def _attribute(self, node: ast.Attribute) -> Value:
        """Translate a field of self, of a module or of a named tuple."""
        if self.is_self(node.value):
            return self.field(node)
        base = self.expression(node.value)
        if isinstance(base.type, Known) and isinstance(base.type.thing, ModuleType):
            return self.thing(getattr(base.type.thing, node.attr), node)
        base = self.some(base)
        if isinstance(base.type, Tuple) and node.attr in base.type.names:
            return self.element_at(
                self.temporary(base), base.type.names.index(node.attr)
            )
        raise self.refuse(
            node, f".{node.attr}", "fields of self, of modules and of named tuples"
        )

    def is_self(self, node: ast.AST) -> bool:
        """Return whether an expression is `self` of a method."""
        return isinstance(node, ast.Name) and node.id == "self" and self.spec.has_self

    def field(self, node: ast.Attribute) -> Value:
        """Return the value of a field of the block, or one of its methods."""
        name = node.attr
        program = self.program
        if name in program.fields:
            t = program.fields[name]
            if t == NONE:
                return constant(None)  # type: ignore[return-value]
            value = Value(t, f"self->{safe_field(name)}", again=True)
            value = value.with_bounds(*program.field_bounds.get(name, (None, None)))
            if isinstance(t, Maybe) and f"self.{name}" in self.sure:
                return Value(t.item, f"{value.code}.v", again=True)
            return value
        if name == "instance":
            return Value(S, "self->instance", again=True)
        method = getattr(program.block, name, None)
        if isinstance(method, FunctionType):
            return Value(Function((Callee(method, is_method=True),)), "", again=True)
        raise UnknownYetError(
            self.refuse(node, f"self.{name} is never assigned", "assign it in start")
        )

    def _tuple(self, node: ast.Tuple) -> Value:
        """Translate a tuple display; starred elements may have a length of run time."""
        makers: list[Any] = []
        for e in node.elts:
            makers.append(e.value if isinstance(e, ast.Starred) else e)
        values = self.in_order(makers)
        parts: list[Value] = []
        growing: list[tuple[Value, bool]] = []
        has_constant_length = True
        for e, v in zip(node.elts, values, strict=True):
            if not isinstance(e, ast.Starred):
                parts.append(v)
                growing.append((v, False))
                continue
            v = self.some(v)
            if isinstance(v.type, List) and v.parts is None:
                has_constant_length = False
                growing.append((v, True))
            else:
                inside = self.elements(
                    v, len(v.parts) if v.parts is not None else most(v.type), e
                )
                parts += inside
                growing += [(p, False) for p in inside]
        if has_constant_length:
            return self.tuple_of(parts)
        return self.concatenate(growing, node)

    def tuple_of(self, parts: Sequence[Value]) -> Value:
        """Return a tuple value of these parts; it is constant where all of them are."""
        parts = tuple(parts)
        if not parts:
            return constant(())  # type: ignore[return-value]
        const = (
            tuple(p.const for p in parts) if all(p.is_const for p in parts) else UNKNOWN
        )
        return Value(
            Tuple(tuple(p.type for p in parts)),
            "",
            parts=parts,
            const=const,
            again=all(p.again for p in parts),
        )

    def concatenate(self, pieces: Sequence[tuple[Value, bool]], node: ast.AST) -> Value:
        """Join single values and tuples of run-time length to one tuple.

        Each piece is a value and whether it is a tuple to be spliced in.
        """
        item: Type = NEVER
        size = 0
        for v, many in pieces:
            try:
                item = join(item, element(v.type) if many else v.type)
            except JoinError as error:
                raise self.refuse(
                    node, f"a tuple of {error}", "keep to one type"
                ) from None
            size += most(v.type) if many else 1
        t = List(item, min(size, self.most_wanted or size))
        name = self.fresh("joined")
        self.line(f"{self.program.names(t)} {name} = {{0}};")
        for v, many in pieces:
            if not many:
                text = self.convert(v, item, node)
                self.line(f"{name}.e[py_room({name}.n++, {t.most})] = {text};")
                continue
            if element(v.type) == NEVER:
                continue
            x, k = self.temporary(v), self.fresh("k")
            n = f"{x.code}.n" if isinstance(v.type, List) else str(most(v.type))
            inner = Value(element(v.type), f"{x.code}.e[{k}]", again=True)
            self.line(f"for (int64_t {k} = 0; {k} < {n}; {k}++)")
            text = self.convert(inner, item, node)
            self.line(f"    {name}.e[py_room({name}.n++, {t.most})] = {text};")
        return Value(t, name, again=True)

    # maximum length of the tuple that is assigned, where its annotation gives one
    most_wanted: int | None = None

    def _list(self, node: ast.List) -> Value:
        """Translate a list display of fixed length."""
        if any(isinstance(e, ast.Starred) for e in node.elts) or not node.elts:
            raise self.refuse(node, "this list", "a tuple, or a list of a fixed length")
        return replace(
            self.tuple_of(self.in_order(node.elts)), generator=False, const=UNKNOWN
        )

    def _unaryop(self, node: ast.UnaryOp) -> Value:
        """Translate `not` and the minus sign, with the bounds of an integer."""
        if isinstance(node.op, ast.Not):
            value = self.condition(node.operand)
            if value.is_const:
                return constant(not value.const)  # type: ignore[return-value]
            return Value(B, f"!{value.within(UNARY)}", UNARY)
        value = self.some(self.expression(node.operand))
        if value.is_const and isinstance(value.const, (int, float)):
            return constant(
                -value.const if isinstance(node.op, ast.USub) else value.const
            )  # type: ignore[return-value]
        if isinstance(node.op, ast.USub) and value.type in (F, I, B):
            low = None if value.high is None else -value.high
            high = None if value.low is None else -value.low
            inside = value.within(UNARY)
            text = f"-({inside})" if inside.startswith("-") else f"-{inside}"
            floats = None if value.as_float is None else f"(0.0 - {value.as_float})"
            if value.type == I and value.low is None:
                text = f"py_sub_i(0, {value.code})"
            return Value(
                F if value.type == F else I,
                text,
                UNARY,
                low=low,
                high=high,
                as_float=floats,
            )
        raise self.refuse(
            node, f"{type(node.op).__name__} of {type_text(value.type)}", "not, or -"
        )

    def _binop(self, node: ast.BinOp) -> Value:
        """Translate a binary operation; `& 2^64 - 1` makes a 64-bit mask."""
        if _is_literal(node):  # (1 << 64) - 1, a part of which has more than 64 bits
            with suppress(ArithmeticError, ValueError):
                result = eval(ast.unparse(node))
                if (value := constant(result)) is None:
                    raise self.refuse(node, str(result), "integers of 64 bits")
                return value
        if isinstance(node.op, ast.BitAnd):
            right = self.expression(node.right)
            if right.is_const and right.const == MASK:
                return self.translate_masked(node.left)
        a, b = self.in_order([node.left, node.right])
        return self.binary(node, type(node.op), self.some(a), self.some(b))

    def translate_masked(self, node: ast.expr) -> Value:
        """Translate an integer expression modulo 2^64, as `& _MASK` requires."""

        def text(e: ast.expr) -> tuple[str, int]:
            """Return the C of an operand modulo 2^64 and how tightly it binds."""
            if isinstance(e, ast.BinOp) and type(e.op) in ARITHMETIC:
                sign, level = ARITHMETIC[type(e.op)]
            elif isinstance(e, ast.BinOp) and isinstance(e.op, ast.BitXor):
                sign, level = "^", XOR
            else:
                v = self.expression(e)
                if v.type == U:
                    return v.code, v.binds
                if v.type == I:
                    if v.is_const:
                        return f"UINT64_C(0x{v.const & MASK:X})", ATOM
                    return f"(uint64_t){v.within(UNARY)}", UNARY
                raise self.refuse(e, f"{type_text(v.type)} & 2^64 - 1", "integers")
            (a, binds), (b, tight) = text(e.left), text(e.right)
            a = a if binds >= level else f"({a})"
            b = b if tight > level else f"({b})"
            return f"{a} {sign} {b}", level

        code, binds = text(node)
        return Value(U, code, binds)

    def binary(
        self, node: ast.AST, op: type[ast.operator], a: Value, b: Value
    ) -> Value:
        """Translate `a op b` for numbers, 64-bit masks and tuples."""
        if a.is_const and b.is_const:
            constant_result = self.fold(op, a.const, b.const)
            if constant_result is not None:
                return constant_result
        ta, tb = a.type, b.type
        if isinstance(ta, (Tuple, List, Array)) or isinstance(tb, (Tuple, List, Array)):
            return self.of_tuples(node, op, a, b)
        if not {ta, tb} <= {F, I, B, U}:
            raise self.refuse(
                node, f"{op.__name__} of {type_text(ta)} and {type_text(tb)}", "numbers"
            )
        if U in (ta, tb):
            return self.of_masks(node, op, a, b)
        if op is ast.Div:
            return self.quotient(a, b)
        if op is ast.Pow:
            return self._power(node, a, b)
        if op in (ast.Mod, ast.FloorDiv):
            return self.modulo(op, a, b)
        return self._of_numbers(node, op, a, b)

    def _of_numbers(
        self, node: ast.AST, op: type[ast.operator], a: Value, b: Value
    ) -> Value:
        """Translate a sum, difference or product of two numbers."""
        if op not in ARITHMETIC:
            raise self.refuse(node, f"{op.__name__}", "of 64-bit masks only")
        if F in (a.type, b.type):
            return self._of_floats(op, a, b)
        return self.of_integers(op, a, b)

    def _power(self, node: ast.AST, a: Value, b: Value) -> Value:
        """Translate `a ** b`, of which at least one is a float."""
        if b.type in (I, B) and a.type in (I, B):
            raise self.refuse(node, "a power of integers", "products, or a float")
        return Value(F, f"py_pow({self.convert(a, F)}, {self.convert(b, F)})")

    def _of_floats(self, op: type[ast.operator], a: Value, b: Value) -> Value:
        """Translate a sum, difference or product of which one operand is a float."""
        sign, level = ARITHMETIC[op]
        first = a if a.type == F else Value(F, self.convert(a, F), UNARY)
        right = b if b.type == F else Value(F, self.convert(b, F), UNARY)
        if a.type == B and not a.is_const:
            first = Value(F, f"(double){a.within(UNARY)}", UNARY)
        text = right.within(level + 1)
        return Value(F, f"{first.within(level)} {sign} {text}", level)

    def fold(self, op: type[ast.operator], a: Any, b: Any) -> Value | None:
        """Compute `a op b` of two constants, or return None where it has no result."""
        if isinstance(a, (str, tuple)) or isinstance(b, (str, tuple)):
            if op is ast.Add and type(a) is type(b):
                return constant(a + b)
            if op is ast.Mult and isinstance(a, tuple) and isinstance(b, int):
                return constant(a * b)
            return None
        if a is None or b is None:
            return None
        operation: Any = {
            ast.Add: lambda: a + b,
            ast.Sub: lambda: a - b,
            ast.Mult: lambda: a * b,
            ast.Div: lambda: a / b,
            ast.FloorDiv: lambda: a // b,
            ast.Mod: lambda: a % b,
            ast.Pow: lambda: a**b,
            ast.LShift: lambda: a << b,
        }.get(op)
        if operation is None:
            return None
        try:
            return constant(operation())
        except ArithmeticError:
            return None

    def of_integers(self, op: type[ast.operator], a: Value, b: Value) -> Value:
        """Translate a sum, difference or product of integers, with its bounds.

        Plain C operators are used where the result stays below 2^62; otherwise a
        function that checks for overflow.
        """
        sign, level = ARITHMETIC[op]
        low = high = None
        bounds = [a.low, a.high, b.low, b.high]
        if a.type == B:
            bounds[0], bounds[1] = 0, 1
        if b.type == B:
            bounds[2], bounds[3] = 0, 1
        al, ah, bl, bh = bounds
        if al is not None and bl is not None:
            low = al + bl if op is ast.Add else None
        if ah is not None and bh is not None and op is ast.Add:
            high = ah + bh
        if op is ast.Sub:
            low = al - bh if al is not None and bh is not None else None
            high = ah - bl if ah is not None and bl is not None else None
        if op is ast.Mult and None not in bounds:
            products = [x * y for x in (al, ah) for y in (bl, bh)]  # type: ignore[operator]
            low, high = min(products), max(products)
        if low is not None and high is not None and max(-low, high) < 1 << 62:
            right = b.within(level + 1)
            if op is ast.Mult:
                return Value(
                    I, f"{a.within(level)} * {right}", level, low=low, high=high
                )
            return Value(
                I, f"{a.within(level)} {sign} {right}", level, low=low, high=high
            )
        name = {"+": "add", "-": "sub", "*": "mul"}[sign]
        return Value(I, f"py_{name}_i({a.code}, {b.code})", low=low, high=high)

    def of_masks(
        self, node: ast.AST, op: type[ast.operator], a: Value, b: Value
    ) -> Value:
        """Translate an operation on 64-bit masks (unsigned in C)."""
        if F in (a.type, b.type):
            x = a if a.type == F else Value(F, f"(double){a.within(UNARY)}", UNARY)
            y = b if b.type == F else Value(F, f"(double){b.within(UNARY)}", UNARY)
            return self.binary(node, op, x, y)
        if op is ast.Div:
            return self.quotient(
                Value(F, f"(double){a.within(UNARY)}", UNARY),
                Value(F, self.convert(b, F), UNARY),
            )
        signs = {
            ast.BitXor: ("^", XOR),
            ast.BitOr: ("|", OR_BITS),
            ast.BitAnd: ("&", AND_BITS),
            ast.RShift: (">>", SHIFT),
        }
        if op not in signs:
            raise self.refuse(
                node, f"{op.__name__} of 64-bit masks", "with & (1 << 64) - 1 after"
            )
        sign, level = signs[op]
        if op is ast.RShift:
            if not b.is_const or not 0 <= b.const < 64:
                raise self.refuse(node, "a shift by this", "a constant from 0 to 63")
            return Value(U, f"{a.within(level)} >> {b.const}", level)
        first = a.within(level + 1) if a.type == U else self.convert(a, U)
        right = b.within(level + 1) if b.type == U else self.convert(b, U)
        return Value(U, f"{first} {sign} {right}", level)

    def quotient(self, a: Value, b: Value) -> Value:
        """Translate `a / b` with Python's check for division by zero."""
        if a.type in (I, B) and b.type in (I, B) and not (is_exact(a) and is_exact(b)):
            return Value(F, f"py_div_i({a.code}, {b.code})")
        first = Value(F, self.convert(a, F), a.binds if a.type == F else UNARY)
        right = Value(F, self.convert(b, F), b.binds if b.type == F else UNARY)
        if b.is_const and b.const != 0:
            return Value(F, f"{first.within(MUL)} / {right.within(MUL + 1)}", MUL)
        kind = "" if F in (a.type, b.type) else "_int"
        return Value(F, f"py_div{kind}({first.code}, {right.code})")

    def modulo(self, op: type[ast.operator], a: Value, b: Value) -> Value:
        """Translate `a % b` or `a // b` with Python's signs."""
        name = "mod" if op is ast.Mod else "floordiv"
        if a.type in (I, B) and b.type in (I, B):
            low = high = None
            if b.is_const and b.const > 0:
                if op is ast.Mod:
                    low, high = 0, b.const - 1
                elif a.low is not None and a.high is not None:
                    low, high = a.low // b.const, a.high // b.const
            return Value(I, f"py_{name}_i({a.code}, {b.code})", low=low, high=high)
        return Value(F, f"py_{name}({self.convert(a, F)}, {self.convert(b, F)})")

    def of_tuples(
        self, node: ast.AST, op: type[ast.operator], a: Value, b: Value
    ) -> Value:
        """Translate concatenation and repetition of tuples."""
        if op is ast.Mult and b.is_const and isinstance(b.const, int):
            x = self.temporary(a)
            n = len(x.parts) if x.parts is not None else most(a.type)
            if (
                n == 1
                and b.const > 64
                and x.parts is not None
                and is_scalar(x.parts[0].type)
            ):
                t, name, k = (
                    Tuple((x.parts[0].type,) * b.const),
                    self.fresh("all"),
                    self.fresh("k"),
                )
                self.line(f"{self.program.names(t)} {name};")
                self.line(
                    f"for (int64_t {k} = 0; {k} < {b.const}; {k}++) "
                    f"{name}.e[{k}] = {x.parts[0].code};"
                )
                return Value(t, name, again=True)
            if isinstance(a.type, List) and x.parts is None:
                raise self.refuse(
                    node, "a tuple of unknown length, repeated", "write it out"
                )
            return self.tuple_of(self.elements(x, n, node) * b.const)
        if op is ast.Add:
            pieces: list[tuple[Value, bool]] = []
            has_constant_length = True
            for v in (a, b):
                if isinstance(v.type, List) and v.parts is None:
                    has_constant_length = False
                    pieces.append((v, True))
                elif (
                    isinstance(v.type, Tuple)
                    and v.parts is None
                    and len(v.type.items) > 16
                ):
                    pieces.append((v, True))
                else:
                    n = len(v.parts) if v.parts is not None else most(v.type)
                    pieces += [(p, False) for p in self.elements(v, n, node)]
            if has_constant_length:
                flat: list[Value] = []
                for v, many in pieces:
                    flat += self.elements(v, most(v.type), node) if many else [v]
                return self.tuple_of(flat)
            return self.concatenate(pieces, node)
        raise self.refuse(node, f"{op.__name__} of tuples", "+, or * by a constant")

    def _boolop(self, node: ast.BoolOp) -> Value:
        """Translate `and` or `or`, operand by operand, with what each makes certain."""
        is_and = isinstance(node.op, ast.And)
        outer_sure = set(self.sure)
        result = self.expression(node.values[0])
        for previous, operand in zip(node.values, node.values[1:], strict=False):
            yes, no = self.certain(previous)
            self.sure |= yes if is_and else no
            result = self.either(node, is_and, result, operand)
        self.sure = outer_sure
        return result

    def either(
        self, node: ast.BoolOp, is_and: bool, before: Value, operand: ast.expr
    ) -> Value:
        """Translate `left and operand` or `left or operand`.

        The operand is evaluated only where the left side does not decide.
        """
        if before.is_const:
            return before if bool(before.const) != is_and else self.expression(operand)
        inner: list[str] = []
        self.out, outer = inner, self.out
        self.level += 1
        right = self.expression(operand)
        if (
            id(node) in self.conditions
        ):  # statements of the operand's truth run only if the operand is evaluated
            right = self.truth(right, node)
        self.out = outer
        self.level -= 1
        sign, level = ("&&", AND) if is_and else ("||", OR)
        if before.type == B and right.type == B and not inner:
            if right.is_const and bool(right.const) == is_and:
                return before
            return _join_conditions(before, right, sign, level)
        if id(node) in self.conditions:
            first = self.truth(before, node)
            if not inner:
                second = self.truth(right, node)
                if second.is_const and bool(second.const) == is_and:
                    return first
                return Value(
                    B, f"{first.within(level)} {sign} {second.within(level + 1)}", level
                )
            name = self.fresh("both" if is_and else "either")
            self.line(f"bool {name} = {first.code};")
            self.line(f"if ({name if is_and else '!' + name}) {{")
            self.out += inner
            self.level += 1
            self.line(f"{name} = {self.truth(right, node).code};")
            self.level -= 1
            self.line("}")
            return Value(B, name, again=True)
        x = self.temporary(before)
        first = self.truth(x, node)
        left_value = x
        if isinstance(x.type, Maybe) and not is_and:
            left_value = Value(x.type.item, f"{x.code}.v", again=True)
        return (
            self.choose(node, first, (right, inner), (left_value, []))
            if is_and
            else self.choose(node, first, (left_value, []), (right, inner))
        )

    conditions: set[int]  # ids of `and`/`or` expressions used only as a condition

    def choose(
        self,
        node: ast.AST,
        test: Value,
        yes: tuple[Value, list[str]],
        no: tuple[Value, list[str]],
    ) -> Value:
        """Translate `test ? yes : no`, each with the statements that it needs."""
        if test.is_const:
            value, lines = yes if test.const else no
            self.out += lines
            return value
        (a, before_a), (b, before_b) = yes, no
        try:
            t = join(a.type, b.type)
        except JoinError as error:
            raise self.refuse(node, f"either {error}", "keep to one type") from None
        if t == NEVER:
            t = NONE
        low = high = None
        if t == I and None not in (a.low, a.high, b.low, b.high):
            low, high = min(a.low, b.low), max(a.high, b.high)  # type: ignore[type-var]
        mark = len(self.out)
        if not before_a and not before_b:
            self.out, outer = [], self.out
            first, right = self.convert(a, t, node), self.convert(b, t, node)
            extra = self.out
            self.out = outer
            if not extra:
                first = first if a.binds > COND or t != a.type else f"({first})"
                code = f"{test.within(COND + 1)} ? {first} : {right}"
                return Value(t, code, COND, low=low, high=high)
        assert mark == len(self.out)
        name = self.fresh("chosen")
        self.line(f"{self.program.names(t)} {name};")
        self.line(f"if ({test.code}) {{")
        self.out += before_a
        self.level += 1
        self.line(f"{name} = {self.convert(a, t, node)};")
        self.level -= 1
        self.line("} else {")
        self.out += before_b
        self.level += 1
        self.line(f"{name} = {self.convert(b, t, node)};")
        self.level -= 1
        self.line("}")
        return Value(t, name, again=True, low=low, high=high)

    def branch(self, node: ast.expr, sure: set[str]) -> tuple[Value, list[str]]:
        """Translate an expression of a branch; return its value and its statements.

        `sure` are the names that are not None within the branch.
        """
        outer_sure = set(self.sure)
        self.sure |= sure
        self.out, outer = [], self.out
        self.level += 1
        value = self.expression(node)
        lines, self.out = self.out, outer
        self.level -= 1
        self.sure = outer_sure
        return value, lines

    def _ifexp(self, node: ast.IfExp) -> Value:
        test = self.condition(node.test)
        yes, no = self.certain(node.test)
        if test.is_const:
            return self.expression(node.body if test.const else node.orelse)
        return self.choose(
            node, test, self.branch(node.body, yes), self.branch(node.orelse, no)
        )

    def condition(self, node: ast.expr) -> Value:
        """Translate an expression as a condition and return its truth."""
        self.mark(node)
        return self.truth(self.expression(node), node)

    def mark(self, node: ast.expr) -> None:
        """Mark the `and`, `or` and `not` parts of a condition as conditions too."""
        if isinstance(node, ast.BoolOp):
            self.conditions.add(id(node))
            for value in node.values:
                self.mark(value)
        elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
            self.mark(node.operand)

    def certain(self, test: ast.expr) -> tuple[set[str], set[str]]:
        """Return which names are not None where a test holds, and where it fails."""

        def path(e: ast.expr) -> str | None:
            """Return the name of a variable or field of `self`, or None for others."""
            if isinstance(e, ast.Name):
                return e.id
            if isinstance(e, ast.Attribute) and self.is_self(e.value):
                return f"self.{e.attr}"
            return None

        match test:
            case ast.Compare(
                left=x, ops=[ast.Is()], comparators=[ast.Constant(value=None)]
            ):
                return set(), {p} if (p := path(x)) else set()
            case ast.Compare(
                left=x, ops=[ast.IsNot()], comparators=[ast.Constant(value=None)]
            ):
                return {p} if (p := path(x)) else set(), set()
            case ast.UnaryOp(op=ast.Not(), operand=x):
                yes, no = self.certain(x)
                return no, yes
            case ast.BoolOp(op=ast.And(), values=values):
                sure_names = [self.certain(v) for v in values]
                return set().union(*(y for y, _ in sure_names)), set()
            case ast.BoolOp(op=ast.Or(), values=values):
                sure_names = [self.certain(v) for v in values]
                return set(), set().union(*(n for _, n in sure_names))
            case ast.Name() | ast.Attribute():
                return {p} if (p := path(test)) else set(), set()
        return set(), set()

    def _compare(self, node: ast.Compare) -> Value:
        """Translate a comparison; a chain becomes one C expression with &&."""
        values = self.in_order([node.left, node.comparators[0]])
        if len(node.ops) > 1:
            values[1] = self.temporary(values[1])
            mark = len(self.out)
            rest = [self.expression(e) for e in node.comparators[1:]]
            values += [*(self.temporary(v) for v in rest[:-1]), rest[-1]]
            if len(self.out) > mark:
                raise self.refuse(
                    node,
                    "a chained comparison, of which a part is not for sure",
                    "two comparisons and `and`",
                )
        result: Value | None = None
        for op, a, b in zip(node.ops, values, values[1:], strict=False):
            one = self.compare(node, op, a, b)
            if result is None or (result.is_const and result.const):
                result = one
            elif result.is_const:
                pass
            elif one.is_const:
                result = result if one.const else one
            else:
                result = Value(B, f"{result.within(AND)} && {one.within(AND + 1)}", AND)
        assert result is not None
        return result

    def compare(self, node: ast.AST, op: ast.cmpop, a: Value, b: Value) -> Value:
        """Translate one comparison `a op b`."""
        if isinstance(op, (ast.Is, ast.IsNot)):
            return self._compare_with_none(node, op, a, b)
        if isinstance(op, (ast.In, ast.NotIn)):
            return self.translate_membership(node, op, a, b)
        a, b = self.some(a), self.some(b)
        sign = COMPARISONS[type(op)]
        if a.is_const and b.is_const:
            table: Any = {"==": a.const == b.const, "!=": a.const != b.const}
            if sign in table:
                return constant(table[sign])  # type: ignore[return-value]
        if isinstance(a.type, (Tuple, List, Array)):
            return self._compare_tuples(node, sign, a, b)
        return self._compare_numbers(node, sign, a, b)

    def _compare_with_none(
        self, node: ast.AST, op: ast.Is | ast.IsNot, a: Value, b: Value
    ) -> Value:
        """Translate `a is None` or `a is not None`."""
        if b.type != NONE:
            raise self.refuse(node, "`is` of values", "==")
        if isinstance(a.type, Maybe):
            x = self.temporary(a)
            no = "!" if isinstance(op, ast.Is) else ""
            return Value(B, f"{no}{x.code}.some", UNARY if no else ATOM)
        return constant((a.type == NONE) == isinstance(op, ast.Is))  # type: ignore[return-value]

    def _compare_tuples(self, node: ast.AST, sign: str, a: Value, b: Value) -> Value:
        """Translate == or != of tuples."""
        if sign not in ("==", "!="):
            raise self.refuse(node, f"{sign} of tuples", "== and !=")
        is_equal = self.equal(node, a, b)
        if sign == "!=":
            return Value(B, f"!{is_equal.within(UNARY)}", UNARY)
        return is_equal

    def _compare_numbers(self, node: ast.AST, sign: str, a: Value, b: Value) -> Value:
        """Translate a comparison of two numbers or two 64-bit masks."""
        if U in (a.type, b.type) and {a.type, b.type} != {U}:
            raise self.refuse(node, "a 64-bit mask compared", "with another one")
        if not {a.type, b.type} <= {F, I, B, U}:
            raise self.refuse(
                node,
                f"{sign} of {type_text(a.type)} and {type_text(b.type)}",
                "numbers",
            )
        first, right = a.within(LESS + 1), b.within(LESS + 1)
        if F in (a.type, b.type):
            first = first if a.type == F else self.exactly(a)
            right = right if b.type == F else self.exactly(b)
        level = EQUAL if sign in ("==", "!=") else LESS
        return Value(B, f"{first} {sign} {right}", level)

    def exactly(self, value: Value) -> str:
        """Return an integer as a double of the same value.

        The C fails at run time where no double has that value.
        """
        if value.type != I or value.as_float is not None or is_exact(value):
            return self.convert(value, F)
        return f"py_exact({value.code})"

    def equal(self, node: ast.AST, a: Value, b: Value) -> Value:
        """Translate equality of tuples, element by element."""
        if isinstance(a.type, List) or isinstance(b.type, List):
            x, y = self.temporary(a), self.temporary(b)
            item = join(element(a.type), element(b.type))
            name, k = self.fresh("equal"), self.fresh("k")
            n, m = self.length(x), self.length(y)
            self.line(f"bool {name} = {n.code} == {m.code};")
            if item == NEVER:
                return Value(B, name, again=True)
            self.line(f"for (int64_t {k} = 0; {name} && {k} < {n.code}; {k}++)")
            p, q = self.at(x, k), self.at(y, k)
            self.line(f"    {name} = {self.compare(node, ast.Eq(), p, q).code};")
            return Value(B, name, again=True)
        if not isinstance(b.type, (Tuple, Array)):
            raise self.refuse(
                node, f"== of a tuple and {type_text(b.type)}", "two tuples"
            )
        n, m = most(a.type), most(b.type)  # type: ignore[assignment]
        if n != m:
            return constant(False)  # type: ignore[return-value]
        x, y = self.temporary(a), self.temporary(b)
        pairs = zip(self.elements(x, n), self.elements(y, m), strict=True)  # type: ignore[arg-type]
        texts = [self.compare(node, ast.Eq(), p, q).within(AND + 1) for p, q in pairs]
        return Value(B, " && ".join(texts), AND if len(texts) > 1 else EQUAL)

    def at(self, x: Value, k: str) -> Value:
        """Return element `k` (a C expression) of a uniform tuple.

        The code of the tuple may be repeated.
        """
        if x.parts is not None:
            x = Value(x.type, self.place_table(x), again=True)
        return Value(element(x.type), f"{x.code}.e[{k}]", again=True)

    def place_table(self, x: Value) -> str:
        """Place a tuple in a C variable whose elements have one type.

        An index of run time can then select an element.
        """
        if x.parts is not None and x.is_const:
            t = uniform_constant(x.const)
            table = self.program.table(x.const, t) if t and t.uniform else None
            if table:
                return str(table)
        t = Tuple((element(x.type),) * most(x.type))
        name = self.fresh("table")
        self.line(f"const {self.program.names(t)} {name} = {self.convert(x, t)};")
        return name

    def translate_membership(
        self, node: ast.AST, op: ast.cmpop, a: Value, b: Value
    ) -> Value:
        """Translate `a in b` or `a not in b` for a tuple `b`."""
        x = self.temporary(a)
        if isinstance(b.type, Known):
            raise self.refuse(node, "`in` this", "a tuple")
        if isinstance(b.type, List) and b.parts is None:
            y, name, k = self.temporary(b), self.fresh("found"), self.fresh("k")
            self.line(f"bool {name} = false;")
            self.line(f"for (int64_t {k} = 0; {k} < {y.code}.n; {k}++)")
            same = self.compare(node, ast.Eq(), x, self.at(y, k))
            self.line(f"    {name} = {name} || {same.within(OR + 1)};")
            result = Value(B, name, again=True)
        else:
            n = len(b.parts) if b.parts is not None else most(b.type)
            texts = [
                self.compare(node, ast.Eq(), x, y).within(OR + 1)
                for y in self.elements(self.temporary(b), n, node)
            ]
            texts = [
                f"({text})" if " && " in text and len(texts) > 1 else text
                for text in texts
            ]
            result = Value(
                B, " || ".join(texts) or "false", OR if len(texts) > 1 else EQUAL
            )
        if isinstance(op, ast.NotIn):
            return Value(B, f"!{result.within(UNARY)}", UNARY)
        return result

    def _namedexpr(self, node: ast.NamedExpr) -> Value:
        value = self.expression(node.value)
        self.assign(node.target, value)
        return self._name(ast.copy_location(ast.Name(node.target.id, ast.Load()), node))

    @abstractmethod
    def assign(self, target: ast.expr, value: Value) -> None:
        """Write the C that assigns a value to a name, a field or a tuple of names."""

    # --- indices ----------------------------------------------------------------------

    def length(self, value: Value) -> Value:
        """Return the number of elements of a tuple or list as a value."""
        if value.parts is not None:
            return constant(len(value.parts))  # type: ignore[return-value]
        if isinstance(value.type, List):
            x = self.temporary(value)
            return Value(I, f"{x.code}.n", low=0, high=value.type.most, again=True)
        return constant(most(value.type))  # type: ignore[return-value]

    def _subscript(self, node: ast.Subscript) -> Value:
        """Translate an index into a tuple or list, or a slice of it."""
        value = self.some(self.expression(node.value))
        if isinstance(value.type, Known):
            raise self.refuse(node, "an index of this", "of a tuple")
        if not isinstance(value.type, (Tuple, List, Array)):
            raise self.refuse(
                node, f"an index of {type_text(value.type)}", "of a tuple"
            )
        if isinstance(node.slice, ast.Slice):
            return self.slice_tuple(node, value, node.slice)
        index = self.expression(node.slice)
        return self.index_tuple(node, value, index)

    def index_tuple(self, node: ast.AST, value: Value, index: Value) -> Value:
        """Translate an index into a tuple, checked where it is a constant."""
        if index.type == B:
            index = replace(index, type=I, low=0, high=1)
        if index.type != I:
            raise self.refuse(
                node, f"an index that is {type_text(index.type)}", "an integer"
            )
        n = len(value.parts) if value.parts is not None else most(value.type)
        if index.is_const and not (
            isinstance(value.type, List) and value.parts is None
        ):
            k = index.const
            if not -n <= k < n:
                raise self.refuse(
                    node, f"index {k} of a tuple of {n}", f"from {-n} to {n - 1}"
                )
            return self.element_at(self.temporary(value), k % n)
        x = self.temporary(value)
        if (isinstance(x.type, (Tuple, Array)) and x.parts is not None) or (
            isinstance(x.type, Tuple) and not x.type.uniform
        ):
            try:
                item = element(x.type)
            except JoinError as error:
                raise self.refuse(
                    node, f"an index into a tuple of {error}", "if and elif"
                ) from None
            code = self.place_table(x)
            x = Value(Tuple((item,) * n), code, again=True)
        k = self.checked_index(index, self.length(x))
        item = element(x.type)
        if item == NEVER:
            raise self.refuse(
                node, "an index of an empty tuple", "of one with elements"
            )
        return Value(item, f"{x.code}.e[{k}]", again=bool(re.fullmatch(r"\w+", k)))

    def checked_index(self, index: Value, n: Value) -> str:
        """Return the C of an index, with a check that it is within the tuple.

        As in Python, a negative index counts from the end. The check is left out where
        the bounds of the index show that it always passes.
        """
        if (
            n.is_const
            and index.low is not None
            and index.high is not None
            and (index.low >= 0 and index.high < n.const)
        ):
            return index.code
        return f"py_index({index.code}, {n.code})"

    def linear(self, node: ast.expr) -> dict[str, int]:
        """Return an integer expression as a sum of terms.

        Keys are the text of a term, or "" for the constant; values are its factor.
        """
        match node:
            case ast.BinOp(left=a, op=ast.Add(), right=b):
                return _sum(self.linear(a), self.linear(b), 1)
            case ast.BinOp(left=a, op=ast.Sub(), right=b):
                return _sum(self.linear(a), self.linear(b), -1)
            case ast.BinOp(left=a, op=ast.Mult(), right=b):
                x, y = self.linear(a), self.linear(b)
                for p, q in ((x, y), (y, x)):
                    if set(p) <= {""}:
                        return {k: v * p.get("", 0) for k, v in q.items()}
        if isinstance(node, (ast.Constant, ast.Name, ast.Attribute)):
            value = self.quiet(node)
            if value is not None and value.is_const and isinstance(value.const, int):
                return {"": value.const}
        return {ast.dump(node): 1}

    def quiet(self, node: ast.expr) -> Value | None:
        """Evaluate a name or constant without appending statements."""
        self.out, outer = [], self.out
        try:
            return self.expression(node)
        finally:
            self.out = outer

    def slice_tuple(self, node: ast.AST, value: Value, s: ast.Slice) -> Value:
        """Translate a slice of a tuple, of constant length where that can be shown."""
        x = self.temporary(value)
        variable = isinstance(x.type, List) and x.parts is None
        n = (
            None
            if variable
            else (len(x.parts) if x.parts is not None else most(x.type))
        )
        lower, upper, step = (
            None if e is None else self.expression(e)
            for e in (s.lower, s.upper, s.step)
        )
        if step is not None and not step.is_const:
            raise self.refuse(node, "a slice with this step", "a constant step")
        if n is not None and all(e is None or e.is_const for e in (lower, upper)):
            indices = range(n)[
                slice(*(None if e is None else e.const for e in (lower, upper, step)))
            ]
            return self.tuple_of([self.element_at(x, k) for k in indices])
        if n is not None and not isinstance(x.type, List):
            x = (
                x
                if x.parts is None and x.type.uniform
                else Value(
                    Tuple((element(x.type),) * n), self.place_table(x), again=True
                )
            )
        if step is not None and step.const != 1:
            if n is None or upper is not None or lower is None or n % step.const:
                raise self.refuse(
                    node, "a slice with a step", "of a row of a table: [i::columns]"
                )
            if lower.low is None or lower.low < 0:
                # a negative start counts from the end in Python: the C refuses it
                self.line(f"py_window({lower.code}, 1, {step.const});")
            first = self.temporary(
                Value(I, self.checked_index(lower, constant(step.const)))  # type: ignore[arg-type]
            )
            item = element(x.type)
            return self.tuple_of(
                [
                    Value(
                        item,
                        f"{x.code}.e[{first.code} + {k}]"
                        if k
                        else f"{x.code}.e[{first.code}]",
                        again=True,
                    )
                    for k in range(0, n, step.const)
                ]
            )
        if s.lower is not None and s.upper is not None:
            difference = _sum(self.linear(s.upper), self.linear(s.lower), -1)
            if not {k for k, v in difference.items() if v} - {""}:
                return self.window(x, lower, difference.get("", 0))  # type: ignore[arg-type]
        return self.run_time_slice(x, lower, upper)

    def window(self, x: Value, lower: Value, count: int) -> Value:
        """Return `count` elements from index `lower` on.

        The C checks at run time that they are there, unless bounds show it.
        """
        if not lower.again:
            lower = self.temporary(replace(lower, as_float=None))
        n = self.length(x)
        sure = (
            n.is_const
            and lower.low is not None
            and lower.high is not None
            and (lower.low >= 0 and lower.high + count <= n.const)
        )
        if not sure:
            self.line(f"py_window({lower.code}, {count}, {n.code});")
        item = element(x.type)
        if count > 16:
            t = Tuple((item,) * count)
            name, k = self.fresh("row"), self.fresh("k")
            self.line(f"{self.program.names(t)} {name};")
            self.line(
                f"for (int64_t {k} = 0; {k} < {count}; {k}++) "
                f"{name}.e[{k}] = {x.code}.e[{lower.code} + {k}];"
            )
            return Value(t, name, again=True)
        start = lower.within(ADD)
        return self.tuple_of(
            [
                Value(item, f"{x.code}.e[{start}{f' + {k}' if k else ''}]", again=True)
                for k in range(count)
            ]
        )

    def run_time_slice(
        self, x: Value, lower: Value | None, upper: Value | None
    ) -> Value:
        """Translate a slice of run-time length, with Python's clipping of its ends."""
        t = List(element(x.type), most(x.type))
        name, k, n = self.fresh("slice"), self.fresh("k"), self.length(x)
        first, last = self.fresh("from"), self.fresh("to")
        self.line(
            f"const int64_t {first} = "
            f"{f'py_bound({lower.code}, {n.code})' if lower else '0'};"
        )
        self.line(
            f"const int64_t {last} = "
            f"{f'py_bound({upper.code}, {n.code})' if upper else n.code};"
        )
        self.line(f"{self.program.names(t)} {name} = {{0}};")
        self.line(
            f"for (int64_t {k} = {first}; {k} < {last}; {k}++) "
            f"{name}.e[{name}.n++] = {x.code}.e[{k}];"
        )
        return Value(t, name, again=True)

    # --- text -------------------------------------------------------------------------

    def _joinedstr(self, node: ast.JoinedStr) -> Value:
        """Translate an f-string by writing its pieces to the text buffer of the C."""
        pieces = []
        placeholders = [
            p.value for p in node.values if isinstance(p, ast.FormattedValue)
        ]
        values = iter(self.in_order(placeholders))
        for part in node.values:
            if isinstance(part, ast.Constant):
                pieces.append((constant(part.value), ""))
                continue
            assert isinstance(part, ast.FormattedValue)
            if part.conversion not in (-1, 114):
                raise self.refuse(node, "this conversion", "none, or !r")
            spec = ""
            if part.format_spec is not None:
                spec = "".join(str(v.value) for v in part.format_spec.values)  # type: ignore[attr-defined]
            text = next(values)
            if part.conversion != -1 and text.type == S:
                raise self.refuse(node, "!r of text", "without, in quotes")
            pieces.append((self.temporary(text), spec))
        self.line("py_text_begin();")
        for value, spec in pieces:
            assert value is not None
            self.write_text(node, value, spec)
        name = self.fresh("text")
        self.line(f"const char *{name} = py_text_end();")
        return Value(S, name, again=True)

    def write_text(self, node: ast.AST, value: Value, spec: str) -> None:
        """Write the C that appends a value to the text in the buffer."""
        t = value.type
        if value.is_const and isinstance(value.const, (str, int, float)) and t != B:
            text = format(value.const, spec)
            if text:
                self.line(f"py_text({constant(text).code});")  # type: ignore[union-attr]
        elif t == S and not spec:
            self.line(f"py_text({value.code});")
        elif spec:
            self._write_formatted(node, value, spec)
        elif isinstance(t, Tuple):
            self._write_tuple_text(node, value, t)
        else:
            self._write_plain_text(node, value)

    def _write_formatted(self, node: ast.AST, value: Value, spec: str) -> None:
        """Write the C that appends a number in the format `spec`."""
        if value.type not in (F, I):
            raise self.refuse(
                node, f"the format {spec!r} of {type_text(value.type)}", "of a number"
            )
        match = re.fullmatch(r"(?:\.(\d+))?([gfe])", spec)
        if not match:
            raise self.refuse(
                node, f"the format {spec!r}", "g, f or e with a precision"
            )
        self.line(
            f"py_text_format('{match[2]}', {match[1] or 6}, {self.convert(value, F)});"
        )

    def _write_tuple_text(self, node: ast.AST, value: Value, t: Tuple) -> None:
        """Write the C that appends the elements of a tuple in parentheses."""
        self.line('py_text("(");')
        for k, part in enumerate(self.elements(value, len(t.items), node)):
            if k:
                self.line('py_text(", ");')
            self.write_text(node, part, "")
        self.line('py_text(",)");' if len(t.items) == 1 else 'py_text(")");')

    def _write_plain_text(self, node: ast.AST, value: Value) -> None:
        """Write the C that appends a number, a truth value or None."""
        t = value.type
        if t == F:
            self.line(f"py_text_float({value.code});")
        elif t in (I, U):
            self.line(f"py_text_{'int' if t == I else 'mask'}({value.code});")
        elif t == B:
            self.line(f'py_text({value.within(COND + 1)} ? "True" : "False");')
        elif t == NONE:
            self.line('py_text("None");')
        else:
            raise self.refuse(
                node, f"the text of {type_text(t)}", "of numbers and tuples of them"
            )


class UnknownYetError(Exception):
    """A type or field that is unknown in this pass and may be known in the next.

    If no later pass finds it, `reason` is raised.
    """

    def __init__(self, reason: SubsetError) -> None:
        super().__init__(str(reason))
        self.reason = reason


def _join_conditions(a: Value, b: Value, sign: str, level: int) -> Value:
    """Join two conditions by && or ||.

    Where both operators are mixed, parentheses avoid a compiler warning.
    """
    lowest = EQUAL if sign == "||" else level
    first = a.code if a.binds == level or a.binds >= lowest else f"({a.code})"
    right = b.code if b.binds >= max(lowest, level + 1) else f"({b.code})"
    return Value(B, f"{first} {sign} {right}", level)


def safe_field(name: str) -> str:
    """Return the C name of a field."""
    from .types import safe

    return safe(name)


def _sum(a: dict[str, int], b: dict[str, int], sign: int) -> dict[str, int]:
    """Return `a + sign * b` of two sums of terms."""
    return {k: a.get(k, 0) + sign * b.get(k, 0) for k in {*a, *b}}


def _is_literal(node: ast.expr) -> bool:
    """Return whether an expression consists of integer literals alone.

    Division and powers do not count.
    """
    if isinstance(node, ast.BinOp) and not isinstance(node.op, (ast.Div, ast.Pow)):
        return _is_literal(node.left) and _is_literal(node.right)
    return isinstance(node, ast.Constant) and type(node.value) is int


def is_exact(value: Value) -> bool:
    """Return whether a double can represent every value of an integer exactly."""
    if value.type == B:
        return True
    return None not in (value.low, value.high) and max(-value.low, value.high) <= EXACT  # type: ignore[operator,type-var]


def is_scalar(t: Type) -> bool:
    """Return whether a type is a scalar that has values."""
    return isinstance(t, Scalar) and t not in (NONE, NEVER)
