"""What an evaluated script can hold beside Python's own values, and the limits of all of it.

A call of something that is not in the script is a `Construct`: its full name, arguments and place.
What the script does not determine is an `Unknown`: an `ImportNote` with the reason and the place
where it began. Within an expression, `NotKnownError` carries it to where the value is used. Places
are those of findings: lines and columns count from 1, and what spans lines is marked at its
beginning.

A script may be hostile. So every step is counted, texts and containers have a largest size, and a
container counts with everything in it: a list that contains itself twice, sixty times over, is
small in memory only.
"""

from __future__ import annotations

import ast
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from r2bspec.diagnostics import Span
from r2bspec.safe_io.limits import MAX_SCRIPT_ITEMS, MAX_SCRIPT_STEPS, MAX_SCRIPT_TEXT

_ITEMS_OF_A_STEP: Final = 10
_CHARACTERS_OF_A_STEP: Final = 200
_MESSAGE: Final = re.compile(r"\.(?:msg|srv)\.\w+")


class ScriptLimitError(Exception):
    """A script needs more than the limits; the argument says of what."""


class StepCounter:
    """Counts the steps of one import, over all files that it evaluates."""

    def __init__(self) -> None:
        self._steps = 0

    def count(self, steps: int = 1) -> None:
        """Count steps.

        Raises:
            ScriptLimitError: there were too many.
        """
        self._steps += steps
        if self._steps > MAX_SCRIPT_STEPS:
            raise ScriptLimitError(f"more than {MAX_SCRIPT_STEPS:,} steps")

    def count_items(self, *values: Any) -> None:
        """Check the size of values that are put together, at the cost of a step for some items.

        Raises:
            ScriptLimitError: they are too large, or there were too many steps.
        """
        self.count(check_size(*values) // _ITEMS_OF_A_STEP)

    def count_text(self, text: str) -> None:
        """Check the length of a text, at the cost of a step for some characters.

        Raises:
            ScriptLimitError: it is too long, or there were too many steps.
        """
        if len(text) > MAX_SCRIPT_TEXT:
            raise ScriptLimitError(f"a text of more than {MAX_SCRIPT_TEXT:,} characters")
        self.count(len(text) // _CHARACTERS_OF_A_STEP)


def check_size(*values: Any) -> int:
    """The number of items in values, with everything that these contain.

    Raises:
        ScriptLimitError: they have more than the limit.
    """
    waiting, seen = list(values), 0
    while waiting:
        value = waiting.pop()
        seen += 1
        if isinstance(value, list | tuple):
            waiting.extend(value)
        elif isinstance(value, dict):
            waiting.extend(value.values())
        if seen + len(waiting) > 2 * MAX_SCRIPT_ITEMS:
            raise ScriptLimitError(f"more than {2 * MAX_SCRIPT_ITEMS:,} items")
    return seen


@dataclass(frozen=True, slots=True)
class ImportNote:
    """Something in the script that was not followed, and why."""

    reason: str
    place: Span


@dataclass(frozen=True, slots=True)
class Unknown(ImportNote):
    """A value that the script alone does not determine."""


class NotKnownError(Exception):
    """An expression has no known value: a reason that begins here, or the `Unknown` it needs."""

    def __init__(self, reason: str | Unknown) -> None:
        super().__init__(reason)
        self.reason = reason

    def unknown(self, place: Span) -> Unknown:
        """The value of an expression at a place."""
        return self.reason if isinstance(self.reason, Unknown) else Unknown(self.reason, place)


def unknown_in(value: Any) -> Unknown | None:
    """The first unknown part of a value, if there is one."""
    waiting = [value]
    seen = 0
    while waiting and seen < MAX_SCRIPT_ITEMS:
        seen += 1
        part = waiting.pop()
        if isinstance(part, Unknown):
            return part
        if isinstance(part, list | tuple):
            waiting.extend(reversed(part))
        elif isinstance(part, dict):
            waiting.extend(part.values())
    return None


def require_known(*values: Any) -> None:
    """Raises NotKnownError if a part of a value is unknown."""
    missing = unknown_in(values)
    if missing is not None:
        raise NotKnownError(missing)


@dataclass(frozen=True, slots=True)
class Foreign:
    """Something imported that is not in the script: a module, a class or a function."""

    name: str


@dataclass(slots=True, eq=False)
class Construct:
    """A call of something foreign.

    Attributes:
        name: the full name of what is called, such as ``launch_ros.descriptions.ComposableNode``.
        arguments: by position.
        keywords: by name; places of them are in `keyword_places`.
        owner: the object whose method is called.
        condition: why the call is made, where the script tests a condition that is a construct.
    """

    name: str
    arguments: list[Any]
    keywords: dict[str, Any]
    place: Span
    keyword_places: dict[str, Span] = field(default_factory=dict)
    owner: Construct | None = None
    condition: Any = None

    @property
    def short_name(self) -> str:
        """The last part of the name: ``ComposableNode``."""
        return self.name.rpartition(".")[2]

    @property
    def is_message(self) -> bool:
        """Whether it is a message of ROS, or a part of one: its attributes are fields."""
        return _MESSAGE.search(self.name) is not None

    def field_of_message(self, name: str) -> Construct:
        """The field that the script sets parts of; it is added where it is not set yet."""
        part = Construct(f"{self.name}.{name}", [], {}, self.place)
        self.keywords[name] = part
        return part

    def get(self, keyword: str, position: int | None = None, default: Any = None) -> Any:
        """An argument by its name, or by its position."""
        if keyword in self.keywords:
            return self.keywords[keyword]
        if position is not None and position < len(self.arguments):
            return self.arguments[position]
        return default

    def place_of(self, keyword: str) -> Span:
        """The place of a keyword argument; that of the call without it."""
        return self.keyword_places.get(keyword, self.place)


@dataclass(frozen=True, slots=True)
class Method:
    """A method of a construct, of a text, list or map, or one that a class inherits from outside.

    Attributes:
        owner: a `Construct`, a plain value, or a `ScriptClass` whose foreign base has the method.
    """

    owner: Any
    name: str


class NamedNumber(int):
    """A width or a height of a named resolution; `variable` is its name in a spec."""

    variable: str = ""


class LaunchText(str):
    """The value of a launch argument: as a parameter it is read as YAML, so that "10" is 10."""


class CopiedEnvironment(dict[Any, Any]):
    """A copy of ``os.environ``, of which only what the script adds is known by its value."""


class PlacedTuple(tuple[Any, ...]):
    """A tuple that is written in the script, with its place."""

    place: Span


class PlacedDict(dict[Any, Any]):
    """A map that is written in the script, with the places of its values by key."""

    places: dict[Any, Span]


@dataclass(frozen=True, slots=True)
class ImageSize:
    """A `Resolution` of ros2_benchmark: width and height in pixels."""

    width: int
    height: int
    label: str = ""
    name: str = ""

    def item(self, key: str) -> Any:
        """What ``resolution[key]`` is; raises KeyError."""
        if key == "name":
            return self.label
        value = NamedNumber({"width": self.width, "height": self.height}[key])
        value.variable = f"{self.name}_{key}".lower() if self.name else ""
        return value if self.name else int(value)


@dataclass(slots=True, eq=False)
class Scope:
    """The names of a module or a function call."""

    module: ScriptModule
    names: dict[str, Any]
    above: Scope | None = None

    def find(self, name: str, default: Any) -> Any:
        """The value of a name; `default` where it has none."""
        scope: Scope | None = self
        while scope is not None:
            if name in scope.names:
                return scope.names[name]
            scope = scope.above
        return default

    def place(self, node: ast.AST, last: ast.AST | None = None) -> Span:
        """The place of a part of the syntax tree, or from its beginning to the end of another."""
        line: int = getattr(node, "lineno", 1)
        column: int = getattr(node, "col_offset", 0) + 1
        last = last or node
        is_one_line = getattr(last, "end_lineno", None) == line
        end: int = getattr(last, "end_col_offset", 0) if is_one_line else 0
        return Span(str(self.module.file), line, column, line, max(end, column + 1))


@dataclass(slots=True, eq=False)
class ScriptModule:
    """A Python file that was read.

    Attributes:
        text: its text, for findings.
        tree: its syntax tree.
    """

    file: Path
    text: str
    tree: ast.Module
    scope: Scope = field(init=False)

    def __post_init__(self) -> None:
        self.scope = Scope(self, {"__file__": "$(script)/" + self.file.name, "__name__": "script"})


@dataclass(slots=True, eq=False)
class ScriptFunction:
    """A function of a script, with the scope that it was defined in."""

    node: ast.FunctionDef | ast.Lambda
    scope: Scope
    kind: str = "function"


@dataclass(slots=True, eq=False)
class ScriptClass:
    """A class of a script."""

    node: ast.ClassDef
    bases: list[Any]
    names: dict[str, Any]

    def lineage(self) -> list[Any]:
        """The class and its bases over all levels, each once, in the order of their look-up."""
        seen: dict[int, Any] = {}
        waiting: list[Any] = [self]
        while waiting:
            kind = waiting.pop()
            if id(kind) not in seen:
                seen[id(kind)] = kind
                waiting += reversed(kind.bases) if isinstance(kind, ScriptClass) else []
        return list(seen.values())

    def foreign_bases(self) -> list[str]:
        """The full names of its bases outside of the script, over all levels."""
        return [base.name for base in self.lineage() if isinstance(base, Foreign)]

    def find(self, name: str, default: Any = None) -> Any:
        """An attribute of the class or its bases in the script; `default` where none has it."""
        for kind in self.lineage():
            if isinstance(kind, ScriptClass) and name in kind.names:
                return kind.names[name]
        return default


@dataclass(slots=True, eq=False)
class ScriptObject:
    """An object of a class of a script."""

    kind: ScriptClass
    names: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class BoundFunction:
    """A function with the object or class that it is called on."""

    function: ScriptFunction
    owner: Any
