"""Reading a quality-of-service profile from Python source, without running it.

A profile is a depth, a preset of rclpy, or ``QoSProfile(...)`` whose arguments are literals and
names of policies. It is given inline, by a variable that is bound once, by a constant of the class,
of the file or of a file of its package, by an entry of a dict, or by the return value of a function
or method. Statements such as ``profile.durability = ...`` in the same scope count. A profile that
is written in any other way is not known.
"""

from __future__ import annotations

import ast
from collections.abc import Mapping
from typing import Any, Final, NamedTuple, get_args, get_type_hints

from r2bspec.language.quantities import Duration
from r2bspec.language.spec import QoS
from r2bspec.plan.wiring.python_files import (
    Definition,
    SourceFile,
    find_constant,
    find_definition,
    find_module,
)
from r2bspec.plan.wiring.python_source import returned_value, single_values

_PRESETS: Final = {
    "qos_profile_default": "default",
    "qos_profile_sensor_data": "sensor_data",
    "qos_profile_services_default": "services",
    "qos_profile_parameters": "parameters",
    "qos_profile_system_default": "system_default",
    "DEFAULT": "default",
    "SENSOR_DATA": "sensor_data",
    "SERVICES_DEFAULT": "services",
    "PARAMETERS": "parameters",
    "SYSTEM_DEFAULT": "system_default",
}
"""The presets of rclpy, by the names of `QoSPresetProfiles`, too."""

_FIELDS: Final = {
    **{name: name for name in ("history", "depth", "reliability", "durability")},
    **{name: name for name in ("deadline", "lifespan", "liveliness")},
    "liveliness_lease_duration": "lease_duration",
}
"""The fields of a profile in a spec, by their names in rclpy."""

_MAX_STEPS: Final = 10


class Scope(NamedTuple):
    """Where an expression stands.

    Attributes:
        file: with the text.
        values: the only value of each variable, ``self.NAME`` too; None if there are others.
        functions: the methods of the class and the functions inside of the text, by their names.
        node: the text: a method or a function.
        owners: the expressions that are the node, such as ``self``.
    """

    file: SourceFile
    values: Mapping[str, ast.expr | None]
    functions: Mapping[str, ast.FunctionDef]
    node: ast.AST
    owners: frozenset[str] = frozenset()


class _Place(NamedTuple):
    """An expression, None if it is not known, and where it stands."""

    given: ast.expr | None
    scope: Scope


def read_profile(given: ast.expr | None, scope: Scope) -> QoS | None:
    """Return the profile that an argument means; None if the text does not say it."""
    fields = _fields(given, scope, _MAX_STEPS)
    return None if fields is None else QoS.from_keys(fields)


def _fields(given: ast.expr | None, scope: Scope, steps: int) -> dict[str, Any] | None:
    """Return the fields of a profile, as a spec has them."""
    if given is None or not steps:
        return None
    names = scope.file.names
    if names.full_name(given.func if isinstance(given, ast.Call) else given).startswith("rclpy."):
        return _made(given, scope)
    place = _meaning(given, scope, steps)
    if place is None:
        return _made(given, scope)
    fields = _fields(place.given, place.scope, steps - 1)
    written = ast.unparse(given)
    for statement in [*ast.walk(scope.node), *names.top_level]:
        match statement:
            case ast.Assign(targets=[ast.Attribute(value=owner, attr=name)], value=value) if (
                ast.unparse(owner) == written
            ):
                changed = _field(name, value, scope)
                if fields is None or changed is None:
                    return None
                fields |= changed
    return fields


def _meaning(given: ast.expr, scope: Scope, steps: int) -> _Place | None:
    """Return the expression that gives another one its value, and where it stands; None if none."""
    file = scope.file
    match given:
        case ast.Name() | ast.Attribute() if (key := ast.unparse(given)) in scope.values:
            return _Place(scope.values[key], scope)
        case ast.Name(id=name) if (constant := find_constant(file, name)) is not None:
            return _Place(constant[1], _of_file(constant[0]))
        case ast.Attribute(value=inner, attr="value"):
            return _Place(inner, scope)
        case ast.Attribute(value=owner, attr=name):
            module = find_module(file, owner)
            if module is not None and (constant := find_constant(module, name)) is not None:
                return _Place(constant[1], _of_file(constant[0]))
            made = _definition(owner, file)
            if made is not None and isinstance(made.node, ast.ClassDef):
                value = single_values(made.node, made.node.body).get(name)
                return _Place(value, _of_file(made.file))
        case ast.Subscript(value=table, slice=ast.Constant(value=wanted)):
            return _entry(_Place(table, scope), wanted, steps)
        case ast.Call(func=called):
            return _returned(given, called, scope)
    return None


def _entry(table: _Place, wanted: object, steps: int) -> _Place | None:
    """Return the entry of a dict."""
    place: _Place | None = table
    while steps and place is not None and place.given and not isinstance(place.given, ast.Dict):
        steps -= 1
        place = _meaning(place.given, place.scope, steps)
    if place is None or not isinstance(place.given, ast.Dict):
        return None
    for key, value in zip(place.given.keys, place.given.values, strict=True):
        if isinstance(key, ast.Constant) and key.value == wanted:
            return _Place(value, place.scope)
    return None


def _definition(given: ast.expr, file: SourceFile) -> Definition | None:
    """Return the class or the function that ``NAME`` or ``module.NAME`` is."""
    match given:
        case ast.Name(id=name):
            return find_definition(file, name)
        case ast.Attribute(value=owner, attr=name) if module := find_module(file, owner):
            return find_definition(module, name)
    return None


def _of_file(file: SourceFile) -> Scope:
    return Scope(file, {}, {}, ast.Module([], []))


def _returned(call: ast.Call, called: ast.expr, scope: Scope) -> _Place | None:
    """Return what a function returns, and its scope with its arguments."""
    definition, skipped = _definition(called, scope.file), 0
    match called:
        case ast.Attribute(value=owner, attr=name) if (
            ast.unparse(owner) in scope.owners and name in scope.functions
        ):
            definition = Definition(scope.file, scope.functions[name])
            skipped = 0 if definition.node.decorator_list else 1
    if definition is None or not isinstance(definition.node, ast.FunctionDef):
        return None
    arguments = definition.node.args
    names = [each.arg for each in arguments.args]
    keywords = [each.arg for each in arguments.kwonlyargs]
    given = dict(zip(names[skipped:], call.args, strict=False))
    given |= {each.arg: each.value for each in call.keywords if each.arg}
    values = {
        **single_values(definition.node),
        **dict(zip(reversed(names), reversed(arguments.defaults), strict=False)),
        **dict(zip(keywords, arguments.kw_defaults, strict=True)),
        **{name: _literal(value, scope) for name, value in given.items()},
    }
    inner = Scope(definition.file, values, {}, definition.node)
    return _Place(returned_value(definition.node), inner)


def _literal(given: ast.expr, scope: Scope) -> ast.expr | None:
    """Return an argument as it means the same in another file; None if that is not known."""
    if isinstance(given, ast.Name):
        place = _meaning(given, scope, 1)
        given = place.given if place is not None and place.given is not None else given
    return None if isinstance(given, ast.Name) else given


def _made(given: ast.expr, scope: Scope) -> dict[str, Any] | None:
    """Return the fields of a depth, a preset, or of ``QoSProfile(...)``."""
    names = scope.file.names
    match given:
        case ast.Constant(value=int(depth)) if depth > 0 and not isinstance(depth, bool):
            return {"depth": depth}
        case ast.Call(func=made, args=[], keywords=keywords) if (
            names.full_name(made).rpartition(".")[2] == "QoSProfile"
        ):
            fields: dict[str, Any] = {}
            for keyword in keywords:
                read = _field(keyword.arg or "", keyword.value, scope)
                if read is None:
                    return None
                fields |= read
            return fields
    full = names.full_name(given)
    preset = _PRESETS.get(full.removesuffix(".value").rpartition(".")[2])
    if preset is None or not full.startswith("rclpy."):
        return None
    profile = QoS.from_word(preset)
    return {name: getattr(profile, name) for name in _FIELDS.values()}


def _field(name: str, value: ast.expr, scope: Scope) -> dict[str, Any] | None:
    """Return a field as a spec has it; None if it is not known."""
    field = _FIELDS.get(name)
    if field is None:
        return None
    if isinstance(value, ast.Name) and (place := _meaning(value, scope, 1)) is not None:
        if place.given is None:
            return None
        value, scope = place.given, place.scope
    names = scope.file.names
    match value:
        case ast.Constant(value=int(depth)) if field == "depth" and depth > 0:
            return {field: depth}
        case ast.Call(keywords=parts, args=[]) if field.endswith(("deadline", "span", "duration")):
            limit = _duration(parts) if names.full_name(value.func).endswith("Duration") else None
            return {field: limit} if limit else None
        case ast.Attribute(attr=policy):
            words = get_args(get_type_hints(QoS).get(field))
            word = policy.lower().removeprefix(f"rmw_qos_policy_{field}_")
            return {field: word} if word in words else None
    return None


def _duration(parts: list[ast.keyword]) -> Duration | None:
    total_ns = 0.0
    for part in parts:
        match part.value:
            case ast.Constant(value=int() | float() as value):
                total_ns += value * {"seconds": 10**9, "nanoseconds": 1}.get(part.arg or "", 0)
            case _:
                return None
    return Duration(round(total_ns)) if total_ns > 0 else None
