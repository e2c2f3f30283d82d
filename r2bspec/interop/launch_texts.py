"""Substitutions and conditions of launch, performed with the values of launch arguments.

Values that launch would get from the machine, such as the output of a command, stay unknown.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

from r2bspec.interop import stand_ins
from r2bspec.interop.stand_ins import Recorded

CONFIGURATIONS: Final[dict[str, str]] = {}
"""The values of launch arguments, by name."""


def perform(value: Any) -> str:
    """Return the text of a value, with marks for its unknown parts."""
    if value is None:
        return ""
    if isinstance(value, Recorded):
        substitute = _SUBSTITUTIONS.get(value._kind)
        text = substitute(value) if substitute is not None else None
        return str(value) if text is None else text
    if isinstance(value, list | tuple):
        return "".join(map(perform, value))
    return os.fspath(value) if isinstance(value, os.PathLike) else str(value)


def evaluate(condition: Any) -> bool:
    """Return the truth of a condition; an unknown condition is taken as met, with a note."""
    if condition is None or isinstance(condition, bool):
        return condition is not False
    if isinstance(condition, Recorded):
        kind, first = condition._kind, condition._args[:1] or [*condition._kwargs.values()][:1]
        if kind in {"IfCondition", "UnlessCondition"} and first:
            text = perform(first[0]).strip().lower()
            if text in {"true", "1", "false", "0"}:
                return (text in {"true", "1"}) is (kind == "IfCondition")
        if kind in {"LaunchConfigurationEquals", "LaunchConfigurationNotEquals"} and first:
            has = CONFIGURATIONS.get(perform(first[0]))
            wanted = condition._get("expected_value", 1)
            is_same = has == (None if wanted is None else perform(wanted))
            return is_same is (kind == "LaunchConfigurationEquals")
        place = condition._place
        stand_ins.RECORDING.note(
            "lost", f"a condition ({kind}) is not known; it is taken as met", place
        )
    return True


def _configuration(value: Recorded) -> str | None:
    name = perform(value._get("variable_name", 0))
    if name in CONFIGURATIONS:
        return CONFIGURATIONS[name]
    default = value._get("default", 1)
    if default is not None:
        return perform(default)
    return stand_ins.RECORDING.mark(f"the launch argument {name}", value._place)


def _environment(value: Recorded) -> str:
    name = perform(value._get("name", 0))
    default = value._get("default_value", 1)
    if default is None:
        return f"$(env {name})"
    reason = f"the environment variable {name!r} has its default here"
    stand_ins.RECORDING.note("changed", reason, value._place)
    return perform(default)


def _python(value: Recorded) -> str | None:
    text = perform(value._get("expression", 0))
    if "$(" in text:
        return None
    try:
        return str(eval(text, {}))  # noqa: S307 - as launch does
    except Exception:
        return None


def _join(value: Recorded) -> str:
    return "/".join(map(perform, value._get("substitutions", 0, ()))).replace("//", "/")


def _slash(value: Recorded) -> str:
    return f"{perform(value._args[0])}/{perform(value._args[1])}"


def _truth(value: Any) -> bool:
    return perform(value).strip().lower() in {"true", "1"}


def _both(test: Callable[[Any, Any], bool]) -> Callable[[Recorded], str]:
    return lambda value: str(test(value._get("left", 0), value._get("right", 1))).lower()


def _first(value: Recorded) -> str:
    given = [*value._args, *value._kwargs.values()]
    return perform(given[0]) if given else ""


_SUBSTITUTIONS: Final[dict[str, Callable[[Recorded], str | None]]] = {
    "TextSubstitution": _first,
    "LaunchConfiguration": _configuration,
    "EnvironmentVariable": _environment,
    "OptionalEnvironmentVariable": _environment,
    "FindPackageShare": lambda value: stand_ins.RECORDING.share(_first(value)),
    "FindPackagePrefix": lambda value: f"{stand_ins.RECORDING.share(_first(value))}/../..",
    "FindPackage": lambda value: f"{stand_ins.RECORDING.share(_first(value))}/../..",
    "PathJoinSubstitution": _join,
    "PathSubstitution": _first,
    "truediv": _slash,
    "add": lambda value: perform(value._args),
    "PythonExpression": _python,
    "ThisLaunchFileDir": lambda value: str(Path(value._place[0]).parent),
    "ThisLaunchFile": lambda value: str(value._place[0]),
    "AnonName": _first,
    "ParameterValue": _first,
    "NotSubstitution": lambda value: str(not _truth(value._args[0])).lower(),
    "AndSubstitution": _both(lambda left, right: _truth(left) and _truth(right)),
    "OrSubstitution": _both(lambda left, right: _truth(left) or _truth(right)),
    "EqualsSubstitution": _both(lambda left, right: perform(left) == perform(right)),
    "NotEqualsSubstitution": _both(lambda left, right: perform(left) != perform(right)),
    "IfElseSubstitution": lambda value: perform(
        value._get("if_value", 1)
        if _truth(value._get("condition", 0))
        else value._get("else_value", 2)
    ),
}


def start() -> None:
    """Let stand-ins of substitutions and conditions answer when a function of the file asks."""
    answers = stand_ins.RECORDING.answers
    answers["perform"] = lambda value, *_: perform(value)
    answers["perform_substitution"] = lambda _, value: perform(value)
    answers["evaluate"] = lambda value, *_: evaluate(value)
    answers["to_path"] = lambda value, *_: Path(perform(value))
