"""Nodes of a launch file: Python read as a syntax tree, XML and YAML parsed; nothing executed."""

from __future__ import annotations

import ast
from collections.abc import Mapping
from pathlib import Path

from r2bspec.authoring.draft_spec import DraftNodes
from r2bspec.check.installed_packages import ament_prefixes, package_share
from r2bspec.errors import UsageError
from r2bspec.interop.script_import.benchmark_script import launch_file_actions
from r2bspec.interop.script_import.launch_actions import (
    IncludeAction,
    NodeAction,
    collect_actions,
    topic_in,
)
from r2bspec.interop.script_import.markup_launch import markup_launch_actions
from r2bspec.interop.script_import.source_files import (
    TOO_COMPLEX,
    ScriptComments,
    ScriptReader,
    UnusableScriptError,
    read_comments,
)
from r2bspec.interop.script_import.spec_nodes import NodeWriter
from r2bspec.interop.script_import.spec_values import SpecValues, relative_folder
from r2bspec.interop.script_import.values import Note, ScriptLimitError
from r2bspec.interop.script_import.yaml_writer import Block
from r2bspec.safe_io.safe_file import is_folder, is_regular
from r2bspec.wiring.ast_reader import read_node_class, read_python_file

_SUFFIXES = (".launch.py", ".launch.xml", ".launch.yaml", ".launch.yml", "_launch.py", ".launch")


def find_launch_file(wanted: str) -> Path:
    """A launch file: a path, a package with one launch file, or ``PACKAGE:FILE``.

    Raises:
        UsageError: there is no such file, or the package has several.
    """
    if is_regular(Path(wanted)):
        return Path(wanted)
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
    return folder / names[0]


def add_launch_nodes(draft: DraftNodes, file: Path, spec_folder: Path) -> None:
    """Add the nodes of a launch file, and of files that it includes and that can be read.

    Raises:
        UsageError: it cannot be read or parsed, or exceeds the limits.
    """
    try:
        _add_nodes(draft, ScriptReader(file), file, spec_folder)
    except UnusableScriptError as error:
        span = error.finding.span
        message = f"{span.file}:{span.line}:{span.column}: {error.finding.message}"
        raise UsageError(message, code=error.finding.code) from error
    except ScriptLimitError as error:
        message = f"{file}:1:1: the file needs more than is evaluated: {error}"
        raise UsageError(message, code=TOO_COMPLEX) from error


def _add_nodes(draft: DraftNodes, reader: ScriptReader, file: Path, spec_folder: Path) -> None:
    actions, notes = _actions(reader, file, {})
    parts = collect_actions(
        actions, lambda include: _expanded(reader, include, notes), reader.steps
    )
    is_python = file.suffix == ".py"
    comments = read_comments(file, reader.texts[str(file)]) if is_python else ScriptComments()
    values = SpecValues(relative_folder(file.parent, spec_folder), "/", comments, notes=notes)
    writer = NodeWriter(values, draft.keys)
    writer.add_containers(draft.containers, parts.containers, parts.members, [], [])
    before = len(draft.nodes.entries)
    writer.add_all(draft.nodes, parts.members)
    for entry, action in zip(draft.nodes.entries[before:], parts.members, strict=True):
        if isinstance(action, NodeAction) and isinstance(entry.value, Block):
            _add_interface(entry.value, action, file.parent)
    draft.is_absolute = True
    draft.variables |= values.variables
    draft.environment += [name for name in values.environment if name not in draft.environment]
    draft.topics += [
        topic_in(member.namespace or "/", remapping.target)
        for member in parts.members
        for remapping in member.remappings
    ]
    draft.unknown += [
        f"{Path(note.place.file).name}:{note.place.line}: {note.reason}"
        for note in (*notes, *parts.ignored, *values.changes)
    ]


def _add_interface(block: Block, node: NodeAction, folder: Path) -> None:
    """Add what the source of a Python program tells about its topics."""
    program = _program(node, folder)
    tree = read_python_file(program) if program is not None else None
    if tree is None:
        return
    classes = [each.name for each in tree.body if isinstance(each, ast.ClassDef)]
    known = [each for name in classes if (each := read_node_class(tree, name)) is not None]
    if len(known) == 1:
        block.add("subscribes", _topic_types(known[0].subscribes))
        block.add("publishes", _topic_types(known[0].publishes))


def _program(node: NodeAction, folder: Path) -> Path | None:
    """The file of a program, if it can be found and may be Python."""
    if node.executable and node.package:
        files = [each / "lib" / node.package / node.executable for each in ament_prefixes()]
    else:
        words = [each.replace("$(script)", str(folder)) for each in node.command[:2]]
        files = [Path(each) for each in words if each.endswith(".py")]
    return next((each for each in files if is_regular(each)), None)


def _topic_types(topics: Mapping[str, str] | None) -> Block:
    block = Block()
    for name, kind in (topics or {}).items():
        block.add(name, kind)
    return block


def _actions(
    reader: ScriptReader, file: Path, arguments: dict[str, object]
) -> tuple[list[object], list[Note]]:
    if file.suffix == ".py":
        return launch_file_actions(reader, file, arguments)
    return markup_launch_actions(reader, file, arguments)


def _expanded(
    reader: ScriptReader, include: IncludeAction, notes: list[Note]
) -> list[object] | None:
    """The actions of an included file that is next to the launch file or above."""
    file = reader.find_share_file(include.package, include.file)
    share = package_share(include.package) if file is None and include.package else None
    place = include.source.place
    if share is not None:
        file = share / include.file
    elif include.path.startswith("$(script)/"):
        file = Path(place.file).parent / include.path.removeprefix("$(script)/")
    if file is None or not is_regular(file):
        return None
    try:
        actions, inner = _actions(reader, file, include.arguments)
    except UnusableScriptError as error:
        notes.append(Note(f"{file.name} is not expanded: {error}", place))
        return None
    notes += inner
    return actions
