"""Evaluates expressions of a script; `r2bspec.interop.script_import.evaluator` has the rest."""

from __future__ import annotations

import ast
from collections.abc import Mapping
from typing import Any

from r2bspec.interop.script_import import plain_calls
from r2bspec.interop.script_import.foreign_calls import (
    NOT_KNOWN,
    foreign_call,
    foreign_value,
    join_path,
)
from r2bspec.interop.script_import.plain_calls import NotSupportedError
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
    LaunchText,
    Place,
    PlacedDict,
    PlacedTuple,
    PlainMethod,
    Scope,
    ScriptClass,
    ScriptFunction,
    ScriptModule,
    Unknown,
    unknown_in,
)

_ASSETS = "$(assets)"
_LAUNCH_VALUES = frozenset(
    {"LaunchConfiguration", "LaunchConfigurationEquals", "LaunchConfigurationNotEquals"}
)


class ExpressionEvaluator:
    """Evaluates expressions.

    Args:
        launch_values: what ``LaunchConfiguration(name)`` is, by name.
        steps: counts the steps.
    """

    def __init__(self, launch_values: Mapping[str, Any], steps: StepCounter) -> None:
        self.launch_values = launch_values
        self.step = steps.count

    def unknown(self, reason: str, node: ast.AST, scope: Scope) -> Unknown:
        """An unknown value that begins here."""
        return Unknown(reason, Place.of(scope.module.file, node))

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

    def _call(self, node: ast.Call, scope: Scope) -> Any:
        function = self.value(node.func, scope)
        arguments = self._items(node.args, scope)
        keywords: dict[str, Any] = {}
        places: dict[str, Place] = {}
        for each in node.keywords:
            value = self.value(each.value, scope)
            if each.arg is not None:
                keywords[each.arg] = value
                places[each.arg] = Place.of(scope.module.file, each)
            elif isinstance(value, dict) and all(isinstance(key, str) for key in value):
                keywords |= value
            else:
                return self.unknown("arguments that are not known are passed on", node, scope)
        result = self.call_value(function, arguments, keywords, Place.of(scope.module.file, node))
        if isinstance(result, Construct) and not result.keyword_places:
            result.keyword_places = places
        return result

    def call_value(
        self, function: Any, arguments: list[Any], keywords: dict[str, Any], place: Place
    ) -> Any:
        """The result of a call."""
        match function:
            case Unknown():
                return function
            case ScriptFunction():
                return self.call_script_function(function, arguments, keywords, place)
            case BoundFunction(function=inner, owner=owner):
                return self.call_script_function(inner, [owner, *arguments], keywords, place)
            case ScriptClass():
                return self.instance(function, arguments, keywords)
            case PlainMethod(owner=owner, name=name):
                return self._plain(owner, name, arguments, keywords, place)
            case Foreign(name=name):
                return self._foreign(name, arguments, keywords, place)
            case ForeignMethod(owner=kind, name=name):
                return self._test_method(kind, name, arguments, keywords, place)
            case ConstructMethod(owner=owner, name=name):
                full = f"{owner.name}.{name}"
                return Construct(full, arguments, keywords, place, owner=owner)
            case Construct(name=name):
                return Construct(f"{name}()", arguments, keywords, place, owner=function)
            case Instance():
                called = self.attribute(function, "__call__", ast.Pass(), _NO_SCOPE)
                if isinstance(called, BoundFunction):
                    return self.call_value(called, arguments, keywords, place)
        return Unknown("what is called is not known", place)

    def _plain(
        self, owner: Any, name: str, arguments: list[Any], keywords: dict[str, Any], place: Place
    ) -> Any:
        adds = isinstance(owner, list | dict) and name in {"append", "extend", "insert", "update"}
        missing = None if adds else unknown_in([arguments, keywords])
        if missing is not None:
            return missing
        try:
            return plain_calls.call_method(owner, name, arguments, keywords)
        except NotSupportedError:
            return Unknown(f"the result of {name}() is not known", place)

    def _foreign(
        self, name: str, arguments: list[Any], keywords: dict[str, Any], place: Place
    ) -> Any:
        if name.startswith("builtins."):
            return self._builtin(name.removeprefix("builtins."), arguments, keywords, place)
        last = name.rpartition(".")[2]
        if last in _LAUNCH_VALUES and arguments:
            known = self._launch_value(last, arguments)
            if known is not NOT_KNOWN:
                return known
        result = foreign_call(name, arguments, keywords, place)
        return Construct(name, arguments, keywords, place) if result is NOT_KNOWN else result

    def _launch_value(self, kind: str, arguments: list[Any]) -> Any:
        if not isinstance(arguments[0], str):
            return NOT_KNOWN
        value = self.launch_values.get(arguments[0], NOT_KNOWN)
        if kind != "LaunchConfiguration":
            if not isinstance(value, str | bool | int | float) or len(arguments) < 2:
                return NOT_KNOWN
            return (str(value) == str(arguments[1])) is (kind == "LaunchConfigurationEquals")
        return LaunchText(value) if isinstance(value, str) else value

    def _builtin(
        self, name: str, arguments: list[Any], keywords: dict[str, Any], place: Place
    ) -> Any:
        if name == "print":
            return None
        if name == "super":
            return Construct("super", [], {}, place)
        missing = unknown_in([arguments, keywords])
        if missing is not None:
            return missing
        try:
            return plain_calls.call_function(name, arguments, keywords)
        except NotSupportedError:
            reason = "the content of a file" if name == "open" else f"the result of {name}()"
            return Unknown(f"{reason} is not known", place)

    def _test_method(
        self,
        kind: ScriptClass,
        name: str,
        arguments: list[Any],
        keywords: dict[str, Any],
        place: Place,
    ) -> Any:
        """A method that the class of the benchmark inherits from ros2_benchmark."""
        if name == "generate_namespace":
            return self._namespace(kind, arguments, keywords, place)
        if name == "get_assets_root_path":
            return _ASSETS
        if name == "get_input_data_absolute_path":
            config = self._config(kind)
            path = None if config is None else config.get("input_data_path")
            return join_path([_ASSETS, path], place)
        return Construct(name, arguments, keywords, place)

    def _namespace(
        self, kind: ScriptClass, arguments: list[Any], keywords: dict[str, Any], place: Place
    ) -> Any:
        config = self._config(kind)
        root = "r2b" if config is None else config.get("benchmark_namespace", default="r2b")
        parts = [each for each in (root, *arguments) if each]
        if not all(isinstance(each, str) for each in parts):
            return unknown_in(parts) or Unknown("the namespace is not a text", place)
        return ("" if keywords.get("absolute") is False else "/") + "/".join(parts)

    @staticmethod
    def _config(kind: ScriptClass) -> Construct | None:
        try:
            config = kind.find("config")
        except KeyError:
            return None
        return config if isinstance(config, Construct) else None

    def call_script_function(
        self, function: ScriptFunction, arguments: list[Any], keywords: dict[str, Any], place: Place
    ) -> Any:
        """Evaluate the body of a function; see `Evaluator`."""
        raise NotImplementedError

    def instance(self, kind: ScriptClass, arguments: list[Any], keywords: dict[str, Any]) -> Any:
        """An object of a class of the script; see `Evaluator`."""
        raise NotImplementedError

    def _assign(self, target: ast.expr, value: Any, scope: Scope) -> None:
        raise NotImplementedError


def _whole(scope: Scope, first: ast.AST, last: ast.AST) -> Place:
    """The place from the beginning of one part to the end of another."""
    start, end = Place.of(scope.module.file, first), Place.of(scope.module.file, last)
    return Place(start.file, start.line, start.column, end.end_line, end.end_column)


_NO_SCOPE: Any = None
