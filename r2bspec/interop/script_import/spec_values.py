"""Values of a script as values of a spec, and everything on the way that the spec must say.

A reference to what the machine decides becomes a variable or an environment variable of the spec.
What has no form in a spec is left out with a note, and what the spec says in another way is noted
as a change. Both become findings, and the notes comments of the spec.
"""

from __future__ import annotations

import math
import os
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from r2bspec.diagnostics import Span
from r2bspec.interop.script_import.source_files import ScriptComments
from r2bspec.interop.script_import.values import (
    Construct,
    ImageSize,
    LaunchText,
    NamedNumber,
    Note,
    NotKnownError,
    ScriptLimitError,
    Unknown,
    check_size,
)
from r2bspec.interop.script_import.yaml_writer import identifier
from r2bspec.language.yaml_document import ScalarError, resolve

_REFERENCE: Final = re.compile(r"\$\((?P<kind>assets|script|env|share) ?(?P<name>[^()]*)\)")


@dataclass(slots=True)
class SpecValues:
    """Converts values, and collects what they need.

    Attributes:
        script_folder: the folder of the script, relative to that of the spec.
        namespace: of the benchmark, absolute.
        comments: those of the script.
        variables: name to value, in the order of first use.
        environment: environment variables that are read.
        notes: what has no form in the spec.
        changes: what the spec says in another way.
    """

    script_folder: str
    namespace: str
    comments: ScriptComments
    variables: dict[str, Any] = field(default_factory=dict)
    environment: list[str] = field(default_factory=list)
    notes: list[Note] = field(default_factory=list)
    changes: list[Note] = field(default_factory=list)

    def lose(self, reason: str, place: Span) -> None:
        """Note something that has no form in the spec."""
        self.notes.append(Note(reason, place))

    def change(self, what: str, place: Span) -> None:
        """Note something that the spec says in another way."""
        self.changes.append(Note(what, place))

    def convert(self, value: Any, place: Span) -> Any:
        """A value of a spec.

        Raises:
            NotKnownError: it has none; the reason is an `Unknown` with the place.
        """
        try:
            check_size(value)
            return self._converted(value)
        except ScriptLimitError as error:
            raise NotKnownError(Unknown(f"the value has {error}", place)) from error
        except NotKnownError as error:
            raise NotKnownError(error.unknown(place)) from error

    def _converted(self, value: Any) -> Any:
        if isinstance(value, Unknown):
            raise NotKnownError(value)
        if isinstance(value, NamedNumber):
            self.variables.setdefault(value.variable, int(value))
            return f"$(var {value.variable})"
        if isinstance(value, str):
            plain = _read_as_yaml(value) if isinstance(value, LaunchText) else value
            return self.text(plain) if isinstance(plain, str) else plain
        if isinstance(value, bool | int | float) and math.isfinite(value):
            return value
        if isinstance(value, list | tuple):
            return [self._converted(item) for item in value]
        if isinstance(value, dict):
            return {str(key): self._converted(item) for key, item in value.items()}
        if isinstance(value, ImageSize):
            return f"{value.width}x{value.height}"
        what = value.short_name if isinstance(value, Construct) else type(value).__name__
        raise NotKnownError(f"{'None' if value is None else what} is not a value of a spec")

    def text(self, value: str) -> str:
        """A text with its references as variables of the spec."""
        return _REFERENCE.sub(self._reference, value)

    def _reference(self, match: re.Match[str]) -> str:
        kind, name = match["kind"], match["name"].strip()
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
