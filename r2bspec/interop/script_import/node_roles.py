"""Which nodes of a script belong to the harness, to the preprocessors, and to the graph.

ros2_benchmark runs all of them at once, so its scripts do not say. What decides, in this order: a
topic of the loader or a buffer of the player, or a topic that is played or monitored; the lists in
the docstring and names that begin with ``Prep``; topics shared with nodes that are decided.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field

from r2bspec.interop.script_import.known_topics import default_topics
from r2bspec.interop.script_import.launch_actions import (
    IncludeAction,
    LaunchParts,
    NodeAction,
)

HARNESS_PACKAGES = frozenset({"ros2_benchmark", "isaac_ros_benchmark"})
_HEADING = re.compile(r"preprocessors?|graph under test|required|packages|datasets", re.IGNORECASE)


@dataclass(slots=True)
class ScriptGraph:
    """The actions of a script by their roles.

    Attributes:
        undecided: members of the graph of which nothing tells that they are no preprocessors.
    """

    loader: NodeAction | None = None
    player: NodeAction | None = None
    monitors: list[NodeAction] = field(default_factory=list)
    preprocessors: list[NodeAction | IncludeAction] = field(default_factory=list)
    graph: list[NodeAction | IncludeAction] = field(default_factory=list)
    undecided: list[NodeAction | IncludeAction] = field(default_factory=list)
    further: list[NodeAction] = field(default_factory=list)


def divide_by_role(parts: LaunchParts, docstring: str, namespace: str) -> ScriptGraph:
    """The actions by their roles.

    Args:
        parts: all actions of the script.
        docstring: that of the script, whose lists of nodes are read.
        namespace: of the benchmark, absolute.
    """
    found = ScriptGraph()
    others: list[NodeAction | IncludeAction] = []
    for node in parts.nodes:
        kind = _harness_part(node)
        if kind == "monitor":
            found.monitors.append(node)
        elif kind == "loader" and found.loader is None:
            found.loader = node
        elif kind == "player" and found.player is None:
            found.player = node
        elif kind:
            found.further.append(node)
        else:
            others.append(node)
    others += parts.includes
    if found.player is None:
        found.graph = others
        return found
    roles = _Roles(found, found.player, others, docstring, namespace).decide()
    for each in others:
        role = roles.get(id(each))
        (found.preprocessors if role == "preprocessor" else found.graph).append(each)
        if role is None:
            found.undecided.append(each)
    return found


def topic_in(namespace: str, topic: str) -> str:
    """The absolute name of a topic."""
    if topic.startswith("/"):
        return topic
    return f"{namespace.rstrip('/')}/{topic}"


def remapped(node: NodeAction, source: str, default: str = "") -> str:
    """What a node calls `source` in the graph; by default itself."""
    for each in node.remappings:
        if each.source.lstrip("/") == source:
            return each.target
    return default or source


def input_numbers(player: NodeAction) -> list[int]:
    """The numbers of the inputs that the player has remappings for."""
    found = set()
    for each in player.remappings:
        match = re.fullmatch(r"/?(?:buffer/)?input(\d{1,3})", each.source)
        if match:
            found.add(int(match[1]))
    return sorted(found)


def _harness_part(node: NodeAction) -> str:
    if node.package not in HARNESS_PACKAGES:
        return ""
    last = node.plugin.rpartition("::")[2]
    for end, part in (
        ("DataLoaderNode", "loader"),
        ("PlaybackNode", "player"),
        ("MonitorNode", "monitor"),
    ):
        if last.endswith(end):
            return part
    return ""


class _Roles:
    def __init__(
        self,
        found: ScriptGraph,
        player: NodeAction,
        others: list[NodeAction | IncludeAction],
        docstring: str,
        namespace: str,
    ) -> None:
        loader = found.loader
        self.others = others
        self.namespace = namespace
        numbers = input_numbers(player)
        buffers = {self._topic(remapped(player, f"buffer/input{n}"), player) for n in numbers}
        played = {self._topic(remapped(player, f"input{n}"), player) for n in numbers}
        loaded = (
            {self._topic(each.target, loader) for each in loader.remappings} if loader else set()
        )
        watched = {
            self._topic(each.target, one) for one in found.monitors for each in one.remappings
        }
        self.before = (loaded | buffers) - played
        self.after = played | watched
        self.sections = _sections(docstring)

    def decide(self) -> dict[int, str]:
        topics = {id(each): self._topics(each) for each in self.others}
        roles: dict[int, str] = {}
        for each in self.others:
            role = self._by_topics(topics[id(each)]) or self._by_text(each)
            if role:
                roles[id(each)] = role
        for _ in self.others:
            if not self._spread(roles, topics):
                break
        return roles

    def _topic(self, topic: str, node: NodeAction) -> str:
        return topic_in(node.namespace or self.namespace, topic)

    def _topics(self, each: NodeAction | IncludeAction) -> set[str]:
        namespace = each.namespace or self.namespace
        found = {topic_in(namespace, one.target) for one in each.remappings}
        if isinstance(each, IncludeAction):
            values = (one for one in each.arguments.values() if isinstance(one, str) and one)
            return found | {topic_in(namespace, one) for one in values}
        own = {one.source.lstrip("/") for one in each.remappings}
        defaults = (one for one in default_topics(each.plugin) if one not in own)
        return found | {topic_in(namespace, one) for one in defaults}

    def _by_topics(self, topics: set[str]) -> str:
        before, after = bool(topics & self.before), bool(topics & self.after)
        if before == after:
            return ""
        return "preprocessor" if before else "graph"

    def _by_text(self, each: NodeAction | IncludeAction) -> str:
        name = each.name if isinstance(each, NodeAction) else each.file.rpartition("/")[2]
        if name.lower().startswith("prep"):
            return "preprocessor"
        last = each.plugin.rpartition("::")[2] if isinstance(each, NodeAction) else ""
        for wanted in filter(None, (name, last)):
            places = [role for role, text in self.sections.items() if wanted in text]
            if len(places) == 1:
                return places[0]
        return ""

    def _spread(self, roles: dict[int, str], topics: dict[int, set[str]]) -> bool:
        """Give an undecided member the role of all that it shares a topic with."""
        changed = False
        for each in self.others:
            if id(each) in roles:
                continue
            near = {
                roles[id(one)]
                for one in self.others
                if id(one) in roles and topics[id(one)] & topics[id(each)]
            }
            if len(near) == 1:
                roles[id(each)] = near.pop()
                changed = True
        return changed


def _sections(docstring: str) -> dict[str, str]:
    """The parts of a docstring that list preprocessors and the nodes under test."""
    found = {"preprocessor": "", "graph": ""}
    current = ""
    for line in docstring.splitlines():
        heading = _HEADING.search(line) if line.rstrip().endswith(":") else None
        if heading:
            word = heading[0].lower()
            current = (
                "preprocessor" if word.startswith("prep") else "graph" if "graph" in word else ""
            )
        elif current:
            found[current] += line + "\n"
    return found
