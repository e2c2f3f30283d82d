"""Reading a quality-of-service profile from Python source, without running it.

A profile is a depth, a preset of rclpy, or ``QoSProfile(...)`` whose arguments are literals and
names of policies. It is given inline, by a variable that is bound once, by a constant of the class,
of the file or of a file of its package, or by the return value of a function or method. Statements
such as ``profile.durability = ...`` in the same scope count. A profile that is written in any other
way is not known.
"""

from __future__ import annotations

import ast
from collections.abc import Mapping
from typing import Any, Final, get_args, get_type_hints

from r2bspec.language.quantities import Duration
from r2bspec.language.spec import QoS
from r2bspec.plan.wiring.python_files import SourceFile, find_constant, find_definition
from r2bspec.plan.wiring.python_source import SourceNames, returned_value

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


def read_profile(
    given: ast.expr | None,
    file: SourceFile,
    values: Mapping[str, ast.expr | None],
    scope: ast.AST,
) -> QoS | None:
    """Return the profile that an argument means; None if the text does not tell.

    Args:
        given: the argument.
        file: with the class.
        values: the only value of each variable of the method, of ``self.NAME``, and what
            ``self.NAME()`` returns.
        scope: the method, in which the fields of a profile may be set.
    """
    written = None
    for _ in range(_MAX_STEPS):
        if given is None or file.names.full_name(given).startswith("rclpy."):
            break
        key = ast.unparse(given)
        match given:
            case ast.Name() | ast.Attribute() | ast.Call() if key in values:
                given = values[key]
            case ast.Name(id=name) if (constant := find_constant(file, name)) is not None:
                (file, given), values = constant, {}
            case ast.Call(func=ast.Name(id=name), args=[], keywords=[]) if (
                definition := find_definition(file, name)
            ) is not None:
                file, given, values = definition.file, returned_value(definition.node), {}
            case _:
                break
        written = written or key
    names = file.names
    profile = _profile(given, names)
    if profile is None or written is None:
        return profile
    for statement in [*ast.walk(scope), *names.top_level]:
        match statement:
            case ast.Assign(targets=[ast.Attribute(value=owner, attr=field)], value=value) if (
                ast.unparse(owner) == written
            ):
                changed = _field(field, value, names)
                if changed is None:
                    return None
                profile = QoS.from_keys({**_fields_of(profile), **changed})
    return profile


def _fields_of(profile: QoS) -> dict[str, Any]:
    return {name: getattr(profile, name) for name in _FIELDS.values()}


def _profile(given: ast.expr | None, names: SourceNames) -> QoS | None:
    match given:
        case ast.Constant(value=int(depth)) if depth > 0 and not isinstance(depth, bool):
            return QoS(depth=depth)
        case ast.Call(func=made, args=[], keywords=keywords) if (
            names.full_name(made).rpartition(".")[2] == "QoSProfile"
        ):
            fields: dict[str, Any] = {}
            for keyword in keywords:
                read = _field(keyword.arg or "", keyword.value, names)
                if read is None:
                    return None
                fields |= read
            return QoS.from_keys(fields)
    full = names.full_name(given) if given is not None else ""
    preset = _PRESETS.get(full.removesuffix(".value").rpartition(".")[2])
    return QoS.from_word(preset) if preset and full.startswith("rclpy.qos.") else None


def _field(name: str, value: ast.expr, names: SourceNames) -> dict[str, Any] | None:
    """Return a field as a spec has it; None if it is not known."""
    field = _FIELDS.get(name)
    if field is None:
        return None
    if isinstance(value, ast.Name) and (constant := names.constant(value.id)) is not None:
        value = constant
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
