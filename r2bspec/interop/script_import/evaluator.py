"""The statements of a script, evaluated over its syntax tree: nothing is imported or executed.

Assignments, loops over what is known, conditions that are decided, and the script's own functions
and classes have the effect that they have in Python. Where a condition is not known, neither branch
counts, and the names that it binds are unknown; only the test whether a file exists is followed, as
the condition of what it guards. What the script does for its effect is kept in order; notes tell
what was not followed.
"""

from __future__ import annotations

import ast
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from r2bspec.diagnostics import Span
from r2bspec.interop.script_import.expressions import Expressions, truth
from r2bspec.interop.script_import.known_functions import is_file_test
from r2bspec.interop.script_import.source_files import ScriptReader
from r2bspec.interop.script_import.values import (
    Construct,
    Foreign,
    ImportNote,
    NotKnownError,
    Scope,
    ScriptClass,
    ScriptFunction,
    ScriptLimitError,
    ScriptModule,
    Unknown,
)
from r2bspec.safe_io.limits import MAX_SCRIPT_CALL_DEPTH

_LOGGING = frozenset({"info", "warning", "error", "debug"})


@dataclass(frozen=True, slots=True)
class BlockExit:
    """The end of a block by ``return``, ``break``, ``continue`` or ``raise``."""

    kind: str
    value: Any = None


class Evaluator(Expressions):
    """Evaluates one script and the modules that it needs.

    Args:
        reader: reads the modules.
        launch_values: what ``LaunchConfiguration(name)`` is, by name.

    Attributes:
        effects: constructs that the script calls for their effect, such as ``time.sleep(5)``.
        imports: the places of imports of modules that were not read, by the name of the module.
    """

    def __init__(self, reader: ScriptReader, launch_values: Mapping[str, Any] | None = None):
        super().__init__(launch_values or {}, reader.steps)
        self.reader = reader
        self.effects: list[Construct] = []
        self.imports: dict[str, Span] = {}
        self._depth = 0
        self._conditions: list[Any] = []

    def take_effects(self) -> list[Construct]:
        """The effects since the last call."""
        effects, self.effects = self.effects, []
        return effects

    def run_module(self, module: ScriptModule) -> None:
        """Evaluate the statements of a module.

        Raises:
            ScriptLimitError: it needs more than the limits.
        """
        try:
            self._block(module.tree.body, module.scope)
        except RecursionError as error:
            raise ScriptLimitError("an expression that is nested too deeply") from error

    def call(self, function: Any, *arguments: Any, place: Span) -> Any:
        """Call a function of the script with values.

        Raises:
            ScriptLimitError: it needs more than the limits.
        """
        try:
            return self.call_value(function, list(arguments), {}, place)
        except NotKnownError as error:
            return error.unknown(place)
        except RecursionError as error:
            raise ScriptLimitError("an expression that is nested too deeply") from error

    def call_script(
        self, function: ScriptFunction, arguments: list[Any], keywords: dict[str, Any]
    ) -> Any:
        """What a function of the script returns.

        Raises:
            NotKnownError: it raises, or the arguments do not fit.
        """
        self._depth += 1
        if self._depth > MAX_SCRIPT_CALL_DEPTH:
            raise ScriptLimitError(f"more than {MAX_SCRIPT_CALL_DEPTH} calls inside each other")
        try:
            names = self._bound_names(function, arguments, keywords)
            scope = Scope(function.scope.module, names, function.scope)
            if isinstance(function.node, ast.Lambda):
                return self.value(function.node.body, scope)
            ended = self._block(function.node.body, scope)
            if ended is not None and ended.kind == "raise":
                raise NotKnownError(f"{function.node.name} raises an exception here")
            return ended.value if ended is not None else None
        finally:
            self._depth -= 1

    def _bound_names(
        self, function: ScriptFunction, given: list[Any], keywords: dict[str, Any]
    ) -> dict[str, Any]:
        """The parameters of a function with their values."""
        parameters = function.node.args
        named = [parameter.arg for parameter in (*parameters.posonlyargs, *parameters.args)]
        only = [parameter.arg for parameter in parameters.kwonlyargs]
        others = {key: value for key, value in keywords.items() if key not in (*named, *only)}
        names: dict[str, Any] = dict(zip(named, given, strict=False))
        names |= {key: value for key, value in keywords.items() if key not in others}
        defaults = dict(zip(reversed(named), reversed(parameters.defaults), strict=False))
        defaults |= {
            name: node for name, node in zip(only, parameters.kw_defaults, strict=True) if node
        }
        for name, node in defaults.items():
            if name not in names:
                names[name] = self.value(node, function.scope)
        fits = all(name in names for name in (*named, *only))
        for parameter, rest in (
            (parameters.vararg, given[len(named) :]),
            (parameters.kwarg, others),
        ):
            if parameter is not None:
                self.steps.count_items(rest)
                names[parameter.arg] = rest
            elif rest:
                fits = False
        if not fits:
            raise NotKnownError("the arguments do not fit the function")
        return names

    def _block(self, statements: list[ast.stmt], scope: Scope) -> BlockExit | None:
        for statement in statements:
            self.steps.count()
            ended = self._statement(statement, scope)
            if ended is not None:
                return ended
        return None

    def _statement(self, node: ast.stmt, scope: Scope) -> BlockExit | None:
        match node:
            case ast.Expr(value=value):
                result = self.value(value, scope)
                self._effect(result)
                if isinstance(result, Unknown) and isinstance(value, ast.Call):
                    self._note(f"this call is not followed: {result.reason}", node, scope)
            case ast.Assign(targets=targets, value=value):
                self._assign_all(targets, value, scope)
            case ast.AnnAssign(target=target, value=value) if value is not None:
                self.assign(target, self.value(value, scope), scope)
            case ast.AugAssign():
                self._augment(node, scope)
            case ast.Import():
                self._import(node, scope)
            case ast.ImportFrom():
                self._import_from(node, scope)
            case ast.FunctionDef(name=name, decorator_list=decorators):
                kinds = {marker.id for marker in decorators if isinstance(marker, ast.Name)}
                kind = next(iter(kinds & {"staticmethod", "classmethod", "property"}), "function")
                scope.names[name] = ScriptFunction(node, scope, kind)
            case ast.ClassDef():
                self._define_class(node, scope)
            case ast.Return(value=value):
                return BlockExit("return", None if value is None else self.value(value, scope))
            case ast.Raise() | ast.Break() | ast.Continue():
                return BlockExit(type(node).__name__.lower())
            case ast.If():
                return self._if(node, scope)
            case ast.For():
                return self._for(node, scope)
            case ast.While():
                return self._while(node, scope)
            case ast.With(items=items, body=body):
                for item in items:
                    value = self.value(item.context_expr, scope)
                    if item.optional_vars is not None:
                        self.assign(item.optional_vars, value, scope)
                return self._block(body, scope)
            case ast.Try(body=body, finalbody=final):
                # What happens when something fails is not what the script does.
                return self._block(body, scope) or self._block(final, scope)
            case ast.Pass() | ast.Global() | ast.Nonlocal() | ast.Assert() | ast.AnnAssign():
                pass
            case _:
                self._note(f"a statement of this kind ({type(node).__name__})", node, scope)
        return None

    def _effect(self, value: Any) -> None:
        if isinstance(value, Construct):
            if self._conditions:
                value.condition = self._conditions[-1]
            self.effects.append(value)

    def _assign_all(self, targets: list[ast.expr], source: ast.expr, scope: Scope) -> None:
        value = self.value(source, scope)
        if isinstance(value, Construct):
            if value.owner is not None or value.name.startswith("subprocess."):
                self._effect(value)  # result = client.call_async(request)
            # The statement is what has the author's comment above it.
            value.place = scope.place(source)
        for target in targets:
            self.assign(target, value, scope)

    def _augment(self, node: ast.AugAssign, scope: Scope) -> None:
        left, right = self.value(node.target, scope), self.value(node.value, scope)
        lost = next((side for side in (left, right) if isinstance(side, Unknown)), None)
        try:
            result = lost or self.binary(node.op, left, right)
        except NotKnownError as error:
            result = error.unknown(scope.place(node.value))
        self.assign(node.target, result, scope)

    def _define_class(self, node: ast.ClassDef, scope: Scope) -> None:
        kind = ScriptClass(node, [self.value(base, scope) for base in node.bases], {})
        scope.names[node.name] = kind
        self._block(node.body, Scope(scope.module, kind.names, scope))
        for member in kind.names.values():
            if isinstance(member, ScriptFunction):
                member.scope = scope

    def _if(self, node: ast.If, scope: Scope) -> BlockExit | None:
        condition = self.value(node.test, scope)
        decided = truth(condition)
        if decided is not None:
            return self._block(node.body if decided else node.orelse, scope)
        if _is_file_condition(condition):
            self._conditions.append(condition)
            try:
                ended = self._block(node.body, scope)
            finally:
                self._conditions.pop()
            return ended if ended is not None and ended.kind == "return" else None
        branches = [*node.body, *node.orelse]
        if not _only_reports(branches):
            reason = "this condition is not known, so neither branch was imported"
            self._skip(reason, node, branches, scope)
        return None

    def _for(self, node: ast.For, scope: Scope) -> BlockExit | None:
        values = self.value(node.iter, scope)
        if not isinstance(values, list | tuple | dict | str):
            reason = "what this loop goes over is not known, so it was not imported"
            self._skip(reason, node, node.body, scope)
            return None
        for value in list(values):
            self.steps.count()
            self.assign(node.target, value, scope)
            ended = self._block(node.body, scope)
            if ended is not None and ended.kind != "continue":
                return None if ended.kind == "break" else ended
        return self._block(node.orelse, scope)

    def _while(self, node: ast.While, scope: Scope) -> BlockExit | None:
        while True:
            self.steps.count()
            condition = self.value(node.test, scope)
            decided = truth(condition)
            if decided is None and _is_file_condition(condition):
                place = scope.place(node)
                self._effect(Construct("wait_for_file", condition.arguments, {}, place))
            elif decided is None:
                reason = "this loop waits for something that is not known"
                self._skip(reason, node, node.body, scope)
            if not decided:
                return None
            ended = self._block(node.body, scope)
            if ended is not None and ended.kind != "continue":
                return None if ended.kind == "break" else ended

    def _import(self, node: ast.Import, scope: Scope) -> None:
        for alias in node.names:
            first = alias.name.partition(".")[0]
            if alias.asname:
                scope.names[alias.asname] = self._module(alias.name)
            else:
                is_one = first == alias.name
                scope.names[first] = self._module(first) if is_one else Foreign(first)
            self.imports.setdefault(first, scope.place(node))

    def _import_from(self, node: ast.ImportFrom, scope: Scope) -> None:
        base = node.module or ""
        module = self._relative(base, node.level, scope) if node.level else self._module(base)
        self.imports.setdefault(base.partition(".")[0], scope.place(node))
        for alias in node.names:
            if alias.name == "*":
                is_read = isinstance(module, ScriptModule)
                names = module.scope.names.items() if is_read else [("*", module)]
                scope.names |= {key: value for key, value in names if not key.startswith("_")}
                continue
            try:
                value = self.attribute(module, alias.name)
            except NotKnownError as error:
                value = error.unknown(scope.place(node))
            if isinstance(value, Foreign) and base:
                value = self._module(f"{base}.{alias.name}")
            scope.names[alias.asname or alias.name] = value

    def _module(self, name: str) -> Any:
        module = self.reader.find_module(name)
        return Foreign(name) if module is None else self._run_once(module)

    def _relative(self, base: str, level: int, scope: Scope) -> Any:
        folder = scope.module.file.parent
        for _ in range(min(level, 5) - 1):
            folder = folder.parent
        module = self.reader.find_sibling(folder, base)
        return Foreign(base or "module") if module is None else self._run_once(module)

    def _run_once(self, module: ScriptModule) -> ScriptModule:
        if "__evaluated__" not in module.scope.names:
            module.scope.names["__evaluated__"] = True
            self._depth += 1
            if self._depth > MAX_SCRIPT_CALL_DEPTH:
                raise ScriptLimitError(
                    f"more than {MAX_SCRIPT_CALL_DEPTH} modules inside each other"
                )
            self._block(module.tree.body, module.scope)
            self._depth -= 1
        return module

    def _note(self, reason: str, node: ast.AST, scope: Scope) -> None:
        self.notes.append(ImportNote(reason, scope.place(node)))

    def _skip(self, reason: str, node: ast.AST, statements: list[ast.stmt], scope: Scope) -> None:
        """Note that statements are not evaluated: every name that they would bind is unknown."""
        self._note(reason, node, scope)
        for part in (part for statement in statements for part in ast.walk(statement)):
            if isinstance(part, ast.Name) and isinstance(part.ctx, ast.Store):
                place = scope.place(part)
                scope.names[part.id] = Unknown("it depends on a condition", place)


def _is_file_condition(condition: Any) -> bool:
    """Whether a condition is that a file does not exist, or that it does."""
    if isinstance(condition, Construct) and condition.name == "not":
        return is_file_test(condition.owner)
    return is_file_test(condition)


def _only_reports(statements: list[ast.stmt]) -> bool:
    """Whether statements only print, log or raise."""
    for statement in statements:
        match statement:
            case ast.Raise() | ast.Pass():
                continue
            case ast.Expr(value=ast.Call(func=ast.Name(id="print"))):
                continue
            case ast.Expr(value=ast.Call(func=ast.Attribute(attr=attr))) if attr in _LOGGING:
                continue
            case ast.If(body=body, orelse=orelse) if _only_reports([*body, *orelse]):
                continue
        return False
    return True
