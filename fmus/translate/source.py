"""Read Python files for the translator: trees, comments and declarations."""

from __future__ import annotations

import ast
import inspect
import io
import re
import tokenize
import types as python_types
import typing
from collections import Counter
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

from .types import (
    NEVER,
    B,
    Callee,
    F,
    JoinError,
    Maybe,
    Scalar,
    SubsetError,
    Tuple,
    Type,
    join,
)

BY_ADDRESS = 64  # bytes: larger arguments are passed by address

_TOOLS = re.compile(r"#\s*(fmt:|type:|noqa|mypy:)")


class Source:
    """A Python file: its tree, its functions by first line, its comments by line."""

    def __init__(self, path: Path) -> None:
        """Read a Python file: its functions by first line, its comments by line."""
        self.path = path
        text = path.read_text(encoding="utf-8")
        self.tree = ast.parse(text)
        self.functions: dict[int, ast.FunctionDef] = {}
        for node in ast.walk(self.tree):
            if isinstance(node, ast.FunctionDef):
                first = min([node.lineno, *(d.lineno for d in node.decorator_list)])
                self.functions[first] = node
        self._comments: dict[int, str] = {}
        for token in tokenize.generate_tokens(io.StringIO(text).readline):
            if token.type == tokenize.COMMENT and not _TOOLS.match(token.string):
                without_marker = re.split(r"\s*#\s*(?:fmt:|type:|noqa)", token.string)[
                    0
                ]
                self._comments[token.start[0]] = (
                    without_marker.lstrip("# ").rstrip().replace("*/", "* /")
                )

    def comments(self, first: int, last: int) -> list[str]:
        """Return the comments from line `first` to line `last`."""
        return [
            self._comments[k] for k in range(first, last + 1) if self._comments.get(k)
        ]


@cache
def source(path: str) -> Source:
    """Read the file at a path, once per process."""
    return Source(Path(path))


class Nested:
    """A function defined within another, for given argument types of that one."""

    def __init__(self, node: ast.FunctionDef, spec: Any) -> None:
        self.node, self.spec = node, spec
        self.__name__ = node.name


class Info:
    """Declarations of a function.

    They are its parameters, defaults and types, and whether Python caches its result.
    """

    no_default = object()

    def __init__(self, callee: Callee, display_path: str) -> None:
        """Read the declarations of a function; `display_path` is its file for messages.

        Raises
        ------
        SubsetError
            If its parameters are outside of the subset.
        """
        function = callee.function
        self.is_cached = hasattr(function, "__wrapped__")
        function = getattr(function, "__wrapped__", function)
        if isinstance(function, Nested):
            self.node, self.globals = function.node, function.spec.globals
            self.source = function.spec.source
            self.place = function.spec.place
            defaults: tuple[Any, ...] = ()
            keyword_defaults: dict[str, Any] = {}
            if self.node.args.defaults or self.node.args.kw_defaults:
                raise SubsetError(
                    f"{self.place}:{self.node.lineno}: defaults of a function within "
                    "another: give the arguments"
                )
        else:
            code = function.__code__
            self.source = source(code.co_filename)
            self.place = display_path
            if code.co_firstlineno not in self.source.functions:
                raise SubsetError(
                    f"{display_path}:{code.co_firstlineno}: a lambda with a name: def"
                )
            self.node = self.source.functions[code.co_firstlineno]
            self.globals = function.__globals__
            defaults, keyword_defaults = (
                function.__defaults__ or (),
                function.__kwdefaults__ or {},
            )
        self.name = self.node.name
        arguments = self.node.args
        if arguments.vararg or arguments.kwarg:
            raise SubsetError(
                f"{self.place}:{self.node.lineno}: * in {self.name}'s parameters: name them"
            )
        pairs = self._parameters_with_defaults(arguments, defaults, keyword_defaults)
        if callee.is_method:
            pairs = pairs[1:]
        self.parameters = [(a.arg, v) for a, v in pairs]
        annotations = [self._annotation(a.annotation) for a, _ in pairs]
        self.annotated_types: list[Type | None] = [t for t, _ in annotations]
        self.optional: list[bool] = [optional for _, optional in annotations]
        constants = self._find_slice_bounds()
        self.wants_constant = [a in constants for a, _ in self.parameters]
        self.is_constant: Any = None
        if self.is_cached and not self.parameters:
            self.is_constant = callee.function()

    def _parameters_with_defaults(
        self,
        arguments: ast.arguments,
        defaults: tuple[Any, ...],
        keyword_defaults: Mapping[str, Any],
    ) -> list[tuple[ast.arg, Any]]:
        """Pair each parameter with its default, or with `no_default`."""
        names = [*arguments.posonlyargs, *arguments.args]
        values = [self.no_default] * (len(names) - len(defaults)) + list(defaults)
        values += [
            keyword_defaults.get(a.arg, self.no_default) for a in arguments.kwonlyargs
        ]
        return list(zip([*names, *arguments.kwonlyargs], values, strict=True))

    def _find_slice_bounds(self) -> set[str]:
        """Return the names in slices that the function never assigns."""
        in_slices = {
            n.id
            for s in ast.walk(self.node)
            if isinstance(s, ast.Slice)
            for n in ast.walk(s)
            if isinstance(n, ast.Name)
        }
        assigned_names = {
            n.id
            for n in ast.walk(self.node)
            if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)
        }
        return in_slices - assigned_names

    def _annotation(self, node: ast.expr | None) -> tuple[Type | None, bool]:
        """Return the type of an annotation and whether it admits None."""
        if node is None:
            return None, True
        try:
            thing = eval(
                compile(ast.Expression(node), "annotation", "eval"), dict(self.globals)
            )
        except Exception:
            return None, "None" in ast.unparse(node)
        return of_annotation(thing)


def of_annotation(thing: Any) -> tuple[Type | None, bool]:
    """Return the type that an annotation gives, and whether it admits None.

    The type is None where the annotation does not determine it fully.
    """
    if thing is float:
        return F, False
    if thing is bool:
        return B, False
    if (
        isinstance(thing, python_types.UnionType)
        or typing.get_origin(thing) is typing.Union
    ):
        return None, type(None) in typing.get_args(thing)
    if isinstance(thing, type) and hasattr(thing, "_fields"):
        kinds = typing.get_type_hints(thing)
        if all(k is float for k in kinds.values()):
            return Tuple((F,) * len(kinds), tuple(kinds)), False
        return None, False
    if typing.get_origin(thing) is tuple:
        items = []
        for x in typing.get_args(thing):
            t, optional = (None, False) if x is Ellipsis else of_annotation(x)
            if optional and t is None:
                (x,) = (k for k in typing.get_args(x) if k is not type(None))
                t, _ = of_annotation(x)
                t = None if t is None else Maybe(t)
            if t is None:
                return None, False
            items.append(t)
        return (Tuple(tuple(items)) if items else None), False
    return None, thing is typing.Any


class NameUses:
    """Where a function uses its local names.

    For each name it records how often it is assigned, whether in a loop, and in which
    block of statements.
    """

    def __init__(self, body: list[ast.stmt]) -> None:
        self.stores: Counter[str] = Counter()
        self.changed_in_place: set[str] = set()
        self.in_loops: set[str] = set()
        self.lines: dict[str, list[int]] = {}
        self._paths: dict[str, list[tuple[int, ...]]] = {}
        self._first_stores: dict[str, tuple[tuple[int, ...], int]] = {}
        self._record_block(body, (), False)

    def find_inline_declarations(self) -> dict[int, set[str]]:
        """Return, by node, the names that can be declared at their first assignment."""
        inline: dict[int, set[str]] = {}
        for name, (path, node) in self._first_stores.items():
            paths = self._paths[name]
            common = paths[0]
            for other in paths:
                common = _common_start(common, other)
            if common == path and paths[0] == path:
                inline.setdefault(node, set()).add(name)
        return inline

    def _record_block(
        self, body: list[ast.stmt], path: tuple[int, ...], loop: bool
    ) -> None:
        """Record the names of a block of statements and of the blocks within it."""
        block_path = (*path, id(body))
        for s in body:
            if isinstance(s, ast.FunctionDef):
                bound_names = frozenset(a.arg for a in s.args.args)
                self._record_names(s, block_path, loop, bound_names)
                continue
            inner_blocks = _inner_blocks(s)
            inside: set[int] = set()
            for block in inner_blocks:
                inside |= {id(x) for x in block}
            for child in ast.iter_child_nodes(s):
                if id(child) in inside or isinstance(child, ast.ExceptHandler):
                    continue
                self._record_names(child, block_path, loop, frozenset())
            if isinstance(s, ast.AugAssign) and isinstance(s.target, ast.Name):
                self.stores[s.target.id] += 1
            for block in inner_blocks:
                in_loop = loop or isinstance(s, (ast.For, ast.While))
                self._record_block(block, block_path, in_loop)

    def _record_names(
        self,
        node: ast.AST,
        path: tuple[int, ...],
        loop: bool,
        bound_names: frozenset[str],
    ) -> None:
        """Record the names of an expression, except those a comprehension binds."""
        bound_names = bound_names | _bound_names(node)
        if isinstance(node, ast.Name) and node.id not in bound_names:
            self._record_name(node, path, loop)
        if (
            isinstance(node, ast.Subscript)
            and isinstance(node.ctx, ast.Store)
            and isinstance(node.value, ast.Name)
        ):
            self.changed_in_place.add(node.value.id)
        for child in ast.iter_child_nodes(node):
            self._record_names(child, path, loop, bound_names)

    def _record_name(self, node: ast.Name, path: tuple[int, ...], loop: bool) -> None:
        """Record one use of a local name."""
        if isinstance(node.ctx, ast.Store):
            self.stores[node.id] += 1
            if loop:
                self.in_loops.add(node.id)
            self._first_stores.setdefault(node.id, (path, id(node)))
        self._paths.setdefault(node.id, []).append(path)
        self.lines.setdefault(node.id, []).append(node.lineno)


def _inner_blocks(s: ast.stmt) -> list[list[ast.stmt]]:
    """Return the blocks of statements directly within a statement."""
    if not isinstance(s, (ast.If, ast.For, ast.While, ast.Try)):
        return []
    blocks = [block for block in (s.body, s.orelse) if block]
    if isinstance(s, ast.Try):
        blocks += [h.body for h in s.handlers]
    return blocks


def _bound_names(node: ast.AST) -> set[str]:
    """Return the names that a comprehension or lambda binds."""
    if isinstance(node, ast.Lambda):
        return {a.arg for a in node.args.args}
    names: set[str] = set()
    if isinstance(node, (ast.GeneratorExp, ast.ListComp)):
        for g in node.generators:
            names |= {n.id for n in ast.walk(g.target) if isinstance(n, ast.Name)}
    return names


def _common_start(a: tuple[int, ...], b: tuple[int, ...]) -> tuple[int, ...]:
    """Return the longest start that two paths share."""
    k = 0
    while k < min(len(a), len(b)) and a[k] == b[k]:
        k += 1
    return a[:k]


class Spec:
    """A function for given argument types, and what the passes find out about it."""

    def __init__(
        self,
        key: Any,
        info: Info,
        callee: Callee,
        types: tuple[Type, ...],
        consts: tuple[Any, ...],
        owner: Any,
        name: str,
    ) -> None:
        """Specialise a function for types and constants of its arguments."""
        self.key, self.info, self.callee = key, info, callee
        self.types, self.consts, self.owner, self.name = types, consts, owner, name
        self.node, self.globals, self.source = info.node, info.globals, info.source
        self.place = info.place
        self.arguments = [
            (n, t) for (n, _), t in zip(info.parameters, types, strict=True)
        ]
        is_nested = isinstance(callee.function, Nested)
        self.takes_self = callee.is_method
        self.self_captured = is_nested and any(n == "self" for n, _ in callee.captures)
        self.has_self = callee.is_method or self.self_captured
        self.variables: dict[str, Type] = {}
        self.hoisted_names: set[str] = set()
        self.result: Type = NEVER
        self.is_translated = False
        self.effects = False
        self.lines: list[str] = []
        # functions with a remembered result that this one calls, directly or indirectly
        self.reached_memos: set[str] = set()
        self.recursive = False
        self.end_reached = False
        self.busy = False
        self._find_places()

    @property
    def top(self) -> set[str]:
        """Return the variables that are declared at the top of the function."""
        return self.hoisted_names

    def _find_places(self) -> None:
        """Find where each local name is used, and how each argument is passed."""
        uses = NameUses(self.node.body)
        self.stores = uses.stores
        self.changed_in_place = uses.changed_in_place
        self.in_loops = uses.in_loops
        self.inline = uses.find_inline_declarations()
        self._lines = uses.lines
        parameters = {a for a, _ in self.arguments}
        # a list counts as changed where a function that gets it changes it
        for call in ast.walk(self.node):
            if isinstance(call, ast.Call):
                self._record_changed_lists(call, parameters)
        self.locals_names = {*self.stores, *parameters}
        self.by_address = {
            n
            for (n, t) in self.arguments
            if n in self.changed_in_place
            or (self.stores[n] == 0 and (size(t) > BY_ADDRESS or _captures(t)))
        }

    def _record_changed_lists(self, call: ast.Call, parameters: set[str]) -> None:
        """Record lists passed to a function that changes their elements."""
        target: object = None
        match call.func:
            case ast.Name(id=name):
                target = self.globals.get(name)
            case ast.Attribute(value=ast.Name(id=module), attr=name):
                target = getattr(self.globals.get(module), name, None)
        if not isinstance(target, python_types.FunctionType) or "desat" not in (
            target.__module__ or ""
        ):
            return
        if not inspect.getsourcefile(target):
            return
        node = source(target.__code__.co_filename).functions.get(
            target.__code__.co_firstlineno
        )
        if node is None:
            return
        changed_parameters = {
            n.value.id
            for n in ast.walk(node)
            if isinstance(n, ast.Subscript)
            and isinstance(n.ctx, ast.Store)
            and isinstance(n.value, ast.Name)
        }
        for argument, parameter in zip(call.args, node.args.args, strict=False):
            if parameter.arg in changed_parameters and isinstance(argument, ast.Name):
                self.changed_in_place.add(argument.id)

    def passing(self, k: int) -> str:
        """Return how argument `k` is passed: "value", "address" or "change".

        "change" is a list whose elements the function assigns.
        """
        name, _ = self.arguments[k]
        if name in self.changed_in_place:
            return "change"
        return "address" if name in self.by_address else "value"

    def give(self, t: Type, one: Any, node: ast.AST) -> None:
        """Widen the result type by the type of another returned value."""
        try:
            wider = join(self.result, t)
        except JoinError as error:
            raise one.refuse(
                node, f"{self.info.name} returns {error}", "keep to one type"
            ) from None
        if wider != self.result:
            self.result = wider
            one.types_changed = True

    def used_after(self, loop: ast.For, name: str) -> bool:
        """Return whether a name is used after a loop."""
        return any(line > (loop.end_lineno or 0) for line in self._lines.get(name, ()))

    def outside_of(self, loop: ast.For, name: str) -> bool:
        """Return whether a name is used before the loop that assigns it."""
        return any(line < loop.lineno for line in self._lines.get(name, ()))

    @property
    def memo(self) -> bool:
        """Return whether the C keeps the last result.

        It does so where Python caches the function and the result has more than 1024
        bytes.
        """
        return self.info.is_cached and size(self.result) > 1024

    @property
    def never_returns(self) -> bool:
        """Return whether the function always raises."""
        return self.is_translated and self.result == NEVER


def _captures(t: Type) -> bool:
    """Return whether a type is a function that captures variables."""
    return type(t).__name__ == "Function" and any(c.captures for c in t.callees)


def size(t: Type) -> int:
    """Estimate the size of a value of a type in bytes."""
    if isinstance(t, Scalar):
        return 8
    if isinstance(t, Tuple):
        return sum(size(x) for x in t.items)
    name = type(t).__name__
    if name == "List":
        return 8 + int(t.most) * size(t.item)
    if name == "Maybe":
        return 8 + size(t.item)
    if name == "Function":
        return sum(
            8 if x == "self" else size(x) for c in t.callees for _, x in c.captures
        )
    return 8
