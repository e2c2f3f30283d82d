"""First specs from what a person has: a recording, a launch file, a node, a running system.

Each source adds nodes to a draft, and notes what it does not tell; the recording adds the inputs.
`draft_text` writes the spec. A launch file in Python is executed with stand-ins (`launch_source`);
nothing else is. Nodes of the running ROS graph are external nodes of a spec, because a graph does
not tell how they are started.
"""

from __future__ import annotations

import ast
import importlib.util
import json
import os
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from r2bspec.authoring.draft_spec import Draft, DraftNodes, DraftRecording
from r2bspec.authoring.draft_text import draft_text
from r2bspec.authoring.launch_source import add_launch_nodes, find_launch_file
from r2bspec.bags.recorded_parts import find_parts
from r2bspec.bags.recorded_times import times_of_bag
from r2bspec.datasets.catalogue import index, locate
from r2bspec.diagnostics import Diagnostic
from r2bspec.errors import R2bspecError, UsageError
from r2bspec.execute.processes.prerequisites import domain_of_user
from r2bspec.interop.spec_text import Block, identifier, unique_name
from r2bspec.language.templates import node_key
from r2bspec.plan.installed_packages import python_target, top_level_names
from r2bspec.plan.wiring.companion_files import read_source
from r2bspec.plan.wiring.console_scripts import installed_script, source_script
from r2bspec.plan.wiring.parameter_files import read_parameter_file
from r2bspec.plan.wiring.python_files import read_python_file, source_folder
from r2bspec.safe_io.private_files import temporary_folder
from r2bspec.safe_io.safe_file import is_regular

_SLACK_S = 60.0
_COMMON_TOPICS = frozenset({"/tf", "/tf_static", "/clock"})


@dataclass(frozen=True, slots=True)
class InitSources:
    """What a first spec is made from.

    Attributes:
        bag: a recording or the name of a dataset.
        launch: a launch file, a package, or PACKAGE:FILE.
        launch_arguments: values of its launch arguments, by name.
        graph: whether the running ROS graph is read.
        node: a Python node, as a spec names it.
        parameter_file: a file with parameters of that node; empty for none.
        timeout_s: how long to wait for nodes of the graph.
    """

    bag: str = ""
    launch: str = ""
    launch_arguments: Mapping[str, str] = field(default_factory=dict)
    graph: bool = False
    node: str = ""
    parameter_file: str = ""
    timeout_s: float = 10.0


@dataclass(frozen=True, slots=True)
class FirstSpec:
    """A first spec: its text, whether it lacks topics, and how it differs from its sources."""

    text: str
    lacks_topics: bool = False
    findings: tuple[Diagnostic, ...] = ()


def spec_from_sources(name: str, folder: Path, sources: InitSources) -> FirstSpec:
    """Return a spec that is valid as it is.

    Args:
        name: of the benchmark.
        folder: of the spec.
        sources: what it is made from.

    Raises:
        UsageError: a source does not exist or cannot be read.
        DataError: the recording cannot be read.
    """
    draft, shown = DraftNodes(), []
    findings: tuple[Diagnostic, ...] = ()
    if sources.node:
        _add_node(draft, sources.node, sources.parameter_file, folder)
        shown.append(f"the node {sources.node}")
    if sources.launch:
        launch = find_launch_file(sources.launch, sources.launch_arguments)
        findings = add_launch_nodes(draft, launch, folder)
        draft.unknown += [
            f"the environment variable {variable}: set it as where the file is launched"
            for variable in draft.environment
            if variable not in os.environ
        ]
        shown.append(f"the launch file {launch.file.name}")
    if sources.graph:
        add_graph_nodes(draft, inspect_graph(sources.timeout_s))
        shown.append("the running ROS graph")
    recording = _recording(sources.bag, folder) if sources.bag else None
    if recording is not None:
        shown.append(f"the recording {recording.written}")
    spec = Draft(name, draft, recording, folder)
    return FirstSpec(draft_text(spec, shown), spec.lacks_topics, findings)


def find_node(wanted: str, folder: Path) -> str:
    """Return a Python node of the command line as a spec in a folder names it.

    A path is relative to the current folder; ``PACKAGE:EXECUTABLE`` is the function of that script.

    An installed package counts before one whose source is in the work tree of the spec.

    Raises:
        UsageError: there is no such script.
    """
    package, colon, executable = wanted.partition(":")
    if colon and package.endswith(".py") and not package.startswith("/"):
        return f"{_written(package, folder)}{colon}{executable}"
    if not colon or "/" in package:
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


def _add_node(draft: DraftNodes, target: str, parameter_file: str, folder: Path) -> None:
    """Add a node, with what its source says of its state.

    Its name is its own, in the namespace in which the file has parameters of it.
    """
    interface, _ = read_source(target, folder)
    entry = Block.of({"python": target})
    if interface.is_lifecycle:
        entry.add("lifecycle", "active")
    key = node_key(target, interface.name)
    if parameter_file:
        content = read_parameter_file(Path(parameter_file))
        if content.missing or content.problem:
            what = content.problem or "does not exist"
            hint = "It is a file as for 'ros2 run ... --ros-args --params-file FILE'."
            raise UsageError(f"{parameter_file} {what}", hint=hint)
        if content.flat:
            above = [f"Those of {Path(parameter_file).name}, which names no node."]
            entry.add("parameters", Block.of(dict(content.nodes[0][1])), above)
        else:
            entry.add("parameters", _written(parameter_file, folder))
        if not content.matching(f"/r2b/{key}"):
            names = [
                name for name, _ in content.nodes if name.endswith(f"/{key}") and "*" not in name
            ]
            draft.is_absolute = bool(names)
            if names and (namespace := names[0].removesuffix(f"/{key}")):
                entry.add("namespace", namespace)
            if names[1:]:
                draft.unknown.append(f"which of {', '.join(names)} it is: the file names them all")
    draft.nodes.add(key, entry)


def _written(file: str, folder: Path) -> str:
    """Return a file as a spec in a folder names it."""
    relative = os.path.relpath(Path(file).expanduser().absolute(), folder.absolute())
    return relative if relative.startswith(".") else f"./{relative}"


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
        hint = "A path on the command line is relative to the current folder."
        raise UsageError(f"{os.path.relpath(python.file)} does not exist", hint=hint)
    try:
        names = top_level_names(python.file)
    except SyntaxError as error:
        raise UsageError(
            f"{python.file}:{error.lineno}: {error.msg}",
            hint="Correct it there: 'python3 -m py_compile' must accept it.",
        ) from error
    if names is not None and python.name not in names:
        tree = read_python_file(python.file)
        body = tree.body if tree is not None else []
        classes = [part.name for part in body if isinstance(part, ast.ClassDef)]
        raise UsageError(
            f"{python.file} has no class or function {python.name!r}",
            hint=f"Its classes: {', '.join(classes) or 'none'}.",
        )


def _recording(bag: str, folder: Path) -> DraftRecording:
    location = locate(bag, Path())
    written = location.dataset or _written(bag, folder)
    found = index(location)
    if not found.message_count:
        raise UsageError(
            f"{written} has no messages",
            hint="Record it again, or leave --from-bag out.",
            code="R2B321",
        )
    times = times_of_bag(location.path, found) if location.path is not None else None
    parts = find_parts(found, times or {})
    if parts is not None:
        return DraftRecording(written, parts.larger, parts.window, location.path)
    return DraftRecording(written, found, path=location.path)


class NoGraphError(R2bspecError):
    """The running graph cannot be inspected, or has no nodes."""

    code = "R2B601"
    way_out = "Start the graph in the same ROS_DOMAIN_ID; 'ros2 node list' must show its nodes."


def inspect_graph(timeout_s: float) -> list[dict[str, Any]]:
    """Return the nodes of the graph in the ROS domain of this environment.

    Args:
        timeout_s: how long to wait for the first node.

    Raises:
        UsageError: ROS 2 is not installed, or there are no nodes.
        NoGraphError: the inspection failed.
    """
    if importlib.util.find_spec("rclpy") is None:
        raise UsageError(
            "ROS 2 is not installed, so there is no graph to read",
            hint="Source ROS 2, or describe the nodes with --from-launch or --node.",
            code="R2B620",
        )
    domain_of_user()
    with temporary_folder("graph") as scratch:
        target = scratch / "graph.json"
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
        draft.nodes.add(key, _entry(node))
    draft.is_absolute = True
    started = (
        "how the nodes are started: they are external here, so they must run before a benchmark; "
        "replace 'external' by their package, plugin, executable or launch file"
    )
    names = "their remappings: ROS shows the names of topics after remapping only"
    draft.unknown += [started, names]


def _entry(node: dict[str, Any]) -> Block:
    def listed(side: str) -> dict[str, Any]:
        """Return the topics of one side that are the node's own."""
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
