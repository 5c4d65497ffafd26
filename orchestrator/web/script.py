"""Translate Python functions that use numpy to JavaScript, for a page.

They are the measures and derived quantities. `numpy.js` implements as `$` the functions
of numpy that they call. Operators become calls of it, because JavaScript's arrays have
none. Unknown constructs are refused: no measure is written a second time.
"""

from __future__ import annotations

import ast
import inspect
import json
import re
import sys
import textwrap
from collections.abc import Callable, Iterable, Iterator
from importlib.resources import files
from typing import Any

import numpy as np

from ..numbers.derived import QUANTITIES
from ..system.errors import DesatError

_NUMPY = (files(__package__) / "numpy.js").read_text(encoding="utf-8")
_KNOWN = frozenset(re.findall(r"^  (\w+):", _NUMPY, re.M)) | set(
    re.findall(r", (\w+): (?:both|each|over)\(", _NUMPY)
)
_OPERATION = re.compile(r'\b(both|each)\("([^"]+)"')
_LOOPS = {
    "both": "(a, b) => {0}, (x, y, i, j, data) => {{\n"
    "    for (let k = 0; k < data.length; k++) {{\n"
    "      const a = x[i * k], b = y[j * k];\n"
    "      data[k] = {0};\n    }}\n  }}",
    "each": "(a) => {0}, (x, data) => {{\n"
    "    for (let k = 0; k < data.length; k++) {{\n"
    "      const a = x[k];\n"
    "      data[k] = {0};\n    }}\n  }}",
}
_OPERATORS: dict[type[ast.AST], str] = {
    ast.Add: "add",
    ast.Sub: "sub",
    ast.Mult: "mul",
    ast.Div: "div",
    ast.Pow: "pow",
    ast.FloorDiv: "floordiv",
    ast.Mod: "mod",
    ast.MatMult: "matmul",
    ast.BitAnd: "and",
    ast.BitOr: "or",
    ast.Lt: "lt",
    ast.Gt: "gt",
    ast.LtE: "le",
    ast.GtE: "ge",
    ast.Eq: "eq",
    ast.NotEq: "ne",
    ast.USub: "neg",
    ast.Invert: "not",
}
_BUILTINS = {
    "float": "float",
    "int": "int",
    "bool": "bool",
    "len": "len",
    "round": "round",
    "max": "larger",
    "min": "smaller",
    "abs": "abs",
    "enumerate": "enumerate",
}
# modules whose functions are translated along with those that call them
_OURS = ("desat.numbers.", "desat.analyses.")


def numpy_source() -> str:
    """Return numpy.js with each operation named by text written out as functions."""

    def written_out(match: re.Match[str]) -> str:
        """Return the functions of one operation."""
        kind, text = match.groups()
        return f"{kind}({_LOOPS[kind].format(text)}"

    return _OPERATION.sub(written_out, _NUMPY)


def script(functions: Iterable[Callable[..., Any]]) -> tuple[str, dict[str, str]]:
    """Translate functions and all functions that they call to JavaScript.

    Returns
    -------
    tuple
        The JavaScript, which ends with an object `measures` of the functions by name;
        and for each function that does not translate the reason, by name.
    """
    program, refused, there = _ScriptProgram(), dict[str, str](), list[str]()
    for function in functions:
        try:
            there.append(program.name_of(function))
        except DesatError as error:
            refused[function.__name__] = str(error)
    parts = [*program.parts.values(), f"const measures = {{ {', '.join(there)} }};"]
    return "\n".join(parts) + "\n", refused


class _ScriptProgram:
    """Functions and constants translated so far, each after those it needs."""

    def __init__(self) -> None:
        self.parts: dict[str, str] = {}

    def name_of(self, thing: Any) -> str:
        """Return the JavaScript name of a function, translating it if needed.

        Raises DesatError where it does not translate.
        """
        name: str = thing.__name__
        thing = inspect.unwrap(thing)  # rows may be computed in blocks
        if name not in self.parts:
            tree = ast.parse(textwrap.dedent(inspect.getsource(thing))).body[0]
            assert isinstance(tree, ast.FunctionDef)
            self.parts[name] = _Function(self, tree, thing.__globals__).text()
        return name

    def table_of(self, name: str, scope: dict[str, Any]) -> str:
        """Return the name of a module's table of functions, translated if needed."""
        if name not in self.parts:
            tree = ast.parse(inspect.getsource(sys.modules[scope["__name__"]]))
            value = next(
                n.value
                for n in tree.body
                if isinstance(n, (ast.Assign, ast.AnnAssign))
                and name in ast.unparse(n).partition("=")[0]
            )
            assert value is not None
            self.parts[name] = f"const {name} = {_Expressions(self, scope).of(value)};"
        return name


class _Expressions:
    """Expressions of a function with the globals `scope` and local names `local`."""

    def __init__(self, program: _ScriptProgram, scope: dict[str, Any]) -> None:
        self._program, self._scope = program, scope
        self.local: set[str] = set()

    def of(self, node: ast.expr) -> str:
        """Translate an expression, or raise DesatError if it has no JavaScript."""
        method = getattr(self, f"_{type(node).__name__.lower()}", None)
        if method is None:
            raise DesatError(
                f"line {node.lineno}: this has no translation to JavaScript: `{ast.unparse(node)}`"
            )
        text: str = method(node)
        return text

    def _list_of(self, nodes: Iterable[ast.expr]) -> str:
        """Translate expressions, separated by commas."""
        return ", ".join(map(self.of, nodes))

    def _constant(self, node: ast.Constant) -> str:
        if node.value is ...:
            return '"..."'
        if node.value is None or isinstance(node.value, bool):
            return {None: "null", True: "true", False: "false"}[node.value]
        is_text = isinstance(node.value, str)
        return json.dumps(node.value) if is_text else repr(node.value)

    def _joinedstr(self, node: ast.JoinedStr) -> str:
        """Translate an f-string."""
        return f'[{self._list_of(node.values)}].join("")'

    def _formattedvalue(self, node: ast.FormattedValue) -> str:
        """Translate a value in an f-string, with its format."""
        form = self.of(node.format_spec) if node.format_spec else '""'
        return f"$.format({self.of(node.value)}, {form})"

    def _name(self, node: ast.Name) -> str:
        """Translate a local name, a constant or a table of the module."""
        if node.id in self.local:
            return (
                f"{node.id}_"
                if node.id in ("with", "function", "var", "new")
                else node.id
            )
        value = self._scope.get(node.id)
        if isinstance(value, (int, float, str)):
            return self._constant(ast.Constant(value))
        if isinstance(value, dict):
            return self._program.table_of(node.id, self._scope)
        raise DesatError(
            f"line {node.lineno}: this has no translation to JavaScript: `{node.id}`"
        )

    def _tuple(self, node: ast.Tuple | ast.List) -> str:
        return f"[{self._list_of(node.elts)}]"

    _list = _tuple

    def _dict(self, node: ast.Dict) -> str:
        entries = (
            f"{self.of(k)}: {self.of(v)}"
            for k, v in zip(node.keys, node.values, strict=True)
            if k is not None
        )
        return f"{{ {', '.join(entries)} }}"

    def _starred(self, node: ast.Starred) -> str:
        return f"...{self.of(node.value)}"

    def _lambda(self, node: ast.Lambda) -> str:
        names = {a.arg for a in node.args.args}
        new = names - self.local
        self.local |= new
        text = f"({', '.join(a.arg for a in node.args.args)}) => {self.of(node.body)}"
        self.local -= new
        return text

    def _binop(self, node: ast.BinOp) -> str:
        return self._operator(node.op, node.left, node.right)

    def _unaryop(self, node: ast.UnaryOp) -> str:
        if isinstance(node.op, ast.Not):
            return f"!{self.of(node.operand)}"
        return self._operator(node.op, node.operand)

    def _operator(self, op: ast.AST, *operands: ast.expr) -> str:
        """Translate an operator to a call of `numpy.js`."""
        if type(op) not in _OPERATORS:
            raise DesatError(
                f"line {operands[0].lineno}: this has no translation to JavaScript: {type(op).__name__}"
            )
        return f"$.{_OPERATORS[type(op)]}({self._list_of(operands)})"

    def _boolop(self, node: ast.BoolOp) -> str:
        joint = " && " if isinstance(node.op, ast.And) else " || "
        return f"({joint.join(map(self.of, node.values))})"

    def _compare(self, node: ast.Compare) -> str:
        if isinstance(node.ops[0], (ast.Is, ast.IsNot)):
            sign = "===" if isinstance(node.ops[0], ast.Is) else "!=="
            return f"({self.of(node.left)} {sign} {self.of(node.comparators[0])})"
        sides = [node.left, *node.comparators]
        parts = [
            self._operator(op, a, b)
            for op, a, b in zip(node.ops, sides, sides[1:], strict=False)
        ]
        return parts[0] if len(parts) == 1 else f"({' && '.join(parts)})"

    def _ifexp(self, node: ast.IfExp) -> str:
        return f"({self.of(node.test)} ? {self.of(node.body)} : {self.of(node.orelse)})"

    def _attribute(self, node: ast.Attribute) -> str:
        """Translate np.pi, or T, shape or ndim of an array."""
        if ast.unparse(node) == "np.pi":
            return "Math.PI"
        if node.attr not in ("T", "shape", "ndim"):
            raise DesatError(
                f"line {node.lineno}: this has no translation to JavaScript: `{ast.unparse(node)}`"
            )
        return f"$.{node.attr}({self.of(node.value)})"

    def _subscript(self, node: ast.Subscript) -> str:
        return f"$.get({self.of(node.value)}, {self.places(node)})"

    def places(self, node: ast.Subscript) -> str:
        """Translate the index between brackets."""
        inside = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
        return f"[{', '.join(map(self._place, inside))}]"

    def _place(self, node: ast.expr) -> str:
        """Translate one index or slice."""
        if not isinstance(node, ast.Slice):
            return self.of(node)
        if node.step is not None:
            raise DesatError(
                f"line {node.lineno}: this has no translation to JavaScript: `{ast.unparse(node)}`"
            )
        ends = ("null" if x is None else self.of(x) for x in (node.lower, node.upper))
        return f"{{ slice: [{', '.join(ends)}] }}"

    def _listcomp(self, node: ast.ListComp) -> str:
        """Translate a list comprehension to `map`; refuse one with a condition."""
        (of,) = node.generators
        if of.ifs or not isinstance(of.target, ast.Name):
            raise DesatError(
                f"line {node.lineno}: this has no translation to JavaScript: `{ast.unparse(node)}`"
            )
        source = self.of(of.iter)
        new = {of.target.id} - self.local
        self.local |= new
        text = f"[...{source}].map(({of.target.id}) => {self.of(node.elt)})"
        self.local -= new
        return text

    def _call(self, node: ast.Call) -> str:
        """Translate a call; named arguments become an object."""
        to_type = isinstance(node.func, ast.Attribute) and node.func.attr == "astype"
        arguments = [self.of(a) for a in node.args if not to_type]
        if named := {
            k.arg: self.of(k.value) for k in node.keywords if k.arg != "dtype"
        }:
            arguments.append(
                f"{{ {', '.join(f'{k}: {v}' for k, v in named.items())} }}"
            )
        if isinstance(node.func, ast.Attribute):
            full_name, name = ast.unparse(node.func), node.func.attr
            if not re.fullmatch(r"np(\.\w+)+", full_name):
                arguments.insert(0, self.of(node.func.value))
            return f"{self._runtime(name, node)}({', '.join(arguments)})"
        return f"{self._called(node, bool(named))}({', '.join(arguments)})"

    def _called(self, node: ast.Call, named: bool) -> str:
        """Return the function that a call without a dot calls."""
        if not isinstance(node.func, ast.Name):
            return self.of(node.func)
        name = node.func.id
        value = self._scope.get(name)
        if (
            inspect.isfunction(value)
            and value.__module__.startswith(_OURS)
            and not named
        ):
            return self._program.name_of(value)
        return (
            name if name in self.local else self._runtime(_BUILTINS.get(name, ""), node)
        )

    def _runtime(self, name: str, node: ast.Call) -> str:
        """Return a function of `numpy.js`, or raise DesatError if it has none."""
        if name not in _KNOWN:
            raise DesatError(
                f"line {node.lineno}: this has no translation to JavaScript: `{ast.unparse(node)}`"
            )
        return f"$.{name}"


class _Function(_Expressions):
    """Translation of one function."""

    def __init__(
        self, program: _ScriptProgram, tree: ast.FunctionDef, scope: dict[str, Any]
    ) -> None:
        super().__init__(program, scope)
        self._tree = tree
        arguments = [*tree.args.args, *([tree.args.vararg] if tree.args.vararg else [])]
        self.local |= {a.arg for a in arguments}
        self._locals = sorted(
            {
                n.id
                for part in ast.walk(tree)
                if not isinstance(part, ast.ListComp)
                for n in ast.iter_child_nodes(part)
                if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)
            }
            - self.local
        )
        self.local |= {*self._locals}

    def text(self) -> str:
        """Return the function as JavaScript.

        `order` of it holds the names of its arguments.
        """
        args = self._tree.args
        names = [a.arg for a in args.args]
        defaults = [None] * (len(names) - len(args.defaults)) + list(args.defaults)
        heads = [
            n if d is None else f"{n} = {self.of(d)}"
            for n, d in zip(names, defaults, strict=True)
        ]
        heads += [f"...{args.vararg.arg}"] if args.vararg else []
        body = [line for s in self._tree.body for line in self._statement(s)]
        declaration = [f"let {', '.join(self._locals)};"] if self._locals else []
        lines = "".join(f"  {line}\n" for line in (*declaration, *body))
        names_text = ", ".join(f'"{n}"' for n in names)
        name = self._tree.name
        return (
            f"function {name}({', '.join(heads)}) {{\n{lines}}}\n"
            f"{name}.order = [{names_text}];"
        )

    def _statement(self, node: ast.stmt) -> Iterator[str]:
        """Yield the JavaScript of a statement."""
        match node:
            case ast.Expr(ast.Constant()):
                pass  # its docstring
            case ast.Return(value) if value is not None:
                yield f"return {self.of(value)};"
            case ast.Assign([target], value) | ast.AnnAssign(target, _, value) if (
                value is not None
            ):
                yield self._assigned(target, self.of(value))
            case ast.AugAssign(target, op, value):
                source = ast.parse(ast.unparse(target), mode="eval").body
                yield self._assigned(target, self._operator(op, source, value))
            case ast.If(test, body, orelse):
                yield f"if ({self.of(test)}) {{"
                yield from self._block(body)
                yield (
                    f"}} else {{ {' '.join(self._block(orelse))} }}" if orelse else "}"
                )
            case ast.For(target, source, body):
                yield f"for ({self.of(target)} of {self.of(source)}) {{"
                yield from self._block(body)
                yield "}"
            case ast.With(_, body):
                yield from (line for s in body for line in self._statement(s))
            case _:
                raise DesatError(
                    f"line {node.lineno}: this has no translation to JavaScript: "
                    f"`{ast.unparse(node).partition(chr(10))[0]}`"
                )

    def _block(self, body: Iterable[ast.stmt]) -> Iterator[str]:
        """Yield the indented JavaScript of statements."""
        yield from (f"  {line}" for s in body for line in self._statement(s))

    def _assigned(self, target: ast.expr, value: str) -> str:
        """Return the assignment of a value to a name or an element."""
        if isinstance(target, ast.Subscript):
            return f"$.set({self.of(target.value)}, {self.places(target)}, {value});"
        return f"{self.of(target)} = {value};"


def quantities() -> list[Callable[..., np.ndarray[Any, Any]]]:
    """Return the functions of all derived quantities."""
    return [q.function for q in QUANTITIES.values()]
