"""Define the value of an expression during translation.

It holds the type, the C code, and whatever else is known of the expression.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

from .types import (
    NEVER,
    NONE,
    B,
    F,
    I,
    JoinError,
    List,
    S,
    Scalar,
    Tuple,
    Type,
    U,
    join,
)

UNKNOWN: Any = object()  # marks a value that is no constant

# precedence of C operators: a larger number binds more tightly
ATOM, UNARY, MUL, ADD, SHIFT, LESS, EQUAL, AND_BITS, XOR, OR_BITS, AND, OR, COND = (
    100,
    90,
    80,
    70,
    60,
    50,
    45,
    40,
    35,
    30,
    20,
    15,
    10,
)


@dataclass(frozen=True)
class Value:
    """An expression in translation: its type and its C code.

    `binds` is the precedence of the code, `const` the value of a constant, `parts` the
    elements of a tuple that is written out, `low` and `high` are bounds of an integer.
    `again` says that the code may be repeated.
    """

    type: Type
    code: str
    binds: int = ATOM
    const: Any = UNKNOWN
    parts: tuple[Value, ...] | None = None
    low: int | None = None
    high: int | None = None
    again: bool = False
    # an integer converted from a float: C of the same number as a double, not limited
    # to 64 bits
    as_float: str | None = None
    generator: bool = False

    @property
    def is_const(self) -> bool:
        """Return whether the value is a constant."""
        return self.const is not UNKNOWN

    def within(self, level: int) -> str:
        """Return the code, in parentheses if it binds less tightly than `level`."""
        return self.code if self.binds >= level else f"({self.code})"

    def with_bounds(self, low: int | None, high: int | None) -> Value:
        """Return the value with these bounds."""
        return replace(self, low=low, high=high)


def number(x: float) -> str:
    """Format a float as a C literal."""
    if math.isinf(x):
        return "INFINITY" if x > 0 else "-INFINITY"
    if math.isnan(x):
        return "NAN"
    return repr(x)


def constant(x: Any) -> Value | None:
    """Return a Python constant as a value, or None if the subset lacks its type."""
    if x is None:
        return Value(NONE, "", const=None, again=True)
    if isinstance(x, bool):
        return Value(B, "true" if x else "false", const=x, again=True)
    if isinstance(x, int):
        return _integer_constant(x)
    if isinstance(x, float):
        code = number(x)
        return Value(
            F, code, UNARY if code.startswith("-") else ATOM, const=x, again=True
        )
    if isinstance(x, str):
        return Value(S, c_text(x), const=x, again=True)
    if isinstance(x, tuple):
        return _tuple_constant(x)
    return None


def _integer_constant(x: int) -> Value | None:
    """Return an integer as a value, or None if it has more than 64 bits."""
    if not -(2**63) <= x < 2**64:
        return None
    if x > 2**63 - 1:
        return Value(U, f"UINT64_C(0x{x:X})", const=x, again=True)
    code = str(x) if abs(x) < 2**31 else f"INT64_C({x})"
    return Value(I, code, ATOM if x >= 0 else UNARY, const=x, low=x, high=x, again=True)


def _tuple_constant(x: tuple[Any, ...]) -> Value | None:
    """Return a tuple as a value, or None if the subset lacks an element's type."""
    parts = [constant(e) for e in x]
    if any(p is None for p in parts):
        return None
    if not parts:
        return Value(List(NEVER, 0), "", const=(), parts=(), again=True)
    names = tuple(getattr(type(x), "_fields", ()))
    return Value(
        Tuple(tuple(p.type for p in parts if p), names),
        "",
        const=x,
        parts=tuple(p for p in parts if p),
        again=True,
    )


def uniform_constant(x: Any) -> Type | None:
    """Return the type of a constant table whose rows share one type, or None.

    Where the rows have no common type, the result is a mixed tuple. None means that an
    element is no constant of the subset or that the table is empty.
    """
    if isinstance(x, tuple):
        items = [uniform_constant(e) for e in x]
        if not items or any(t is None for t in items):
            return None
        try:
            item_type: Type = NEVER
            for t in items:
                item_type = join(item_type, t)
        except JoinError:
            return Tuple(tuple(items))
        if isinstance(item_type, List):
            return Tuple(tuple(items))
        return Tuple((item_type,) * len(items))
    value = constant(x)
    return value.type if value and isinstance(value.type, Scalar) else None


def c_text(x: str) -> str:
    """Format a string as a C string literal in ASCII."""
    out = []
    for byte in x.encode():
        char = chr(byte)
        out.append(
            f"\\{char}"
            if char in '"\\'
            else char
            if 32 <= byte < 127
            else f"\\{byte:03o}"
        )
    return '"' + "".join(out).replace("??", "?\\?") + '"'
