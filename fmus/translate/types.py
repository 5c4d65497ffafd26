"""The types of the subset, how two of them join, and what they are called in C."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any


class SubsetError(Exception):
    """A construct outside of the subset; the text says where, what, and what to write
    instead."""


@dataclass(frozen=True)
class Scalar:
    """double, bool, int64_t, uint64_t (of masked arithmetic), text, or nothing yet."""

    name: str

    def __repr__(self) -> str:
        return self.name


F, B, I, U = Scalar("float"), Scalar("bool"), Scalar("int"), Scalar("64-bit mask")  # noqa: E741
S, NONE, NEVER = Scalar("str"), Scalar("None"), Scalar("nothing")


@dataclass(frozen=True)
class Tuple:
    """A tuple of a fixed length; `names` where it is a named one."""

    items: tuple[Any, ...]
    names: tuple[str, ...] = field(default=(), compare=False)

    @property
    def uniform(self) -> bool:
        return len(set(self.items)) == 1


@dataclass(frozen=True)
class List:
    """A tuple of up to `most` elements."""

    item: Any
    most: int


@dataclass(frozen=True)
class Array:
    """A list: it changes in place, and keeps its length."""

    item: Any
    size: int


@dataclass(frozen=True)
class Maybe:
    """T | None."""

    item: Any


@dataclass(frozen=True)
class Callee:
    """A function known while translating: of a module, of the block (`bound`), or
    inside another, with what it captures."""

    function: Any
    bound: bool = False
    captured: tuple[tuple[str, Any], ...] = ()


@dataclass(frozen=True)
class Function:
    """One of some functions."""

    callees: tuple[Callee, ...]


Type = Any
"""One of the classes above."""


class JoinError(Exception):
    """Two types that no variable can have."""


def join(a: Type, b: Type) -> Type:
    """The type of what may be of type a or b. Raises JoinError."""
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
        pair = {a, b}
        if pair == {B, I}:
            return I
        if pair == {I, U}:
            return U
        raise JoinError(f"{a} and {b}")
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
    if isinstance(a, Function) and isinstance(b, Function):
        if any(c.captured for c in (*a.callees, *b.callees)):
            raise JoinError("two functions that capture variables")
        return Function(tuple(dict.fromkeys((*a.callees, *b.callees))))
    raise JoinError(f"{shown(a)} and {shown(b)}")


def element(t: Type) -> Type:
    """The type that all elements of a tuple have. Raises JoinError."""
    if isinstance(t, (List, Array)):
        return t.item
    found: Type = NEVER
    for x in t.items:
        found = join(found, x)
    return found


def most(t: Type) -> int:
    """The most elements that a value of a type has."""
    return (
        t.most
        if isinstance(t, List)
        else t.size
        if isinstance(t, Array)
        else len(t.items)
    )


def shown(t: Type) -> str:
    """A type for people."""
    match t:
        case Tuple() if t.items and t.uniform:
            return f"tuple of {len(t.items)} {shown(t.items[0])}"
        case Tuple():
            return f"tuple[{', '.join(map(shown, t.items))}]"
        case List():
            return f"tuple of up to {t.most} {shown(t.item)}"
        case Array():
            return f"list of {t.size} {shown(t.item)}"
        case Maybe():
            return f"{shown(t.item)} | None"
        case Function():
            return "function"
    return str(t)


class Names:
    """The C names of types, and their definitions in an order that C takes."""

    def __init__(self) -> None:
        self._names: dict[Type, str] = {}
        self.definitions: list[str] = []
        self.equal: set[str] = set()

    def __call__(self, t: Type) -> str:
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
                for n, x in callee.captured
                if x == "self" or not hidden(x)
            ]
            body = "int which;" if rest else " ".join(members) or "char nothing;"
        else:
            raise AssertionError(t)
        name = name or f"{PREFIX}{_kind(t)}{len(self.definitions) + 1}"
        self.definitions.append(f"typedef struct {{ {body} }} {name};")
        return name

    def member(self, t: Type) -> str:
        """The type of a captured variable; the block by its address."""
        return f"{BLOCK} *" if t == "self" else self(t)


def hidden(t: Type) -> bool:
    """True for a function that C knows by its name, so that no value of it is needed."""
    return isinstance(t, Function) and len(t.callees) == 1 and not t.callees[0].captured


def _kind(t: Type) -> str:
    return {
        "Tuple": "tuple",
        "List": "upto",
        "Maybe": "maybe",
        "Function": "function",
        "Array": "list",
    }[type(t).__name__]


def member_names(t: Tuple) -> list[str]:
    """What the elements of a tuple of different types are called in C."""
    return [f"x{i}" for i in range(len(t.items))]


PREFIX = "desat_"
"""What each name begins with that is known in the whole of a C file: none of a library
does."""
BLOCK = f"{PREFIX}block"
_WORDS = """auto break case char const continue default do double else enum extern float for goto if
inline int long register restrict return short signed sizeof static struct switch typedef union
unsigned void volatile while bool true false self block main signal NULL INFINITY NAN abs div errno
fabs sqrt exp log sin cos tan floor ceil pow remainder malloc memo"""
_RESERVED = frozenset(_WORDS.split())


def safe(name: str) -> str:
    """A Python name that C takes as well."""
    return f"{name}_" if name in _RESERVED or name.startswith(("py_", PREFIX)) else name
