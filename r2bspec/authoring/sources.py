"""First specs from what a person has: a recording, a launch file, a node, a running system.

Each source adds nodes to a draft, and what it does not tell; the recording adds the inputs.
`draft_spec` writes the spec. Launch files in Python are read as a syntax tree, those in XML and
YAML are parsed; nothing is executed. Nodes of the running ROS graph are external nodes of a spec,
because a graph does not tell how they are started.
"""

from __future__ import annotations

import ast
import importlib.util
import json
import os
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from r2bspec.authoring.draft_spec import DraftNodes, Recording, draft_text
from r2bspec.datasets.catalogue import index, locate
from r2bspec.errors import R2bspecError, UsageError
from r2bspec.interop.script_import import source_files
from r2bspec.interop.script_import.benchmark_script import launch_file_actions
from r2bspec.interop.script_import.launch_actions import (
    IncludeAction,
    NodeAction,
    collect_actions,
    topic_in,
)
from r2bspec.interop.script_import.markup_launch import markup_launch_actions
from r2bspec.interop.script_import.spec_entries import NodeWriter
from r2bspec.interop.script_import.spec_text import (
    Block,
    SpecValues,
    flow,
    identifier,
    relative_folder,
    unique_name,
)
from r2bspec.interop.script_import.values import Note, ScriptLimitError
from r2bspec.language.templates import node_key
from r2bspec.plan.installed_packages import package_share, python_target, top_level_names
from r2bspec.plan.this_machine import ament_prefixes
from r2bspec.plan.wiring.ast_reader import read_node_class, read_python_file
from r2bspec.plan.wiring.companion_files import read_source, source_folder
from r2bspec.plan.wiring.console_scripts import installed_script, source_script
from r2bspec.safe_io.safe_file import is_folder, is_regular

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
        _add_nodes(draft, source_files.ScriptReader(file), file, spec_folder)
    except source_files.UnusableScriptError as error:
        span = error.finding.span
        message = f"{span.file}:{span.line}:{span.column}: {error.finding.message}"
        hint = error.finding.help
        raise UsageError(message, code=error.finding.code, hint=hint) from error
    except ScriptLimitError as error:
        message = f"{file}:1:1: the file needs more than is evaluated: {error}"
        hint = "Name a simpler file, or write the nodes into the spec."
        raise UsageError(message, code=source_files.TOO_COMPLEX, hint=hint) from error


def _add_nodes(
    draft: DraftNodes, reader: source_files.ScriptReader, file: Path, spec_folder: Path
) -> None:
    actions, notes = _actions(reader, file, {})
    parts = collect_actions(
        actions, lambda include: _expanded(reader, include, notes), reader.steps
    )
    is_python = file.suffix == ".py"
    comments = (
        source_files.read_comments(file, reader.texts[str(file)])
        if is_python
        else source_files.ScriptComments()
    )
    values = SpecValues(relative_folder(file.parent, spec_folder), "/", comments, notes=notes)
    writer = NodeWriter(values, draft.keys)
    writer.add_containers(draft.containers, parts.containers, parts.members, [], [])
    for action, node in writer.add_all(draft.nodes, parts.members):
        _add_interface(node, action, file.parent)
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
    known = [each for name in classes if (each := read_node_class(tree, name)).publishes]
    if len(known) == 1 and not (known[0].may_subscribe_more or known[0].may_publish_more):
        block.add("subscribes", Block.of(known[0].subscribes or {}))
        block.add("publishes", Block.of(known[0].publishes or {}))


def _program(node: NodeAction, folder: Path) -> Path | None:
    """The file of a program, if it can be found and may be Python."""
    if node.executable and node.package:
        files = [each / "lib" / node.package / node.executable for each in ament_prefixes()]
    else:
        words = [each.replace("$(script)", str(folder)) for each in node.command[:2]]
        files = [Path(each) for each in words if each.endswith(".py")]
    return next((each for each in files if is_regular(each)), None)


def _actions(
    reader: source_files.ScriptReader, file: Path, arguments: dict[str, object]
) -> tuple[list[object], list[Note]]:
    if file.suffix == ".py":
        return launch_file_actions(reader, file, arguments)
    return markup_launch_actions(reader, file, arguments)


def _expanded(
    reader: source_files.ScriptReader, include: IncludeAction, notes: list[Note]
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
    except source_files.UnusableScriptError as error:
        notes.append(Note(f"{file.name} is not expanded: {error}", place))
        return None
    notes += inner
    return actions


_SLACK_S = 60.0
_MAX_SHOWN = 20
"""Parameters of a node that its comment shows."""

_COMMON_TOPICS = frozenset({"/tf", "/tf_static", "/clock"})


@dataclass(frozen=True, slots=True)
class InitSources:
    """What a first spec is made from.

    Attributes:
        bag: a recording or the name of a dataset.
        launch: a launch file, a package, or PACKAGE:FILE.
        graph: whether the running ROS graph is read.
        node: a Python node, as a spec names it.
        timeout_s: how long to wait for nodes of the graph.
    """

    bag: str = ""
    launch: str = ""
    graph: bool = False
    node: str = ""
    timeout_s: float = 10.0


def spec_from_sources(name: str, folder: Path, sources: InitSources) -> str:
    """The text of a spec.

    Args:
        name: of the benchmark.
        folder: of the spec.
        sources: what it is made from.

    Raises:
        UsageError: a source does not exist or cannot be read.
        DataError: the recording cannot be read.
    """
    draft, shown = DraftNodes(), []
    if sources.node:
        draft.nodes.add(node_key(sources.node), _node_block(sources.node, folder))
        shown.append(f"the node {sources.node}")
    if sources.launch:
        file = find_launch_file(sources.launch)
        add_launch_nodes(draft, file, folder)
        shown.append(f"the launch file {file.name}")
    if sources.graph:
        add_graph_nodes(draft, inspect_graph(sources.timeout_s))
        shown.append("the running ROS graph")
    recording = _recording(sources.bag, folder) if sources.bag else None
    if recording is not None:
        shown.append(f"the recording {recording.written}")
    return draft_text(name, shown, draft, recording, folder)


def find_node(wanted: str, folder: Path) -> str:
    """A Python node as a spec names it: ``PACKAGE:EXECUTABLE`` is the function of that script.

    An installed package counts before one whose source is in the work tree of the spec.

    Raises:
        UsageError: there is no such script.
    """
    package, colon, executable = wanted.partition(":")
    if not colon or package.endswith(".py") or "/" in package:
        return wanted
    if script := installed_script(package, executable):
        return script
    found = source_script(source_folder(folder), package, executable)
    if found is None:
        raise UsageError(
            f"no console script {executable!r} of a package {package!r} is found",
            hint="It is looked for among the installed packages, and below "
            f"{source_folder(folder)}. A file is named ./file.py:Class.",
        )
    file, function = found
    path = os.path.relpath(file, folder)
    return f"{path if path.startswith('.') else f'./{path}'}:{function}"


def _node_block(target: str, folder: Path) -> Block:
    """The entry of a node, with what its source says of its executor and its state."""
    interface, start = read_source(target, folder)
    entry = Block.of({"python": target})
    threads = start.threads_of_main if start is not None else None
    if threads is not None:
        entry.add("executor", "multi_threaded", after="as the program in its file makes it")
    if threads:
        entry.add("threads", threads)
    if interface.is_lifecycle:
        entry.add("lifecycle", "active")
    return entry


def check_node_file(target: str, folder: Path) -> None:
    """Check that the file of a node exists and defines it.

    Args:
        target: as a spec names it; nothing is checked of a module.
        folder: of the spec.

    Raises:
        UsageError: it does not.
    """
    python = python_target(target, folder)
    if python.module:
        return
    if not is_regular(python.file):
        hint = "Paths are relative to the folder of the spec."
        raise UsageError(f"{python.file} does not exist", hint=hint)
    try:
        names = top_level_names(python.file)
    except SyntaxError as error:
        raise UsageError(f"{python.file}:{error.lineno}: {error.msg}") from error
    if names is not None and python.name not in names:
        tree = read_python_file(python.file)
        body = tree.body if tree is not None else []
        classes = [part.name for part in body if isinstance(part, ast.ClassDef)]
        raise UsageError(
            f"{python.file} has no class or function {python.name!r}",
            hint=f"Its classes: {', '.join(classes) or 'none'}.",
        )


def is_readable_node(target: str, folder: Path) -> bool:
    """Whether a target is a class of a node, in a file whose source tells its topics or not."""
    return read_source(target, folder)[0].publishes is not None


def _recording(bag: str, folder: Path) -> Recording:
    location = locate(bag, Path())
    written = location.dataset
    if written is None:
        relative = os.path.relpath(Path(bag).expanduser().absolute(), folder.absolute())
        written = relative if relative.startswith(".") else f"./{relative}"
    return Recording(written, index(location))


class NoGraphError(R2bspecError):
    """The running graph cannot be inspected, or has no nodes."""

    code = "R2B601"


def inspect_graph(timeout_s: float) -> list[dict[str, Any]]:
    """The nodes of the graph in the ROS domain of this environment.

    Args:
        timeout_s: how long to wait for the first node.

    Raises:
        UsageError: ROS 2 is not installed, or there are no nodes.
        NoGraphError: the inspection failed.
    """
    if importlib.util.find_spec("rclpy") is None:
        raise UsageError("ROS 2 is not installed, so there is no graph to read", code="R2B620")
    with tempfile.TemporaryDirectory() as scratch:
        target = Path(scratch, "graph.json")
        words = [sys.executable, "-P", "-m", "r2bspec.harness.inspect_nodes"]
        try:
            done = subprocess.run(
                [*words, str(timeout_s), str(target)],
                capture_output=True,
                text=True,
                timeout=timeout_s + _SLACK_S,
                check=False,
            )
        except subprocess.TimeoutExpired as error:
            raise NoGraphError("the inspection of the graph does not end") from error
        if done.returncode or not target.is_file():
            last = (done.stderr.strip().splitlines() or ["it ended without a result"])[-1]
            raise NoGraphError(f"the graph cannot be inspected: {last}")
        nodes: list[dict[str, Any]] = json.loads(target.read_text(encoding="utf-8"))
    if not nodes:
        raise UsageError(
            "there are no nodes in the ROS graph of this environment",
            hint="Start the system first; ROS_DOMAIN_ID and RMW_IMPLEMENTATION must be its own.",
        )
    return nodes


def add_graph_nodes(draft: DraftNodes, nodes: list[dict[str, Any]]) -> None:
    """Add running nodes as external ones, with their topics, types and QoS profiles."""
    keys = draft.keys
    for node in nodes:
        key = unique_name(identifier(node["name"]), keys)
        if key != node["name"]:
            draft.unknown.append(
                f"{node['namespace'].rstrip('/')}/{node['name']} shares its name with another "
                f"node, which a spec cannot say: here it is {key}, and a run will not find it"
            )
        draft.nodes.add(key, _entry(node), _comments(node))
    draft.is_absolute = True
    started = (
        "how the nodes are started: they are external here, so they must run before a benchmark; "
        "replace 'external' by their package, plugin, executable or launch file"
    )
    names = "their remappings: ROS shows the names of topics after remapping only"
    draft.unknown += [started, names]


def _entry(node: dict[str, Any]) -> Block:
    def listed(side: str) -> dict[str, Any]:
        """The topics of one side that are the node's own."""
        topics = sorted(node[side].items())
        return {topic: value for topic, value in topics if topic not in _COMMON_TOPICS}

    usual = {("reliability", "reliable"), ("durability", "volatile")}
    profiles = {
        topic: {key: value for key, value in profile.items() if (key, value) not in usual}
        for topic, profile in listed("qos").items()
    }
    return Block.of(
        {
            "external": True,
            "namespace": None if node["namespace"] == "/" else node["namespace"],
            "subscribes": Block.of(listed("subscribes")),
            "publishes": Block.of(listed("publishes")),
            "qos": Block.of(profiles),
        }
    )


def _comments(node: dict[str, Any]) -> list[str]:
    parameters = node["parameters"].items()
    shown = {name: entry["default"] for name, entry in parameters if "default" in entry}
    if not shown:
        return []
    lines = [f"  {name}: {flow(value)}" for name, value in list(shown.items())[:_MAX_SHOWN]]
    more = len(shown) - len(lines)
    return ["Its parameters:", *lines, *([f"  and {more} more"] if more > 0 else [])]
