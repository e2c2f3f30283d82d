"""The values that the evaluator of scripts knows, in addition to Python's own.

A call of something that is not in the script becomes a `Construct`: its full name, arguments and
place. What has no known value is an `Unknown`, with the reason and the place where it began.
"""

from __future__ import annotations

import ast
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

_MESSAGE = re.compile(r"\.(?:msg|srv)\.\w+")


@dataclass(frozen=True, slots=True)
class Place:
    """A place in a Python file; line and column count from 1."""

    file: Path
    line: int
    column: int = 1
    end_line: int = 0
    end_column: int = 0

    @classmethod
    def of(cls, file: Path, node: ast.AST) -> Place:
        """The place of a part of a syntax tree."""
        line = getattr(node, "lineno", 1)
        column = getattr(node, "col_offset", 0) + 1
        end_line = getattr(node, "end_lineno", None) or line
        end_column = (getattr(node, "end_col_offset", None) or column) + 1
        return cls(file, line, column, end_line, end_column)


@dataclass(frozen=True, slots=True)
class Unknown:
    """A value that the script alone does not determine."""

    reason: str
    place: Place


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
    place: Place
    keyword_places: dict[str, Place] = field(default_factory=dict)
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
        made = Construct(f"{self.name}.{name}", [], {}, self.place)
        self.keywords[name] = made
        return made

    def get(self, keyword: str, position: int | None = None, default: Any = None) -> Any:
        """An argument by its name, or by its position."""
        if keyword in self.keywords:
            return self.keywords[keyword]
        if position is not None and position < len(self.arguments):
            return self.arguments[position]
        return default

    def place_of(self, keyword: str) -> Place:
        """The place of a keyword argument; that of the call without it."""
        return self.keyword_places.get(keyword, self.place)


@dataclass(frozen=True, slots=True)
class ConstructMethod:
    """An attribute of a construct, such as ``.items`` or ``.generate``."""

    owner: Construct
    name: str


class NamedNumber(int):
    """A width or a height of a named resolution; `variable` is its name in a spec."""

    variable: str = ""

    @classmethod
    def of(cls, value: int, variable: str) -> NamedNumber:
        """The number with its name."""
        made = cls(value)
        made.variable = variable
        return made


class LaunchText(str):
    """The value of a launch argument: as a parameter it is read as YAML, so that "10" is 10."""


class PlacedTuple(tuple[Any, ...]):
    """A tuple that is written in the script, with its place."""

    place: Place

    @classmethod
    def of(cls, values: list[Any], place: Place) -> PlacedTuple:
        """The tuple with its place."""
        made = cls(values)
        made.place = place
        return made


class PlacedDict(dict[Any, Any]):
    """A map that is written in the script, with the places of its values by key."""

    places: dict[Any, Place]


@dataclass(frozen=True, slots=True)
class ImageSize:
    """A `Resolution` of ros2_benchmark: width and height in pixels."""

    width: int
    height: int
    label: str = ""
    name: str = ""

    def item(self, key: str) -> Any:
        """What ``resolution[key]`` is."""
        if key == "name":
            return self.label
        value = {"width": self.width, "height": self.height}[key]
        return NamedNumber.of(value, f"{self.name}_{key}".lower()) if self.name else value


@dataclass(slots=True, eq=False)
class Scope:
    """The names of a module or a function call."""

    module: ScriptModule
    names: dict[str, Any]
    above: Scope | None = None

    def find(self, name: str) -> Any:
        """The value of a name; raises KeyError."""
        scope: Scope | None = self
        while scope is not None:
            if name in scope.names:
                return scope.names[name]
            scope = scope.above
        raise KeyError(name)


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
    owner: ScriptClass | None = None
    kind: str = "function"


@dataclass(slots=True, eq=False)
class ScriptClass:
    """A class of a script."""

    node: ast.ClassDef
    bases: list[Any]
    names: dict[str, Any]

    def foreign_bases(self) -> list[str]:
        """The full names of its bases outside of the script, over all levels."""
        found: list[str] = []
        for base in self.bases:
            if isinstance(base, Foreign):
                found.append(base.name)
            elif isinstance(base, ScriptClass):
                found += base.foreign_bases()
        return found

    def find(self, name: str) -> Any:
        """An attribute of the class or its bases in the script; raises KeyError."""
        if name in self.names:
            return self.names[name]
        for base in self.bases:
            if isinstance(base, ScriptClass):
                try:
                    return base.find(name)
                except KeyError:
                    continue
        raise KeyError(name)


@dataclass(slots=True, eq=False)
class Instance:
    """An object of a class of a script."""

    kind: ScriptClass
    names: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class BoundFunction:
    """A function with the object or class that it is called on."""

    function: ScriptFunction
    owner: Any


@dataclass(frozen=True, slots=True)
class ForeignMethod:
    """A method of a class of the script that only its foreign base has."""

    owner: ScriptClass
    name: str


@dataclass(frozen=True, slots=True)
class PlainMethod:
    """A method of a text, list or map."""

    owner: Any
    name: str


def unknown_in(value: Any) -> Unknown | None:
    """The first unknown part of a value, if there is one."""
    waiting = [value]
    seen = 0
    while waiting and seen < 10_000:
        seen += 1
        each = waiting.pop()
        if isinstance(each, Unknown):
            return each
        if isinstance(each, list | tuple):
            waiting.extend(reversed(each))
        elif isinstance(each, dict):
            waiting.extend(each.values())
    return None
