"""Translate one function of the subset, for given argument types, to C."""

from __future__ import annotations

import ast
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from .calls import UNROLLED, Calls, Iteration, RangeOf
from .expressions import Known, UnknownYetError, safe_field
from .order import Order, find_refused, reads
from .source import BY_ADDRESS, of_annotation, size
from .types import (
    NEVER,
    NONE,
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
    element,
    hidden,
    join,
    most,
    safe,
    type_text,
)
from .value import Value, constant

RAISES = {
    "BlockError": "PY_BLOCK_ERROR",
    "ValueError": "PY_VALUE_ERROR",
    "TypeError": "PY_TYPE_ERROR",
    "ZeroDivisionError": "PY_ZERO_DIVISION",
    "OverflowError": "PY_OVERFLOW",
    "IndexError": "PY_INDEX_ERROR",
    "RuntimeError": "PY_RUNTIME_ERROR",
    "ArithmeticError": "PY_ZERO_DIVISION, PY_OVERFLOW",
}
CAUGHT = {
    "BlockError": "1 << PY_BLOCK_ERROR",
    "ValueError": "1 << PY_BLOCK_ERROR | 1 << PY_VALUE_ERROR",
    "ZeroDivisionError": "1 << PY_ZERO_DIVISION",
    "OverflowError": "1 << PY_OVERFLOW",
    "ArithmeticError": "1 << PY_ZERO_DIVISION | 1 << PY_OVERFLOW",
    "IndexError": "1 << PY_INDEX_ERROR",
}


class Translation(Calls):
    """One pass over the body of a function."""

    def __init__(self, spec: Any, program: Any) -> None:
        """Begin to translate a specialised function: bind parameters and captures.

        Raises
        ------
        SubsetError
            If the function has a construct that would behave differently in C.
        """
        self.spec, self.program = spec, program
        self.out, self.level = [], 1
        self.counts = {}
        self.types = dict(spec.variables)
        self.bindings = {}
        self.bounds = {}
        self.kept_of, self.reached_memos = Counter(), set()
        self.sure = set()
        self.conditions = set()
        self.flow_ended = False
        self.effects = False
        self.types_changed = False
        self.declared_names: set[str] = set()
        self.tries = 0
        self.limits_needed: dict[str, int] = {}
        # number of enclosing try statements at the start of each enclosing loop
        self.loops: list[int] = []
        self.commented_to = spec.node.lineno
        arguments = {name for name, _ in spec.arguments}
        self.order = Order(spec.node, program.block, spec.changed_in_place)
        for finding in find_refused(
            self.order, spec.node, spec.changed_in_place, arguments
        ):
            raise self.refuse(*finding)
        for (name, t), const in zip(spec.arguments, spec.consts, strict=True):
            if const is not None:
                self.bindings[name] = constant(const)  # type: ignore[assignment]
            elif isinstance(t, Function):
                code = "" if hidden(t) else self.local(name)
                self.bindings[name] = Value(t, code, again=True)
            else:
                self.types[name] = join(t, self.types.get(name, NEVER))
                self.declared_names.add(name)
        for name, t in spec.callee.captures:
            if name == "self":
                continue
            at = f"all->{safe(name)}"
            if (
                isinstance(t, Function)
                and len(t.callees) == 1
                and not t.callees[0].captures
            ):
                at = ""
            self.bindings[name] = Value(t, at, again=True)

    def copy_widened_parameters(self) -> None:
        """Copy parameters that later get values of a wider type to variables."""
        for name, t in self.spec.arguments:
            final = self.spec.variables.get(name, t)
            if final != t and name not in self.bindings:
                argument = Value(t, f"{safe(name)}_given", again=True)
                text = self.convert(argument, final)
                self.line(f"{self.program.names(final)} {safe(name)} = {text};")

    def local(self, name: str) -> str:
        """Return the C of a local variable, dereferenced if passed by address."""
        if name in self.spec.by_address:
            return f"(*{safe(name)})"
        return safe(name)

    # --- statements -------------------------------------------------------------------

    def block(self, body: Sequence[ast.stmt]) -> bool:
        """Write statements; return True where the end cannot be reached."""
        for statement in body:
            if self.flow_ended:
                self.flow_ended = False
                return True
            self.comments(statement)
            try:
                self.statement(statement)
            except JoinError as error:
                raise self.refuse(
                    statement, str(error), "keep to one type; 1.0 is a float"
                ) from None
        flow_ended, self.flow_ended = self.flow_ended, False
        return flow_ended

    def comments(self, node: ast.stmt) -> None:
        """Copy the comments of the source up to a statement to the C."""
        last = node.end_lineno or node.lineno
        if isinstance(node, (ast.If, ast.For, ast.While, ast.Try, ast.FunctionDef)):
            last = node.body[0].lineno - 1
        for text in self.spec.source.comments(self.commented_to + 1, last):
            self.line(f"/* {text} */")
        self.commented_to = max(self.commented_to, last)

    def statement(self, node: ast.stmt) -> None:
        """Write one statement, or refuse its kind."""
        method = getattr(self, f"do_{type(node).__name__.lower()}", None)
        if method is None:
            raise self.refuse(
                node,
                f"a {type(node).__name__.lower()} statement",
                "plain assignments, if, for, while, return, raise",
            )
        method(node)

    def do_pass(self, node: ast.Pass) -> None:
        pass

    def do_expr(self, node: ast.Expr) -> None:
        if isinstance(node.value, ast.Constant):
            return
        value = self.expression(node.value)
        self.evaluate(value)

    def evaluate(self, value: Value) -> None:
        """Write the evaluation of an unused value, because it may fail."""
        if value.parts is not None and not value.is_const:
            for part in value.parts:
                self.evaluate(part)
        elif value.code and not value.again and value.type not in (NONE, NEVER):
            self.line(f"(void)({value.code});")

    def do_annassign(self, node: ast.AnnAssign) -> None:
        """Translate an annotated assignment; the annotation may limit a length."""
        limit = self.program.most_of(node.annotation, self.spec.globals)
        if limit is not None:
            if isinstance(node.target, ast.Name):
                self.limits_needed[node.target.id] = limit
            elif isinstance(node.target, ast.Attribute):
                self.program.limits_needed[node.target.attr] = limit
        if node.value is None:
            return
        self.most_wanted = limit
        value = self.expression(node.value)
        self.most_wanted = None
        item = optional(node.annotation, self.spec.globals)
        if item is not None and value.type == NONE:
            value = Value(Maybe(item), f"({self.program.names(Maybe(item))}){{0}}")
        self.assign(node.target, value)

    def do_assign(self, node: ast.Assign) -> None:
        """Translate an assignment; the value of several targets is computed once."""
        (first, *_) = node.targets
        if isinstance(first, ast.Name) and first.id in self.limits_needed:
            self.most_wanted = self.limits_needed[first.id]
        if (
            isinstance(first, ast.Attribute)
            and first.attr in self.program.limits_needed
        ):
            self.most_wanted = self.program.limits_needed[first.attr]
        value = self.expression(node.value)
        self.most_wanted = None
        if (
            isinstance(node.value, ast.Name)
            and isinstance(first, ast.Name)
            and isinstance(value.type, Tuple)
        ):
            for name in (node.value.id, first.id):
                if name in self.spec.changed_in_place:
                    raise self.refuse(
                        node,
                        f"a second name for the list {name}",
                        "list(...) copies it",
                    )
        if len(node.targets) > 1:
            value = self.temporary(value)
        for target in reversed(node.targets) if len(node.targets) > 1 else node.targets:
            self.assign(target, value)

    def do_augassign(self, node: ast.AugAssign) -> None:
        """Translate `a op= b` as `a = a op b`; text is joined."""
        load = ast.copy_location(_load(node.target), node)
        if isinstance(node.target, ast.Name) and node.target.id in self.limits_needed:
            self.most_wanted = self.limits_needed[node.target.id]
        assignment = ast.copy_location(ast.BinOp(load, node.op, node.value), node)
        if (
            isinstance(node.target, ast.Name)
            and node.target.id in self.types
            and (self.types[node.target.id] == S)
        ):
            joined_text = ast.JoinedStr(
                [
                    ast.FormattedValue(load, -1, None),
                    ast.FormattedValue(node.value, -1, None),
                ]
            )
            value = self.expression(ast.copy_location(joined_text, node))
        else:
            value = self.expression(assignment)
        self.most_wanted = None
        self.assign(node.target, value)

    def assign(self, target: ast.expr, value: Value) -> None:
        """Assign a value to a name, a field, an element, or to several in order."""
        if isinstance(target, ast.Name):
            self.store(target, value)
        elif isinstance(target, ast.Attribute):
            if not self.is_self(target.value):
                raise self.refuse(
                    target, "an assignment to a field of this", "fields of self"
                )
            self.store_field(target, value)
        elif isinstance(target, ast.Subscript):
            self.store_element(target, value)
        elif isinstance(target, (ast.Tuple, ast.List)):
            if any(isinstance(e, ast.Starred) for e in target.elts):
                raise self.refuse(target, "* in a target", "a name for each")
            n = len(target.elts)
            parts = self.elements(value, n, target)
            names = [self.target_code(e) for e in target.elts]
            for k, part in enumerate(parts):
                text = self.text_of(part)
                calls = re.search(r"\bself\b(?!->)", text) is not None
                if any(
                    c and (_mentions(text, c) or (calls and c.startswith("self->")))
                    for c in names[:k]
                ):
                    parts = [self.pin(p) for p in parts]
                    break
            for e, part in zip(target.elts, parts, strict=True):
                self.assign(e, part)
        else:
            raise self.refuse(target, "this target", "names and fields of self")

    def pin(self, value: Value) -> Value:
        """Store a value in a temporary unless no statement can change it."""
        if (
            value.is_const
            or value.type in (NONE, NEVER)
            or isinstance(value.type, Known)
        ):
            return value
        if value.parts is not None:
            return replace(value, parts=tuple(self.pin(p) for p in value.parts))
        if self.is_fixed(value):
            return value
        return self.temporary(replace(value, again=False))

    def text_of(self, value: Value) -> str:
        """Return the C code of a value and of all its parts."""
        if value.parts is not None:
            return " ".join(self.text_of(p) for p in value.parts)
        return value.code

    def target_code(self, target: ast.expr) -> str:
        """Return the C of the variable or field that a target changes."""
        if isinstance(target, ast.Name):
            return self.local(target.id)
        if isinstance(target, ast.Attribute):
            return f"self->{safe_field(target.attr)}"
        if isinstance(target, ast.Subscript):
            return self.target_code(target.value)
        return ""

    def store(self, target: ast.Name, value: Value) -> None:
        """Assign a value to a local variable, declaring it where needed.

        A constant or function assigned once becomes no variable: the name stands for
        it.
        """
        name = target.id
        if name == "_":
            self.evaluate(value)
            return
        self.sure.discard(name)
        if name in self.bindings:
            if name in dict(self.spec.callee.captures):
                raise self.refuse(
                    target,
                    f"{name} belongs to the function around",
                    "a name of its own",
                )
            del self.bindings[name]
        if self._stands_for_value(target, value):
            self.bindings[name] = value
            return
        t = self._widen_variable(target, value)
        if t in (NONE, NEVER):
            return
        final = self.spec.variables[name]
        if isinstance(final, List) and final.item == NEVER:
            return
        text = self.convert(value, final, target)
        self._store_bounds(name, value)
        self._write_assignment(target, final, text)

    def _stands_for_value(self, target: ast.Name, value: Value) -> bool:
        """Return whether a name stands for its value, so that it is no C variable."""
        name = target.id
        if isinstance(value.type, Known) or (
            isinstance(value.type, Function) and len(value.type.callees) == 1
        ):
            if name in self.types:
                raise self.refuse(target, f"{name} was a number before", "another name")
            if not (isinstance(value.type, Function) and self.spec.stores[name] > 1):
                return True
        if (
            value.is_const
            and self.spec.stores[name] == 1
            and name not in self.types
            and (value.type in (S, I) or isinstance(value.type, (Tuple, List)))
            and name not in {*self.spec.changed_in_place, *self.spec.in_loops}
        ):
            return True
        return self.stays(name, value)

    def _widen_variable(self, target: ast.Name, value: Value) -> Type:
        """Join the type of a variable with that of a new value, and return it."""
        name = target.id
        old = self.types.get(name, NEVER)
        t = self.join_with(old, value.type, self.limits_needed.get(name), target, name)
        argument_type = dict(self.spec.arguments).get(name)
        if argument_type == I and t != I and t != F:
            raise self.refuse(
                target, f"{name} is an integer and then a 64-bit mask", "another name"
            )
        if t != self.spec.variables.get(name):
            self.types_changed = True
            self.spec.variables[name] = t
        self.types[name] = t
        return t

    def _store_bounds(self, name: str, value: Value) -> None:
        """Keep the bounds of an integer that is assigned only once."""
        is_assigned_once = (
            name not in self.spec.in_loops
            and self.spec.stores[name] == 1
            and dict(self.spec.arguments).get(name) is None
        )
        self.bounds[name] = (None, None)
        if value.type == I and is_assigned_once:
            self.bounds[name] = (value.low, value.high)

    def _write_assignment(self, target: ast.Name, final: Type, text: str) -> None:
        """Write an assignment in C, as a declaration where it is the first."""
        name = target.id
        if name not in self.declared_names:
            inline_names = self.spec.inline.get(id(target), ())
            if self.level == 1 + self.tries or name in inline_names:
                self.declared_names.add(name)
                const = "const " if self.spec.stores[name] == 1 else ""
                const = "" if name in self.spec.changed_in_place else const
                names = self.program.names(final)
                const = "" if names.startswith("const") else const
                self.line(f"{const}{names} {safe(name)} = {text};")
                return
            self.spec.hoisted_names.add(name)
        self.line(f"{self.local(name)} = {text};")

    def stays(self, name: str, value: Value) -> bool:
        """Return whether a name may stand for a remembered result without a copy."""
        return (
            value.again
            and value.code.startswith("(*kept_")
            and size(value.type) > BY_ADDRESS
            and self.level == 1 + self.tries
            and self.spec.stores[name] == 1
            and name
            not in {*self.types, *self.limits_needed, *self.spec.changed_in_place}
        )

    def join_with(
        self, old: Type, new: Type, limit: int | None, node: ast.AST, name: str
    ) -> Type:
        """Return the type of a variable of type `old` that gets one of type `new`."""
        try:
            t = join(old, new)
        except JoinError as error:
            raise self.refuse(node, f"{name} is {error}", "keep to one type") from None
        if limit is not None and isinstance(t, (List, Tuple)):
            item = NEVER if isinstance(t, List) and t.most == 0 else element(t)
            t = List(item, limit)
        elif (
            isinstance(t, List)
            and isinstance(old, List)
            and t.most > old.most > 0
            and (t.most > 4096)
        ):
            raise self.refuse(node, f"{name} grows", "Annotated[tuple[...], MOST]")
        return t

    def store_field(self, target: ast.Attribute, value: Value) -> None:
        """Assign a value to a field of the block, widening its type where needed."""
        name = target.attr
        program = self.program
        self.effects = True
        self.sure.discard(f"self.{name}")
        if isinstance(value.type, (Known, Function)) or _has(Function, value.type):
            raise self.refuse(
                target, f"self.{name} keeps a function", "numbers and tuples"
            )
        declared_type = program.declared_types.get(name)
        if declared_type is None and _has(S, value.type):
            raise self.refuse(
                target, f"self.{name} keeps text", "a number; text is for messages"
            )
        old = program.fields.get(name, NEVER)
        if declared_type is None:
            t = self.join_with(
                old, value.type, program.limits_needed.get(name), target, f"self.{name}"
            )
            if t != old:
                program.fields[name] = t
                program.types_changed = True
                program.unsettled_name = f"self.{name}"
            if (isinstance(t, List) and t.item == NEVER) or t in (NONE, NEVER):
                return
        else:
            t = declared_type
        self.line(f"self->{safe_field(name)} = {self.convert(value, t, target)};")

    def store_element(self, target: ast.Subscript, value: Value) -> None:
        """Assign a value to an element of a list that the function made."""
        if not isinstance(target.value, ast.Name):
            raise self.refuse(target, "an element of this", "of a list with a name")
        name = target.value.id
        value = self.temporary(value) if not value.again else value
        x = self.expression(target.value)
        if x.code != self.local(name) or not isinstance(x.type, (Tuple,)):
            raise self.refuse(
                target, f"an element of {name} is changed", "of a list made here"
            )
        index = self.expression(target.slice)
        n = most(x.type)
        item = element(x.type)
        wider = join(item, value.type)
        if wider != item:
            self.spec.variables[name] = Tuple((wider,) * n)
            self.types[name] = self.spec.variables[name]
            self.types_changed = True
        if not x.type.uniform:
            self.types_changed = True
            return
        if index.is_const:
            if not -n <= index.const < n:
                raise self.refuse(
                    target, f"index {index.const} of {n}", "one that is there"
                )
            k = str(index.const % n)
        else:
            k = self.checked_index(index, constant(n))  # type: ignore[arg-type]
        self.line(f"{x.code}.e[{k}] = {self.convert(value, wider, target)};")

    def do_return(self, node: ast.Return) -> None:
        """Translate a return, leaving each enclosing try."""
        value = constant(None) if node.value is None else self.expression(node.value)
        assert value is not None
        if node.value is not None and self.flow_ended:
            return
        t = value.type
        if isinstance(t, Known):
            if not isinstance(t.thing, RangeOf):
                raise self.refuse(node, "this is returned", "numbers and tuples")
            raise self.refuse(node, "a range is returned", "a tuple")
        self.spec.give(t, self, node)
        self.flow_ended = True
        if self.spec.result in (NONE, NEVER):
            if value.code and t not in (NONE, NEVER):
                self.line(f"{value.code};")
            for _ in range(self.tries):
                self.line("py_end_try();")
            self.line("return;")
            return
        if self.spec.memo:
            self._memorise(value, node)
            self.line("memo.known = true;")
            self.line("return &memo.value;")
            return
        text = self.convert(value, self.spec.result, node)
        if self.tries:
            name = self.fresh("given") if "given" in self.spec.locals_names else "given"
            self.line(f"const {self.program.names(self.spec.result)} {name} = {text};")
            text = name
        for _ in range(self.tries):
            self.line("py_end_try();")
        self.line(f"return {text};")

    def _memorise(self, value: Value, node: ast.Return) -> None:
        """Keep a cached function's result: element by element, to need less stack."""
        result = self.spec.result
        if value.parts and isinstance(result, Tuple) and result.uniform:
            for k, (part, item) in enumerate(
                zip(value.parts, result.items, strict=True)
            ):
                self.line(f"memo.value.e[{k}] = {self.convert(part, item, node)};")
        else:
            self.line(f"memo.value = {self.convert(value, result, node)};")

    def do_raise(self, node: ast.Raise) -> None:
        """Translate a raise of a known exception with a text."""
        match node.exc:
            case ast.Call(func=ast.Name(id=name), args=[text]) if name in RAISES:
                value = self.expression(text)
                self.line(f"py_raise({RAISES[name]}, {value.code});")
                self.flow_ended = True
                return
        raise self.refuse(
            node, "raise of this", "raise BlockError(text), or self.fail(text)"
        )

    def do_if(self, node: ast.If) -> None:
        """Translate an if; names tested against None are sure within its branches."""
        test = self.condition(node.test)
        yes, no = self.certain(node.test)
        if test.is_const:
            self.flow_ended = self.block(node.body if test.const else node.orelse)
            return
        before = set(self.sure)
        declared_before = set(self.declared_names)
        bounds = dict(self.bounds)
        self.line(f"if ({test.code}) {{")
        self.sure = before | yes
        self.level += 1
        first = self.block(node.body)
        self.level -= 1
        after_yes = set(self.sure)
        self.declared_names = declared_before | (self.declared_names & self.spec.top)
        self.sure = before | no
        if node.orelse:
            self.line("} else {")
            self.level += 1
            second = self.block(node.orelse)
            self.level -= 1
            self.declared_names = declared_before | (
                self.declared_names & self.spec.top
            )
        else:
            second = False
        self.line("}")
        after_no = set(self.sure)
        self.bounds = {
            k: v
            for k, v in self.bounds.items()
            if bounds.get(k) == v or self.spec.stores[k] == 1
        }
        self.sure = after_no if first else after_yes if second else after_yes & after_no
        self.flow_ended = first and second

    def do_while(self, node: ast.While) -> None:
        """Translate a while loop; statements of its test run before each pass."""
        if node.orelse:
            raise self.refuse(node, "else of a loop", "a variable")
        self.forget(node)
        mark = len(self.out)
        self.level += 1
        test = self.condition(node.test)
        pre = self.out[mark:]
        del self.out[mark:]
        self.level -= 1
        endless = test.is_const and bool(test.const)
        if endless:
            self.line("for (;;) {")
        elif pre:
            self.line("for (;;) {")
            self.out += pre
            self.line(f"    if (!({test.code})) break;")
        else:
            self.line(f"while ({test.code}) {{")
        self.level += 1
        before = set(self.sure)
        self.sure |= self.certain(node.test)[0]
        self.loops.append(self.tries)
        declared_before = set(self.declared_names)
        self.block(node.body)
        self.declared_names = declared_before | (self.declared_names & self.spec.top)
        self.loops.pop()
        self.sure = before & self.sure
        self.level -= 1
        self.line("}")
        self.flow_ended = endless and not any(
            isinstance(n, ast.Break) for n in _own_nodes(node.body)
        )

    def forget(self, node: ast.stmt) -> None:
        """Discard what is known of each name that a loop assigns."""
        for n in ast.walk(node):
            if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store):
                self.sure.discard(n.id)
                self.bounds.pop(n.id, None)
            if isinstance(n, ast.Attribute) and isinstance(n.ctx, ast.Store):
                self.sure.discard(f"self.{n.attr}")

    def do_for(self, node: ast.For) -> None:
        """Translate a for loop over a tuple, a range or a text.

        A loop that changes the sequence that it runs over is refused or runs over a
        copy.
        """
        if node.orelse:
            raise self.refuse(node, "else of a loop", "a variable")
        iteration = self._loop_iteration(node)
        free = self._targets_are_free(node)
        breaks = any(
            isinstance(n, (ast.Break, ast.Continue)) for n in _own_nodes(node.body)
        )
        if iteration.unroll and breaks:
            raise self.refuse(
                node, "break or continue over a mixed tuple", "over equal elements"
            )
        if iteration.unroll or (
            iteration.constant_count is not None
            and iteration.constant_count <= 1
            and not breaks
            and free
        ):
            for one in range(iteration.constant_count or 0):
                self.one_pass(node, iteration, constant(one), True)  # type: ignore[arg-type]
                if self.flow_ended:
                    break
            self.flow_ended = False
            return
        simple = (
            isinstance(node.target, ast.Name) and free and iteration.start is not None
        )
        if simple and node.target.id != "_":  # type: ignore[attr-defined]
            self.counting(node, iteration)
            return
        k = self.fresh("k")
        self.line(f"for (int64_t {k} = 0; {k} < {iteration.count.code}; {k}++) {{")
        self.level += 1
        top = iteration.most
        index = Value(
            I, k, again=True, low=0, high=None if top is None else max(top - 1, 0)
        )
        self.one_pass(node, iteration, index, free)
        self.flow_ended = False
        self.level -= 1
        self.line("}")

    def _loop_iteration(self, node: ast.For) -> Iteration:
        """Return the passes of a for loop, over a copy where its body changes them."""
        iteration = self.iteration(node.iter)
        self.forget(node)
        runs_over = reads(node.iter)
        if (
            isinstance(node.iter, ast.Call)
            and self.quiet_target(node.iter.func) is range
        ):
            runs_over = reads(node.iter.args[0]) if len(node.iter.args) > 1 else set()
        clash = runs_over & self.order.changes(*node.body)
        is_variable = isinstance(node.iter, (ast.Name, ast.Attribute))
        is_replaced = clash & _stored_names(node.body)
        is_assigned_elsewhere = not clash <= self.spec.changed_in_place
        if clash and not is_variable and (is_replaced or is_assigned_elsewhere):
            raise self.refuse(
                node,
                f"{min(clash)} changes in a loop over it",
                "a tuple of it, before",
            )
        if (
            clash & self.spec.changed_in_place
        ):  # each pass reads the element as it is when the pass begins
            item = iteration.item
            iteration = replace(iteration, item=lambda k: self.pin(item(k)))
        if (
            iteration.source is not None
            and not iteration.source.is_const
            and _changes(node, iteration.source.code)
        ):
            source = self.temporary(replace(iteration.source, again=False), hint="over")
            iteration = self.over_value(node.iter, source)
        return iteration

    def _targets_are_free(self, node: ast.For) -> bool:
        """Return whether nothing but the loop itself assigns or uses its targets."""
        names = [
            n.id
            for n in ast.walk(node.target)
            if isinstance(n, ast.Name) and n.id != "_"
        ]
        stored_names = _stored_names(node.body)
        return not any(
            n in stored_names
            or self.spec.used_after(node, n)
            or n in self.types
            or self.spec.outside_of(node, n)
            for n in names
        )

    def counting(self, node: ast.For, iteration: Iteration) -> None:
        """Translate a for loop over a range to a C loop with the same variable."""
        assert isinstance(node.target, ast.Name)
        assert iteration.start is not None
        name, step, start = node.target.id, iteration.step, iteration.start
        k = safe(name)
        zero = start.is_const and start.const == 0 and step == 1
        if zero:
            end = iteration.count.code
            self.line(f"for (int64_t {k} = 0; {k} < {end}; {k}++) {{")
        else:
            count = self.fresh("k")
            self.line(
                f"for (int64_t {count} = 0; {count} < {iteration.count.code}; {count}++) {{"
            )
            self.level += 1
            item = iteration.item(
                Value(I, count, again=True, low=0, high=iteration.most)
            )
            self.line(f"const int64_t {k} = {item.code};")
            self.level -= 1
        top = iteration.most
        first = Value(
            I, k, again=True, low=0, high=None if top is None else max(top - 1, 0)
        )
        bounds = iteration.item(first)
        self.bindings[name] = Value(I, k, again=True, low=bounds.low, high=bounds.high)
        self.level += 1
        before = set(self.sure)
        self.loops.append(self.tries)
        declared_before = set(self.declared_names)
        self.block(node.body)
        self.declared_names = declared_before | (self.declared_names & self.spec.top)
        self.flow_ended = False
        self.loops.pop()
        self.sure &= before
        self.level -= 1
        self.bindings.pop(name, None)
        self.line("}")

    def one_pass(
        self, node: ast.For, iteration: Iteration, k: Value, free: bool
    ) -> None:
        """Write the body of a loop, its target bound to the item of pass `k`."""
        outer_bindings, sure = dict(self.bindings), set(self.sure)
        declared_before = set(self.declared_names)
        item = iteration.item(k)
        if free:
            self.bind(node.target, item, True)
        else:
            self.assign(node.target, item)
        self.loops.append(self.tries)
        self.flow_ended = self.block(node.body)
        self.loops.pop()
        self.declared_names = declared_before | (self.declared_names & self.spec.top)
        names = {n.id for n in ast.walk(node.target) if isinstance(n, ast.Name)}
        self.bindings = {
            n: v
            for n, v in self.bindings.items()
            if n in outer_bindings or n not in names
        }
        self.bindings.update({n: v for n, v in outer_bindings.items() if n in names})
        self.sure &= sure

    def do_break(self, node: ast.Break) -> None:
        self.leave("break;")

    def do_continue(self, node: ast.Continue) -> None:
        self.leave("continue;")

    def leave(self, text: str) -> None:
        """Leave the enclosing loop's pass, ending each try within it."""
        for _ in range(self.tries - self.loops[-1]):
            self.line("py_end_try();")
        self.line(text)
        self.flow_ended = True

    def do_try(self, node: ast.Try) -> None:
        """Translate a try with one except that always raises or fails."""
        if node.finalbody or node.orelse or len(node.handlers) != 1:
            raise self.refuse(node, "this try", "one except, no else, no finally")
        (handler,) = node.handlers
        kinds = (
            handler.type.elts if isinstance(handler.type, ast.Tuple) else [handler.type]
        )
        masks = []
        for kind in kinds:
            if not isinstance(kind, ast.Name) or kind.id not in CAUGHT:
                raise self.refuse(handler, "except of this", f"of {', '.join(CAUGHT)}")
            masks.append(CAUGHT[kind.id])
        frame = self.fresh("frame")
        self.line(f"py_frame {frame};")
        self.line(f"if (PY_TRY({frame})) {{")
        self.level += 1
        self.tries += 1
        sure = set(self.sure)
        declared_before = set(self.declared_names)
        flow_ended = self.block(node.body)
        self.declared_names = declared_before | (self.declared_names & self.spec.top)
        self.tries -= 1
        if not flow_ended:
            self.line("py_end_try();")
        self.level -= 1
        self.line(f"}} else if (py_caught({' | '.join(masks)})) {{")
        self.level += 1
        self.sure = set(sure)
        if handler.name:
            self.line("const char *error = py_caught_text();")
            self.bindings[handler.name] = Value(S, "error", again=True)
        over = self.block(handler.body)
        if not over:
            raise self.refuse(
                handler, "an except that goes on", "one that raises or fails"
            )
        if handler.name:
            del self.bindings[handler.name]
        self.level -= 1
        self.line("} else {")
        self.line("    py_raise_again();")
        self.line("}")
        self.sure &= sure
        self.flow_ended = flow_ended

    def do_functiondef(self, node: ast.FunctionDef) -> None:
        """Translate a nested function to a struct of the variables it captures.

        The struct is filled where the function is defined.
        """
        captures: list[tuple[str, Any]] = []
        parameters = {a.arg for a in node.args.args}
        parameters |= {
            n.id
            for n in ast.walk(node)
            if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)
        }
        names = list(
            dict.fromkeys(
                n.id
                for n in ast.walk(node)
                if isinstance(n, ast.Name) and n.id not in parameters
            )
        )
        values = []
        for name in names:
            if name == "self":
                captures.append(("self", "self"))
                values.append("self")
                continue
            if name not in self.types and name not in self.bindings:
                if name in self.spec.locals_names and name not in self.spec.globals:
                    raise self.refuse(
                        node,
                        f"{node.name} uses {name}, which comes later",
                        "assign it before",
                    )
                continue
            value = self._name(ast.copy_location(ast.Name(name, ast.Load()), node))
            if isinstance(value.type, Known) or (value.type == S and value.is_const):
                raise self.refuse(
                    node, f"{node.name} uses {name}", "a number or a tuple"
                )
            for other in ast.walk(self.spec.node):
                if (
                    isinstance(other, ast.Name)
                    and isinstance(other.ctx, ast.Store)
                    and (
                        other.id == name
                        and other.lineno > node.lineno
                        and not _inside(node, other)
                    )
                ):
                    raise self.refuse(
                        other,
                        f"{name} changes after {node.name}, which uses it",
                        "another name",
                    )
            captures.append((name, value.type))
            values.append(self.code(value))
        callee = Callee(
            self.program.nested_function(node, self.spec), captures=tuple(captures)
        )
        t = Function((callee,))
        if captures:
            name = f"{safe(node.name)}_of"
            text = ", ".join(
                f".{'self' if x == 'self' else safe(n)} = {v}"
                for v, (n, x) in zip(values, captures, strict=True)
                if v
            )
            self.line(f"const {self.program.names(t)} {name} = {{{text}}};")
            self.bindings[node.name] = Value(t, name, again=True)
        else:
            self.bindings[node.name] = Value(t, "", again=True)


def optional(annotation: ast.expr, scope: dict[str, Any]) -> Type | None:
    """Return T of an annotation `T | None`.

    None where the annotation has another form or its type is incomplete.
    """
    match annotation:
        case ast.BinOp(left=left, op=ast.BitOr(), right=ast.Constant(value=None)):
            try:
                thing = eval(
                    compile(ast.Expression(left), "annotation", "eval"), dict(scope)
                )
            except Exception:
                return None
            return of_annotation(thing)[0]
    return None


def _load(target: ast.expr) -> ast.expr:
    """Return the expression that reads an assignment's target."""
    text = ast.unparse(target)
    expression = ast.parse(text, mode="eval").body
    for n in ast.walk(expression):
        if hasattr(n, "lineno"):
            n.lineno = target.lineno
    return expression


def _own_nodes(body: Sequence[ast.stmt]) -> list[ast.AST]:
    """Return all nodes of a loop's body except those of loops within it."""
    nodes: list[ast.AST] = []
    todo: list[ast.AST] = list(body)
    while todo:
        node = todo.pop()
        nodes.append(node)
        if not isinstance(node, (ast.For, ast.While, ast.FunctionDef)):
            todo += ast.iter_child_nodes(node)
    return nodes


def _mentions(text: str, code: str) -> bool:
    """Return whether C text reads a variable or field."""
    return re.search(rf"(?<![\w>.]){re.escape(code)}(?!\w)", text) is not None


def _stored_names(body: list[ast.stmt]) -> set[str]:
    """Return the names that a block of statements assigns."""
    names: set[str] = set()
    for s in body:
        for n in ast.walk(s):
            if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store):
                names.add(n.id)
    return names


def _changes(node: ast.For, code: str) -> bool:
    """Return whether a loop's body may change the sequence it runs over."""
    if not code:
        return False
    stored_names = {
        n.id
        for s in node.body
        for n in ast.walk(s)
        if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)
    }
    if re.match(r"\(?\*?self->", code):
        fields = {
            n.attr
            for s in node.body
            for n in ast.walk(s)
            if isinstance(n, ast.Attribute) and isinstance(n.ctx, ast.Store)
        }
        calls = any(
            isinstance(n, ast.Call)
            and isinstance(n.func, ast.Attribute)
            and isinstance(n.func.value, ast.Name)
            and n.func.value.id == "self"
            for s in node.body
            for n in ast.walk(s)
        )
        return calls or any(f"self->{f}" in code for f in fields)
    root = re.match(r"\(?\*?(\w+)", code)
    return root is not None and root[1] in stored_names


def _has(kind: Any, t: Type) -> bool:
    """Return whether a type is, or contains, a class of types or one type."""
    if isinstance(t, kind) if isinstance(kind, type) else t == kind:
        return True
    if isinstance(t, Tuple):
        return any(_has(kind, x) for x in t.items)
    return isinstance(t, (List, Maybe)) and _has(kind, t.item)


def _inside(node: ast.AST, other: ast.AST) -> bool:
    """Return whether a node lies inside another."""
    return any(n is other for n in ast.walk(node))


_ = (UNROLLED, UnknownYetError, type_text)
