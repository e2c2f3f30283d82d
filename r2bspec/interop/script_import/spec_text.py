"""Values of a script as values of a spec, and the text of the spec, in the style of a person.

A reference to what the machine decides becomes a variable or an environment variable of the spec.
What has no form in a spec is left out with a note, and what the spec says in another way is noted
as a change. Both become findings, and the notes comments of the spec.

A `Block` is a map with one key per line; other maps and lists are on one line where they fit. Names
of others become keys with `identifier` and `unique_name`.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from r2bspec.diagnostics import Span
from r2bspec.interop.script_import.source_files import ScriptComments
from r2bspec.interop.script_import.values import (
    Construct,
    ImageSize,
    ImportNote,
    LaunchText,
    NamedNumber,
    NotKnownError,
    ScriptLimitError,
    Unknown,
    check_size,
)
from r2bspec.language.yaml_document import ScalarError, resolve, to_yaml

_WIDTH = 96
_NO_NAME = re.compile(r"[^A-Za-z0-9_]+")
_PLAIN_IN_FLOW = re.compile(r"[A-Za-z0-9_./$(~-][A-Za-z0-9_./$() %<>=~-]*$")
_CONTROL = re.compile(r"[\x00-\x1f\x7f-\x9f\u2028\u2029\ufeff\ud800-\udfff]")


@dataclass(slots=True)
class TextEntry:
    """A key with its value and comments."""

    key: str
    value: Any
    above: tuple[str, ...] = ()
    after: str = ""


@dataclass(slots=True)
class Block:
    """A map that is written one key per line."""

    entries: list[TextEntry] = field(default_factory=list)
    below: list[str] = field(default_factory=list)

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> Block:
        """A map with these keys."""
        block = cls()
        block.add_all(values)
        return block

    def add_all(self, values: Mapping[str, Any]) -> None:
        """Add keys without comments."""
        for key, value in values.items():
            self.add(key, value)

    def add(self, key: str, value: Any, above: Iterable[str] = (), after: str = "") -> None:
        """Add a key; empty values are left out."""
        is_empty = isinstance(value, list | dict) and not value
        if value is None or is_empty or (isinstance(value, Block) and not value):
            return
        self.entries.append(TextEntry(key, value, tuple(above), after))

    def __bool__(self) -> bool:
        return bool(self.entries or self.below)


def document(block: Block, header: Iterable[str]) -> str:
    """A document: a comment at its head, and the top-level keys with an empty line between them."""
    lines = [*comment_lines(header, ""), ""]
    for number, entry in enumerate(block.entries):
        nested = isinstance(entry.value, Block) or bool(entry.above)
        if number and (nested or isinstance(block.entries[number - 1].value, Block)):
            lines.append("")
        lines += _entry(entry, "")
    if block.below:
        lines += ["", *comment_lines(block.below, "")]
    return "\n".join(lines).strip("\n") + "\n"


def comment_lines(texts: Iterable[str], indent: str) -> list[str]:
    """Comments as lines of YAML; a text of several lines keeps them."""
    return [
        f"{indent}# {_CONTROL.sub('?', line)}".rstrip()
        for text in texts
        for line in text.split("\n")
    ]


def flow(value: Any) -> str:
    """A value on one line."""
    if isinstance(value, dict):
        inside = ", ".join(f"{flow(key)}: {flow(item)}" for key, item in value.items())
        return f"{{{inside}}}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(flow, value))}]"
    if isinstance(value, str):
        return scalar(value) if _PLAIN_IN_FLOW.match(value) else _quoted(value)
    return scalar(value)


def scalar(value: Any) -> str:
    """A scalar on one line, quoted where YAML needs it."""
    if isinstance(value, str):
        lines = to_yaml([str(value)]).removeprefix("- ").splitlines()
        is_plain = len(lines) == 1 and value == value.strip() and not _CONTROL.search(value)
        return lines[0] if is_plain else _quoted(value)
    is_integer = isinstance(value, int) and not isinstance(value, bool)
    return to_yaml(int(value) if is_integer else value).split("\n")[0]


def _quoted(text: str) -> str:
    shown = text.replace("\\", "\\\\").replace('"', '\\"')
    escaped = _CONTROL.sub(lambda found: "\\u" + format(ord(found[0]), "04x"), shown)
    return f'"{escaped}"'


def _entry(entry: TextEntry, indent: str) -> list[str]:
    above = list(entry.above)
    after = f" # {_CONTROL.sub('?', entry.after)}" if entry.after else ""
    if after and not isinstance(entry.value, Block):
        length = len(f"{indent}{scalar(entry.key)}: {flow(entry.value)}{after}")
        if length > _WIDTH:
            above.append(entry.after)
            after = ""
    lines = comment_lines(above, indent)
    head = f"{indent}{scalar(entry.key)}:"
    value = entry.value
    if isinstance(value, Block):
        inner = [line for nested in value.entries for line in _entry(nested, indent + "  ")]
        below = comment_lines(value.below, indent + "  ")
        if not value.entries:
            return [
                *lines,
                *(f"{indent}# {entry.key}: {line[len(indent) + 4 :]}" for line in below),
            ]
        return [*lines, head + after, *below, *inner]
    if isinstance(value, dict | list | tuple):
        text = "" if _has_block(value) else f"{head} {flow(value)}"
        if text and len(text) <= _WIDTH:
            return [*lines, text + after]
        return [*lines, head + after, *_long(value, indent + "  ")]
    return [*lines, f"{head} {scalar(value)}{after}"]


def _has_block(value: Any) -> bool:
    return not isinstance(value, dict) and any(isinstance(item, Block) for item in value)


def _long(value: Any, indent: str) -> list[str]:
    if isinstance(value, dict):
        return [
            line for key, nested in value.items() for line in _entry(TextEntry(key, nested), indent)
        ]
    lines = []
    for item in value:
        if isinstance(item, Block):
            inner = [line for entry in item.entries for line in _entry(entry, indent + "  ")]
            inner = inner or [f"{indent}  {{}}"]
            lines.append(f"{indent}- {inner[0].strip()}")
            lines += inner[1:]
        elif isinstance(item, dict | list | tuple):
            lines.append(f"{indent}- {flow(item)}")
        else:
            lines.append(f"{indent}- {scalar(item)}")
    return lines


def identifier(text: str) -> str:
    """A name of letters, digits and underscores."""
    name = _NO_NAME.sub("_", text).strip("_") or "unnamed"
    return f"n_{name}" if name[0].isdigit() else name


def unique_name(name: str, used: set[str]) -> str:
    """A name that is not used yet; it is added to `used`."""
    unique, number = name, 2
    while unique in used:
        unique, number = f"{name}_{number}", number + 1
    used.add(unique)
    return unique


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
        share_folder: the share folder of a package, as the spec writes it.
    """

    script_folder: str
    namespace: str
    comments: ScriptComments
    variables: dict[str, Any] = field(default_factory=dict)
    environment: list[str] = field(default_factory=list)
    notes: list[ImportNote] = field(default_factory=list)
    changes: list[ImportNote] = field(default_factory=list)
    share_folder: Callable[[str], str] = "/opt/ros/jazzy/share/{}".format

    def lose(self, reason: str, place: Span) -> None:
        """Note something that has no form in the spec."""
        self.notes.append(ImportNote(reason, place))

    def change(self, what: str, place: Span) -> None:
        """Note something that the spec says in another way."""
        self.changes.append(ImportNote(what, place))

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
            variable, value = f"share_{identifier(name)}", self.share_folder(name)
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
