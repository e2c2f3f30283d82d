"""The nodes of a launch file, for a first spec: all of it, or the file as one node.

A Python file is executed with stand-ins for launch, and becomes nodes, containers and further
launch files. If anything that it starts is not fully known, it becomes one ``launch`` node of the
whole file, with its arguments: half of a graph is not the graph. A file in XML or YAML always
becomes one node. Differences between a run and `ros2 launch` are noted with their lines.
"""

from __future__ import annotations

import ast
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from r2bspec.authoring.draft_spec import DraftNodes
from r2bspec.diagnostics import Diagnostic, Severity
from r2bspec.diagnostics.quote import suggestion
from r2bspec.errors import UsageError
from r2bspec.interop.node_roles import topic_in
from r2bspec.interop.recording import (
    IncludeAction,
    Member,
    NodeAction,
    Note,
    RecordedFile,
    UnusableFileError,
    record,
    span_of,
)
from r2bspec.interop.spec_entries import NodeWriter
from r2bspec.interop.spec_text import Block, SpecValues, flow
from r2bspec.plan.installed_packages import package_share
from r2bspec.plan.this_machine import ament_prefixes
from r2bspec.plan.wiring.python_files import read_python_file
from r2bspec.plan.wiring.source_interface import read_node_class
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
    package: str
    arguments: Mapping[str, str]


def find_launch_file(wanted: str, arguments: Mapping[str, str]) -> LaunchSource:
    """Return a launch file: a path, a package with one launch file, or ``PACKAGE:FILE``.

    Args:
        wanted: what names it.
        arguments: values for its launch arguments.

    Raises:
        UsageError: there is no such file, or the package has several.
    """
    if is_regular(Path(wanted)):
        return LaunchSource(Path(wanted), "", arguments)
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
    return LaunchSource(folder / names[0], package, arguments)


def add_launch_nodes(
    draft: DraftNodes, source: LaunchSource, spec_folder: Path
) -> tuple[Diagnostic, ...]:
    """Add the nodes of a launch file, which is executed if it is in Python.

    Returns:
        Notes on what the spec says otherwise than the file.

    Raises:
        UsageError: the file ends with an exception, or has no such launch argument.
    """
    file = source.file
    if file.suffix != ".py":
        why = Note("changed", "launch files in XML and YAML are not read", (str(file), 1))
        notes = _add_whole(draft, source, RecordedFile(), spec_folder, [why])
    else:
        try:
            recorded = record(file, "launch", source.arguments)
        except UnusableFileError as error:
            hint = f"'ros2 launch {file}' must be able to read it; --launch-arg sets arguments."
            raise UsageError(str(error), code=error.code, hint=hint) from error
        _check_arguments(source, recorded)
        notes = _add_known(draft, source, recorded, spec_folder)
    draft.is_absolute = True
    draft.unknown += [f"{Path(n.place[0]).name}:{n.place[1]}: {n.reason}" for n in notes]
    return tuple(
        Diagnostic("R2B711", Severity.INFO, note.reason, span_of(note.place)) for note in notes
    )


def _add_known(
    draft: DraftNodes, source: LaunchSource, recorded: RecordedFile, spec_folder: Path
) -> list[Note]:
    """Add the nodes, or the whole file if something is not known; returns the notes."""
    values = SpecValues(recorded, spec_folder, source.file, "/")
    writer = NodeWriter(values, draft.keys)
    nodes, containers = Block(), Block()
    members: list[Member] = [*recorded.nodes, *recorded.includes]
    writer.add_containers(containers, recorded.containers, members, [], [])
    for action, node in writer.add_all(nodes, members):
        _add_interface(node, action, source.file.parent)
    notes = sorted(dict.fromkeys(values.notes), key=lambda note: note.place)
    lost = [note for note in notes if note.kind != "changed"]
    if not nodes:
        lost.append(Note("lost", "with these arguments, the file starts nothing", _start(source)))
    if lost:
        return _add_whole(draft, source, recorded, spec_folder, lost)
    _add_to(draft, nodes, containers, values)
    draft.topics += [
        topic_in(member.namespace or "/", target)
        for member in members
        for _, target in member.remappings
    ]
    return notes


def _add_to(draft: DraftNodes, nodes: Block, containers: Block, values: SpecValues) -> None:
    draft.nodes.entries += nodes.entries
    draft.containers.entries += containers.entries
    draft.variables |= values.variables
    draft.environment += [name for name in values.environment if name not in draft.environment]


def _add_whole(
    draft: DraftNodes,
    source: LaunchSource,
    recorded: RecordedFile,
    spec_folder: Path,
    lost: list[Note],
) -> list[Note]:
    """Add one node for the whole file, with the arguments that are given; returns why."""
    file = source.file
    folder = f"$(share {source.package})/launch" if source.package else "$(script)"
    values = SpecValues(RecordedFile(), spec_folder, file, "/")
    nodes = Block()
    include = IncludeAction(
        place=_start(source), path=f"{folder}/{file.name}", arguments=dict(source.arguments)
    )
    NodeWriter(values, draft.keys).add_all(nodes, [include])
    shown = [
        f"  {name}: {flow(default) if default is not None else '?'}"
        for name, default in recorded.arguments.items()
    ]
    more = [f"  and {len(shown) - _MAX_SHOWN} more"] if len(shown) > _MAX_SHOWN else []
    above = ["Its arguments, which 'launch.arguments' can set:", *shown[:_MAX_SHOWN], *more]
    nodes.entries[-1].above = tuple(above if shown else ())
    _add_to(draft, nodes, Block(), values)
    also = f", and {len(lost) - 1} more reasons" if len(lost) > 1 else ""
    what = f"{file.name} is one launch node, because of this: {lost[0].reason}{also}"
    return [Note("changed", what, lost[0].place)]


def _check_arguments(source: LaunchSource, recorded: RecordedFile) -> None:
    """Check that the file, or a file that it includes, may have the arguments that are given.

    Raises:
        UsageError: it has not.
    """
    if recorded.includes:
        return
    texts = [Path(file).read_text("utf-8", "replace") for file in recorded.files]
    for name in source.arguments.keys() - recorded.arguments.keys():
        if any(name in text for text in texts):
            continue
        advice = suggestion(name, list(recorded.arguments), "its arguments")
        raise UsageError(
            f"{source.file.name} has no launch argument {name!r}", hint=advice or "It has none."
        )


def _start(source: LaunchSource) -> tuple[str, int]:
    return str(source.file), 1


def _add_interface(block: Block, node: NodeAction, folder: Path) -> None:
    """Add what the source of a Python program tells about its topics."""
    program = _program(node, folder)
    tree = read_python_file(program) if program is not None else None
    if tree is None:
        return
    classes = [each.name for each in tree.body if isinstance(each, ast.ClassDef)]
    read = [read_node_class(tree, name) for name in classes or ["main"]]
    known = [each for each in read if not (each.may_subscribe_more or each.may_publish_more)]
    if len(known) == 1:
        block.add("subscribes", Block.of(known[0].subscribes or {}))
        block.add("publishes", Block.of(known[0].publishes or {}))


def _program(node: NodeAction, folder: Path) -> Path | None:
    """Return the file of a program, if it can be found and may be Python."""
    if node.executable and node.package:
        files = [each / "lib" / node.package / node.executable for each in ament_prefixes()]
    else:
        words = [each.replace("$(script)", str(folder)) for each in node.command[:2]]
        files = [Path(word) for word in words if word.endswith(".py")]
    return next((file for file in files if is_regular(file)), None)
