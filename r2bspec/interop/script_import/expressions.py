"""The values of expressions and calls in a script, as Python would compute them, but not by Python.

An expression whose value the script does not determine is an `Unknown`, and so is everything that
is computed from it; lists, maps and arguments keep the unknown among the known. Calls of functions
of the script evaluate their bodies, those in `known_functions` have their results, and any other
call is a `Construct` that says what is called with what.

`Evaluator` adds the statements; only the bodies of functions lead there.
"""

from __future__ import annotations

import ast
import contextlib
from collections.abc import Iterator, Mapping
from typing import Any

from r2bspec.diagnostics import Span
from r2bspec.interop.script_import import known_functions
from r2bspec.interop.script_import.known_functions import ASSETS, foreign_call, foreign_constant
from r2bspec.interop.script_import.values import (
    BoundFunction,
    Construct,
    CopiedEnvironment,
    Foreign,
    ImageSize,
    ImportNote,
    LaunchText,
    Method,
    NotKnownError,
    PlacedDict,
    PlacedTuple,
    Scope,
    ScriptClass,
    ScriptFunction,
    ScriptLimitError,
    ScriptModule,
    ScriptObject,
    StepCounter,
    Unknown,
    require_known,
)
from r2bspec.safe_io.limits import MAX_SCRIPT_ITEMS, MAX_SCRIPT_TEXT

_NAMES = frozenset({"print", "super", "isinstance", "open"})
"""Functions of Python that are understood without being called."""
_UNDEFINED = object()
_ADDING = frozenset({"append", "extend", "insert", "update"})
_ADDING_ACTIONS = frozenset({"add_action", "add_entity"})


def truth(value: Any) -> bool | None:
    """Whether a value is true; None if that is not known."""
    if isinstance(value, Unknown | Construct | Foreign | Method):
        return None
    if isinstance(value, str) and value.startswith("$(env "):
        return None
    if isinstance(value, str | list | dict | tuple | int | float) or value is None:
        return bool(value)
    return True


class Expressions:
    """Evaluates expressions.

    Args:
        launch_values: what ``LaunchConfiguration(name)`` is, by name.
        steps: counts the steps.
    """

    def __init__(self, launch_values: Mapping[str, Any], steps: StepCounter) -> None:
        self.launch_values = launch_values
        self.steps = steps
        self.notes: list[ImportNote] = []

    def value(self, node: ast.expr, scope: Scope) -> Any:
        """The value of an expression, which may be unknown."""
        self.steps.count()
        try:
            value = self._value(node, scope)
        except NotKnownError as error:
            return error.unknown(scope.place(node))
        if isinstance(value, str):
            self.steps.count_text(value)
        return value

    def _known(self, node: ast.expr, scope: Scope) -> Any:
        """The value of an expression.

        Raises:
            NotKnownError: it is not known.
        """
        value = self.value(node, scope)
        if isinstance(value, Unknown):
            raise NotKnownError(value)
        return value

    def _is_true(self, node: ast.expr, scope: Scope) -> bool:
        decided = truth(self._known(node, scope))
        if decided is None:
            raise NotKnownError("the condition is not known")
        return decided

    def _value(self, node: ast.expr, scope: Scope) -> Any:
        match node:
            case ast.Constant(value=value):
                return self._constant(value)
            case ast.Name(id=name):
                return self._name(name, scope)
            case ast.Attribute(value=owner, attr=name):
                return self.attribute(self._known(owner, scope), name)
            case ast.Call():
                return self._call(node, scope)
            case ast.List(elts=parts) | ast.Set(elts=parts):
                return self._items(parts, scope)
            case ast.Tuple(elts=parts):
                placed = PlacedTuple(self._items(parts, scope))
                placed.place = scope.place(node)
                return placed
            case ast.Dict():
                return self._dict(node, scope)
            case ast.JoinedStr(values=parts):
                return self._joined(parts, scope)
            case ast.BinOp(left=left, op=op, right=right):
                return self.binary(op, self._known(left, scope), self._known(right, scope))
            case ast.UnaryOp(op=op, operand=operand):
                return self._unary(op, self._known(operand, scope), scope.place(node))
            case ast.BoolOp(op=op, values=parts):
                return self._bool(parts, scope, stop=isinstance(op, ast.Or))
            case ast.Compare():
                return self._compare(node, scope)
            case ast.IfExp(test=test, body=body, orelse=orelse):
                return self.value(body if self._is_true(test, scope) else orelse, scope)
            case ast.Subscript(value=owner, slice=ast.Slice() as part):
                return self._slice(self._known(owner, scope), part, scope)
            case ast.Subscript(value=owner, slice=key):
                return self._item(self._known(owner, scope), self._known(key, scope))
            case (
                ast.ListComp(elt=element) | ast.GeneratorExp(elt=element) | ast.SetComp(elt=element)
            ):
                scopes = self._rounds(node.generators, Scope(scope.module, {}, scope))
                return self._limited(self.value(element, inner) for inner in scopes)
            case ast.DictComp(key=key, value=element):
                scopes = self._rounds(node.generators, Scope(scope.module, {}, scope))
                return dict(
                    self._limited(
                        (self._key(key, inner), self.value(element, inner)) for inner in scopes
                    )
                )
            case ast.Lambda():
                return ScriptFunction(node, scope)
            case ast.Starred(value=inside):
                return self.value(inside, scope)
        raise NotKnownError(f"an expression of this kind ({type(node).__name__}) is not understood")

    @staticmethod
    def _constant(value: Any) -> Any:
        if isinstance(value, str) and "$(" in value:
            raise NotKnownError("a text with '$(' would be a reference in a spec")
        known_functions.check_number(value)
        if isinstance(value, str | int | float | bool) or value is None:
            return value
        raise NotKnownError("a constant of this type has no form in a spec")

    @staticmethod
    def _name(name: str, scope: Scope) -> Any:
        is_builtin = known_functions.has_function(name) or name in _NAMES
        value = scope.find(name, Foreign(f"builtins.{name}") if is_builtin else _UNDEFINED)
        if value is _UNDEFINED:
            everything = scope.find("*", None)
            if isinstance(everything, Foreign):
                return Foreign(f"{everything.name}.{name}")
            raise NotKnownError(f"the name {name!r} is not defined in the script")
        return value

    def attribute(self, owner: Any, name: str) -> Any:
        """The value of ``owner.name``.

        Raises:
            NotKnownError: it has none that is known.
        """
        match owner:
            case Foreign(name=full):
                return foreign_constant(f"{full}.{name}") or Foreign(f"{full}.{name}")
            case ScriptModule():
                return owner.scope.find(name, Foreign(f"{owner.file.stem}.{name}"))
            case ScriptObject():
                if name in owner.names:
                    return owner.names[name]
                return self._class_attribute(owner.kind, owner, name)
            case ScriptClass():
                return self._class_attribute(owner, owner, name)
            case Construct():
                if name in owner.keywords:
                    return owner.keywords[name]
                return owner.field_of_message(name) if owner.is_message else Method(owner, name)
            case Method(owner=ScriptClass() as kind, name=outer):
                return Method(kind, f"{outer}.{name}")
        if known_functions.has_method(owner, name):
            return Method(owner, name)
        raise NotKnownError(f"the attribute {name!r} is not known")

    @staticmethod
    def _class_attribute(kind: ScriptClass, owner: Any, name: str) -> Any:
        value = kind.find(name, Method(kind, name))
        if not isinstance(value, ScriptFunction) or value.kind == "staticmethod":
            return value
        if value.kind == "classmethod":
            return BoundFunction(value, kind)
        return BoundFunction(value, owner) if isinstance(owner, ScriptObject) else value

    def _limited(self, values: Iterator[Any]) -> list[Any]:
        """The values as a list of a limited size."""
        items: list[Any] = []
        for value in values:
            items.append(value)
            if len(items) > MAX_SCRIPT_ITEMS:
                raise ScriptLimitError(f"more than {MAX_SCRIPT_ITEMS:,} items")
        self.steps.count_items(items)
        return items

    def _items(self, parts: list[ast.expr], scope: Scope) -> list[Any]:
        return self._limited(self._unpacked(parts, scope))

    def _unpacked(self, parts: list[ast.expr], scope: Scope) -> Iterator[Any]:
        for part in parts:
            value = self.value(part, scope)
            if isinstance(part, ast.Starred) and isinstance(value, list | tuple):
                yield from value
            else:
                yield value

    def _key(self, node: ast.expr, scope: Scope) -> Any:
        key = self.value(node, scope)
        self.steps.count_items(key)
        if isinstance(key, str | int | float | tuple):
            with contextlib.suppress(TypeError):
                hash(key)
                return key
        raise NotKnownError(Unknown("a key of this map is not known", scope.place(node)))

    def _dict(self, node: ast.Dict, scope: Scope) -> PlacedDict:
        values = PlacedDict()
        values.places = {}
        for key_node, value_node in zip(node.keys, node.values, strict=True):
            value = self.value(value_node, scope)
            if key_node is not None:
                key = self._key(key_node, scope)
                values[key] = value
                values.places[key] = scope.place(key_node, value_node)
            elif isinstance(value, dict):
                values.update(value)
            else:
                raise NotKnownError("a map that is not known is merged")
        self.steps.count_items(values)
        return values

    def _joined(self, parts: list[ast.expr], scope: Scope) -> str:
        text = ""
        for part in parts:
            if isinstance(part, ast.FormattedValue):
                value = self._known(part.value, scope)
                self.steps.count_items(value)
                width = "" if part.format_spec is None else self.value(part.format_spec, scope)
                text += known_functions.formatted(value, width)
            else:
                text += str(self._known(part, scope))
            if len(text) > MAX_SCRIPT_TEXT:
                raise ScriptLimitError(f"a text of more than {MAX_SCRIPT_TEXT:,} characters")
        return text

    def binary(self, op: ast.operator, left: Any, right: Any) -> Any:
        """The value of ``left op right``.

        Raises:
            NotKnownError: it has none.
        """
        self.steps.count_items(left, right)
        return known_functions.binary(type(op), left, right)

    @staticmethod
    def _unary(op: ast.unaryop, value: Any, place: Span) -> Any:
        if isinstance(op, ast.Not):
            decided = truth(value)
            if decided is None and isinstance(value, Construct):
                return Construct("not", value.arguments, {}, place, owner=value)
            return value if decided is None else not decided
        if isinstance(value, int | float) and isinstance(op, ast.USub | ast.UAdd):
            return -value if isinstance(op, ast.USub) else value
        raise NotKnownError("the operand is not a number")

    def _bool(self, parts: list[ast.expr], scope: Scope, *, stop: bool) -> Any:
        value: Any = None
        for part in parts:
            value = self._known(part, scope)
            decided = truth(value)
            if decided is None:
                raise NotKnownError("the condition is not known")
            if decided is stop:
                break
        return value

    def _compare(self, node: ast.Compare, scope: Scope) -> bool:
        left = self.value(node.left, scope)
        for op, right_node in zip(node.ops, node.comparators, strict=True):
            right = self.value(right_node, scope)
            if isinstance(op, ast.Is | ast.IsNot) and right is None:
                if isinstance(left, Unknown):
                    raise NotKnownError(left)
            elif any(isinstance(side, Unknown | Construct | Foreign) for side in (left, right)):
                raise NotKnownError("what is compared is not known")
            self.steps.count_items(left, right)
            if not known_functions.compare(type(op), left, right):
                return False
            left = right
        return True

    def _item(self, owner: Any, key: Any) -> Any:
        is_environment = isinstance(owner, Foreign) and owner.name == "os.environ"
        if isinstance(owner, CopiedEnvironment) and key not in owner:
            is_environment = True
        if is_environment and isinstance(key, str):
            return known_functions.environment_variable(key)
        self.steps.count_items(key)
        try:
            if isinstance(owner, ImageSize):
                return owner.item(key)
            if isinstance(owner, list | tuple | dict | str):
                return owner[key]
        except (KeyError, IndexError, TypeError):
            pass
        raise NotKnownError("there is no such item")

    def _slice(self, owner: Any, part: ast.Slice, scope: Scope) -> Any:
        ends = [
            None if end is None else self.value(end, scope)
            for end in (part.lower, part.upper, part.step)
        ]
        try:
            if isinstance(owner, list | tuple | str):
                return owner[slice(*ends)]
        except (TypeError, ValueError):
            pass
        raise NotKnownError("the slice is not known")

    def _rounds(self, generators: list[ast.comprehension], scope: Scope) -> Iterator[Scope]:
        """The scope of each round of a comprehension."""
        if not generators:
            yield scope
            return
        first, *others = generators
        values = self.value(first.iter, scope)
        if not isinstance(values, list | tuple | dict | str):
            raise NotKnownError("what this goes over is not known")
        for value in list(values):
            self.steps.count()
            self.assign(first.target, value, scope)
            if all(self._is_true(test, scope) for test in first.ifs):
                yield from self._rounds(others, scope)

    def assign(self, target: ast.expr, value: Any, scope: Scope) -> None:
        """Give a name, the parts of a tuple, an attribute or an item its value."""
        match target:
            case ast.Name(id=name):
                if isinstance(value, ImageSize) and not value.name:
                    value = ImageSize(value.width, value.height, value.label, name)
                scope.names[name] = value
            case ast.Tuple(elts=parts) | ast.List(elts=parts):
                if not isinstance(value, list | tuple) or len(value) != len(parts):
                    reason = "a value that is not a list is unpacked"
                    lost = (
                        value
                        if isinstance(value, Unknown)
                        else Unknown(reason, scope.place(target))
                    )
                    value = [lost] * len(parts)
                for part, item in zip(parts, value, strict=True):
                    self.assign(part, item, scope)
            case ast.Attribute(value=owner, attr=name):
                self._set_attribute(self.value(owner, scope), name, value, scope.place(target))
            case ast.Subscript(value=owner, slice=key):
                container = self.value(owner, scope)
                if isinstance(container, Foreign | Construct):
                    reason = "what is set here belongs to another package"
                    self.notes.append(ImportNote(reason, scope.place(target)))
                self._set_item(container, self.value(key, scope), value)
            case _:
                self.notes.append(ImportNote("an assignment of this kind", scope.place(target)))

    @staticmethod
    def _set_attribute(owner: Any, name: str, value: Any, place: Span) -> None:
        if isinstance(owner, ScriptObject | ScriptClass):
            owner.names[name] = value
        elif isinstance(owner, Construct):
            owner.keywords[name] = value
            owner.keyword_places[name] = place

    def _set_item(self, owner: Any, key: Any, value: Any) -> None:
        self.steps.count_items(key, value)
        try:
            if isinstance(owner, dict | list):
                owner[key] = value
        except (TypeError, IndexError):
            pass

    def _call(self, node: ast.Call, scope: Scope) -> Any:
        function = self.value(node.func, scope)
        arguments = self._items(node.args, scope)
        keywords: dict[str, Any] = {}
        places: dict[str, Span] = {}
        for keyword in node.keywords:
            value = self.value(keyword.value, scope)
            if keyword.arg is not None:
                keywords[keyword.arg] = value
                places[keyword.arg] = scope.place(keyword)
            elif isinstance(value, dict) and all(isinstance(key, str) for key in value):
                keywords |= value
            else:
                raise NotKnownError("arguments that are not known are passed on")
        self.steps.count_items(keywords)
        if isinstance(function, Foreign) and function.name.endswith("ThisLaunchFileDir"):
            here = scope.module.scope.find("__file__", "")
            return LaunchText(str(here).rpartition("/")[0])
        result = self.call_value(function, arguments, keywords, scope.place(node))
        if isinstance(result, Construct) and not result.keyword_places:
            result.keyword_places = places
        return result

    def call_value(
        self, function: Any, arguments: list[Any], keywords: dict[str, Any], place: Span
    ) -> Any:
        """The result of a call.

        Raises:
            NotKnownError: it is not known.
        """
        match function:
            case Unknown():
                return function
            case ScriptFunction():
                return self.call_script(function, arguments, keywords)
            case BoundFunction(function=inner, owner=owner):
                return self.call_script(inner, [owner, *arguments], keywords)
            case ScriptClass():
                return self._instance(function, arguments, keywords)
            case Foreign(name=name) if name.startswith("builtins."):
                return self._builtin(name.removeprefix("builtins."), arguments, keywords, place)
            case Foreign(name=name):
                return foreign_call(name, arguments, keywords, place, self.launch_values)
            case Method(owner=ScriptClass() as kind, name=name):
                return self._test_method(kind, name, arguments, keywords, place)
            case Method(owner=Construct() as owner, name=name) if name in _ADDING_ACTIONS:
                self._add_action(owner, arguments)
                return None
            case Method(owner=Construct() as owner, name="perform_substitution") if arguments:
                return arguments[0]
            case Method(owner=Construct() as owner, name=name):
                return Construct(f"{owner.name}.{name}", arguments, keywords, place, owner=owner)
            case Method(owner=owner, name=name):
                if not (isinstance(owner, list | dict) and name in _ADDING):
                    self.steps.count_items(owner)
                    require_known(arguments, keywords)
                return known_functions.call_method(owner, name, arguments, keywords)
            case Construct(name=name):
                return Construct(f"{name}()", arguments, keywords, place, owner=function)
            case ScriptObject():
                called = self.attribute(function, "__call__")
                if isinstance(called, BoundFunction):
                    return self.call_value(called, arguments, keywords, place)
        raise NotKnownError("what is called is not known")

    def _add_action(self, owner: Construct, actions: list[Any]) -> None:
        """``description.add_action(action)``."""
        key = "initial_entities" if owner.short_name == "LaunchDescription" else "actions"
        before = owner.get(key, 0, [])
        self.steps.count_items(actions)
        before = [*before] if isinstance(before, list | tuple) else [before]
        self.steps.count_items(before)
        owner.keywords[key] = [*before, *actions]

    @staticmethod
    def _builtin(name: str, arguments: list[Any], keywords: dict[str, Any], place: Span) -> Any:
        if name == "print":
            return None
        if name == "super":
            return Construct("super", [], {}, place)
        require_known(arguments, keywords)
        return known_functions.call_function(name, arguments, keywords)

    @staticmethod
    def _test_method(
        kind: ScriptClass, name: str, arguments: list[Any], keywords: dict[str, Any], place: Span
    ) -> Any:
        """A method that the class of the benchmark inherits from ros2_benchmark."""
        config = kind.find("config")
        if not isinstance(config, Construct):
            config = Construct("config", [], {}, place)
        if name == "get_assets_root_path":
            return ASSETS
        if name == "get_input_data_absolute_path":
            return known_functions.join_path(ASSETS, config.get("input_data_path"))
        if name != "generate_namespace":
            return Construct(name, arguments, keywords, place)
        root = config.get("benchmark_namespace", default="r2b")
        parts = [part for part in (root, *arguments) if part]
        require_known(parts)
        if not all(isinstance(part, str) for part in parts):
            raise NotKnownError("the namespace is not a text")
        return ("" if keywords.get("absolute") is False else "/") + "/".join(parts)

    def _instance(
        self, kind: ScriptClass, arguments: list[Any], keywords: dict[str, Any]
    ) -> ScriptObject:
        instance = ScriptObject(kind)
        constructor = kind.find("__init__")
        if isinstance(constructor, ScriptFunction):
            with contextlib.suppress(NotKnownError):
                self.call_script(constructor, [instance, *arguments], keywords)
        return instance

    def call_script(
        self, _function: ScriptFunction, _arguments: list[Any], _keywords: dict[str, Any]
    ) -> Any:
        """What a function of the script returns.

        Raises:
            NotKnownError: it raises; here always, because statements are a matter of `Evaluator`.
        """
        raise NotKnownError("functions are not called here")
