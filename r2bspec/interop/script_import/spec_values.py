"""Values of a script as values of a spec, and the variables that they need."""

from __future__ import annotations

import math
import os
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from r2bspec.interop.script_import.evaluator import Note
from r2bspec.interop.script_import.plain_calls import check_size
from r2bspec.interop.script_import.script_limits import ScriptLimitError
from r2bspec.interop.script_import.script_values import (
    Construct,
    ImageSize,
    LaunchText,
    NamedNumber,
    Place,
    Unknown,
)
from r2bspec.language.yaml_scalars import ScalarError, resolve

_REFERENCE = re.compile(r"\$\((?P<kind>assets|script|env|share) ?(?P<name>[^()]*)\)")
_NAME = re.compile(r"[^A-Za-z0-9_]+")


class NoValueError(Exception):
    """A value of a script that has no form in a spec; the argument is a `Note`."""

    def __init__(self, note: Note) -> None:
        super().__init__(note.message)
        self.note = note


@dataclass(slots=True)
class SpecValues:
    """Converts values, and collects the variables that they refer to.

    Attributes:
        script_folder: the folder of the script, relative to that of the spec.
        sizes: the named resolutions of the script.
        variables: name to value, in the order of first use.
        environment: environment variables that are read.
    """

    script_folder: str
    sizes: dict[str, ImageSize]
    variables: dict[str, Any] = field(default_factory=dict)
    environment: list[str] = field(default_factory=list)

    def convert(self, value: Any, place: Place) -> Any:
        """A value of a spec.

        Raises:
            NoValueError: it has none.
        """
        try:
            check_size(value)
        except ScriptLimitError as error:
            raise NoValueError(Note(f"the value has {error}", place)) from error
        return self._converted(value, place)

    def _converted(self, value: Any, place: Place) -> Any:
        if isinstance(value, Unknown):
            raise NoValueError(Note(value.reason, value.place))
        if isinstance(value, NamedNumber):
            self.variables.setdefault(value.variable, int(value))
            return f"$(var {value.variable})"
        if isinstance(value, str):
            plain = _read_as_yaml(value) if isinstance(value, LaunchText) else value
            return self.text(plain) if isinstance(plain, str) else plain
        if isinstance(value, bool | int | float) and math.isfinite(value):
            return value
        if isinstance(value, list | tuple):
            return [self._converted(each, place) for each in value]
        if isinstance(value, dict):
            return {str(key): self._converted(each, place) for key, each in value.items()}
        if isinstance(value, ImageSize):
            return f"{value.width}x{value.height}"
        what = value.short_name if isinstance(value, Construct) else type(value).__name__
        if value is None:
            what = "None"
        raise NoValueError(Note(f"{what} is not a value of a spec", place))

    def text(self, value: str) -> str:
        """A text with its references as variables of the spec."""
        return _REFERENCE.sub(self._reference, value)

    def _reference(self, found: re.Match[str]) -> str:
        kind, name = found["kind"], found["name"].strip()
        if kind == "env":
            if name not in self.environment:
                self.environment.append(name)
            return f"$(env {name})"
        if kind == "assets":
            variable, value = "assets_root", "./assets"
        elif kind == "script":
            variable, value = "script_folder", self.script_folder
        else:
            variable, value = f"share_{identifier(name)}", f"/opt/ros/jazzy/share/{name}"
        self.variables.setdefault(variable, value)
        return f"$(var {variable})"


def _read_as_yaml(text: str) -> Any:
    """A scalar as YAML reads it; the text itself for anything else."""
    try:
        value = resolve(text)
    except ScalarError:
        return str(text)
    return value if isinstance(value, bool | int | float) else str(text)


def relative_folder(folder: Path, start: Path) -> str:
    """A folder as a path relative to another one, beginning with a dot."""
    relative = os.path.relpath(folder.absolute(), start.absolute())
    return relative if relative.startswith(".") else f"./{relative}"


def identifier(text: str) -> str:
    """A name of letters, digits and underscores."""
    name = _NAME.sub("_", text).strip("_") or "unnamed"
    return f"n_{name}" if name[0].isdigit() else name


def unique_name(wanted: str, used: set[str]) -> str:
    """A name that is not used yet; it is added to `used`."""
    name, number = wanted, 2
    while name in used:
        name, number = f"{wanted}_{number}", number + 1
    used.add(name)
    return name
