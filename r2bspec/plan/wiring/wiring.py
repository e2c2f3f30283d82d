"""The wiring of a spec: every known publisher and subscription of every topic, as values."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from operator import attrgetter
from typing import Literal

import msgspec

from r2bspec.diagnostics.diagnostic import Path
from r2bspec.language.spec import Node, ParameterValue, QoS
from r2bspec.plan.wiring.name_resolution import Remapper, expand
from r2bspec.plan.wiring.node_interface import Interface
from r2bspec.plan.wiring.python_source import KEYWORDS, NodeStart

Phase = Literal["preprocess", "measure"]
ProcessRole = Literal["host", "container", "command"]


class NodeWiring(msgspec.Struct, frozen=True):
    """A node of the spec with its resolved names.

    Attributes:
        key: its key in the spec, which is also its ROS name.
        name: full name, such as ``/r2b/apriltag``.
        path: its place in the spec.
        names: how the names of its topics are resolved.
        is_ros_process: False for a command without settings that are specific to ROS.
        parameters: its parameters, merged from all files and values.
        start: how a Python node is started.
    """

    key: str
    name: str
    namespace: str
    path: Path
    node: Node
    names: Remapper
    interface: Interface
    is_ros_process: bool = True
    parameters: Mapping[str, ParameterValue] = msgspec.field(default_factory=dict)
    start: NodeStart = KEYWORDS

    @property
    def role(self) -> ProcessRole | None:
        """The role of its process, as in `NodeKind`."""
        return self.node.kind.role

    @property
    def shares_process(self) -> bool:
        """Whether it can run in one process with other nodes."""
        return self.node.kind.shares_process and not self.start.needs_own_process


class WiredEndpoint(msgspec.Struct, frozen=True):
    """A publisher or a subscription of a topic.

    Attributes:
        owner: the full name of a node, or the part of the harness.
        topic: full name.
        type: such as ``sensor_msgs/msg/Image``; empty if unknown.
        path: the place in the spec that decides its topic.
        topic_is_key: whether the topic is the key at that place, rather than the value.
        own_name: the name of the topic in the code of the node; empty for the harness.
        type_path: the place in the spec that sets the type; empty if it comes from elsewhere.
        type_parameter: the parameter of the node that decides the type; empty if none does.
        monitor: the name of the monitor, for the endpoint of a monitor.
        qos: its QoS profile; None if unknown.
        qos_path: the place in the spec that sets the profile; empty if it comes from elsewhere.
    """

    owner: str
    is_publisher: bool
    topic: str
    type: str
    path: Path
    topic_is_key: bool = False
    own_name: str = ""
    type_path: Path = ()
    type_parameter: str = ""
    monitor: str = ""
    qos: QoS | None = None
    qos_path: Path = ()

    @property
    def is_node(self) -> bool:
        """Whether a node of the spec owns it, rather than the harness."""
        return self.owner.startswith("/")


_TOPIC = attrgetter("topic")


def _grouped(
    endpoints: Iterable[WiredEndpoint], key: Callable[[WiredEndpoint], str]
) -> dict[str, tuple[WiredEndpoint, ...]]:
    groups: dict[str, list[WiredEndpoint]] = {}
    for endpoint in endpoints:
        groups.setdefault(key(endpoint), []).append(endpoint)
    return {name: tuple(group) for name, group in groups.items()}


@dataclass(frozen=True)
class PhaseWiring:
    """The nodes and endpoints of one phase."""

    phase: Phase
    nodes: tuple[NodeWiring, ...]
    endpoints: tuple[WiredEndpoint, ...]

    @cached_property
    def _publishers(self) -> dict[str, tuple[WiredEndpoint, ...]]:
        return _grouped((end for end in self.endpoints if end.is_publisher), _TOPIC)

    @cached_property
    def _subscriptions(self) -> dict[str, tuple[WiredEndpoint, ...]]:
        return _grouped((end for end in self.endpoints if not end.is_publisher), _TOPIC)

    @cached_property
    def _by_owner(self) -> dict[str, tuple[WiredEndpoint, ...]]:
        return _grouped(self.endpoints, attrgetter("owner"))

    @cached_property
    def topics(self) -> tuple[str, ...]:
        """Every known topic, sorted."""
        return tuple(sorted(self._publishers.keys() | self._subscriptions.keys()))

    def publishers(self, topic: str) -> tuple[WiredEndpoint, ...]:
        """The known publishers of a topic."""
        return self._publishers.get(topic, ())

    def subscriptions(self, topic: str) -> tuple[WiredEndpoint, ...]:
        """The known subscriptions of a topic."""
        return self._subscriptions.get(topic, ())

    @cached_property
    def _by_name(self) -> dict[str, NodeWiring]:
        return {node.name: node for node in self.nodes}

    def node(self, owner: str) -> NodeWiring | None:
        """The node with that full name; None for a part of the harness."""
        return self._by_name.get(owner)

    def endpoints_of(self, owner: str) -> tuple[WiredEndpoint, ...]:
        """The endpoints of a node or of a part of the harness."""
        return self._by_owner.get(owner, ())

    @cached_property
    def possible_publishers(self) -> tuple[NodeWiring, ...]:
        """Nodes that may publish any topic, because their publishers are not all known."""
        return tuple(node for node in self.nodes if not node.interface.publishes_all)

    @cached_property
    def possible_subscribers(self) -> tuple[NodeWiring, ...]:
        """Nodes that may subscribe to any topic, because their subscriptions are not all known."""
        return tuple(node for node in self.nodes if not node.interface.subscribes_all)

    def downstream_of(self, topics: Iterable[str]) -> frozenset[str]:
        """The topics reachable from `topics` through nodes, including themselves."""
        return self._reachable(topics, self.subscriptions)

    def upstream_of(self, topic: str) -> frozenset[str]:
        """The topics from which `topic` is reachable through nodes, including itself."""
        return self._reachable([topic], self.publishers)

    def _reachable(
        self, topics: Iterable[str], entered_by: Callable[[str], tuple[WiredEndpoint, ...]]
    ) -> frozenset[str]:
        """Walk through the nodes that own an endpoint of a topic, to their opposite endpoints."""
        visited: set[str] = set()
        pending = list(topics)
        while pending:
            topic = pending.pop()
            if topic in visited:
                continue
            visited.add(topic)
            entries = [entry for entry in entered_by(topic) if entry.is_node]
            pending += [
                endpoint.topic
                for entry in entries
                for endpoint in self.endpoints_of(entry.owner)
                if endpoint.is_publisher != entry.is_publisher
            ]
        return frozenset(visited)


class Wiring(msgspec.Struct, frozen=True):
    """Both phases of a spec."""

    namespace: str
    preprocess: PhaseWiring
    measure: PhaseWiring

    @property
    def phases(self) -> tuple[PhaseWiring, PhaseWiring]:
        """Both phases, in order."""
        return (self.preprocess, self.measure)

    def topic(self, name: str) -> str:
        """The full name of a topic that the spec names outside of a node."""
        return expand(name, "", self.namespace)
