"""Evaluates calls in a script: of its own functions, of Python's, and of foreign ones."""

from __future__ import annotations

import ast
from collections.abc import Mapping
from typing import Any

from r2bspec.interop.script_import import plain_calls
from r2bspec.interop.script_import.foreign_calls import (
    NOT_KNOWN,
    foreign_call,
    join_path,
)
from r2bspec.interop.script_import.plain_calls import NotSupportedError
from r2bspec.interop.script_import.script_values import (
    BoundFunction,
    Construct,
    ConstructMethod,
    Foreign,
    ForeignMethod,
    Instance,
    LaunchText,
    Place,
    PlainMethod,
    Scope,
    ScriptClass,
    ScriptFunction,
    Unknown,
    unknown_in,
)

_ASSETS = "$(assets)"
_LAUNCH_VALUES = frozenset(
    {"LaunchConfiguration", "LaunchConfigurationEquals", "LaunchConfigurationNotEquals"}
)
_NO_SCOPE: Any = None


class CallEvaluator:
    """Evaluates calls; `r2bspec.interop.script_import.expressions` has the other expressions."""

    launch_values: Mapping[str, Any]

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

    def value(self, node: ast.expr, scope: Scope) -> Any:
        """The value of an expression; see `ExpressionEvaluator`."""
        raise NotImplementedError

    def attribute(self, owner: Any, name: str, node: ast.AST, scope: Scope) -> Any:
        """The value of ``owner.name``; see `ExpressionEvaluator`."""
        raise NotImplementedError

    def unknown(self, reason: str, node: ast.AST, scope: Scope) -> Unknown:
        """An unknown value that begins here."""
        return Unknown(reason, Place.of(scope.module.file, node))

    def _items(self, parts: list[ast.expr], scope: Scope) -> list[Any]:
        raise NotImplementedError
