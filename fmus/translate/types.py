"""Define the types of the subset, how they join, and their names in C."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any


class SubsetError(Exception):
    """A construct outside of the subset.

    The text gives the place, the construct and a replacement.
    """


@dataclass(frozen=True)
class Scalar:
    """A scalar type.

    One of double, bool, int64_t, uint64_t (masked arithmetic), text, None, or nothing
    yet.
    """

    name: str

    def __repr__(self) -> str:
        return self.name


F, B, I, U = Scalar("float"), Scalar("bool"), Scalar("int"), Scalar("64-bit mask")  # noqa: E741
S, NONE, NEVER = Scalar("str"), Scalar("None"), Scalar("nothing")


@dataclass(frozen=True)
class Tuple:
    """A tuple of fixed length; `names` are the fields of a named tuple."""

    items: tuple[Any, ...]
    names: tuple[str, ...] = field(default=(), compare=False)

    @property
    def uniform(self) -> bool:
        """Return whether all elements have one type."""
        return len(set(self.items)) == 1


@dataclass(frozen=True)
class List:
    """A tuple of up to `most` elements, whose length is known at run time."""

    item: Any
    most: int


@dataclass(frozen=True)
class Array:
    """A Python list: its elements change in place and its length is fixed."""

    item: Any
    size: int


@dataclass(frozen=True)
class Maybe:
    """An optional type, `T | None`."""

    item: Any


@dataclass(frozen=True)
class Callee:
    """A function known during translation.

    It belongs to a module, to the block (`is_method`), or to another function; then
    `captures` holds the variables that it captures.
    """

    function: Any
    is_method: bool = False
    captures: tuple[tuple[str, Any], ...] = ()


@dataclass(frozen=True)
class Function:
    """A function value, one of several callees."""

    callees: tuple[Callee, ...]


Type = Any  # one of the classes above


class JoinError(Exception):
    """Two types that no variable can have both."""


def join(a: Type, b: Type) -> Type:
    """Return the type of a variable that holds values of types `a` and `b`.

    Raises
    ------
    JoinError
        If no type has both.
    """
    if a == b or b == NEVER:
        return a
    if a == NEVER:
        return b
    if a == NONE or b == NONE:
        other = b if a == NONE else a
        return other if isinstance(other, Maybe) else Maybe(other)
    if isinstance(a, Maybe) or isinstance(b, Maybe):
        x = a.item if isinstance(a, Maybe) else a
        y = b.item if isinstance(b, Maybe) else b
        return Maybe(join(x, y))
    if isinstance(a, Scalar) and isinstance(b, Scalar):
        return _join_scalars(a, b)
    if isinstance(a, Function) and isinstance(b, Function):
        return _join_functions(a, b)
    return _join_sequences(a, b)


def _join_scalars(a: Scalar, b: Scalar) -> Type:
    """Return the common type of two different scalars."""
    pair = {a, b}
    if pair == {B, I}:
        return I
    if pair == {I, U}:
        return U
    raise JoinError(f"{a} and {b}")


def _join_functions(a: Function, b: Function) -> Type:
    """Return the type of a function value with the callees of both."""
    if any(c.captures for c in (*a.callees, *b.callees)):
        raise JoinError("two functions that capture variables")
    return Function(tuple(dict.fromkeys((*a.callees, *b.callees))))


def _join_sequences(a: Type, b: Type) -> Type:
    """Return the common type of two tuples or lists."""
    if isinstance(a, Tuple) and isinstance(b, Tuple) and len(a.items) == len(b.items):
        return Tuple(
            tuple(join(x, y) for x, y in zip(a.items, b.items, strict=True)),
            a.names if a.names == b.names else (),
        )
    if isinstance(a, (Tuple, List)) and isinstance(b, (Tuple, List)):
        item = join(element(a), element(b))
        return List(item, max(most(a), most(b)))
    if isinstance(a, Array) and isinstance(b, Array) and a.size == b.size:
        return Array(join(a.item, b.item), a.size)
    raise JoinError(f"{type_text(a)} and {type_text(b)}")


def element(t: Type) -> Type:
    """Return the common type of all elements of a tuple.

    Raises
    ------
    JoinError
        If the elements have no common type.
    """
    if isinstance(t, (List, Array)):
        return t.item
    item_type: Type = NEVER
    for x in t.items:
        item_type = join(item_type, x)
    return item_type


def most(t: Type) -> int:
    """Return the maximum number of elements that a value of a type has."""
    return (
        t.most
        if isinstance(t, List)
        else t.size
        if isinstance(t, Array)
        else len(t.items)
    )


def type_text(t: Type) -> str:
    """Format a type for a message."""
    match t:
        case Tuple() if t.items and t.uniform:
            return f"tuple of {len(t.items)} {type_text(t.items[0])}"
        case Tuple():
            return f"tuple[{', '.join(map(type_text, t.items))}]"
        case List():
            return f"tuple of up to {t.most} {type_text(t.item)}"
        case Array():
            return f"list of {t.size} {type_text(t.item)}"
        case Maybe():
            return f"{type_text(t.item)} | None"
        case Function():
            return "function"
    return str(t)


class Names:
    """C names of types, and their definitions in an order that C accepts."""

    def __init__(self) -> None:
        self._names: dict[Type, str] = {}
        self.definitions: list[str] = []
        self.equal: set[str] = set()

    def __call__(self, t: Type) -> str:
        """Return the C name of a type, defining it at first use."""
        if isinstance(t, Scalar):
            return {
                F: "double",
                B: "bool",
                I: "int64_t",
                U: "uint64_t",
                S: "const char *",
                NONE: "void",
                NEVER: "void",
            }[t]
        if t not in self._names:
            self._names[t] = self._define(t)
        return self._names[t]

    def _define(self, t: Type) -> str:
        """Define a type in C and return its name."""
        name = ""
        if isinstance(t, (Tuple, Array)) and (isinstance(t, Array) or t.uniform):
            item, n = element(t), most(t)
            base = self(item)
            if isinstance(item, Scalar):
                kind = {F: "double", B: "bool", I: "int", U: "mask", S: "text"}[item]
                name = f"{PREFIX}{kind}{n}"
                if isinstance(t, Array):
                    return self(Tuple((item,) * n))
                if any(f" {name};" in d for d in self.definitions):
                    return name
            elif isinstance(t, Array):
                return self(Tuple((item,) * n))
            body = f"{base} e[{n}];"
        elif isinstance(t, Tuple):
            names = member_names(t)
            body = " ".join(
                f"{self(x)} {n};" for x, n in zip(t.items, names, strict=True)
            )
            body = body or "char nothing;"
        elif isinstance(t, List):
            item = "double" if t.item == NEVER else self(t.item)
            body = f"int64_t n; {item} e[{max(t.most, 1)}];"
        elif isinstance(t, Maybe):
            body = f"bool some; {self(t.item)} v;"
        elif isinstance(t, Function):
            (callee, *rest) = t.callees
            members = [
                f"{self.member(x)} {'self' if x == 'self' else safe(n)};"
                for n, x in callee.captures
                if x == "self" or not hidden(x)
            ]
            body = "int which;" if rest else " ".join(members) or "char nothing;"
        else:
            raise AssertionError(t)
        name = name or f"{PREFIX}{_kind(t)}{len(self.definitions) + 1}"
        self.definitions.append(f"typedef struct {{ {body} }} {name};")
        return name

    def member(self, t: Type) -> str:
        """Return the C type of a captured variable; the block is held by address."""
        return f"{BLOCK} *" if t == "self" else self(t)


def hidden(t: Type) -> bool:
    """Return whether C knows a function by its name, so that it needs no value."""
    return isinstance(t, Function) and len(t.callees) == 1 and not t.callees[0].captures


def _kind(t: Type) -> str:
    """Return the word for a type that its C name contains."""
    return {
        "Tuple": "tuple",
        "List": "upto",
        "Maybe": "maybe",
        "Function": "function",
        "Array": "list",
    }[type(t).__name__]


def member_names(t: Tuple) -> list[str]:
    """Return the C names of the members of a tuple of mixed types."""
    return [f"x{i}" for i in range(len(t.items))]


PREFIX = "desat_"  # prefix of all names with file scope: no library uses it
BLOCK = f"{PREFIX}block"
_WORDS = """auto break case char const continue default do double else enum extern float for goto if
inline int long register restrict return short signed sizeof static struct switch typedef union
unsigned void volatile while bool true false self block main signal NULL INFINITY NAN abs div errno
fabs sqrt exp log sin cos tan floor ceil pow remainder malloc memo"""
_RESERVED = frozenset(_WORDS.split())


def safe(name: str) -> str:
    """Return a Python name, with an underscore appended where C reserves it."""
    return f"{name}_" if name in _RESERVED or name.startswith(("py_", PREFIX)) else name
