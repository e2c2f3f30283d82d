"""Nodes of a launch file: Python read as a syntax tree, XML and YAML parsed; nothing executed."""

from __future__ import annotations

import ast
from collections.abc import Mapping
from pathlib import Path

from r2bspec.authoring.draft_nodes import DraftNodes
from r2bspec.check.installed_packages import ament_prefixes, package_share
from r2bspec.errors import UsageError
from r2bspec.interop.script_import.benchmark_script import launch_file_actions
from r2bspec.interop.script_import.evaluator import Note
from r2bspec.interop.script_import.launch_actions import (
    IncludeAction,
    LaunchParts,
    NodeAction,
    collect_actions,
)
from r2bspec.interop.script_import.markup_launch import markup_launch_actions
from r2bspec.interop.script_import.node_roles import topic_in
from r2bspec.interop.script_import.script_comments import ScriptComments, read_comments
from r2bspec.interop.script_import.script_limits import ScriptLimitError
from r2bspec.interop.script_import.script_reader import ScriptReader, UnusableScriptError
from r2bspec.interop.script_import.spec_nodes import NodeWriter, containers_of
from r2bspec.interop.script_import.spec_values import SpecValues, relative_folder
from r2bspec.interop.script_import.yaml_writer import Block
from r2bspec.untrusted.safe_file import is_folder, is_regular
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
        UnusableScriptError: it cannot be read or parsed, or exceeds the limits.
    """
    reader = ScriptReader(file)
    try:
        actions, notes = _actions(reader, file, {})
        parts = collect_actions(actions, lambda include, _: _expanded(reader, include, notes))
    except ScriptLimitError as error:
        raise UnusableScriptError.of_limit(file, str(error)) from error
    comments = ScriptComments()
    if file.suffix == ".py":
        comments = read_comments(reader.texts.get(str(file), ""))
    values = SpecValues(relative_folder(file.parent, spec_folder), {})
    changes: list[Note] = []
    writer = NodeWriter(values, comments, "/", file, notes, changes, draft.keys)
    actions_of_nodes: list[NodeAction | IncludeAction] = [*parts.nodes, *parts.includes]
    used = containers_of(draft.containers, parts.containers, actions_of_nodes, [], [])
    writer.keys |= used
    before = len(draft.nodes.entries)
    writer.add_all(draft.nodes, actions_of_nodes, used)
    for entry, action in zip(draft.nodes.entries[before:], actions_of_nodes, strict=True):
        if isinstance(action, NodeAction) and isinstance(entry.value, Block):
            _add_interface(entry.value, action, file.parent)
    draft.is_absolute = True
    draft.variables |= values.variables
    draft.environment += [each for each in values.environment if each not in draft.environment]
    draft.topics += _topics(parts)
    ignored = [Note(message, place) for message, place in parts.ignored]
    draft.unknown += [
        f"{each.place.file.name}:{each.place.line}: {each.message}"
        for each in (*notes, *ignored, *changes)
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
    if share is not None and is_regular(share / include.file):
        file = share / include.file
    if file is None and include.path.startswith("$(script)/"):
        own = include.source.place.file.parent / include.path.removeprefix("$(script)/")
        file = own if is_regular(own) else None
    if file is None:
        return None
    try:
        actions, inner = _actions(reader, file, include.arguments)
    except UnusableScriptError as error:
        notes.append(Note(f"{file.name} is not expanded: {error}", include.source.place))
        return None
    notes += inner
    return actions


def _topics(parts: LaunchParts) -> list[str]:
    members: list[NodeAction | IncludeAction] = [*parts.nodes, *parts.includes]
    return [
        topic_in(node.namespace or "/", each.target) for node in members for each in node.remappings
    ]
