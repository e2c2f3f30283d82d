"""The nodes and containers of a spec, from the actions of a script or a launch file.

A node has the key of its name, if that is free; its values are converted one by one, and a value
without a form in a spec is a comment at its place. Containers are written as far as nodes of the
spec are in them. Preprocessors have one of their own, because they end before anything is measured.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from r2bspec.diagnostics import Span
from r2bspec.interop.script_import.launch_actions import (
    IncludeAction,
    Member,
    NodeAction,
    Remapping,
)
from r2bspec.interop.script_import.spec_text import Block, SpecValues, identifier, unique_name
from r2bspec.interop.script_import.values import NotKnownError, PlacedDict, Unknown, check_size
from r2bspec.language.names import NODE_NAME, PARAMETER, TOPIC

_PREPROCESSING: Final = "preprocessing"
_DEFAULT_CONTAINER: Final = "component_container_mt"
_HARNESS_OUTSIDE: Final = (
    "In the script, the player and the monitors are in this container, too; here they are not."
)
_MAX_NESTING: Final = 20


@dataclass(slots=True)
class NodeWriter:
    """Writes nodes as entries of a spec.

    Attributes:
        keys: the names that are used.
    """

    values: SpecValues
    keys: set[str] = field(default_factory=set)

    def add_all(self, block: Block, members: list[Member], *, preprocessors: bool = False) -> None:
        """Add nodes and included launch files to a map of nodes."""
        for member in members:
            above = self.values.comments.at(member.source.place)
            if isinstance(member, IncludeAction):
                block.add(self._include_key(member), self._include(member), above)
            else:
                node = self._node(member, _PREPROCESSING if preprocessors else member.container)
                block.add(self._key(member), node, above)

    def add_containers(
        self,
        block: Block,
        kinds: Mapping[str, str],
        graph: list[Member],
        preprocessors: list[Member],
        harness: list[NodeAction],
    ) -> None:
        """Add the containers that nodes of the spec use, and reserve the names of the graph's.

        Args:
            block: the map of containers.
            kinds: the executables of all containers, by name.
            graph: the nodes of the graph.
            preprocessors: those that run before.
            harness: player and monitors, which are outside of containers here.
        """
        used = {node.container for node in _components(graph)}
        order = list(kinds).index if used <= set(kinds) else None
        for name in sorted(used, key=order):
            shared = any(node.container == name for node in harness)
            kind = kinds.get(name, _DEFAULT_CONTAINER)
            block.add(name, {"executable": kind}, [_HARNESS_OUTSIDE] if shared else [])
        for node in _components(preprocessors)[:1]:
            kind = kinds.get(node.container, _DEFAULT_CONTAINER)
            block.add(_PREPROCESSING, {"executable": kind})
        self.keys |= used

    def _key(self, node: NodeAction) -> str:
        key = node.name if re.search(NODE_NAME.pattern, node.name) else identifier(node.name)
        if key in self.keys and node.namespace not in {"", self.values.namespace}:
            key = f"{identifier(node.namespace)}_{key}"
        key = unique_name(key, self.keys)
        if key != node.name:
            self.values.change(
                f"{node.name!r} is the name of another node of the script, too, or no valid "
                f"name of a node: here it is {key!r}, and its private topics (~/) change",
                node.source.place_of("name"),
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
        block.add("package", node.package or None)
        block.add("plugin", node.plugin or None)
        block.add("executable", node.executable or None)
        if node.plugin:
            block.add("container", container)
        namespace = node.namespace or ("/" if not node.command else self.values.namespace)
        if namespace != self.values.namespace:
            block.add("namespace", namespace)
        if node.arguments and not node.command:
            block.add("arguments", [self.values.text(word) for word in node.arguments])
        self._parameters(block, node)
        self._remappings(block, node.remappings)
        return block

    def _include(self, include: IncludeAction) -> Block:
        launch = Block()
        launch.add("package", include.package or None)
        launch.add("file", include.file or None)
        launch.add("path", self.values.text(include.path) if include.path else None)
        place = include.source.place_of("launch_arguments")
        arguments = self._map(include.arguments, place, launch.below)
        texts = {
            key: str(value) if isinstance(value, list | dict) else value
            for key, value in arguments.items()
        }
        launch.add("arguments", texts)
        block = Block()
        block.add("launch", launch)
        if include.namespace and include.namespace != self.values.namespace:
            block.add("namespace", include.namespace)
        self._remappings(block, include.remappings)
        return block

    def _parameters(self, block: Block, node: NodeAction) -> None:
        place = node.source.place_of("parameters")
        sources: list[Any] = []
        lost: list[str] = []
        for source in node.parameters:
            if isinstance(source, dict):
                check_size(source)
                values = self._map(_flat(source), place, lost)
                sources += [values] if values else []
            elif isinstance(source, str):
                sources.append(self.values.text(source))
            else:
                self._lose("a parameter source", source, place, lost)
        if len(sources) == 1:
            block.add("parameters", sources[0], lost)
        elif sources:
            block.add("parameters", [_as_block(source) for source in sources], lost)
        else:
            block.below += lost

    def _map(self, values: dict[str, Any], place: Span, lost: list[str]) -> dict[str, Any]:
        """The values of a map that have a form in a spec; `lost` gets comments about the others."""
        converted: dict[str, Any] = {}
        places = values.places if isinstance(values, PlacedDict) else {}
        for key, value in values.items():
            if not re.search(PARAMETER.pattern, str(key)):
                self._lose(f"{key!r}, which is no name of a parameter", value, place, lost)
                continue
            try:
                converted[key] = self.values.convert(value, places.get(key, place))
            except NotKnownError as error:
                unknown = error.unknown(place)
                lost.append(f"not imported: {key} (line {unknown.place.line}: {unknown.reason})")
                self.values.lose(f"{key!r} is left out: {unknown.reason}", unknown.place)
        return converted

    def _lose(self, what: str, value: Any, place: Span, lost: list[str]) -> None:
        reason = value.reason if isinstance(value, Unknown) else "it has no form in a spec"
        place = value.place if isinstance(value, Unknown) else place
        lost.append(f"not imported: {what} (line {place.line}: {reason})")
        self.values.lose(f"{what} is left out: {reason}", place)

    def _remappings(self, block: Block, remappings: list[Remapping]) -> None:
        targets: dict[str, str] = {}
        for remapping in remappings:
            source, target = remapping.source, remapping.target
            if not all(re.search(TOPIC.pattern, name) for name in (source, target)):
                reason = f"{source!r} to {target!r} is no remapping of topics"
                self.values.lose(reason, remapping.place)
            elif source != target:
                targets.setdefault(source, target)  # ROS applies the first that matches
        block.add("remappings", targets)


def _components(members: list[Member]) -> list[NodeAction]:
    return [member for member in members if isinstance(member, NodeAction) and member.plugin]


def _flat(values: dict[Any, Any], above: str = "") -> dict[str, Any]:
    """Nested parameters with dots in their names."""
    if not above and not any(isinstance(value, dict) for value in values.values()):
        return values
    flat: dict[str, Any] = {}
    for key, value in values.items():
        name = f"{above}{key}"
        if isinstance(value, dict) and value and name.count(".") < _MAX_NESTING:
            flat |= _flat(value, f"{name}.")
        else:
            flat[name] = value
    return flat


def _as_block(value: Any) -> Any:
    if not isinstance(value, dict):
        return value
    block = Block()
    for key, item in value.items():
        block.add(key, item)
    return block
