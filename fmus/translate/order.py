"""Find what a part of a function changes: fields of self, names, list elements.

Python evaluates in a fixed order, and a list may have two names. Where the C would
behave differently, `find_refused` reports it before a function is translated.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from types import FunctionType
from typing import Any

from .source import source

_COMPREHENSIONS = (ast.GeneratorExp, ast.ListComp)


class Order:
    """Reads and changes of a function's nodes.

    Local variables are given as `name`, fields as `self.name`.
    """

    def __init__(self, node: ast.FunctionDef, block: type, lists: set[str]) -> None:
        self._block, self._lists = block, lists
        self._within = {
            n.name: n
            for n in ast.walk(node)
            if isinstance(n, ast.FunctionDef) and n is not node
        }
        self._busy: set[str] = set()

    def changes(self, *nodes: ast.AST) -> set[str]:
        """Return the variables and fields that nodes assign, also through calls."""
        paths: set[str] = set()
        for n in (n for node in nodes for n in _walk(node)):
            if isinstance(getattr(n, "ctx", None), ast.Store) and (path := _path(n)):
                paths.add(path)
            elif isinstance(n, ast.Call):
                paths |= self._changes_of_call(n)
        return paths

    def calls_change(self, node: ast.AST) -> bool:
        """Return whether a function that the node calls changes anything."""
        return any(
            self._changes_of_call(n) for n in ast.walk(node) if isinstance(n, ast.Call)
        )

    def _changes_of_call(self, call: ast.Call) -> set[str]:
        """Return the variables and fields that a call changes."""
        match call.func:
            case ast.Attribute(value=ast.Name(id="self"), attr=name):
                return fields_changed(self._block, name)
            case ast.Attribute(value=ast.Call(func=ast.Name(id="super")), attr=name):
                return fields_changed(self._block, name)
            case ast.Name(id=name) if name in self._within and name not in self._busy:
                self._busy.add(name)
                inside = self._within[name]
                local_names = {
                    n.id
                    for n in ast.walk(inside)
                    if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)
                }
                paths = self.changes(*inside.body) - local_names
                self._busy.discard(name)
                return paths
            case ast.Name():
                return {
                    a.id for a in call.args if isinstance(a, ast.Name)
                } & self._lists
        return set()


def fields_changed(
    block: type, name: str, methods_visited: frozenset[str] = frozenset()
) -> set[str]:
    """Return the fields that a method assigns, also through methods it calls.

    They are given as `self.name`.
    """
    fields: set[str] = set()
    if name in methods_visited:
        return fields
    for cls in block.__mro__:
        method = getattr(vars(cls).get(name), "__wrapped__", vars(cls).get(name))
        if not isinstance(method, FunctionType):
            continue
        functions = source(method.__code__.co_filename).functions
        for n in ast.walk(functions.get(method.__code__.co_firstlineno, ast.Pass())):
            if isinstance(getattr(n, "ctx", None), ast.Store) and _path(n).startswith(
                "self."
            ):
                fields.add(_path(n))
            match n:
                case (
                    ast.Call(func=ast.Attribute(value=ast.Name(id="self"), attr=other))
                    | ast.Call(
                        func=ast.Attribute(
                            value=ast.Call(func=ast.Name(id="super")), attr=other
                        )
                    )
                ) if other != name:
                    fields |= fields_changed(block, other, methods_visited | {name})
    return fields


def reads(node: ast.AST) -> set[str]:
    """Return the names and fields that an expression reads directly."""
    paths: set[str] = set()
    for n in ast.walk(node):
        match n:
            case ast.Attribute(value=ast.Name(id="self"), attr=name):
                paths.add(f"self.{name}")
            case ast.Name(id=name) if name != "self":
                paths.add(name)
    return paths


def find_refused(
    order: Order, node: ast.FunctionDef, lists: set[str], arguments: set[str]
) -> Iterator[tuple[ast.AST, str, str]]:
    """Yield each refused construct: its node, what it is, and a replacement.

    `lists` are the variables whose elements are assigned, `arguments` the parameters of the
    function.
    """
    for n in ast.walk(node):
        yield from _refused_targets(order, n)
        yield from _refused_assignments(n, lists)
        yield from _refused_aliases(n, lists)
        yield from _refused_calls(order, n, lists)
        yield from _refused_returns(n, lists & arguments)
        if n is not node:
            yield from _refused_captures(node, n, lists)
        yield from _refused_handlers(order, n)
        yield from _refused_comprehensions(order, n)


def _refused_targets(order: Order, n: ast.AST) -> Iterator[tuple[ast.AST, str, str]]:
    """Yield a target or an index whose calls change something."""
    match n:
        case ast.AugAssign(target=target) if order.calls_change(target):
            yield n, "a call that changes something, in a target", "call it before"
        case ast.Subscript(slice=index) if order.calls_change(index):
            yield n, "a call that changes something, in an index", "call it before"


def _refused_assignments(
    n: ast.AST, lists: set[str]
) -> Iterator[tuple[ast.AST, str, str]]:
    """Yield assignments that are refused, with what is wrong and what to write instead.

    They assign an element and something else at once, or give a list a second name.
    """
    match n:
        case ast.Assign(targets=[_, _, *_] as targets) if any(
            isinstance(t, ast.Subscript) for t in targets
        ):
            yield n, "an element among several targets", "an assignment for each"
        case ast.Assign(targets=[ast.Attribute()], value=value) if _is_name_of(
            value, lists
        ):
            yield n, "a second name for a list that changes", "list(...) copies it"
        case ast.Assign(targets=[ast.Name(id=name)], value=value) if name in lists:
            if not _creates_list(value):
                yield n, f"{name} may be another list, too", "list(...) copies it"


def _creates_list(value: ast.expr) -> bool:
    """Return whether an expression assigned to a list makes no second name of one."""
    if isinstance(value, ast.Call):
        shares = any(isinstance(a, ast.Name) for a in value.args)
        return _is_name_of(value.func, {"list"}) or not shares
    return isinstance(value, (ast.List, ast.ListComp, ast.BinOp, ast.Name))


def _refused_aliases(n: ast.AST, lists: set[str]) -> Iterator[tuple[ast.AST, str, str]]:
    """Yield an expression through which a list would be reached by a second name."""
    match n:
        case ast.IfExp(body=a, orelse=b) if _is_name_of(a, lists) or _is_name_of(
            b, lists
        ):
            yield n, "a second name for a list that changes", "list(...) copies it"
        case ast.Tuple(elts=elements) | ast.List(elts=elements) if any(
            _is_name_of(e, lists) and isinstance(e.ctx, ast.Load)  # type: ignore[attr-defined]
            for e in elements
        ):
            yield n, "a list that changes, within another one", "tuple(...) copies it"


def _refused_calls(
    order: Order, n: ast.AST, lists: set[str]
) -> Iterator[tuple[ast.AST, str, str]]:
    """Yield a call that gets a list together with an argument that changes it."""
    match n:
        case ast.Call(args=[_, _, *_] as args) if any(
            _is_name_of(a, lists)
            and a.id in order.changes(*(b for b in args if b is not a))  # type: ignore[attr-defined]
            for a in args
        ):
            yield (
                n,
                "a list, and what changes it, as arguments of one call",
                "change it before",
            )


def _refused_returns(
    n: ast.AST, changed_arguments: set[str]
) -> Iterator[tuple[ast.AST, str, str]]:
    """Yield a return of an argument whose elements the function assigns."""
    match n:
        case ast.Return(value=ast.Name(id=name)) if name in changed_arguments:
            yield (
                n,
                f"{name} is changed and returned",
                "change it alone, or tuple(...) of it",
            )


def _refused_captures(
    node: ast.FunctionDef, n: ast.AST, lists: set[str]
) -> Iterator[tuple[ast.AST, str, str]]:
    """Yield a function within `node` that uses one of its lists."""
    if not isinstance(n, ast.FunctionDef):
        return
    captured_lists = sorted(reads(n) & lists & _outside(node, n))
    if captured_lists:
        yield (
            n,
            f"{n.name} uses {captured_lists[0]}, a list that changes",
            "give it as an argument",
        )


def _refused_handlers(order: Order, n: ast.AST) -> Iterator[tuple[ast.AST, str, str]]:
    """Yield each except clause that uses a variable assigned in its try."""
    if not isinstance(n, ast.Try):
        return
    stored_names: set[str] = set()
    for s in n.body:
        stored_names |= {x for x in order.changes(s) if "." not in x}
    for h in n.handlers:
        used: set[str] = set()
        for s in h.body:
            used |= stored_names & reads(s)
        if used:
            yield (
                h,
                f"{min(used)} is assigned in the try and used in its except",
                "keep to what was known before",
            )


def _refused_comprehensions(
    order: Order, n: ast.AST
) -> Iterator[tuple[ast.AST, str, str]]:
    """Yield a comprehension for each sequence that changes while it runs over it."""
    if not isinstance(n, _COMPREHENSIONS):
        return
    for c in n.generators:
        rest = [n.elt, *c.ifs]
        for g in n.generators:
            rest += [g.iter, *g.ifs]
        if clash := sorted(reads(c.iter) & order.changes(*rest)):
            yield n, f"{clash[0]} changes in a loop over it", "a tuple of it, before"


def _walk(node: ast.AST) -> Iterator[ast.AST]:
    """Yield all nodes except targets of comprehensions, whose names are local."""
    yield node
    for field, value in ast.iter_fields(node):
        if isinstance(node, ast.comprehension) and field == "target":
            continue
        for child in value if isinstance(value, list) else [value]:
            if isinstance(child, ast.AST):
                yield from _walk(child)


def _path(node: ast.AST) -> str:
    """Return the variable or field that an assignment to a node changes."""
    while isinstance(node, ast.Subscript):
        node = node.value
    match node:
        case ast.Name(id=name):
            return name
        case ast.Attribute(value=ast.Name(id="self"), attr=name):
            return f"self.{name}"
    return ""


def _is_name_of(node: Any, names: set[str]) -> bool:
    """Return whether a node is one of these names."""
    return isinstance(node, ast.Name) and node.id in names


def _outside(node: ast.FunctionDef, inner: ast.FunctionDef) -> set[str]:
    """Return the names that a function uses outside of a function within it."""
    within = {id(n) for n in ast.walk(inner)}
    return {
        n.id for n in ast.walk(node) if isinstance(n, ast.Name) and id(n) not in within
    }
