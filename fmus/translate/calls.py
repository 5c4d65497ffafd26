"""Translate calls of the subset to C.

They are the project's own functions, the library's mathematics, and loops over tuples.
"""

from __future__ import annotations

import ast
import bisect
import builtins
import math
import typing
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from types import MethodType
from typing import TYPE_CHECKING, Any

from .expressions import Expressions, Known, UnknownYetError, _sum
from .types import (
    NEVER,
    NONE,
    B,
    Callee,
    F,
    Function,
    I,
    JoinError,
    List,
    Maybe,
    S,
    Tuple,
    Type,
    U,
    element,
    join,
    most,
    safe,
    type_text,
)
from .value import ATOM, COND, LESS, MUL, UNARY, Value, constant

if TYPE_CHECKING:
    from .source import Info, Spec

UNROLLED = 4  # maximum number of passes for which a comprehension is unrolled

LONGEST = 1 << 16  # maximum number of elements of a tuple of run-time length

FUNCTIONS = {
    getattr(math, name): f"py_{name}"
    for name in (
        "sqrt",
        "sin",
        "cos",
        "tan",
        "asin",
        "acos",
        "atan",
        "atan2",
        "sinh",
        "cosh",
        "tanh",
        "exp",
        "expm1",
        "log",
        "log10",
        "log1p",
        "log2",
        "remainder",
        "fmod",
    )
}
PLAIN = {math.fabs: "fabs", math.copysign: "copysign"}
ROUNDED = {
    math.floor: "floor",
    math.ceil: "ceil",
    math.trunc: "trunc",
    round: "rint",
    int: "trunc",
}


@dataclass
class Iteration:
    """The passes of a loop: their number and the item of each.

    `unroll` says that every pass is written out, because the items differ in type.
    """

    count: Value
    item: Callable[[Value], Value]
    unroll: bool = False
    start: Value | None = None
    step: int = 1
    source: Value | None = None

    @property
    def constant_count(self) -> int | None:
        """Return the number of passes if it is constant, otherwise None."""
        return self.count.const if self.count.is_const else None

    @property
    def most(self) -> int | None:
        """Return the maximum number of passes, or None where it has no bound."""
        return (
            self.constant_count if self.constant_count is not None else self.count.high
        )


#: Library functions that are refused: what the message calls them, and a replacement.
REPLACEMENTS: dict[Any, tuple[str, str]] = {
    math.hypot: ("hypot", "sqrt(x * x + y * y): CPython's is not libm's"),
    math.pow: ("math.pow", "x ** y, which fails otherwise"),
    sum: ("sum", "write it out: Python 3.12 and later compensate"),
}


class RangeOf:
    """A range that is held by a name."""

    def __init__(self, iteration: Iteration) -> None:
        self.iteration = iteration


class Calls(Expressions):
    """Translation of a function's calls to C."""

    def _call(self, node: ast.Call) -> Value:
        """Translate a call of a method, function, constructor or library function."""
        func = node.func
        if isinstance(func, ast.Attribute):
            if (
                isinstance(func.value, ast.Call)
                and isinstance(func.value.func, ast.Name)
                and (func.value.func.id == "super")
            ):
                return self.super_call(node, func.attr)
            if func.attr in (
                "index",
                "count",
                "encode",
                "real",
                "imag",
            ) and not self.is_self(func.value):
                return self.tuple_method(node, func)
            if self.is_self(func.value) and func.attr == "fail":
                (text,) = node.args
                value = self.expression(text)
                self.line(f"py_raise(PY_BLOCK_ERROR, {value.code});")
                self.flow_ended = True
                return constant(None)  # type: ignore[return-value]
        if isinstance(func, ast.Name) and func.id == "getattr" and len(node.args) == 2:
            name = self.expression(node.args[1])
            if not (self.is_self(node.args[0]) and name.is_const):
                raise self.refuse(
                    node, "getattr of this", "of self, with a constant name"
                )
            call = ast.Attribute(node.args[0], name.const, ast.Load())
            return self.field(ast.copy_location(call, node))
        target = self.expression(func)
        target = self.some(target) if isinstance(target.type, Maybe) else target
        if isinstance(target.type, Function):
            return self.call_function(node, target, node.args, node.keywords)
        if not isinstance(target.type, Known):
            raise self.refuse(
                node, f"a call of {type_text(target.type)}", "call a function"
            )
        return self.call_known(node, target.type.thing)

    flow_ended: bool

    def super_call(self, node: ast.Call, name: str) -> Value:
        """Translate a call of a method of a base class through `super()`."""
        order = self.program.block.__mro__
        after = order[order.index(self.spec.owner) + 1 :]
        for cls in after:
            if name in vars(cls):
                callee = Callee(vars(cls)[name], is_method=True)
                return self.call_function(
                    node,
                    Value(Function((callee,)), "", again=True),
                    node.args,
                    node.keywords,
                )
        raise self.refuse(node, f"super().{name}", "a method that a base has")

    def tuple_method(self, node: ast.Call, func: ast.Attribute) -> Value:
        """Translate `index` or `count` of a tuple, or `encode` of a text."""
        base = self.expression(func.value)
        if func.attr == "encode" and base.type == S:
            return base
        if isinstance(base.type, (Tuple, List)) and func.attr in ("index", "count"):
            x, needle = (
                self.temporary(base),
                self.temporary(self.expression(node.args[0])),
            )
            if isinstance(x.type, Tuple) and x.parts is None and not x.type.uniform:
                raise self.refuse(
                    node, f".{func.attr} of a mixed tuple", "of one of one type"
                )
            n = self.length(x)
            name, k = self.fresh(func.attr), self.fresh("k")
            first = "0" if func.attr == "count" else "-1"
            x = x if x.parts is None else Value(x.type, self.place_table(x), again=True)
            same = self.compare(node, ast.Eq(), self.at(x, k), needle).code
            self.line(f"int64_t {name} = {first};")
            if func.attr == "count":
                self.line(
                    f"for (int64_t {k} = 0; {k} < {n.code}; {k}++) {name} += {same};"
                )
            else:
                self.line(
                    f"for (int64_t {k} = 0; {k} < {n.code} && {name} < 0; {k}++) "
                    f"if ({same}) {name} = {k};"
                )
                self.line(f"py_found({name});")
            return Value(
                I,
                name,
                again=True,
                low=0,
                high=n.high if n.high is not None else n.const,
            )
        raise self.refuse(node, f".{func.attr}()", "a function of the subset")

    # --- our own functions ------------------------------------------------------------

    def call_function(
        self,
        node: ast.AST,
        target: Value,
        args: Sequence[Any],
        keywords: Sequence[ast.keyword],
    ) -> Value:
        """Call one of the project's functions.

        Where the value may be one of several functions, a C switch selects it.
        """
        callees = target.type.callees
        values, keyword_values = self.arguments(node, args, keywords)
        if len(callees) == 1:
            return self.call_one(node, target, callees[0], values, keyword_values)
        x = self.temporary(target)
        values = [self.temporary(v) for v in values]
        keyword_values = {k: self.temporary(v) for k, v in keyword_values.items()}
        result: Type = NEVER
        cases = []
        for callee in callees:
            self.out, outer = [], self.out
            self.level += 2
            value = self.call_one(
                node,
                Value(Function((callee,)), ""),
                callee,
                values,
                dict(keyword_values),
            )
            cases.append((value, self.out))
            self.out = outer
            self.level -= 2
            result = join(result, value.type)
        name = self.fresh("result")
        if result not in (NONE, NEVER):
            self.line(f"{self.program.names(result)} {name};")
        self.line(f"switch ({x.code}.which) {{")
        for k, (value, lines) in enumerate(cases):
            self.line(f"{f'case {k}' if k < len(cases) - 1 else 'default'}: {{")
            self.out += lines
            self.level += 1
            if result not in (NONE, NEVER):
                self.line(f"{name} = {self.convert(value, result, node)};")
            elif value.code:
                self.line(f"{value.code};")
            self.line("break;")
            self.level -= 1
            self.line("}")
        self.line("}")
        if result in (NONE, NEVER):
            return constant(None)  # type: ignore[return-value]
        return Value(result, name, again=True)

    def arguments(
        self, node: ast.AST, args: Sequence[Any], keywords: Sequence[ast.keyword]
    ) -> tuple[list[Value], dict[str, Value]]:
        """Return the positional and the named arguments of a call, in their order."""
        makers: list[Any] = [a.value if isinstance(a, ast.Starred) else a for a in args]
        if any(k.arg is None for k in keywords):
            raise self.refuse(node, "** in a call", "name the arguments")
        all_values = self.in_order([*makers, *(k.value for k in keywords)])
        values: list[Value] = []
        for a, v in zip(args, all_values, strict=False):
            if isinstance(a, ast.Starred):
                v = self.some(v)
                if isinstance(v.type, List) and v.parts is None:
                    raise self.refuse(
                        node, "* of a tuple of unknown length", "write it out"
                    )
                values += self.elements(
                    v, len(v.parts) if v.parts is not None else most(v.type)
                )
            else:
                values.append(v)
        keyword_values = {
            k.arg: v
            for k, v in zip(keywords, all_values[len(makers) :], strict=True)
            if k.arg
        }
        return values, keyword_values

    def call_one(
        self,
        node: ast.AST,
        target: Value,
        callee: Callee,
        values: list[Value],
        keyword_values: dict[str, Value],
    ) -> Value:
        """Call a single function that is known during translation."""
        program = self.program
        info = program.info(callee)
        memo = info.is_constant
        if memo is not None:
            return self.thing(memo, node)
        arguments = self._complete_arguments(node, info, values, keyword_values)
        consts: list[Any] = []
        for k, argument in enumerate(arguments):
            v = self._typed_argument(node, info, k, argument)
            arguments[k] = v
            consts.append(v.const if v.is_const and info.wants_constant[k] else None)
        types = tuple(v.type for v in arguments)
        spec = program.specialise(callee, types, tuple(consts), self)
        self.reached_memos |= spec.reached_memos
        texts = []
        if spec.takes_self:
            texts.append("self")
        if callee.captures:
            texts.append(address(self.temporary(target).code))
        for k, v in enumerate(arguments):
            if consts[k] is None and (v.code or not isinstance(v.type, Function)):
                texts.append(self.argument(node, spec, k, v))
        code = f"{spec.name}({', '.join(texts)})"
        if spec.result == NEVER and not spec.is_translated:
            raise UnknownYetError(
                self.refuse(
                    node, f"the type of what {info.name} returns", "annotate it"
                )
            )
        return self._call_result(spec, code)

    def _complete_arguments(
        self,
        node: ast.AST,
        info: Info,
        values: list[Value],
        keyword_values: dict[str, Value],
    ) -> list[Value]:
        """Return a value for each parameter: given by place, by name, or its default."""
        arguments: list[Value] = list(values)
        for name, default in info.parameters[len(values) :]:
            if name in keyword_values:
                arguments.append(keyword_values.pop(name))
            elif default is not info.no_default:
                arguments.append(self.thing(default, node))
            else:
                raise self.refuse(node, f"{info.name} without {name}", "give it")
        if keyword_values or len(arguments) != len(info.parameters):
            raise self.refuse(
                node, f"these arguments of {info.name}", "as it declares them"
            )
        return arguments

    def _typed_argument(self, node: ast.AST, info: Info, k: int, v: Value) -> Value:
        """Return argument `k` with the type that its parameter gets."""
        if isinstance(v.type, Maybe) and not info.optional[k]:
            v = self.some(v)
        annotation = info.annotated_types[k]
        if annotation is not None and v.type != annotation:
            v = self._annotated_argument(node, v, annotation)
        t = v.type
        if isinstance(t, Known):
            if not isinstance(t.thing, RangeOf):
                raise self.refuse(
                    node, "this as an argument", "a number, tuple or function"
                )
            raise self.refuse(node, "a range as an argument", "its ends")
        if isinstance(t, Tuple) and v.parts is not None and not t.uniform:
            return self._uniform_floats(v, t)
        return v

    def _annotated_argument(self, node: ast.AST, v: Value, annotation: Type) -> Value:
        """Convert an argument to its annotation where that is the wider type."""
        try:
            is_wider = join(v.type, annotation) == annotation
        except JoinError:
            is_wider = False
        if not is_wider:
            return v
        low, high = v.low, v.high
        code = self.convert(v, annotation, node)
        v = Value(
            annotation, code, COND, again=False, low=low, high=high, const=v.const
        )
        if v.is_const and annotation == F:
            return constant(float(v.const))  # type: ignore[return-value]
        return v

    def _uniform_floats(self, v: Value, t: Tuple) -> Value:
        """Return a mixed tuple as one of floats where its elements allow it."""
        try:
            item = element(t)
            if item == F:
                floats = Tuple((item,) * len(t.items))
                return Value(floats, self.compound_literal(floats, v.parts))  # type: ignore[arg-type]
        except JoinError:
            pass
        return v

    def _call_result(self, spec: Spec, code: str) -> Value:
        """Write a call as a statement where needed, and return its result."""
        if spec.never_returns:
            self.line(f"{code};")
            self.flow_ended = True
            return constant(None)  # type: ignore[return-value]
        if spec.effects:
            self.effects = True
            self.sure = {path for path in self.sure if not path.startswith("self.")}
        if spec.result in (NONE, NEVER):
            self.line(f"{code};")
            return constant(None)  # type: ignore[return-value]
        if spec.effects:
            return self.temporary(Value(spec.result, code), hint="result")
        if spec.memo:
            self.kept_of[spec.name] += 1
            last_result = self.fresh("kept")
            self.line(
                f"const {self.program.names(spec.result)} *{last_result} = {code};"
            )
            return Value(spec.result, f"(*{last_result})", again=True)
        return Value(spec.result, code)

    # number of calls of each function that remembers its last result
    kept_of: Counter[str]
    reached_memos: set[str]  # names of such functions that callees call
    effects: bool

    def argument(self, node: ast.AST, spec: Any, k: int, v: Value) -> str:
        """Return the C of argument `k` of a call, by value or by address."""
        passing = spec.passing(k)
        if passing == "value":
            return self.convert(v, spec.types[k], node)
        if passing == "change":
            if not v.again or v.parts is not None:
                raise self.refuse(
                    node, "a list that is changed by this call", "give it a name"
                )
            if not any(
                v.code == self.local(name) for name in self.spec.changed_in_place
            ):
                raise self.refuse(
                    node, "a list that a method changes", "a function of the module"
                )
            return address(v.code)
        text = self.convert(v, spec.types[k], node)
        if text == v.code and v.again and not (spec.effects and "self->" in text):
            return address(text)
        if text.startswith("(") and text.endswith("}"):
            return f"&{text}"
        name = self.fresh("argument")
        self.line(f"const {self.program.names(spec.types[k])} {name} = {text};")
        return f"&{name}"

    # --- the library ------------------------------------------------------------------

    def call_known(self, node: ast.Call, thing: Any) -> Value:
        """Translate a call of a named tuple, a builtin or a library function."""
        if isinstance(thing, type) and hasattr(thing, "_fields"):
            return self._call_named_tuple(node, thing)
        if isinstance(thing, type) and issubclass(thing, BaseException):
            raise self.refuse(node, f"{thing.__name__} as a value", "raise it")
        if isinstance(thing, RangeOf):
            raise self.refuse(node, "a call of a range", "a function")
        name = getattr(thing, "__name__", str(thing))
        method = getattr(self, f"call_{name}", None)
        if thing in FUNCTIONS:
            return self.mathematics(node, FUNCTIONS[thing], name)
        if thing in PLAIN:
            texts = [self.convert(self.some(v), F) for v in self.in_order(node.args)]
            return Value(F, f"{PLAIN[thing]}({', '.join(texts)})")
        if thing in ROUNDED:
            return self.translate_rounding(node, ROUNDED[thing])
        if method and getattr(builtins, name, None) is thing:
            result: Value = method(node)
            return result
        return self._call_library(node, thing, name)

    def _call_named_tuple(self, node: ast.Call, thing: Any) -> Value:
        """Translate the making of a named tuple; its float fields become floats."""
        values, keyword_values = self.arguments(node, node.args, node.keywords)
        values += [keyword_values[n] for n in thing._fields[len(values) :]]
        kinds = typing.get_type_hints(thing)
        parts: list[Value] = []
        for name, v in zip(thing._fields, values, strict=True):
            if v.type == I and kinds[name] is float:
                v = Value(F, self.convert(v, F), COND, again=v.again, const=v.const)
            parts.append(v)
        return Value(
            Tuple(tuple(p.type for p in parts), thing._fields), "", parts=tuple(parts)
        )

    def _call_library(self, node: ast.Call, thing: Any, name: str) -> Value:
        """Translate to C a call of `bisect`, or of a function of `math` without its like.

        C has no radians and degrees, and isfinite, isnan and isinf return no bool there.
        """
        if thing in (bisect.bisect_right, bisect.bisect_left, bisect.bisect):
            return self.translate_bisect(
                node, "left" if thing is bisect.bisect_left else "right"
            )
        if thing in (math.radians, math.degrees):
            (x,) = self.in_order(node.args)
            factor = math.pi / 180.0 if thing is math.radians else 180.0 / math.pi
            if x.is_const:
                return constant(float(thing(x.const)))  # type: ignore[return-value]
            x = Value(F, self.convert(self.some(x), F), x.binds)
            return Value(F, f"{x.within(MUL)} * {factor!r}", MUL)
        if thing in (math.isfinite, math.isnan, math.isinf):
            (x,) = self.in_order(node.args)
            return Value(B, f"{name}({self.convert(self.some(x), F)})")
        if thing in REPLACEMENTS:
            raise self.refuse(node, *REPLACEMENTS[thing])
        raise self.refuse(
            node, f"{name}()", "what translates is listed in docs/translation.md"
        )

    def mathematics(self, node: ast.Call, name: str, python: str) -> Value:
        """Translate a function of `math`; constants are computed now."""
        values = [self.some(v) for v in self.in_order(node.args)]
        if any(not {v.type} <= {F, I, B} for v in values):
            raise self.refuse(node, f"{python} of this", "of a number")
        if python == "log" and len(values) == 2:
            raise self.refuse(node, "log with a base", "log(x) / log(base)")
        if all(v.is_const for v in values):
            try:
                return constant(
                    float(getattr(math, python)(*(v.const for v in values)))
                )  # type: ignore[return-value]
            except (ArithmeticError, ValueError):
                pass
        return Value(F, f"{name}({', '.join(self.convert(v, F) for v in values)})")

    def translate_rounding(self, node: ast.Call, name: str) -> Value:
        """Translate a rounding to an integer: floor, ceil, trunc, round or int."""
        if len(node.args) != 1:
            raise self.refuse(node, "rounding to digits", "round(x)")
        value = self.some(self.expression(node.args[0]))
        if value.type in (I, B):
            return replace(value, type=I)
        if value.type != F:
            raise self.refuse(
                node, f"an integer of {type_text(value.type)}", "of a number"
            )
        if value.is_const:
            try:
                exact: Any = {
                    "floor": math.floor,
                    "ceil": math.ceil,
                    "rint": round,
                    "trunc": int,
                }
                return constant(int(exact[name](value.const)))  # type: ignore[return-value]
            except (ArithmeticError, ValueError):
                pass
        return Value(
            I, f"py_{name}({value.code})", as_float=f"py_{name}_f({value.code})"
        )

    def translate_bisect(self, node: ast.Call, side: str) -> Value:
        """Translate a binary search in a tuple of numbers."""
        table, x = self.in_order(node.args)
        table = self.some(table)
        if not isinstance(table.type, Tuple) or element(table.type) not in (F, I):
            raise self.refuse(node, "bisect in this", "in a tuple of numbers")
        n = len(table.type.items)
        if element(table.type) == I:
            if not table.is_const:
                raise self.refuse(node, "bisect in integers", "in floats")
            table = constant(tuple(map(float, table.const)))  # type: ignore[assignment]
        place = (
            self.place_table(table)
            if table.parts is not None
            else self.temporary(table).code
        )
        code = f"py_bisect_{side}({place}.e, {n}, {self.convert(self.some(x), F)})"
        return Value(I, code, low=0, high=n)

    def call_abs(self, node: ast.Call) -> Value:
        return self.absolute(node, self.some(self.expression(node.args[0])))

    def absolute(self, node: ast.AST, value: Value) -> Value:
        """Return the absolute value of a number."""
        if value.is_const:
            return constant(abs(value.const))  # type: ignore[return-value]
        if value.type == F:
            return Value(F, f"fabs({value.code})")
        if value.type in (I, B):
            return Value(
                I,
                f"py_abs_i({value.code})",
                low=0,
                high=None
                if value.low is None or value.high is None
                else max(-value.low, value.high),
            )
        raise self.refuse(node, f"abs of {type_text(value.type)}", "of a number")

    def call_float(self, node: ast.Call) -> Value:
        value = self.some(self.expression(node.args[0]))
        if value.is_const:
            return constant(float(value.const))  # type: ignore[return-value]
        return Value(
            F, self.convert(value, F), UNARY if value.type != F else value.binds
        )

    def call_bool(self, node: ast.Call) -> Value:
        return self.condition(node.args[0])

    def call_len(self, node: ast.Call) -> Value:
        value = self.some(self.expression(node.args[0]))
        if not isinstance(value.type, (Tuple, List)):
            raise self.refuse(node, f"len of {type_text(value.type)}", "of a tuple")
        return self.length(value)

    def call_min(self, node: ast.Call) -> Value:
        return self.extreme(node, "min", "<")

    def call_max(self, node: ast.Call) -> Value:
        return self.extreme(node, "max", ">")

    def extreme(self, node: ast.Call, name: str, sign: str) -> Value:
        """Translate min or max; of equal elements the first wins, as in Python."""
        keywords = {k.arg: k.value for k in node.keywords}
        if len(node.args) > 1 and not keywords:
            values = [self.some(v) for v in self.in_order(node.args)]
            return self.largest(node, name, values)
        if len(node.args) > 1:
            key_value = self.tuple_of(self.in_order(node.args))
            iteration = self.over_value(node, key_value)
        else:
            iteration = self.iteration(node.args[0])
        key = keywords.get("key")
        if (
            iteration.constant_count is not None
            and iteration.constant_count <= 16
            and key is None
        ):
            if iteration.constant_count == 0:
                return self.expression(keywords["default"])
            items = [
                iteration.item(constant(k))  # type: ignore[arg-type]
                for k in range(iteration.constant_count)
            ]
            return self.largest(node, name, [self.some(v) for v in items])
        return self.search_extreme(
            node, name, sign, iteration, key, keywords.get("default")
        )

    def largest(self, node: ast.AST, name: str, values: Sequence[Value]) -> Value:
        """Return the minimum or maximum of values that are written out."""
        result = values[0]
        for v in values[1:]:
            if result.is_const and v.is_const:
                result = constant(getattr(builtins, name)(result.const, v.const))  # type: ignore[assignment]
                continue
            t = join(result.type, v.type)
            if t not in (F, I):
                raise self.refuse(node, f"{name} of {type_text(t)}", "of numbers")
            low = high = None
            if t == I:
                pick: Any = min if name == "min" else max
                lows, highs = (result.low, v.low), (result.high, v.high)
                known_low, known_high = (
                    [x for x in xs if x is not None] for xs in (lows, highs)
                )
                if name == "min":
                    low = pick(lows) if None not in lows else None
                    high = min(known_high) if known_high else None
                else:
                    low = max(known_low) if known_low else None
                    high = pick(highs) if None not in highs else None
            kind = "_i" if t == I else ""
            code = f"py_{name}{kind}({self.convert(result, t)}, {self.convert(v, t)})"
            result = Value(t, code, low=low, high=high)
        return result

    def search_extreme(
        self,
        node: ast.AST,
        name: str,
        sign: str,
        iteration: Iteration,
        key: ast.expr | None,
        default: ast.expr | None,
    ) -> Value:
        """Write a loop that finds the extreme element by a key."""
        best, value = self.fresh(name), self.fresh("value")
        probe: list[Type] = []
        mark = len(self.out)

        def body(item: Value) -> None:
            """Write the comparison of one element with the best so far."""
            x = self.temporary(self.some(item))
            k = self.temporary(self.apply_key(node, key, x))
            if probe and probe != [x.type, k.type]:
                raise JoinError(
                    f"{type_text(probe[0])} and {type_text(x.type)}, by {name} with a key"
                )
            probe[:] = [x.type, k.type]
            self.line(f"if (!{best}.some || {k.code} {sign} {value}) {{")
            self.level += 1
            self.line(f"{best}.some = true;")
            self.line(f"{best}.v = {self.code(x)};")
            self.line(f"{value} = {k.code};")
            self.level -= 1
            self.line("}")

        self.write_loop(iteration, body)
        t = Maybe(probe[0])
        self.out.insert(
            mark, "    " * self.level + f"{self.program.names(probe[1])} {value} = 0;"
        )
        self.out.insert(
            mark, "    " * self.level + f"{self.program.names(t)} {best} = {{0}};"
        )
        best_value = Value(probe[0], f"{best}.v", again=True)
        if default is None:
            self.line(f"py_not_empty({best}.some);")
            if (
                probe[0] == I
                and iteration.start is not None
                and iteration.most is not None
            ):
                start = iteration.start
                if start.is_const:
                    return best_value.with_bounds(
                        start.const, start.const + iteration.most - 1
                    )
            return best_value
        other = self.branch(default, set())
        return self.choose(node, Value(B, f"{best}.some"), (best_value, []), other)

    def apply_key(self, node: ast.AST, key: ast.expr | None, x: Value) -> Value:
        """Apply the key of min or max, or the function of map, to an element."""
        if key is None:
            return x
        if isinstance(key, ast.Lambda):
            (name,) = (a.arg for a in key.args.args)
            before = self.bindings.get(name)
            self.bindings[name] = x
            try:
                return self.expression(key.body)
            finally:
                del self.bindings[name]
                if before is not None:
                    self.bindings[name] = before
        if isinstance(key, ast.Attribute) and key.attr == "__getitem__":
            return self.index_tuple(node, self.expression(key.value), x)
        target = self.expression(key)
        if isinstance(target.type, Known) and target.type.thing is abs:
            return self.absolute(node, x)
        if isinstance(target.type, Function):
            return self.call_function(node, target, [lambda: x], [])
        raise self.refuse(node, "this key", "abs, a lambda or a function")

    def call_any(self, node: ast.Call) -> Value:
        return self.every(node, False)

    def call_all(self, node: ast.Call) -> Value:
        return self.every(node, True)

    def every(self, node: ast.Call, is_all: bool) -> Value:
        """Translate all or any; the first element that decides ends the loop."""
        argument = node.args[0]
        sign, level = ("&&", 20) if is_all else ("||", 15)
        if not isinstance(argument, ast.GeneratorExp):
            iteration = self.iteration(argument)
            if (
                iteration.constant_count is not None
                and iteration.constant_count <= UNROLLED
            ):
                mark = len(self.out)
                tests = [
                    self.truth(iteration.item(constant(k)), node)  # type: ignore[arg-type]
                    for k in range(iteration.constant_count)
                ]
                if len(self.out) == mark and not any(t.is_const for t in tests):
                    text = f" {sign} ".join(t.within(level + 1) for t in tests)
                    return Value(B, text, level)
        name = self.fresh("all" if is_all else "any")
        self.line(f"bool {name} = {'true' if is_all else 'false'};")

        def body(item: Value) -> None:
            """Write the test of one element."""
            test = self.truth(item, node)
            no = f"!{test.within(UNARY)}" if is_all else test.code
            self.line(f"if ({no}) {name} = {'false' if is_all else 'true'};")

        stop = name if is_all else f"!{name}"
        if isinstance(argument, ast.GeneratorExp):
            self.write_comprehension(argument, body, stop)
        else:
            self.write_loop(iteration, body, stop)
        return Value(B, name, again=True)

    def call_next(self, node: ast.Call) -> Value:
        """Translate `next` of a generator expression."""
        (argument,) = node.args
        if not isinstance(argument, ast.GeneratorExp):
            raise self.refuse(node, "next of this", "of a generator expression")
        first_name = self.fresh("first")
        mark = len(self.out)
        types: list[Type] = []

        def body(item: Value) -> None:
            """Write the C that keeps the first element."""
            if types and types != [item.type]:
                raise JoinError(f"{type_text(types[0])} and {type_text(item.type)}")
            types[:] = [item.type]
            self.line(f"{first_name}.some = true;")
            self.line(f"{first_name}.v = {self.code(item)};")

        self.write_comprehension(argument, body, f"!{first_name}.some")
        t = Maybe(types[0])
        self.out.insert(
            mark, "    " * self.level + f"{self.program.names(t)} {first_name} = {{0}};"
        )
        self.line(f"py_next({first_name}.some);")
        return Value(types[0], f"{first_name}.v", again=True)

    def call_tuple(self, node: ast.Call) -> Value:
        if not node.args:
            return constant(())  # type: ignore[return-value]
        if isinstance(node.args[0], ast.GeneratorExp):
            return self.comprehension(node.args[0])
        value = self.collect_items(self.iteration(node.args[0]), node.args[0])
        return value

    def call_list(self, node: ast.Call) -> Value:
        """Translate `list(...)`, whose length must be fixed."""
        value = self.call_tuple(node)
        if isinstance(value.type, List):
            raise self.refuse(node, "a list of unknown length", "a tuple")
        return value

    def call_zip(self, node: ast.Call) -> Value:
        return self.collect_items(self.iteration(node), node)

    call_enumerate = call_map = call_reversed = call_zip

    def call_range(self, node: ast.Call) -> Value:
        return Value(Known(RangeOf(self.iteration(node))), "", again=True)

    # --- loops ------------------------------------------------------------------------

    def collect_items(self, iteration: Iteration, node: ast.AST) -> Value:
        """Return all items of a loop as a tuple."""
        source = iteration.source
        if source is not None:
            if source.parts is None and isinstance(source.type, Tuple):
                return replace(source, type=Tuple(source.type.items))
            return source
        if iteration.constant_count is not None:
            return self.tuple_of(
                [iteration.item(constant(k)) for k in range(iteration.constant_count)]  # type: ignore[arg-type]
            )
        return self.gather_elements(
            node, lambda body: self.write_loop(iteration, body), iteration.most
        )

    def iteration(self, node: ast.expr) -> Iteration:
        """Return the passes of a loop over an expression."""
        if isinstance(node, ast.Call):
            target = self.quiet_target(node.func)
            kinds: dict[Any, Callable[[ast.Call], Iteration]] = {
                range: self.over_range,
                enumerate: self.over_enumerate,
                zip: self.over_zip,
                reversed: self.over_reversed,
                map: self.over_map,
            }
            if target in kinds:
                return kinds[target](node)
            if target in (tuple, list) and node.args:
                return self.over_value(node, self.expression(node))
        if isinstance(node, (ast.GeneratorExp, ast.ListComp)):
            return self.over_value(node, self.comprehension(node))
        return self.over_value(node, self.expression(node))

    def quiet_target(self, node: ast.expr) -> Any:
        """Return the library object that a name refers to, or None."""
        if (
            isinstance(node, ast.Name)
            and node.id not in self.types
            and node.id not in self.bindings
        ):
            value = self.outside(node, node.id)
            if isinstance(value.type, Known):
                return value.type.thing
        return None

    def over_value(self, node: ast.AST, value: Value) -> Iteration:
        """Return the passes over a tuple, a range or a text."""
        value = self.some(value)
        if isinstance(value.type, Known) and isinstance(value.type.thing, RangeOf):
            return value.type.thing.iteration
        if value.type == S:
            return self.over_text(value)
        if not isinstance(value.type, (Tuple, List)):
            raise self.refuse(
                node, f"a loop over {type_text(value.type)}", "over tuples and ranges"
            )
        x = self.temporary(value)
        if isinstance(x.type, List) and x.parts is None:
            return Iteration(self.length(x), lambda k: self.indexed_by(x, k), source=x)
        n = len(x.parts) if x.parts is not None else most(x.type)
        if isinstance(x.type, List):
            return Iteration(constant(0), lambda k: x, source=x)  # type: ignore[arg-type]
        unroll = not x.type.uniform or _is_known(x.type.items[0])
        if x.parts is not None and not unroll and n > UNROLLED:
            x = Value(x.type, self.place_table(x), again=True)
        return Iteration(constant(n), lambda k: self.indexed_by(x, k), unroll, source=x)  # type: ignore[arg-type]

    def over_text(self, value: Value) -> Iteration:
        """Return the passes over the bytes of a text."""
        x = self.temporary(value)
        count = Value(I, f"(int64_t)strlen({x.code})", low=0, high=1 << 30)
        return Iteration(
            self.temporary(count),
            lambda k: Value(
                I, f"(int64_t)(unsigned char){x.code}[{k.code}]", UNARY, low=0, high=255
            ),
        )

    def indexed_by(self, x: Value, k: Value) -> Value:
        """Return element `k`, a constant or a C variable, of a tuple."""
        if k.is_const:
            return self.element_at(x, k.const)
        return self.at(x, k.code)

    def over_range(self, node: ast.Call) -> Iteration:
        """Return the passes over a range, with bounds of its items."""
        args = node.args
        values = [self.some(v) for v in self.in_order(args)]
        if any(v.type not in (I, B) for v in values):
            raise self.refuse(node, "a range of this", "of integers")
        values = [
            v if v.is_const else self.temporary(replace(v, as_float=None))
            for v in values
        ]
        zero, one = constant(0), constant(1)
        assert zero is not None
        assert one is not None
        start = values[0] if len(values) > 1 else zero
        stop = values[1] if len(values) > 1 else values[0]
        step = values[2] if len(values) > 2 else one
        if not step.is_const or not step.const:
            raise self.refuse(node, "a range with this step", "a constant step")
        count = self._range_count(args, start, stop, step.const)

        def item(k: Value) -> Value:
            """Return item `k` of the range, with its bounds."""
            return _range_item(k, start, stop, step.const, count)

        return Iteration(count, item, start=start, step=step.const)

    def _range_count(
        self, args: Sequence[ast.expr], start: Value, stop: Value, step: int
    ) -> Value:
        """Return the number of items of a range, with an upper bound if it has one."""
        if start.is_const and stop.is_const:
            return constant(len(range(start.const, stop.const, step)))  # type: ignore[return-value]
        if step > 0:
            high = self.span(args, start, stop)
        elif start.high is not None and stop.low is not None:
            high = start.high - stop.low
        else:
            high = None
        high = None if high is None else max(-(-high // abs(step)), 0)
        if step == 1:
            code = f"py_count({start.code}, {stop.code})"
        else:
            code = f"py_count_by({start.code}, {stop.code}, {step})"
        return self.temporary(Value(I, code, low=0, high=high))

    def span(self, args: Sequence[ast.expr], start: Value, stop: Value) -> int | None:
        """Return an upper bound of stop minus start of a range that counts upwards.

        None where it has none.
        """
        if stop.high is not None and start.low is not None:
            return stop.high - start.low
        if len(args) < 2:
            return None
        total = 0
        terms = _sum(self.linear(args[1]), self.linear(args[0]), -1)
        expression_of: dict[str, ast.expr] = {}
        for a in args[:2]:
            for e in ast.walk(a):
                if isinstance(e, ast.expr):
                    expression_of[ast.dump(e)] = e
        for text, factor in terms.items():
            if not factor:
                continue
            if not text:
                total += factor
                continue
            value = self.quiet(expression_of[text])
            edge = None if value is None else (value.high if factor > 0 else value.low)
            if edge is None:
                return None
            total += factor * edge
        return total

    def over_enumerate(self, node: ast.Call) -> Iteration:
        """Return the passes over `enumerate(...)`."""
        inner = self.iteration(node.args[0])
        extra = (
            node.args[1]
            if len(node.args) > 1
            else next((k.value for k in node.keywords if k.arg == "start"), None)
        )
        first = self.expression(extra) if extra is not None else constant(0)
        assert first

        def item(k: Value) -> Value:
            index = (
                self.binary(node, ast.Add, k, first)
                if not (first.is_const and first.const == 0)
                else k
            )
            return self.tuple_of([index, inner.item(k)])

        return Iteration(inner.count, item, inner.unroll)

    def over_reversed(self, node: ast.Call) -> Iteration:
        """Return the passes over `reversed(...)`."""
        inner = self.iteration(node.args[0])

        def item(k: Value) -> Value:
            if k.is_const and inner.constant_count is not None:
                return inner.item(constant(inner.constant_count - 1 - k.const))  # type: ignore[arg-type]
            return inner.item(Value(I, f"{inner.count.code} - 1 - {k.code}", 70))

        return Iteration(inner.count, item, inner.unroll)

    def over_map(self, node: ast.Call) -> Iteration:
        """Return the passes over `map(...)` with one iterable."""
        function, *rest = node.args
        (argument,) = rest
        inner = self.iteration(argument)
        return Iteration(
            inner.count,
            lambda k: self.apply_key(node, function, inner.item(k)),
            inner.unroll,
        )

    def over_zip(self, node: ast.Call) -> Iteration:
        """Return the passes over `zip(...)`.

        Lengths that are known at run time alone need `strict=True`; the C compares
        them.
        """
        strict = any(
            k.arg == "strict" and isinstance(k.value, ast.Constant) and k.value.value
            for k in node.keywords
        )
        if len(node.args) == 1 and isinstance(node.args[0], ast.Starred):
            return self.over_columns(node, node.args[0].value)
        inner = [self.iteration(a) for a in node.args]
        lengths = {i.constant_count for i in inner}
        count = inner[0].count
        if len(lengths) > 1 or None in lengths:
            if not strict:
                raise self.refuse(
                    node, "zip of tuples of unknown length", "zip(..., strict=True)"
                )
            if None not in lengths:
                raise self.refuse(
                    node,
                    f"zip of {sorted(n for n in lengths if n)} elements",
                    "of as many",
                )
            for other in inner[1:]:
                self.line(f"py_same_length({count.code}, {other.count.code});")
            constant_counts = [i.count for i in inner if i.constant_count is not None]
            count = (
                constant_counts[0]
                if constant_counts
                else min(
                    (i.count for i in inner),
                    key=lambda c: 1 << 60 if c.high is None else c.high,
                )
            )
        return Iteration(
            count,
            lambda k: self.tuple_of([i.item(k) for i in inner]),
            any(i.unroll for i in inner),
        )

    def over_columns(self, node: ast.AST, argument: ast.expr) -> Iteration:
        """Return the passes over `zip(*rows)`: the columns."""
        rows = self.temporary(self.collect_items(self.iteration(argument), argument))
        if isinstance(rows.type, List) and rows.parts is None:
            item = rows.type.item
            if not isinstance(item, Tuple) or not item.uniform:
                raise self.refuse(node, "columns of such rows", "of rows of one type")

            def column(k: Value) -> Value:
                """Build column `k` of rows whose number is known at run time."""
                t = List(element(item), rows.type.most)
                name, r = self.fresh("column"), self.fresh("r")
                self.line(f"{self.program.names(t)} {name} = {{.n = {rows.code}.n}};")
                self.line(
                    f"for (int64_t {r} = 0; {r} < {rows.code}.n; {r}++) "
                    f"{name}.e[{r}] = {rows.code}.e[{r}].e[{k.code}];"
                )
                return Value(t, name, again=True)

            return Iteration(constant(most(item)), column)  # type: ignore[arg-type]
        n = len(rows.parts) if rows.parts is not None else most(rows.type)
        parts = [self.element_at(rows, k) for k in range(n)]
        sizes = {len(p.parts) if p.parts is not None else most(p.type) for p in parts}
        if len(sizes) != 1:
            raise self.refuse(
                node, "columns of rows of different lengths", "of equal ones"
            )
        parts = [self.temporary(p) for p in parts]
        return Iteration(
            constant(sizes.pop()),  # type: ignore[arg-type]
            lambda k: self.tuple_of([self.indexed_by(p, k) for p in parts]),
            unroll=True,
        )

    def write_loop(
        self,
        iteration: Iteration,
        body: Callable[[Value], None],
        stop: str = "",
        hint: str = "k",
    ) -> None:
        """Write a loop: its body once in a C loop, or once for each unrolled pass."""
        if iteration.unroll or (
            iteration.constant_count is not None and iteration.constant_count <= 1
        ):
            for one in range(iteration.constant_count or 0):
                if stop and one:
                    self.line(f"if ({stop}) {{")
                    self.level += 1
                body(iteration.item(constant(one)))  # type: ignore[arg-type]
                if stop and one:
                    self.level -= 1
                    self.line("}")
            return
        k = self.fresh(hint)
        test = (
            f"{stop} && {k} < {iteration.count.code}"
            if stop
            else f"{k} < {iteration.count.code}"
        )
        self.line(f"for (int64_t {k} = 0; {test}; {k}++) {{")
        self.level += 1
        top = iteration.most
        index = Value(
            I, k, again=True, low=0, high=None if top is None else max(top - 1, 0)
        )
        body(iteration.item(index))
        self.level -= 1
        self.line("}")

    def write_comprehension(
        self, node: Any, body: Callable[[Value], None], stop: str = ""
    ) -> None:
        """Write the loops of a comprehension around `body`, which gets its elements."""

        def inner(generators: Sequence[ast.comprehension]) -> None:
            """Write the remaining loops, or the body where none remains."""
            if not generators:
                body(self.expression(node.elt))
                return
            (first, *rest) = generators
            iteration = self.iteration(first.iter)

            def one(item: Value) -> None:
                """Bind one item, write the conditions and the loops within."""
                outer_bindings = dict(self.bindings)
                self.bind(first.target, item, iteration.unroll)
                for test in first.ifs:
                    self.line(f"if ({self.condition(test).code}) {{")
                    self.level += 1
                inner(rest)
                for _ in first.ifs:
                    self.level -= 1
                    self.line("}")
                self.bindings = outer_bindings

            self.write_loop(iteration, one, stop)

        inner(node.generators)

    def bind(self, target: ast.expr, item: Value, is_unrolled: bool) -> None:
        """Bind the names of a comprehension's target to their values."""
        if isinstance(target, ast.Name):
            if target.id == "_":
                return
            if not item.again:
                item = self.temporary(item, hint=safe(target.id))
            self.bindings[target.id] = item
            return
        if isinstance(target, (ast.Tuple, ast.List)):
            if any(isinstance(e, ast.Starred) for e in target.elts):
                raise self.refuse(target, "* in a target", "a name for each")
            parts = self.elements(item, len(target.elts), target)
            for t, part in zip(target.elts, parts, strict=True):
                self.bind(t, part, is_unrolled)
            return
        raise self.refuse(target, "this target", "names")

    def comprehension(self, node: Any) -> Value:
        """Translate a comprehension to a tuple."""
        size: int | None = 1
        is_complete = True
        if len(node.generators) == 1 or all(not g.ifs for g in node.generators):
            counts = self.count_elements(node)
            is_complete = counts is not None and not any(g.ifs for g in node.generators)
            if (
                is_complete
                and counts is not None
                and (counts[0] <= UNROLLED or counts[1])
            ):
                parts: list[Value] = []
                collector = Unrolled(self)
                collector.collect(node, parts)
                return self.tuple_of(parts)
            if counts is not None:
                size = counts[0]
        return self.gather_elements(
            node,
            lambda body: self.write_comprehension(node, body),
            size if is_complete else None,
            is_complete,
        )

    _generatorexp = _listcomp = comprehension

    def count_elements(self, node: Any) -> tuple[int, bool] | None:
        """Count the elements of a comprehension without its conditions.

        The second value says whether it must be written out. None where the number is
        not known.
        """
        outer, outer_bindings, level = self.out, dict(self.bindings), self.level
        counts = dict(self.counts)
        self.out = []
        try:
            total, unroll = 1, False
            for g in node.generators:
                iteration = self.iteration(g.iter)
                if iteration.constant_count is None:
                    return None
                total *= iteration.constant_count
                unroll = unroll or iteration.unroll
                if iteration.constant_count:
                    self.bind(g.target, iteration.item(constant(0)), True)  # type: ignore[arg-type]
            return total, unroll
        finally:
            self.out, self.bindings, self.level, self.counts = (
                outer,
                outer_bindings,
                level,
                counts,
            )

    def gather_elements(
        self,
        node: ast.AST,
        loops: Callable[[Callable[[Value], None]], None],
        size: int | None,
        is_complete: bool = False,
    ) -> Value:
        """Collect the elements that loops yield in a tuple.

        `is_complete` says that it has exactly `size` elements.
        """
        name = self.fresh("all")
        mark, level = len(self.out), self.level
        types: list[Type] = []
        holes: list[int] = []

        def body(item: Value) -> None:
            """Write a placeholder for one element.

            Its type is known after the loops.
            """
            item = replace(item, type=item.type)
            t = item.type
            if isinstance(t, Tuple) and item.parts is not None:
                t = Tuple(t.items, t.names)
            types.append(t)
            self.line(f"@{name}@{self.code(item)}")
            holes.append(len(self.out) - 1)

        passes = self._count_passes(loops, body)
        item_type: Type = NEVER
        for t in types:
            item_type = join(item_type, t)
        limit = self._limit_length(node, size if is_complete else passes, item_type)
        if holes and any(t != item_type for t in types):
            raise self.refuse(node, "elements of different types", "keep to one type")
        is_tuple = bool(is_complete and size)
        result: Type = (
            Tuple((item_type,) * limit) if is_tuple else List(item_type, limit)
        )
        text = self.program.names(result)
        place = f"{name}_n++" if is_tuple else f"py_room({name}.n++, {limit})"
        for hole in holes:
            indent, _, code = self.out[hole].partition(f"@{name}@")
            self.out[hole] = f"{indent}{name}.e[{place}] = {code};"
        if is_tuple:
            self.out.insert(mark, "    " * level + f"int64_t {name}_n = 0;")
            self.out.insert(mark, "    " * level + f"{text} {name};")
        else:
            self.out.insert(mark, "    " * level + f"{text} {name} = {{0}};")
        return Value(result, name, again=True)

    def _count_passes(
        self,
        loops: Callable[[Callable[[Value], None]], None],
        body: Callable[[Value], None],
    ) -> int | None:
        """Write loops around a body; return the maximum number of passes, if known."""
        limits: list[int | None] = [1]
        # The class's own run: an enclosing `gather_elements` must not count these passes too.
        before, plain = self.write_loop, MethodType(type(self).write_loop, self)

        def write_counted_loop(
            iteration: Iteration, inner: Any, stop: str = "", hint: str = "k"
        ) -> None:
            """Write a loop and multiply the limit of the length by its passes."""
            top = iteration.most
            limits[0] = None if top is None or limits[0] is None else limits[0] * top
            plain(iteration, inner, stop, hint)

        self.write_loop = write_counted_loop  # type: ignore[method-assign,assignment]
        try:
            loops(body)
        finally:
            self.write_loop = before  # type: ignore[method-assign]
        return limits[0]

    def _limit_length(self, node: ast.AST, limit: int | None, item: Type) -> int:
        """Return the maximum length of a tuple; refuse one without a limit."""
        if self.most_wanted is not None:
            limit = self.most_wanted if limit is None else min(limit, self.most_wanted)
        if limit is None or limit > LONGEST or item == NEVER:
            raise self.refuse(
                node,
                "a tuple that may get any length",
                "Annotated[tuple[...], MOST], or a range with an end",
            )
        return limit


def _range_item(k: Value, start: Value, stop: Value, step: int, count: Value) -> Value:
    """Return item `k` of a range, with its bounds."""
    low = high = None
    if start.low is not None and start.high is not None and count.high is not None:
        last = (count.high - 1) * step
        low, high = start.low + min(0, last), start.high + max(0, last)
    if stop.high is not None and step > 0 and start.low is not None:
        low = start.low if low is None else low
        high = stop.high - 1 if high is None else min(high, stop.high - 1)
    if k.is_const and start.is_const:
        return constant(start.const + step * k.const)  # type: ignore[return-value]
    text = k.code if step == 1 else f"{step} * {k.code}"
    starts_at_zero = start.is_const and start.const == 0
    if starts_at_zero:
        code, binds = text, (k.binds if step == 1 else MUL)
    else:
        code, binds = f"{start.code} + {text}", 70
    again = k.again and step == 1 and starts_at_zero
    return Value(I, code, binds, low=low, high=high, again=again)


def address(code: str) -> str:
    """Return the address of a variable; of `(*name)` it is the name."""
    inside = code[2:-1]
    return inside if code.startswith("(*") and inside.isidentifier() else f"&{code}"


def _is_known(t: Type) -> bool:
    """Return whether a type is text or a function, or contains one.

    Such values exist during translation.
    """
    if isinstance(t, Tuple):
        return any(map(_is_known, t.items))
    return t == S or isinstance(t, Function)


class Unrolled:
    """A comprehension that is written out element by element."""

    def __init__(self, calls: Calls) -> None:
        self.calls = calls

    def collect(self, node: Any, parts: list[Value], depth: int = 0) -> None:
        """Append the elements to `parts`, from generator `depth` inwards."""
        calls = self.calls
        if depth == len(node.generators):
            parts.append(calls.expression(node.elt))
            return
        g = node.generators[depth]
        iteration = calls.iteration(g.iter)
        for k in range(iteration.constant_count or 0):
            outer_bindings = dict(calls.bindings)
            calls.bind(g.target, iteration.item(constant(k)), True)  # type: ignore[arg-type]
            self.collect(node, parts, depth + 1)
            calls.bindings = outer_bindings


_ = (ATOM, LESS, U, NONE, UnknownYetError)
