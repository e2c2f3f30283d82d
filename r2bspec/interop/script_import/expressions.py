"""Evaluates expressions of a script.

`r2bspec.interop.script_import.script_calls` has calls, and
`r2bspec.interop.script_import.evaluator` statements.
"""

from __future__ import annotations

import ast
from collections.abc import Mapping
from typing import Any

from r2bspec.interop.script_import import plain_calls
from r2bspec.interop.script_import.foreign_calls import (
    NOT_KNOWN,
    foreign_value,
)
from r2bspec.interop.script_import.plain_calls import NotSupportedError
from r2bspec.interop.script_import.script_calls import CallEvaluator
from r2bspec.interop.script_import.script_limits import (
    MAX_ITEMS,
    MAX_TEXT,
    ScriptLimitError,
    StepCounter,
)
from r2bspec.interop.script_import.script_values import (
    BoundFunction,
    Construct,
    ConstructMethod,
    Foreign,
    ForeignMethod,
    ImageSize,
    Instance,
    Place,
    PlacedDict,
    PlacedTuple,
    PlainMethod,
    Scope,
    ScriptClass,
    ScriptFunction,
    ScriptModule,
    Unknown,
)


class ExpressionEvaluator(CallEvaluator):
    """Evaluates expressions.

    Args:
        launch_values: what ``LaunchConfiguration(name)`` is, by name.
        steps: counts the steps.
    """

    def __init__(self, launch_values: Mapping[str, Any], steps: StepCounter) -> None:
        self.launch_values = launch_values
        self.step = steps.count

    def value(self, node: ast.expr, scope: Scope) -> Any:
        """The value of an expression."""
        self.step()
        match node:
            case ast.Constant(value=value):
                return self._constant(value, node, scope)
            case ast.Name(id=name):
                return self._name(name, node, scope)
            case ast.Attribute(value=owner, attr=name):
                return self.attribute(self.value(owner, scope), name, node, scope)
            case ast.Call():
                return self._call(node, scope)
            case ast.List(elts=parts):
                return self._items(parts, scope)
            case ast.Tuple(elts=parts):
                place = Place.of(scope.module.file, node)
                return PlacedTuple.of(self._items(parts, scope), place)
            case ast.Set(elts=parts):
                return self._items(parts, scope)
            case ast.Dict():
                return self._dict(node, scope)
            case ast.JoinedStr(values=parts):
                return self._joined(parts, node, scope)
            case ast.BinOp(left=left, op=op, right=right):
                return self.binary_value(type(op), self.value(left, scope), right, scope)
            case ast.UnaryOp():
                return self._unary(node, scope)
            case ast.BoolOp():
                return self._bool(node, scope)
            case ast.Compare():
                return self._compare(node, scope)
            case ast.IfExp(test=test, body=body, orelse=orelse):
                decided = self.truth(self.value(test, scope))
                if decided is None:
                    return self.unknown("the condition is not known", node, scope)
                return self.value(body if decided else orelse, scope)
            case ast.Subscript():
                return self._item(node, scope)
            case ast.ListComp() | ast.GeneratorExp() | ast.SetComp():
                return self._comprehension(node, scope)
            case ast.DictComp():
                pairs = self._comprehension(node, scope)
                return dict(pairs) if isinstance(pairs, list) else pairs
            case ast.Lambda():
                return ScriptFunction(node, scope)
            case ast.Starred(value=inner):
                return self.value(inner, scope)
        kind = type(node).__name__
        return self.unknown(f"an expression of this kind ({kind}) is not understood", node, scope)

    def truth(self, value: Any) -> bool | None:
        """Whether a value is true; None if that is not known."""
        if isinstance(value, Unknown | Construct | Foreign | ConstructMethod | ForeignMethod):
            return None
        if isinstance(value, str | list | dict | tuple | int | float) or value is None:
            return bool(value)
        return True

    def binary_value(self, kind: type, left: Any, right_node: ast.expr, scope: Scope) -> Any:
        """The value of ``left op right``."""
        right = self.value(right_node, scope)
        for each in (left, right):
            if isinstance(each, Unknown):
                return each
        try:
            return plain_calls.binary(kind, left, right)
        except NotSupportedError:
            return self.unknown("the operands are not known", right_node, scope)

    def attribute(self, owner: Any, name: str, node: ast.AST, scope: Scope) -> Any:
        """The value of ``owner.name``."""
        match owner:
            case Unknown():
                return owner
            case Foreign(name=full):
                found = foreign_value(f"{full}.{name}")
                return Foreign(f"{full}.{name}") if found is NOT_KNOWN else found
            case ScriptModule():
                try:
                    return owner.scope.find(name)
                except KeyError:
                    return Foreign(f"{owner.file.stem}.{name}")
            case Instance():
                return self._instance_attribute(owner, name, node, scope)
            case ScriptClass():
                return self._class_attribute(owner, owner, name)
            case Construct():
                if name in owner.keywords:
                    return owner.keywords[name]
                if owner.is_message:
                    return owner.field_of_message(name)
                return ConstructMethod(owner, name)
            case ForeignMethod(owner=kind, name=outer):
                return ForeignMethod(kind, f"{outer}.{name}")
        if plain_calls.has_method(owner, name):
            return PlainMethod(owner, name)
        return self.unknown(f"the attribute {name!r} is not known", node, scope)

    def _instance_attribute(self, owner: Instance, name: str, node: ast.AST, scope: Scope) -> Any:
        del node, scope
        if name in owner.names:
            return owner.names[name]
        return self._class_attribute(owner.kind, owner, name)

    def _class_attribute(self, kind: ScriptClass, owner: Any, name: str) -> Any:
        try:
            found = kind.find(name)
        except KeyError:
            return ForeignMethod(kind, name)
        if not isinstance(found, ScriptFunction) or found.kind == "staticmethod":
            return found
        if found.kind == "classmethod":
            return BoundFunction(found, kind)
        return BoundFunction(found, owner) if isinstance(owner, Instance) else found

    def _constant(self, value: Any, node: ast.AST, scope: Scope) -> Any:
        if isinstance(value, str | int | float | bool) or value is None:
            if isinstance(value, str) and "$(" in value:
                return self.unknown("a text with '$(' would be a reference in a spec", node, scope)
            return value
        return self.unknown("a constant of this type has no form in a spec", node, scope)

    def _name(self, name: str, node: ast.AST, scope: Scope) -> Any:
        try:
            return scope.find(name)
        except KeyError:
            pass
        if plain_calls.has_function(name) or name in {"print", "super", "isinstance", "open"}:
            return Foreign(f"builtins.{name}")
        return self.unknown(f"the name {name!r} is not defined in the script", node, scope)

    def _items(self, parts: list[ast.expr], scope: Scope) -> list[Any]:
        found: list[Any] = []
        for each in parts:
            value = self.value(each, scope)
            if isinstance(each, ast.Starred) and isinstance(value, list | tuple):
                found.extend(value)
            else:
                found.append(value)
            if len(found) > MAX_ITEMS:
                raise ScriptLimitError(f"more than {MAX_ITEMS:,} items")
        return found

    def _dict(self, node: ast.Dict, scope: Scope) -> Any:
        found = PlacedDict()
        found.places = {}
        for key_node, value_node in zip(node.keys, node.values, strict=True):
            value = self.value(value_node, scope)
            if key_node is None:
                if not isinstance(value, dict):
                    return self.unknown("a map that is not known is merged", node, scope)
                found.update(value)
                continue
            key = self.value(key_node, scope)
            plain_calls.check_size(key)
            if not isinstance(key, str | int | float | tuple):
                return self.unknown("a key of this map is not known", key_node, scope)
            try:
                found[key] = value
                found.places[key] = _whole(scope, key_node, value_node)
            except TypeError:
                return self.unknown("a key of this map is not known", key_node, scope)
        return found

    def _joined(self, parts: list[ast.expr], node: ast.AST, scope: Scope) -> Any:
        text = ""
        for part in parts:
            if isinstance(part, ast.FormattedValue):
                value = self.value(part.value, scope)
                if isinstance(value, Unknown):
                    return value
                width = "" if part.format_spec is None else self.value(part.format_spec, scope)
                shown = self._formatted(value, width)
            else:
                shown = self.value(part, scope)
            if not isinstance(shown, str):
                return (
                    shown
                    if isinstance(shown, Unknown)
                    else self.unknown("a part of the text is not known", node, scope)
                )
            text += shown
            if len(text) > MAX_TEXT:
                raise ScriptLimitError(f"a text of more than {MAX_TEXT:,} characters")
        return text

    def _formatted(self, value: Any, width: Any) -> Any:
        if isinstance(width, str) and len(width) <= 6 and isinstance(value, int | float | str):
            try:
                return format(value, width)
            except ValueError:
                return None
        try:
            return plain_calls.call_function("str", [value], {}) if width == "" else None
        except NotSupportedError:
            return None

    def _unary(self, node: ast.UnaryOp, scope: Scope) -> Any:
        value = self.value(node.operand, scope)
        if isinstance(node.op, ast.Not):
            decided = self.truth(value)
            if decided is not None:
                return not decided
            place = Place.of(scope.module.file, node)
            if isinstance(value, Construct):
                return Construct("not", value.arguments, {}, place, owner=value)
            return value
        if isinstance(value, int | float) and isinstance(node.op, ast.USub | ast.UAdd):
            return -value if isinstance(node.op, ast.USub) else value
        if isinstance(value, Unknown):
            return value
        return self.unknown("the operand is not a number", node, scope)

    def _bool(self, node: ast.BoolOp, scope: Scope) -> Any:
        stop = isinstance(node.op, ast.Or)
        value: Any = None
        for each in node.values:
            value = self.value(each, scope)
            decided = self.truth(value)
            if decided is None:
                return (
                    value
                    if isinstance(value, Unknown)
                    else self.unknown("the condition is not known", node, scope)
                )
            if decided is stop:
                return value
        return value

    def _compare(self, node: ast.Compare, scope: Scope) -> Any:
        left = self.value(node.left, scope)
        for op, right_node in zip(node.ops, node.comparators, strict=True):
            right = self.value(right_node, scope)
            if isinstance(op, ast.Is | ast.IsNot) and right is None:
                if isinstance(left, Unknown):
                    return left
                result: Any = (left is None) is isinstance(op, ast.Is)
            else:
                if any(isinstance(each, Unknown | Construct | Foreign) for each in (left, right)):
                    return self.unknown("what is compared is not known", node, scope)
                try:
                    result = plain_calls.compare(type(op), left, right)
                except NotSupportedError:
                    return self.unknown("what is compared is not known", node, scope)
            if not result:
                return False
            left = right
        return True

    def _item(self, node: ast.Subscript, scope: Scope) -> Any:
        owner = self.value(node.value, scope)
        if isinstance(node.slice, ast.Slice):
            return self._slice(owner, node.slice, node, scope)
        key = self.value(node.slice, scope)
        for each in (owner, key):
            if isinstance(each, Unknown):
                return each
        if isinstance(owner, ImageSize) and isinstance(key, str):
            if key in {"width", "height", "name"}:
                return owner.item(key)
            return self.unknown("there is no such item", node, scope)
        if isinstance(owner, Foreign) and owner.name == "os.environ" and isinstance(key, str):
            return f"$(env {key})"
        try:
            if isinstance(owner, list | tuple | dict | str):
                return owner[key]
        except (KeyError, IndexError, TypeError):
            pass
        return self.unknown("there is no such item", node, scope)

    def _slice(self, owner: Any, part: ast.Slice, node: ast.AST, scope: Scope) -> Any:
        ends = [
            None if each is None else self.value(each, scope)
            for each in (part.lower, part.upper, part.step)
        ]
        if isinstance(owner, list | tuple | str) and all(
            each is None or isinstance(each, int) for each in ends
        ):
            try:
                return owner[slice(*ends)]
            except ValueError:
                pass
        return (
            owner
            if isinstance(owner, Unknown)
            else self.unknown("the slice is not known", node, scope)
        )

    def _comprehension(
        self, node: ast.ListComp | ast.GeneratorExp | ast.SetComp | ast.DictComp, scope: Scope
    ) -> Any:
        found: list[Any] = []
        inner = Scope(scope.module, {}, scope)
        failed = self._generate(node, 0, inner, found)
        return failed if failed is not None else found

    def _generate(self, node: Any, depth: int, scope: Scope, found: list[Any]) -> Unknown | None:
        if depth == len(node.generators):
            if isinstance(node, ast.DictComp):
                found.append((self.value(node.key, scope), self.value(node.value, scope)))
            else:
                found.append(self.value(node.elt, scope))
            if len(found) > MAX_ITEMS:
                raise ScriptLimitError(f"more than {MAX_ITEMS:,} items")
            return None
        generator = node.generators[depth]
        values = self.value(generator.iter, scope)
        if not isinstance(values, list | tuple | dict | str):
            return self.unknown("what this goes over is not known", node, scope)
        for each in list(values):
            self.step()
            self._assign(generator.target, each, scope)
            decisions = [self.truth(self.value(test, scope)) for test in generator.ifs]
            if None in decisions:
                return self.unknown("the condition is not known", node, scope)
            if all(decisions):
                failed = self._generate(node, depth + 1, scope, found)
                if failed is not None:
                    return failed
        return None

    def _assign(self, target: ast.expr, value: Any, scope: Scope) -> None:
        raise NotImplementedError


def _whole(scope: Scope, first: ast.AST, last: ast.AST) -> Place:
    """The place from the beginning of one part to the end of another."""
    start, end = Place.of(scope.module.file, first), Place.of(scope.module.file, last)
    return Place(start.file, start.line, start.column, end.end_line, end.end_column)
