"""The nodes of a launch file, for a first spec: all of it, or the file as one node.

A file whose nodes are known becomes nodes, containers and further launch files. If anything that it
starts, or says of that, is not known from the text alone, it is one ``launch`` node of the whole
file, with its arguments: half of a graph is not the graph. The same holds for each file that it
includes. What a run does in another way than `ros2 launch` is noted with its line.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from r2bspec.authoring.draft_spec import DraftNodes
from r2bspec.diagnostics import Diagnostic, Severity, Span
from r2bspec.diagnostics.quote import clip, did_you_mean, suggestion
from r2bspec.errors import UsageError
from r2bspec.interop.script_import import source_files
from r2bspec.interop.script_import.launch_actions import collect_actions, topic_in
from r2bspec.interop.script_import.launch_files import LaunchFile, python_launch_file
from r2bspec.interop.script_import.launch_parts import IncludeAction, NodeAction
from r2bspec.interop.script_import.markup_launch import markup_launch_file
from r2bspec.interop.script_import.spec_entries import NodeWriter
from r2bspec.interop.script_import.spec_text import Block, SpecValues, flow, relative_folder
from r2bspec.interop.script_import.values import Construct, ImportNote, ScriptLimitError
from r2bspec.plan.installed_packages import package_share
from r2bspec.plan.this_machine import ament_prefixes
from r2bspec.plan.wiring.ast_reader import read_node_class
from r2bspec.plan.wiring.python_files import read_python_file
from r2bspec.safe_io.safe_file import is_folder, is_regular

_SUFFIXES = (".launch.py", ".launch.xml", ".launch.yaml", ".launch.yml", "_launch.py", ".launch")
_MAX_SHOWN = 20
"""Arguments of a launch file that its comment shows."""


@dataclass(frozen=True, slots=True)
class LaunchSource:
    """A launch file, and where a spec finds it.

    Attributes:
        package: the installed package that it was named by; empty for a path.
        arguments: values for its launch arguments.
    """

    file: Path
    package: str = ""
    arguments: Mapping[str, str] = field(default_factory=dict)


def find_launch_file(wanted: str) -> LaunchSource:
    """A launch file: a path, a package with one launch file, or ``PACKAGE:FILE``.

    Raises:
        UsageError: there is no such file, or the package has several.
    """
    if is_regular(Path(wanted)):
        return LaunchSource(Path(wanted))
    package, _, name = wanted.partition(":")
    share = package_share(package) if package and "/" not in package else None
    if share is None:
        raise UsageError(
            f"{wanted!r} is no file, and no package of this name is installed",
            hint="Give the path of a launch file, PACKAGE or PACKAGE:FILE.",
        )
    folder = share / "launch"
    names = sorted(
        each.name
        for each in (folder.iterdir() if is_folder(folder) else ())
        if each.name.endswith(_SUFFIXES) and (not name or each.name == name)
    )
    if len(names) != 1:
        known = ", ".join(names) or "none"
        raise UsageError(
            f"package {package!r} has {len(names)} such launch files", hint=f"They are: {known}."
        )
    return LaunchSource(folder / names[0], package)


def add_launch_nodes(
    draft: DraftNodes, source: LaunchSource, spec_folder: Path
) -> tuple[Diagnostic, ...]:
    """Add the nodes of a launch file, and of files that it includes and that can be read.

    Returns:
        What the spec says in another way than the file.

    Raises:
        UsageError: it cannot be read or parsed, or exceeds the limits.
    """
    try:
        reading = _whole_files(source, spec_folder, draft.keys)
    except source_files.UnusableScriptError as error:
        span = error.finding.span
        message = f"{span.file}:{span.line}:{span.column}: {error.finding.message}"
        hint = error.finding.help
        raise UsageError(message, code=error.finding.code, hint=hint) from error
    except ScriptLimitError as error:
        message = f"{source.file}:1:1: the file needs more than is evaluated: {error}"
        hint = "Name a simpler file, or write the nodes into the spec."
        raise UsageError(message, code=source_files.TOO_COMPLEX, hint=hint) from error
    reading.check_arguments()
    reading.add_to(draft)
    notes = reading.told()
    draft.unknown += [f"{Path(n.place.file).name}:{n.place.line}: {n.reason}" for n in notes]
    return tuple(Diagnostic("R2B711", Severity.INFO, note.reason, note.place) for note in notes)


def _whole_files(source: LaunchSource, spec_folder: Path, keys: set[str]) -> _Reading:
    """The reading of a file in which nothing is lost: each file with a loss is kept as it is."""
    kept: dict[Path, list[ImportNote]] = {}
    while True:
        reading = _Reading(source, spec_folder, set(keys), kept)
        lost = reading.read()
        if not lost or source.file in kept:
            return reading
        for note in lost:
            file = Path(note.place.file)
            at_fault = file if file in reading.launched else source.file
            kept.setdefault(at_fault, []).append(note)


class _Reading:
    """One reading of a launch file.

    Attributes:
        kept: the files that are not expanded, with what is not known of each.
        is_whole: whether every file that is included was read, too.
        launched: what each launch file does that was read, by its file.
    """

    def __init__(
        self,
        source: LaunchSource,
        spec_folder: Path,
        keys: set[str],
        kept: Mapping[Path, list[ImportNote]],
    ) -> None:
        self.source = source
        self.kept = kept
        self.reader = source_files.ScriptReader(source.file)
        self.launched: dict[Path, LaunchFile] = {}
        self.notes: list[ImportNote] = []
        self.changes: list[ImportNote] = []
        self.is_whole = True
        self.nodes, self.containers, self.topics = Block(), Block(), list[str]()
        folder = relative_folder(source.file.parent, spec_folder)
        self.spec_folder = spec_folder
        self.values = SpecValues(folder, "/", source_files.ScriptComments(), notes=self.notes)
        self.values.share_folder = self._share_folder
        self.writer = NodeWriter(self.values, keys)

    def read(self) -> list[ImportNote]:
        """Read the file; returns what is lost."""
        file = self.source.file
        launched = self._launch_file(file, dict(self.source.arguments))
        if file in self.kept:
            self._keep_whole(launched)
            return self.notes
        self.notes += launched.notes
        parts = collect_actions(
            launched.actions, self._expanded, self.reader.steps, launched.values
        )
        if file.suffix == ".py":
            text = self.reader.texts[str(file)]
            self.values.comments = source_files.read_comments(file, text)
        self.writer.add_containers(self.containers, parts.containers, parts.members, [], [])
        for action, node in self.writer.add_all(self.nodes, parts.members):
            _add_interface(node, action, file.parent)
        self.topics = [
            topic_in(member.namespace or "/", remapping.target)
            for member in parts.members
            for remapping in member.remappings
        ]
        self.notes += parts.ignored
        self.changes += parts.changes
        if not self.nodes:
            place = Span(str(file), 1, 1, 1, 2)
            self.notes.append(ImportNote("with these arguments, the file starts nothing", place))
        return self.notes

    def check_arguments(self) -> None:
        """Note the given arguments that no file names, whether it declares them or not.

        Raises:
            UsageError: there is one, and all of the files were read, or a similar one has no value.
        """
        files = self.launched.values()
        known = [each.name for file in files for each in file.arguments]
        missing = [x.name for file in files for x in file.arguments if x.name not in file.values]
        for name in self.source.arguments:
            word = re.compile(rf"(?<!\w){re.escape(name)}(?!\w)")
            if name in known or any(map(word.search, self.reader.texts.values())):
                continue
            reason = f"{self.source.file.name} has no launch argument {clip(name)!r}"
            advice = suggestion(name, known, "its arguments")
            if (self.is_whole and not self.kept) or did_you_mean(name, known) in missing:
                raise UsageError(reason, hint=advice or "It declares none.")
            place = Span(str(self.source.file), 1, 1, 1, 2)
            reason += f" that is known; {advice}" if advice else " that is known"
            self.changes.append(ImportNote(reason, place))

    def add_to(self, draft: DraftNodes) -> None:
        """Add what was read to a draft."""
        draft.nodes.entries += self.nodes.entries
        draft.containers.entries += self.containers.entries
        draft.is_absolute = True
        draft.variables |= self.values.variables
        draft.environment += [x for x in self.values.environment if x not in draft.environment]
        draft.topics += self.topics

    def told(self) -> list[ImportNote]:
        """What the spec says in another way than the file, in the order of the lines."""
        notes = [*self.changes, *self.values.changes]
        for file, reasons in self.kept.items():
            more = len(dict.fromkeys(note.reason for note in reasons)) - 1
            also = f", and {more} more reasons" if more > 1 else ""
            first = reasons[0].reason.partition(", so ")[0]
            what = f"{file.name} is one launch node, because of this: {first}{also}"
            notes.append(ImportNote(what, reasons[0].place))
        grouped: dict[tuple[str, str], ImportNote] = {}
        for note in notes:
            grouped.setdefault((note.place.file, note.reason), note)
        return sorted(grouped.values(), key=lambda note: (note.place.file, note.place.line))

    def _launch_file(self, file: Path, arguments: Mapping[str, Any]) -> LaunchFile:
        read = python_launch_file if file.suffix == ".py" else markup_launch_file
        self.launched[file] = read(self.reader, file, arguments)
        return self.launched[file]

    def _keep_whole(self, launched: LaunchFile) -> None:
        """One node for the whole file, with the arguments that are given."""
        file, package = self.source.file, self.source.package
        place = Span(str(file), 1, 1, 1, 2)
        include = IncludeAction(Construct("launch", [], {}, place))
        if package:
            include.package, include.file = package, f"launch/{file.name}"
        else:
            include.path = f"$(script)/{file.name}"
        include.arguments = dict(self.source.arguments)
        self.writer.add_all(self.nodes, [include])
        shown = [
            f"  {argument.name}: {flow(argument.default) if argument.default is not None else '?'}"
            for argument in launched.arguments
        ]
        more = [f"  and {len(shown) - _MAX_SHOWN} more"] if len(shown) > _MAX_SHOWN else []
        above = ["Its arguments, which 'launch.arguments' can set:", *shown[:_MAX_SHOWN], *more]
        entry = self.nodes.entries[-1]
        entry.above = (*entry.above, *(above if shown else []))

    def _expanded(self, include: IncludeAction, arguments: Mapping[str, Any]) -> LaunchFile | None:
        """An included file that is next to the launch file or above; it gets all arguments."""
        place = include.source.place
        inherited = {name: value for name, value in arguments.items() if isinstance(value, str)}
        file = self._included(include)
        if file is None or file in self.kept or not is_regular(file):
            for name, value in arguments.items():
                if name in inherited:
                    include.arguments.setdefault(name, value)
                elif name not in include.arguments:
                    what = f"{include.name} gets no launch argument {name!r}, which is not known"
                    self.changes.append(ImportNote(what, place))
            self.is_whole = False
            return None
        try:
            launched = self._launch_file(file, inherited | include.arguments)
        except source_files.UnusableScriptError as error:
            self.changes.append(ImportNote(f"{file.name} is not expanded: {error}", place))
            self.is_whole = False
            return None
        self.notes += launched.notes
        return launched

    def _share_folder(self, package: str) -> str:
        """Where a package is installed; a source folder beside the file has the same files."""
        installed, source = package_share(package), self.reader.find_package(package)
        if installed is None and source is not None:
            return relative_folder(source, self.spec_folder)
        return f"/opt/ros/jazzy/share/{package}" if installed is None else str(installed)

    def _included(self, include: IncludeAction) -> Path | None:
        if include.path:
            in_folder = include.path.startswith("$(script)/")
            return self.reader.referenced(include.path) if in_folder else None
        file = self.reader.find_share_file(include.package, include.file)
        share = package_share(include.package) if file is None else None
        return file if share is None else share / include.file


def _add_interface(block: Block, node: NodeAction, folder: Path) -> None:
    """Add what the source of a Python program tells about its topics."""
    program = _program(node, folder)
    tree = read_python_file(program) if program is not None else None
    if tree is None:
        return
    classes = [each.name for each in tree.body if isinstance(each, ast.ClassDef)]
    read = [read_node_class(tree, name) for name in classes]
    known = [each for each in read if not (each.may_subscribe_more or each.may_publish_more)]
    if len(known) == 1:
        block.add("subscribes", Block.of(known[0].subscribes or {}))
        block.add("publishes", Block.of(known[0].publishes or {}))


def _program(node: NodeAction, folder: Path) -> Path | None:
    """The file of a program, if it can be found and may be Python."""
    if node.executable and node.package:
        files = [each / "lib" / node.package / node.executable for each in ament_prefixes()]
    else:
        words = [each.replace("$(script)", str(folder)) for each in node.command[:2]]
        files = [Path(word) for word in words if word.endswith(".py")]
    return next((file for file in files if is_regular(file)), None)
