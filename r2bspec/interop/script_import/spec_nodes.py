"""The nodes and containers of a spec, from the actions of a script."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import Any

from r2bspec.interop.script_import.evaluator import Note
from r2bspec.interop.script_import.launch_actions import (
    ContainerAction,
    IncludeAction,
    NodeAction,
    Remapping,
)
from r2bspec.interop.script_import.script_comments import ScriptComments
from r2bspec.interop.script_import.script_values import Construct, Place, PlacedDict, Unknown
from r2bspec.interop.script_import.spec_values import (
    NoValueError,
    SpecValues,
    identifier,
    unique_name,
)
from r2bspec.interop.script_import.yaml_writer import Block
from r2bspec.language.names import NODE_NAME, PARAMETER, TOPIC

PREPROCESSING = "preprocessing"
"""The container of the preprocessors, which end before anything is measured."""


HARNESS_OUTSIDE = (
    "In the script, the player and the monitors are in this container, too; here they are not."
)


@dataclass(slots=True)
class NodeWriter:
    """Writes nodes as entries of a spec.

    Attributes:
        namespace: of the benchmark, absolute.
        file: the script; comments are those of this file.
        notes: what has no form in the spec.
        changes: what the spec says in another way.
        keys: the names that are used.
    """

    values: SpecValues
    comments: ScriptComments
    namespace: str
    file: Any
    notes: list[Note]
    changes: list[Note]
    keys: set[str] = field(default_factory=set)

    def add_all(
        self, block: Block, actions: list[NodeAction | IncludeAction], containers: set[str] | None
    ) -> None:
        """Add nodes to a map of nodes.

        Args:
            block: the map.
            actions: the nodes and included launch files.
            containers: the containers of the spec; None for preprocessors, which have their own.
        """
        for each in actions:
            above = self.comments_of(each.source)
            if isinstance(each, IncludeAction):
                block.add(self._include_key(each), self._include(each), above)
            else:
                block.add(self._key(each), self._node(each, containers), above)

    def comments_of(self, source: Construct) -> list[str]:
        """The author's comments above a construct of the script."""
        return self.comments.at(source.place.line) if source.place.file == self.file else []

    def _key(self, node: NodeAction) -> str:
        key = node.name if re.search(NODE_NAME.pattern, node.name) else identifier(node.name)
        made = key
        if key in self.keys and node.namespace not in {"", self.namespace}:
            made = f"{identifier(node.namespace)}_{key}"
        made = unique_name(made, self.keys)
        if made != node.name:
            self.changes.append(
                Note(
                    f"{node.name!r} is the name of another node of the script, too, or no valid "
                    f"name of a node: here it is {made!r}, and its private topics (~/) change",
                    node.source.place_of("name"),
                )
            )
        return made

    def _include_key(self, include: IncludeAction) -> str:
        stem = (include.file or include.path).rpartition("/")[2]
        for end in (".py", ".xml", ".yaml", ".yml", ".launch", ".include"):
            stem = stem.removesuffix(end)
        return unique_name(identifier(stem), self.keys)

    def _node(self, node: NodeAction, containers: set[str] | None) -> Block:
        block = Block()
        if node.command:
            block.add("command", [self.values.text(each) for each in node.command])
        block.add("package", node.package or None)
        block.add("plugin", node.plugin or None)
        block.add("executable", node.executable or None)
        if node.plugin:
            container = PREPROCESSING if containers is None else node.container
            block.add("container", container)
        namespace = node.namespace or ("/" if not node.command else self.namespace)
        if namespace != self.namespace:
            block.add("namespace", namespace)
        if node.arguments and not node.command:
            block.add("arguments", [self.values.text(each) for each in node.arguments])
        self._parameters(block, node)
        self._remappings(block, node.remappings)
        return block

    def _include(self, include: IncludeAction) -> Block:
        launch = Block()
        launch.add("package", include.package or None)
        launch.add("file", include.file or None)
        launch.add("path", self.values.text(include.path) if include.path else None)
        arguments, lost = self._map(include.arguments, include.source.place_of("launch_arguments"))
        launch.add("arguments", {key: _launch_text(each) for key, each in arguments.items()})
        launch.below += lost
        block = Block()
        block.add("launch", launch)
        if include.namespace and include.namespace != self.namespace:
            block.add("namespace", include.namespace)
        self._remappings(block, include.remappings)
        return block

    def _parameters(self, block: Block, node: NodeAction) -> None:
        place = node.source.place_of("parameters")
        sources: list[Any] = []
        lost: list[str] = []
        for each in node.parameters:
            if isinstance(each, dict):
                values, missing = self._map(_flat(each), place)
                lost += missing
                if values:
                    sources.append(values)
            elif isinstance(each, str):
                sources.append(self.values.text(each))
            else:
                self._lose(each, "a parameter source", place, lost)
        above = lost
        if len(sources) == 1:
            block.add("parameters", sources[0], above)
        elif sources:
            block.add("parameters", [_source(each) for each in sources], above)
        else:
            block.below += lost

    def _map(self, values: dict[str, Any], place: Place) -> tuple[dict[str, Any], list[str]]:
        """The values of a map that have a form in a spec, and comments about the others."""
        found: dict[str, Any] = {}
        lost: list[str] = []
        for key, value in values.items():
            if not re.search(PARAMETER.pattern, str(key)):
                self._lose(value, f"{key!r}, which is no name of a parameter", place, lost)
                continue
            places = values.places if isinstance(values, PlacedDict) else {}
            try:
                found[key] = self.values.convert(value, places.get(key, place))
            except NoValueError as error:
                where = error.note.place
                lost.append(f"not imported: {key} (line {where.line}: {error.note.message})")
                self.notes.append(Note(f"{key!r} is left out: {error.note.message}", where))
        return found, lost

    def _lose(self, value: Any, what: str, place: Place, lost: list[str]) -> None:
        reason = value.reason if isinstance(value, Unknown) else "it has no form in a spec"
        where = value.place if isinstance(value, Unknown) else place
        lost.append(f"not imported: {what} (line {where.line}: {reason})")
        self.notes.append(Note(f"{what} is left out: {reason}", where))

    def _remappings(self, block: Block, remappings: list[Remapping]) -> None:
        found: dict[str, str] = {}
        for each in remappings:
            names = (each.source, each.target)
            if not all(re.search(TOPIC.pattern, name) for name in names):
                self.notes.append(
                    Note(
                        f"{each.source!r} to {each.target!r} is no remapping of topics", each.place
                    )
                )
            elif each.source != each.target:
                found.setdefault(each.source, each.target)  # ROS applies the first that matches
        block.add("remappings", found)


def containers_of(
    block: Block,
    containers: list[ContainerAction],
    graph: list[NodeAction | IncludeAction],
    preprocessors: list[NodeAction | IncludeAction],
    harness: list[NodeAction],
) -> set[str]:
    """Add the containers that nodes of the spec use; returns the names of those of the graph."""
    used = {each.container for each in graph if isinstance(each, NodeAction) and each.plugin}
    kinds = {each.name: each.executable for each in containers}
    for name in sorted(used, key=list(kinds).index) if used <= set(kinds) else sorted(used):
        shared = any(each.container == name for each in harness)
        block.add(
            name,
            {"executable": kinds.get(name, "component_container_mt")},
            [HARNESS_OUTSIDE] if shared else [],
        )
    components = [each for each in preprocessors if isinstance(each, NodeAction) and each.plugin]
    if components:
        kind = kinds.get(components[0].container, "component_container_mt")
        block.add(PREPROCESSING, {"executable": kind})
    return used


def _flat(values: dict[Any, Any], above: str = "") -> dict[str, Any]:
    """Nested parameters with dots in their names."""
    if not any(isinstance(each, dict) for each in values.values()) and not above:
        return values
    found: dict[str, Any] = {}
    for key, value in values.items():
        name = f"{above}{key}"
        if isinstance(value, dict) and value and name.count(".") < 20:
            found |= _flat(value, f"{name}.")
        else:
            found[name] = value
    return found


def _source(value: Any) -> Any:
    if not isinstance(value, dict):
        return value
    block = Block()
    for key, each in value.items():
        block.add(key, each)
    return block


def _launch_text(value: Any) -> Any:
    return str(value) if isinstance(value, list | dict) else value
