"""RecordedFile values as values of a spec, and the text of the spec, in the style of a person.

A mark of the recording becomes a variable or an environment variable of the spec, or a placeholder
with a comment. A `Block` is a map with one key per line; other maps and lists are on one line where
they fit. Names of others become keys with `identifier` and `unique_name`.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from r2bspec.interop.recording import Note, Place, RecordedFile
from r2bspec.language.yaml_document import to_yaml
from r2bspec.plan.installed_packages import package_share

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
        """Return a map with these keys."""
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
    """Return a document: a comment at its head, and empty lines between its top-level keys."""
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
    """Return comments as lines of YAML; a text of several lines keeps its lines."""
    return [
        f"{indent}# {_CONTROL.sub('?', line)}".rstrip()
        for text in texts
        for line in text.split("\n")
    ]


def flow(value: Any) -> str:
    """Return a value on one line."""
    if isinstance(value, dict):
        inside = ", ".join(f"{flow(key)}: {flow(item)}" for key, item in value.items())
        return f"{{{inside}}}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(flow, value))}]"
    if isinstance(value, str):
        return scalar(value) if _PLAIN_IN_FLOW.match(value) else _quoted(value)
    return scalar(value)


def scalar(value: Any) -> str:
    """Return a scalar on one line, quoted if YAML needs it."""
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
    """Return a name of letters, digits and underscores."""
    name = _NO_NAME.sub("_", text).strip("_") or "unnamed"
    return f"n_{name}" if name[0].isdigit() else name


def unique_name(name: str, used: set[str]) -> str:
    """Return a name that is not used yet; it is added to `used`."""
    unique, number = name, 2
    while unique in used:
        unique, number = f"{name}_{number}", number + 1
    used.add(unique)
    return unique


_REFERENCE: Final = re.compile(r"\$\((?P<kind>assets|script|env|share|unknown) ?(?P<name>[^()]*)\)")
_PLACEHOLDER: Final = "<not known>"
"""What stands for an unknown text, with a comment that has the line of the file."""


@dataclass(slots=True)
class SpecValues:
    """Converts recorded values, and collects what they need.

    Attributes:
        recorded: what the file does.
        spec_folder: the folder of the spec.
        script: the file that was executed.
        namespace: the namespace of the benchmark, absolute.
        variables: name to value, in the order of first use.
        environment: environment variables that are read.
        notes: what the spec lacks, or says in another way.
        doubts: comments about placeholders, until `take_doubts`.
        sources: the lines of the files that were executed, by file.
    """

    recorded: RecordedFile
    spec_folder: Path
    script: Path
    namespace: str
    variables: dict[str, Any] = field(default_factory=dict)
    environment: list[str] = field(default_factory=list)
    notes: list[Note] = field(default_factory=list)
    doubts: list[str] = field(default_factory=list)
    sources: dict[str, list[str]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.notes += self.recorded.notes

    def lose(self, reason: str, place: Place) -> None:
        """Note something that has no form in the spec."""
        self.notes.append(Note("lost", reason, place))

    def change(self, what: str, place: Place) -> None:
        """Note something that the spec does in another way."""
        self.notes.append(Note("changed", what, place))

    def convert(self, value: Any) -> Any:
        """Return a value in the form of a spec."""
        if isinstance(value, str):
            return self.text(value)
        if isinstance(value, list):
            return [self.convert(item) for item in value]
        if isinstance(value, dict):
            return {name: self.convert(item) for name, item in value.items()}
        return value

    def text(self, value: str) -> str:
        """Return a text with its marks as variables of the spec, or as placeholders."""
        return _REFERENCE.sub(self._reference, value)

    def take_doubts(self) -> list[str]:
        """Return the comments about the placeholders since the last call."""
        doubts, self.doubts = list(dict.fromkeys(self.doubts)), []
        return doubts

    def comments_above(self, place: Place) -> list[str]:
        """Return the author's comments directly above a line of a file."""
        lines = self.lines(place[0])[: place[1] - 1]
        above: list[str] = []
        while lines and (line := lines.pop().strip()).startswith("#"):
            above.insert(0, line.lstrip("#").strip())
        return above

    def lines(self, file: str) -> list[str]:
        """Return the lines of a file that was executed."""
        if file not in self.sources:
            self.sources[file] = Path(file).read_text("utf-8", "replace").splitlines()
        return self.sources[file]

    def _reference(self, match: re.Match[str]) -> str:
        kind, name = match["kind"], match["name"].strip()
        if kind == "unknown":
            unknown = self.recorded.unknown[int(name)]
            self.doubts.append(f"not known: {unknown.what} (line {unknown.place[1]})")
            self.lose(f"{unknown.what} is not known: {_PLACEHOLDER!r} stands for it", unknown.place)
            return _PLACEHOLDER
        if kind == "env":
            if name not in self.environment:
                self.environment.append(name)
            return f"$(env {name})"
        if kind == "assets":
            variable, value = "assets_root", "./assets"
        elif kind == "script":
            folder = relative_folder(self.script.parent, self.spec_folder)
            variable, value = "script_folder", folder
        else:
            variable, value = f"share_{identifier(name)}", self._share(name)
        self.variables.setdefault(variable, value)
        return f"$(var {variable})"

    def _share(self, package: str) -> str:
        """Return where a package is installed.

        A source folder beside the file has the same files.
        """
        installed, source = package_share(package), self.recorded.shares.get(package)
        if installed is None and source is not None:
            return relative_folder(Path(source), self.spec_folder)
        return f"/opt/ros/jazzy/share/{package}" if installed is None else str(installed)


def relative_folder(folder: Path, start: Path) -> str:
    """Return a folder as a path relative to another one, beginning with a dot."""
    relative = os.path.relpath(folder.absolute(), start.absolute())
    return relative if relative.startswith(".") else f"./{relative}"
