"""A launch file in Python as a list of actions, with the values of its launch arguments.

The file is evaluated until its launch arguments have the values that it declares for them itself:
the first time finds the defaults, the next ones use them. Functions that are called at launch
(``OpaqueFunction``) are functions of the file, and are evaluated like it; what they need of the
machine is not known, and so is what they make of that.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from r2bspec.diagnostics import Span
from r2bspec.diagnostics.quote import clip
from r2bspec.interop.script_import import source_files
from r2bspec.interop.script_import.evaluator import Evaluator
from r2bspec.interop.script_import.launch_nodes import listed
from r2bspec.interop.script_import.launch_texts import condition_value, performed
from r2bspec.interop.script_import.values import (
    Construct,
    ImportNote,
    NotKnownError,
    ScriptFunction,
    Unknown,
)
from r2bspec.safe_io.limits import MAX_LAUNCH_LEVELS

LAUNCH_CONTEXT: Final = "launch.LaunchContext"
_HARMLESS: Final = (
    *("sys.path.", "argparse.", "logging.", "warnings.", "launch.logging.", "rclpy.logging."),
    "super",
)
"""What a file may call for an effect that does not reach what it launches."""
_ROUNDS: Final = 4
_INSIDE: Final = {
    "GroupAction": "actions",
    "LaunchDescription": "initial_entities",
    "TimerAction": "actions",
}


@dataclass(frozen=True, slots=True)
class LaunchArgument:
    """An argument that a launch file declares.

    Attributes:
        default: None if it has none, or none that is known.
        choices: the values that it can have; empty for any.
    """

    name: str
    default: str | None
    choices: tuple[str, ...]
    place: Span


@dataclass(slots=True)
class LaunchFile:
    """What a launch file does.

    Attributes:
        actions: its actions, in order.
        notes: what was not followed.
        values: the values of launch arguments, by name, where they are known.
        arguments: those that it declares.
    """

    actions: list[Any] = field(default_factory=list)
    notes: list[ImportNote] = field(default_factory=list)
    values: dict[str, Any] = field(default_factory=dict)
    arguments: list[LaunchArgument] = field(default_factory=list)

    def has(self, kind: str) -> bool:
        """Whether an action of a kind is one of its actions, or what a function of it returns."""
        waiting, level = self.actions, 0
        while waiting and level < MAX_LAUNCH_LEVELS:
            constructs = [action for action in waiting if isinstance(action, Construct)]
            if any(action.short_name == kind for action in constructs):
                return True
            called = [action for action in constructs if action.short_name == "OpaqueFunction"]
            waiting = [each for action in called for each in listed(action.get("actions"))]
            level += 1
        return False

    def declare(self, argument: LaunchArgument) -> None:
        """Note an argument; it has its default where it has no value yet."""
        self.arguments.append(argument)
        name, choices = argument.name, argument.choices
        if argument.default is not None:
            self.values.setdefault(name, argument.default)
        value = self.values.get(name)
        if choices and isinstance(value, str) and value not in choices:
            shown = ", ".join(choices)
            reason = f"{clip(value)!r} is no choice of the launch argument {name!r}: {shown}"
            self.notes.append(ImportNote(reason, argument.place))


def python_launch_file(
    reader: source_files.ScriptReader, file: Path, given: Mapping[str, Any]
) -> LaunchFile:
    """What a launch file in Python does, with the launch arguments given and its defaults.

    Raises:
        UnusableScriptError: it cannot be read.
        ScriptLimitError: it exceeds the limits.
    """
    values = dict(given)
    for _ in range(_ROUNDS):
        launch = _Evaluation(reader, file, values).launch_file(given)
        if launch.values == values:
            break
        values = launch.values
    return launch


class _Evaluation:
    """One evaluation of a file with values of its launch arguments."""

    def __init__(
        self, reader: source_files.ScriptReader, file: Path, values: Mapping[str, Any]
    ) -> None:
        self.module = reader.read(file)
        self.steps = reader.steps
        self.evaluator = Evaluator(reader, values)
        self.launch = LaunchFile()

    def launch_file(self, given: Mapping[str, Any]) -> LaunchFile:
        self.evaluator.run_module(self.module)
        function = self.module.scope.names.get("generate_launch_description")
        if function is None:
            message = "the file has no generate_launch_description, so it is no launch file"
            advice = "give the launch file that starts what this file has"
            raise source_files.unusable(message, self.module, 1, advice=advice)
        if not isinstance(function, ScriptFunction):
            reason = "its generate_launch_description is no function of the file"
            self.launch.notes.append(ImportNote(reason, self.module.scope.place(self.module.tree)))
            return self.launch
        place = self.module.scope.place(function.node)
        made = self.evaluator.call(function, place=place)
        is_description = isinstance(made, Construct) and made.short_name == "LaunchDescription"
        self.launch.actions = listed(made.get("initial_entities", 0) if is_description else made)
        self.launch.values = dict(given)
        self._follow(self.launch.actions, 0)
        self.launch.notes += self.evaluator.notes
        for effect in self.evaluator.effects:
            if not effect.name.startswith(_HARMLESS):
                reason = f"what {clip(effect.name)} does before the launch"
                self.launch.notes.append(ImportNote(reason, effect.place))
        return self.launch

    def _follow(self, actions: list[Any], level: int) -> None:
        """Find what declares and sets launch arguments, and call functions, in order."""
        for action in actions if level < MAX_LAUNCH_LEVELS else ():
            self.steps.count()
            if isinstance(action, list | tuple):
                self._follow(list(action), level + 1)
            if not isinstance(action, Construct):
                continue
            if condition_value(action.get("condition"), self.steps) is False:
                continue
            match action.short_name:
                case "DeclareLaunchArgument":
                    self._declare(action)
                case "SetLaunchConfiguration":
                    self._set(action)
                case "OpaqueFunction":
                    action.keywords["actions"] = listed(self._called(action))
                    self._follow(action.keywords["actions"], level + 1)
                case kind if kind in _INSIDE:
                    self._follow(listed(action.get(_INSIDE[kind], 0)), level + 1)

    def _declare(self, action: Construct) -> None:
        name = performed(action.get("name", 0), action, self.steps)
        default = action.get("default_value")
        text = performed(default, action, self.steps) if default is not None else None
        choices = action.get("choices", default=None)
        known = tuple(str(each) for each in listed(choices) if isinstance(each, str))
        if isinstance(name, str):
            shown = str(text) if isinstance(text, str) else None
            self.launch.declare(LaunchArgument(name, shown, known, action.place))
            if isinstance(text, Unknown):
                self.launch.values.setdefault(name, text)

    def _set(self, action: Construct) -> None:
        name = performed(action.get("name", 0), action, self.steps)
        value = performed(action.get("value", 1), action, self.steps)
        is_certain = condition_value(action.get("condition"), self.steps)
        before = self.launch.values.get(str(name))
        if not isinstance(name, str) or not isinstance(value, str) or not is_certain:
            reason = "a launch argument that is set to something that is not known"
            self.launch.notes.append(ImportNote(reason, action.place))
        elif before is not None and before != value:
            reason = f"the launch argument {name!r} has another value before this action"
            self.launch.notes.append(ImportNote(reason, action.place))
        else:
            self.launch.values[name] = str(value)

    def _called(self, action: Construct) -> Any:
        """What a function returns that is called at launch."""
        function = action.get("function", 0)
        arguments = listed(action.get("args"))
        keywords = action.get("kwargs", default=None)
        keywords = keywords if keywords is not None else {}
        if not isinstance(function, ScriptFunction) or not isinstance(keywords, dict):
            return Unknown("what this function makes is not known", action.place)
        values = dict(self.launch.values)
        context = Construct(LAUNCH_CONTEXT, [], {"launch_configurations": values}, action.place)
        if function.node.args.args:
            arguments = [context, *arguments]
        try:
            made = self.evaluator.call_value(function, arguments, keywords, action.place)
        except NotKnownError as error:
            return error.unknown(action.place)
        self.launch.values |= {
            name: value for name, value in values.items() if isinstance(value, str)
        }
        return made
