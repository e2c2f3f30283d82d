"""The entries of a spec that start something, from the actions of a script or a launch file.

A node has its name as key, if that is free; an unknown value is a placeholder with a comment.
Containers are written if nodes of the spec are in them. Preprocessors have a container of their
own, because they end before anything is measured. Steps around the launch are ``setup``, ``ready``
and ``after_ready``.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import Any, Final

from r2bspec.interop.recording import (
    ContainerAction,
    IncludeAction,
    Member,
    NodeAction,
    Place,
    Process,
)
from r2bspec.interop.spec_text import Block, SpecValues, identifier, unique_name
from r2bspec.language.names import NODE_NAME, PARAMETER, TOPIC
from r2bspec.plan.command_lines import THREADED_CONTAINER, flow_yaml
from r2bspec.plan.process_plans import HARNESS_PROCESS_NAMES

_PREPROCESSING: Final = "preprocessing"
_DEFAULT_CONTAINER: Final = "component_container_mt"
_ROS_ARGUMENTS: Final = "--ros-args"
_SETUP_TIMEOUT: Final = "30 min"
_SHARE_FILE: Final = re.compile(r"\$\(share (?P<package>\w+)\)/(?P<file>[^$]+)")
_HARNESS_OUTSIDE: Final = (
    "In the script, the player and the monitors are in this container, too; here they are not."
)


@dataclass(slots=True)
class NodeWriter:
    """Writes nodes as entries of a spec.

    Attributes:
        keys: the names that are used.
    """

    values: SpecValues
    keys: set[str] = field(default_factory=set)

    def __post_init__(self) -> None:
        self.keys |= {*HARNESS_PROCESS_NAMES, "system"}

    def add_all(
        self, block: Block, members: list[Member], *, preprocessors: bool = False
    ) -> list[tuple[NodeAction, Block]]:
        """Add nodes and included launch files to a map of nodes, and return the entry of each."""
        nodes = []
        for member in members:
            above = self.values.comments_above(member.place)
            if isinstance(member, IncludeAction):
                block.add(self._include_key(member), self._include(member), above)
            else:
                node = self._node(member, _PREPROCESSING if preprocessors else member.container)
                block.add(self._key(member), node, above)
                nodes.append((member, node))
        return nodes

    def add_containers(
        self,
        block: Block,
        kinds: list[ContainerAction],
        graph: list[Member],
        preprocessors: list[Member],
        harness: list[NodeAction],
    ) -> None:
        """Add the containers that nodes of the spec use, and reserve the names of the graph's.

        Args:
            block: the map of containers.
            kinds: all containers.
            graph: the nodes of the graph.
            preprocessors: those that run before.
            harness: player and monitors, which are outside of containers here.
        """
        known = {container.name: container for container in kinds}
        used = {node.container for node in _components(graph)}
        in_order = [name for name in known if name in used]
        for name in [*in_order, *sorted(used - known.keys())]:
            shared = any(node.container == name for node in harness)
            above = [_HARNESS_OUTSIDE] if shared else []
            block.add(identifier(name), self._container(known.get(name)), above)
        first = _components(preprocessors)[:1]
        for node in first:
            block.add(_PREPROCESSING, self._container(known.get(node.container)))
        self.keys |= {identifier(name) for name in used}
        loaded = {node.container for node in (*_components(graph), *_components(preprocessors))}
        for name in known.keys() - loaded - {node.container for node in harness}:
            what = f"no node is loaded into the container {name!r}, so it is left out"
            self.values.change(what, known[name].place)

    def _container(self, container: ContainerAction | None) -> dict[str, Any]:
        """Return the keys of a container.

        With one that is started elsewhere, those of a usual one.
        """
        if container is None:
            return {"executable": _DEFAULT_CONTAINER}
        keys: dict[str, Any] = {"executable": container.executable}
        words = list(container.arguments)
        if THREADED_CONTAINER in words:
            keys["executor"] = "multi_threaded"
            words.remove(THREADED_CONTAINER)
        for source in container.parameters:
            if isinstance(source, str):
                words += [_ROS_ARGUMENTS, "--params-file", source]
                continue
            threads = source.pop("thread_num", 0)
            keys |= {"threads": threads} if threads else {}
            for name, value in source.items():
                words += [_ROS_ARGUMENTS, "-p", f"{name}:={flow_yaml(value)}"]
        for old, new in container.remappings:
            words += [_ROS_ARGUMENTS, "-r", f"{old}:={new}"]
        if words:
            keys["arguments"] = [self.values.text(word) for word in words]
        return keys | self._process(container)

    def _process(self, process: Process) -> dict[str, Any]:
        """Return the keys of a process that an action sets."""
        keys: dict[str, Any] = {}
        if process.prefix:
            keys["prefix"] = [self.values.text(word) for word in process.prefix]
        if process.environment:
            keys["env"] = self.values.convert(process.environment)
        return keys

    def _key(self, node: NodeAction) -> str:
        name = self.values.text(node.name)
        key = name if re.search(NODE_NAME.pattern, name) else identifier(name)
        if key in self.keys and node.namespace not in {"", self.values.namespace}:
            key = f"{identifier(node.namespace)}_{key}"
        key = unique_name(key, self.keys)
        if key != node.name:
            self.values.change(
                f"{name!r} is the name of another node of the script, too, or no valid "
                f"name of a node: here it is {key!r}, and its private topics (~/) change",
                node.place,
            )
        return key

    def _include_key(self, include: IncludeAction) -> str:
        stem = include.name
        for end in (".py", ".xml", ".yaml", ".yml", ".launch", ".include"):
            stem = stem.removesuffix(end)
        return unique_name(identifier(stem), self.keys)

    def _node(self, node: NodeAction, container: str) -> Block:
        block = Block()
        if node.command:
            block.add("command", [self.values.text(word) for word in node.command])
        for key in ("package", "plugin", "executable"):
            block.add(key, self.values.text(getattr(node, key)) or None)
        if node.plugin:
            extra = dict(node.extra_arguments)
            block.add("container", identifier(container))
            block.add("intra_process", extra.pop("use_intra_process_comms", None) or None)
            block.add("extra_arguments", self._map(extra, node.place))
        namespace = node.namespace or ("/" if not node.command else self.values.namespace)
        if namespace != self.values.namespace:
            block.add("namespace", self.values.text(namespace))
        if node.arguments and not node.command:
            block.add("arguments", [self.values.text(word) for word in node.arguments])
        block.add("lifecycle", node.lifecycle or None)
        self._parameters(block, node)
        self._remappings(block, node.remappings, node.place)
        block.add_all(self._process(node))
        block.below += self.values.take_doubts()
        return block

    def _include(self, include: IncludeAction) -> Block:
        launch = Block()
        in_share = _SHARE_FILE.fullmatch(include.path)
        if in_share:
            launch.add_all({"package": in_share["package"], "file": in_share["file"]})
        else:
            launch.add("path", self.values.text(include.path))
        launch.add("arguments", self._map(include.arguments, include.place))
        launch.below += self.values.take_doubts()
        block = Block()
        block.add("launch", launch)
        if include.namespace and include.namespace != self.values.namespace:
            block.add("namespace", include.namespace)
        self._remappings(block, include.remappings, include.place)
        block.add_all(self._process(Process(include.environment)))
        return block

    def _parameters(self, block: Block, node: NodeAction) -> None:
        sources: list[Any] = []
        for source in node.parameters:
            if isinstance(source, dict):
                values = self._map(_flat(source), node.place)
                sources += [values] if values else []
            else:
                sources.append(self.values.text(source))
        doubts = self.values.take_doubts()
        if len(sources) == 1:
            block.add("parameters", sources[0], doubts)
        elif sources:
            maps = [Block.of(each) if isinstance(each, dict) else each for each in sources]
            block.add("parameters", maps, doubts)

    def _map(self, values: dict[str, Any], place: Place) -> dict[str, Any]:
        """Return the values of a map that have a form in a spec, with notes about the others."""
        converted: dict[str, Any] = {}
        for key, value in values.items():
            if not re.search(PARAMETER.pattern, key) or value is None:
                what = f"{key!r} is left out: {'None' if value is None else 'its name'}"
                self.values.lose(f"{what} has no form in a spec", place)
            else:
                converted[key] = self.values.convert(value)
        return converted

    def _remappings(self, block: Block, pairs: list[tuple[str, str]], place: Place) -> None:
        targets: dict[str, str] = {}
        for source, target in pairs:
            names = (self.values.text(source), self.values.text(target))
            if not all(re.search(TOPIC.pattern, name) for name in names):
                self.values.lose(f"{source!r} to {target!r} is no remapping of topics", place)
            elif source != target:
                targets.setdefault(*names)  # ROS applies the first that matches
        block.add("remappings", targets)


def _components(members: list[Member]) -> list[NodeAction]:
    return [member for member in members if isinstance(member, NodeAction) and member.plugin]


def _flat(values: dict[Any, Any], above: str = "") -> dict[str, Any]:
    """Nested parameters with dots in their names."""
    flat: dict[str, Any] = {}
    for key, value in values.items():
        name = f"{above}{key}"
        if isinstance(value, dict) and value:
            flat |= _flat(value, f"{name}.")
        else:
            flat[name] = value
    return flat


def add_steps(body: Block, values: SpecValues) -> None:
    """Add ``setup``, ``ready`` and ``after_ready`` to the keys of a spec."""
    blocks = {"setup": Block(), "ready": Block(), "after_ready": Block()}
    waited: set[str] = set()
    for step in values.recorded.steps:
        block, above = blocks[step.kind], values.comments_above(step.place)
        if step.kind == "ready":
            file = values.text(step.file)
            if file in waited:
                continue
            waited.add(file)
            entry = Block.of({"file": file, "timeout": _SETUP_TIMEOUT})
        elif step.kind == "after_ready":
            entry = Block.of({"service": values.convert(step.service)})
        else:
            entry = Block.of({"command": [values.text(word) for word in step.command]})
            entry.add("creates", values.text(step.creates) if step.creates else None)
            if step.creates and step.command[0] not in {"mkdir", "cp"}:
                entry.add("timeout", _SETUP_TIMEOUT)
        name = unique_name(identifier(step.key), {entry.key for entry in block.entries})
        block.add(name, entry, [*above, *values.take_doubts()])
    for key, block in blocks.items():
        body.add(key, block)
