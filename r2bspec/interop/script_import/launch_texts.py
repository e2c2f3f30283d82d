"""Texts, conditions and parameters that launch makes of substitutions, before it starts anything.

A text may be written in parts, some of which are substitutions: launch performs them and joins all.
A parameter whose value has a substitution in it is read as YAML after that, so ``"10"`` becomes a
number; plain values of Python keep their type. What only the machine decides, such as the output of
a command, is unknown, with a reason.
"""

from __future__ import annotations

from typing import Any, Final

import yaml

from r2bspec.diagnostics.quote import clip
from r2bspec.interop.script_import.substitutions import OPERATIONS, operation_text, truth_of_text
from r2bspec.interop.script_import.values import (
    Construct,
    Foreign,
    LaunchText,
    PlacedDict,
    StepCounter,
    Unknown,
)
from r2bspec.safe_io.limits import MAX_SUBSTITUTION_DEPTH
from r2bspec.safe_io.safe_yaml import load_values

_REASONS: Final = {
    "Command": "the output of a command is not known before it runs",
    "FileContent": "the content of a file is not known before it is read",
    "AnonName": "the name is made up when the file is launched",
    "RewrittenYaml": "the parameter file is written when the file is launched",
    "ReplaceString": "the parameter file is written when the file is launched",
}
_TYPES: Final = {"builtins.str", "builtins.int", "builtins.float", "builtins.bool"}


def performed(value: Any, source: Construct, steps: StepCounter, depth: int = 0) -> Any:
    """The text of a value that may have substitutions in it, or why it is unknown.

    Args:
        value: a text, a substitution, or a list of both.
        source: the action that it is an argument of; its place is that of an unknown.
        steps: counts the steps.
        depth: how many substitutions this one is inside of.
    """
    steps.count()
    if isinstance(value, str | Unknown):
        return value
    if isinstance(value, bool | int | float):
        return str(value)
    if depth > MAX_SUBSTITUTION_DEPTH:
        return Unknown("its substitutions are nested too deeply", source.place)
    if isinstance(value, list | tuple):
        texts = [performed(part, source, steps, depth + 1) for part in value]
        lost = next((text for text in texts if isinstance(text, Unknown)), None)
        if lost is not None:
            return lost
        joined = "".join(texts)
        steps.count_text(joined)
        is_performed = any(
            isinstance(text, LaunchText) and not isinstance(part, list | tuple)
            for text, part in zip(texts, value, strict=True)
        )
        return LaunchText(joined) if is_performed else joined
    if isinstance(value, Construct):
        return _substitution(value, source, steps, depth)
    reason = "it is None" if value is None else "it is no text"
    return Unknown(reason, source.place)


def _substitution(value: Construct, source: Construct, steps: StepCounter, depth: int) -> Any:
    kind = value.short_name
    if kind == "LaunchConfiguration":
        name = value.get("variable_name", 0)
        shown = clip(name) if isinstance(name, str) else "of another name"
        return Unknown(f"the launch argument {shown!r} has no value", value.place)
    if kind in {"ParameterFile", "Parameter"}:
        return Unknown(f"{kind} is no text", value.place)
    if kind == "IfElseSubstitution":
        names = ("condition", "if_value", "else_value")
        operands = [value.get(name, number, "") for number, name in enumerate(names)]
    else:
        operands = [*value.arguments, *value.keywords.values()]
    inner = []
    for operand in operands:
        text = performed(operand, source, steps, depth + 1)
        if isinstance(text, Unknown):
            return text if kind not in _REASONS else Unknown(_REASONS[kind], value.place)
        inner.append(text)
    made = operation_text(OPERATIONS.get(kind, ""), inner, steps)
    if made is None:
        return Unknown(_REASONS.get(kind, f"what {clip(kind)} gives is not known"), value.place)
    return LaunchText(made)


def condition_value(condition: Any, steps: StepCounter) -> bool | None:
    """Whether the condition of an action is met; None if that is not known."""
    if condition is None or isinstance(condition, bool):
        return condition is not False
    if not isinstance(condition, Construct):
        return None
    decided = truth_of_text(performed(condition.get("predicate_expression", 0), condition, steps))
    if decided is None or condition.short_name not in {"IfCondition", "UnlessCondition"}:
        return None
    return decided is (condition.short_name == "IfCondition")


def parameter_value(value: Any, source: Construct, steps: StepCounter) -> Any:
    """The value of a parameter, as launch passes it to a node; unknown parts stay in it."""
    steps.count()
    if isinstance(value, dict):
        known = {key: parameter_value(each, source, steps) for key, each in value.items()}
        if isinstance(value, PlacedDict):
            placed = PlacedDict(known)
            placed.places = value.places
            return placed
        return known
    if isinstance(value, Construct):
        if value.short_name == "ParameterValue":
            return _typed(value, source, steps)
        return _read(performed(value, source, steps))
    if isinstance(value, LaunchText):
        return _read(value)
    if isinstance(value, list | tuple):
        if any(isinstance(part, list | tuple) for part in value):
            return [_read(_forced(performed(part, source, steps))) for part in value]
        if any(isinstance(part, LaunchText | Construct) for part in value):
            return _read(performed(value, source, steps))
        kinds = {type(part) for part in value}
        return [float(part) for part in value] if kinds == {int, float} else value
    return value


def _typed(value: Construct, source: Construct, steps: StepCounter) -> Any:
    """``ParameterValue(value, value_type=...)``."""
    given, kind = value.get("value", 0), value.get("value_type")
    text = performed(given, source, steps)
    if isinstance(text, Unknown) or kind is None:
        return text if isinstance(text, Unknown) else parameter_value(given, source, steps)
    if isinstance(kind, Foreign) and kind.name == "builtins.str":
        return str(text)
    read = _read(_forced(text))
    if isinstance(kind, Foreign) and kind.name in _TYPES and not isinstance(read, list):
        is_whole = isinstance(read, int) and not isinstance(read, bool)
        return float(read) if kind.name == "builtins.float" and is_whole else read
    return read


def _forced(text: Any) -> Any:
    return LaunchText(text) if isinstance(text, str) else text


def _read(text: Any) -> Any:
    """A performed text as YAML reads it; the text itself where that makes no parameter."""
    if not isinstance(text, LaunchText):
        return text
    if not text or "$(" in text:
        return str(text)
    try:
        value = load_values(str(text))
    except yaml.YAMLError:
        return str(text)
    is_list = isinstance(value, list) and bool(value)
    is_plain = isinstance(value, bool | int | float | str)
    is_list = is_list and all(isinstance(part, bool | int | float | str) for part in value)
    return value if is_plain or is_list else str(text)
