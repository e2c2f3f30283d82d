"""Evaluates the syntax tree of a script: constants, loops, functions and classes of its own.

Nothing is imported or executed. What is called but not in the script becomes a `Construct`; what
the script alone does not determine becomes an `Unknown`, and so does everything computed from it.
"""

from __future__ import annotations

import ast
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from r2bspec.interop.script_import import plain_calls
from r2bspec.interop.script_import.expressions import ExpressionEvaluator
from r2bspec.interop.script_import.foreign_calls import is_file_test
from r2bspec.interop.script_import.script_limits import MAX_CALL_DEPTH, ScriptLimitError
from r2bspec.interop.script_import.script_reader import ScriptReader
from r2bspec.interop.script_import.script_values import (
    BoundFunction,
    Construct,
    Foreign,
    ImageSize,
    Instance,
    Place,
    Scope,
    ScriptClass,
    ScriptFunction,
    ScriptModule,
    Unknown,
)


@dataclass(frozen=True, slots=True)
class Returned:
    """The end of a block by ``return``, ``break``, ``continue`` or ``raise``."""

    kind: str
    value: Any = None


@dataclass(slots=True)
class Note:
    """Something in the script that was not followed, and why."""

    message: str
    place: Place


@dataclass(slots=True)
class Trace:
    """What an evaluation came across, in order.

    Attributes:
        effects: constructs that the script calls for their effect, such as ``time.sleep(5)``.
        notes: what was not followed.
    """

    effects: list[Construct] = field(default_factory=list)
    notes: list[Note] = field(default_factory=list)


class Evaluator(ExpressionEvaluator):
    """Evaluates one script and the modules that it needs.

    Args:
        reader: reads the modules.
        launch_values: what ``LaunchConfiguration(name)`` is, by name.
    """

    def __init__(self, reader: ScriptReader, launch_values: Mapping[str, Any] | None = None):
        super().__init__(launch_values or {}, reader.steps)
        self.reader = reader
        self.trace = Trace()
        self._depth = 0
        self._conditions: list[Any] = []

    def run_module(self, module: ScriptModule) -> None:
        """Evaluate the statements of a module.

        Raises:
            ScriptLimitError: it needs more than the limits.
        """
        try:
            self._block(module.tree.body, module.scope)
        except RecursionError as error:
            raise ScriptLimitError("an expression that is nested too deeply") from error

    def call(self, function: Any, *arguments: Any, place: Place) -> Any:
        """Call a function of the script with values.

        Raises:
            ScriptLimitError: it needs more than the limits.
        """
        try:
            return self.call_value(function, list(arguments), {}, place)
        except RecursionError as error:
            raise ScriptLimitError("an expression that is nested too deeply") from error

    def call_script_function(
        self, function: ScriptFunction, arguments: list[Any], keywords: dict[str, Any], place: Place
    ) -> Any:
        """Evaluate the body of a function."""
        self._depth += 1
        if self._depth > MAX_CALL_DEPTH:
            raise ScriptLimitError(f"more than {MAX_CALL_DEPTH} calls inside each other")
        try:
            names = self._bind(function, arguments, keywords)
            if names is None:
                return Unknown("the arguments do not fit the function", place)
            scope = Scope(function.scope.module, names, function.scope)
            if isinstance(function.node, ast.Lambda):
                return self.value(function.node.body, scope)
            ended = self._block(function.node.body, scope)
            if ended is None:
                return None
            if ended.kind == "raise":
                return Unknown(f"{function.node.name} raises an exception here", place)
            return ended.value
        finally:
            self._depth -= 1

    def _bind(
        self, function: ScriptFunction, given: list[Any], keywords: dict[str, Any]
    ) -> dict[str, Any] | None:
        parameters = function.node.args
        named = [each.arg for each in (*parameters.posonlyargs, *parameters.args)]
        names: dict[str, Any] = dict(zip(named, given, strict=False))
        if parameters.vararg is not None:
            names[parameters.vararg.arg] = list(given[len(named) :])
        elif len(given) > len(named):
            return None
        only = [each.arg for each in parameters.kwonlyargs]
        others = {key: each for key, each in keywords.items() if key not in (*named, *only)}
        names |= {key: each for key, each in keywords.items() if key not in others}
        if parameters.kwarg is not None:
            names[parameters.kwarg.arg] = others
        elif others:
            return None
        defaults = dict(zip(reversed(named), reversed(parameters.defaults), strict=False))
        defaults |= {
            name: each for name, each in zip(only, parameters.kw_defaults, strict=True) if each
        }
        for name, default in defaults.items():
            if name not in names:
                names[name] = self.value(default, function.scope)
        return names if all(name in names for name in (*named, *only)) else None

    def _block(self, statements: list[ast.stmt], scope: Scope) -> Returned | None:
        for statement in statements:
            self.step()
            ended = self._statement(statement, scope)
            if ended is not None:
                return ended
        return None

    def _statement(self, node: ast.stmt, scope: Scope) -> Returned | None:
        match node:
            case ast.Expr(value=value):
                result = self.value(value, scope)
                self._effect(result)
                if isinstance(result, Unknown) and isinstance(value, ast.Call):
                    self._note(f"this call is not followed: {result.reason}", node, scope)
            case ast.Assign(targets=targets, value=value):
                self._assign_all(targets, value, scope)
            case ast.AnnAssign(target=target, value=value) if value is not None:
                self._assign(target, self.value(value, scope), scope)
            case ast.AugAssign(target=target, op=op, value=value):
                self._augment(target, op, value, scope)
            case ast.Import() | ast.ImportFrom():
                self._import(node, scope)
            case ast.FunctionDef():
                scope.names[node.name] = self._function(node, scope)
            case ast.ClassDef():
                self._define_class(node, scope)
            case ast.Return(value=value):
                return Returned("return", None if value is None else self.value(value, scope))
            case ast.Raise():
                return Returned("raise")
            case ast.Break():
                return Returned("break")
            case ast.Continue():
                return Returned("continue")
            case ast.If():
                return self._if(node, scope)
            case ast.For():
                return self._for(node, scope)
            case ast.While():
                return self._while(node, scope)
            case ast.With():
                return self._with(node, scope)
            case ast.Try():
                # What happens when something fails is not what the script does.
                return self._block(node.body, scope) or self._block(node.finalbody, scope)
            case ast.Pass() | ast.Global() | ast.Nonlocal() | ast.Assert() | ast.AnnAssign():
                pass
            case _:
                self._note(f"a statement of this kind ({type(node).__name__})", node, scope)
        return None

    def _effect(self, value: Any) -> None:
        if isinstance(value, Construct):
            if self._conditions:
                value.condition = self._conditions[-1]
            self.trace.effects.append(value)

    def _assign_all(self, targets: list[ast.expr], source: ast.expr, scope: Scope) -> None:
        value = self.value(source, scope)
        if isinstance(value, Construct) and (
            value.owner is not None or value.name.startswith("subprocess.")
        ):
            self._effect(value)  # result = client.call_async(request)
        if isinstance(value, Construct):
            # The statement is what has the author's comment above it.
            value.place = Place.of(scope.module.file, source)
        for target in targets:
            self._assign(target, value, scope)

    def _assign(self, target: ast.expr, value: Any, scope: Scope) -> None:
        match target:
            case ast.Name(id=name):
                if isinstance(value, ImageSize) and not value.name:
                    value = ImageSize(value.width, value.height, value.label, name)
                scope.names[name] = value
            case ast.Tuple(elts=parts) | ast.List(elts=parts):
                values = value if isinstance(value, list | tuple) else None
                if values is None or len(values) != len(parts):
                    lost = (
                        value
                        if isinstance(value, Unknown)
                        else self.unknown("a value that is not a list is unpacked", target, scope)
                    )
                    values = [lost] * len(parts)
                for part, each in zip(parts, values, strict=True):
                    self._assign(part, each, scope)
            case ast.Attribute(value=owner, attr=name):
                self._set_attribute(self.value(owner, scope), name, value, target, scope)
            case ast.Subscript(value=owner, slice=key):
                self._set_item(self.value(owner, scope), self.value(key, scope), value)
            case _:
                self._note("an assignment of this kind", target, scope)

    def _set_attribute(
        self, owner: Any, name: str, value: Any, node: ast.expr, scope: Scope
    ) -> None:
        if isinstance(owner, Instance | ScriptClass):
            owner.names[name] = value
        elif isinstance(owner, Construct):
            owner.keywords[name] = value
            owner.keyword_places[name] = Place.of(scope.module.file, node)

    @staticmethod
    def _set_item(owner: Any, key: Any, value: Any) -> None:
        plain_calls.check_size(key)
        try:
            if isinstance(owner, dict | list):
                owner[key] = value
        except (TypeError, IndexError):
            pass

    def _augment(self, target: ast.expr, op: ast.operator, source: ast.expr, scope: Scope) -> None:
        read = ast.copy_location(_as_read(target), target)
        result = self.binary_value(type(op), self.value(read, scope), source, scope)
        self._assign(target, result, scope)

    def _function(self, node: ast.FunctionDef, scope: Scope) -> ScriptFunction:
        kinds = {each.id for each in node.decorator_list if isinstance(each, ast.Name)}
        kind = next(iter(kinds & {"staticmethod", "classmethod", "property"}), "function")
        return ScriptFunction(node, scope, kind=kind)

    def _define_class(self, node: ast.ClassDef, scope: Scope) -> None:
        made = ScriptClass(node, [self.value(each, scope) for each in node.bases], {})
        scope.names[node.name] = made
        inner = Scope(scope.module, made.names, scope)
        self._block(node.body, inner)
        for each in made.names.values():
            if isinstance(each, ScriptFunction):
                each.owner, each.scope = made, scope

    def _if(self, node: ast.If, scope: Scope) -> Returned | None:
        condition = self.value(node.test, scope)
        decided = self.truth(condition)
        if decided is not None:
            return self._block(node.body if decided else node.orelse, scope)
        if _is_file_condition(condition):
            self._conditions.append(condition)
            try:
                ended = self._block(node.body, scope)
            finally:
                self._conditions.pop()
            return ended if ended is not None and ended.kind == "return" else None
        if not _only_reports([*node.body, *node.orelse]):
            self._note("this condition is not known, so neither branch was imported", node, scope)
            self._forget_names([*node.body, *node.orelse], scope)
        return None

    def _for(self, node: ast.For, scope: Scope) -> Returned | None:
        values = self.value(node.iter, scope)
        if isinstance(values, dict):
            values = list(values)
        if not isinstance(values, list | tuple | str):
            self._note("what this loop goes over is not known, so it was not imported", node, scope)
            self._forget_names(node.body, scope)
            return None
        for each in list(values):
            self.step()
            self._assign(node.target, each, scope)
            ended = self._block(node.body, scope)
            if ended is not None and ended.kind == "break":
                return None
            if ended is not None and ended.kind != "continue":
                return ended
        return self._block(node.orelse, scope)

    def _while(self, node: ast.While, scope: Scope) -> Returned | None:
        while True:
            self.step()
            condition = self.value(node.test, scope)
            decided = self.truth(condition)
            if decided is None:
                if _is_file_condition(condition):
                    place = Place.of(scope.module.file, node)
                    self._effect(Construct("wait_for_file", condition.arguments, {}, place))
                else:
                    self._note("this loop waits for something that is not known", node, scope)
                    self._forget_names(node.body, scope)
                return None
            if not decided:
                return None
            ended = self._block(node.body, scope)
            if ended is not None and ended.kind == "break":
                return None
            if ended is not None and ended.kind != "continue":
                return ended

    def _with(self, node: ast.With, scope: Scope) -> Returned | None:
        for item in node.items:
            value = self.value(item.context_expr, scope)
            if item.optional_vars is not None:
                self._assign(item.optional_vars, value, scope)
        return self._block(node.body, scope)

    def _import(self, node: ast.Import | ast.ImportFrom, scope: Scope) -> None:
        for alias in node.names:
            if isinstance(node, ast.Import):
                if alias.asname:
                    scope.names[alias.asname] = self._module(alias.name)
                else:
                    first = alias.name.partition(".")[0]
                    scope.names[first] = Foreign(first)
                continue
            name = alias.asname or alias.name
            base = node.module or ""
            module = self._relative(base, node.level, scope) if node.level else self._module(base)
            scope.names[name] = self.attribute(module, alias.name, node, scope)
            if isinstance(scope.names[name], Foreign):
                inner = self._module(f"{base}.{alias.name}") if base else scope.names[name]
                scope.names[name] = inner

    def _module(self, name: str) -> Any:
        found = self.reader.find_module(name)
        if found is None:
            return Foreign(name)
        self._run_once(found)
        return found

    def _relative(self, base: str, level: int, scope: Scope) -> Any:
        folder = scope.module.file.parent
        for _ in range(min(level, 5) - 1):
            folder = folder.parent
        found = self.reader.find_sibling(folder, base)
        if found is None:
            return Foreign(base or "module")
        self._run_once(found)
        return found

    def _run_once(self, module: ScriptModule) -> None:
        if "__evaluated__" not in module.scope.names:
            module.scope.names["__evaluated__"] = True
            self._depth += 1
            if self._depth > MAX_CALL_DEPTH:
                raise ScriptLimitError(f"more than {MAX_CALL_DEPTH} modules inside each other")
            self._block(module.tree.body, module.scope)
            self._depth -= 1

    def _note(self, message: str, node: ast.AST, scope: Scope) -> None:
        self.trace.notes.append(Note(message, Place.of(scope.module.file, node)))

    def _forget_names(self, statements: list[ast.stmt], scope: Scope) -> None:
        """Make every name unknown that statements would bind."""
        for each in statements:
            for one in ast.walk(each):
                if isinstance(one, ast.Name) and isinstance(one.ctx, ast.Store):
                    scope.names[one.id] = self.unknown("it depends on a condition", one, scope)

    def instance(self, kind: ScriptClass, arguments: list[Any], keywords: dict[str, Any]) -> Any:
        """An object of a class of the script."""
        made = Instance(kind)
        try:
            constructor = kind.find("__init__")
        except KeyError:
            return made
        if isinstance(constructor, ScriptFunction):
            bound = BoundFunction(constructor, made)
            place = Place.of(constructor.scope.module.file, constructor.node)
            self.call_value(bound, arguments, keywords, place)
        return made


def _as_read(target: ast.expr) -> ast.expr:
    match target:
        case ast.Name(id=name):
            return ast.Name(name, ast.Load())
        case ast.Attribute(value=value, attr=attr):
            return ast.Attribute(value, attr, ast.Load())
        case ast.Subscript(value=value, slice=key):
            return ast.Subscript(value, key, ast.Load())
    return ast.Constant(None)


def _is_file_condition(condition: Any) -> bool:
    """Whether a condition is that a file does not exist, or that it does."""
    if isinstance(condition, Construct) and condition.name == "not":
        return is_file_test(condition.owner)
    return is_file_test(condition)


def _only_reports(statements: list[ast.stmt]) -> bool:
    """Whether statements only print, log or raise."""
    for each in statements:
        match each:
            case ast.Raise() | ast.Pass():
                continue
            case (
                ast.Expr(value=ast.Call(func=ast.Name(id="print")))
                | ast.Expr(
                    value=ast.Call(func=ast.Attribute(attr="info" | "warning" | "error" | "debug"))
                )
            ):
                continue
            case ast.If():
                if _only_reports([*each.body, *each.orelse]):
                    continue
        return False
    return True
