"""The wiring of a spec: every known publisher and subscription of every topic, as a graph.

networkx takes long to import, so it is imported for the first question about the graph.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import chain
from typing import TYPE_CHECKING, Literal

import msgspec

from r2bspec.diagnostics.diagnostic import Path
from r2bspec.language.spec import Node, ParameterValue, QoS
from r2bspec.plan.wiring.name_resolution import Remapper, expand
from r2bspec.plan.wiring.node_interface import Interface
from r2bspec.plan.wiring.source_interface import StartStyle

if TYPE_CHECKING:
    import networkx as nx

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
    start: StartStyle = "keywords"

    @property
    def role(self) -> ProcessRole | None:
        """The role of its process, as in `NodeKind`."""
        return self.node.kind.role

    @property
    def shares_process(self) -> bool:
        """Whether it can run in one process with other nodes."""
        return self.node.kind.shares_process and self.start == "keywords"


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


Vertex = tuple[Literal["owner", "topic"], str]
"""Of the graph of a phase: the owner of endpoints, or a topic, by its name."""


@dataclass(frozen=True)
class PhaseWiring:
    """The nodes and endpoints of one phase."""

    phase: Phase
    nodes: tuple[NodeWiring, ...]
    endpoints: tuple[WiredEndpoint, ...]

    @cached_property
    def graph(self) -> nx.DiGraph[Vertex]:
        """The directed graph of owners and topics, in which messages follow the edges.

        An edge has its endpoints as the attribute ``endpoints``. The parts of the harness only
        publish or only subscribe, so every way from topic to topic leads through a node.
        """
        import networkx as nx

        graph: nx.DiGraph[Vertex] = nx.DiGraph()
        for endpoint in self.endpoints:
            owner: Vertex = ("owner", endpoint.owner)
            topic: Vertex = ("topic", endpoint.topic)
            edge = (owner, topic) if endpoint.is_publisher else (topic, owner)
            known = graph.get_edge_data(*edge, default={}).get("endpoints", ())
            graph.add_edge(*edge, endpoints=(*known, endpoint))
        return graph

    @cached_property
    def topics(self) -> tuple[str, ...]:
        """Every known topic, sorted."""
        return tuple(sorted(_topics(self.graph)))

    def publishers(self, topic: str) -> tuple[WiredEndpoint, ...]:
        """Return the known publishers of a topic."""
        return self._endpoints_into(("topic", topic))

    def subscriptions(self, topic: str) -> tuple[WiredEndpoint, ...]:
        """Return the known subscriptions of a topic."""
        return self._endpoints_out_of(("topic", topic))

    def endpoints_of(self, owner: str) -> tuple[WiredEndpoint, ...]:
        """Return the subscriptions and the publishers of a node or of a part of the harness."""
        vertex: Vertex = ("owner", owner)
        return (*self._endpoints_into(vertex), *self._endpoints_out_of(vertex))

    def _endpoints_into(self, vertex: Vertex) -> tuple[WiredEndpoint, ...]:
        tails = self.graph.pred.get(vertex, {})
        return tuple(chain.from_iterable(edge["endpoints"] for edge in tails.values()))

    def _endpoints_out_of(self, vertex: Vertex) -> tuple[WiredEndpoint, ...]:
        heads = self.graph.adj.get(vertex, {})
        return tuple(chain.from_iterable(edge["endpoints"] for edge in heads.values()))

    @cached_property
    def _by_name(self) -> dict[str, NodeWiring]:
        return {node.name: node for node in self.nodes}

    def node(self, owner: str) -> NodeWiring | None:
        """Return the node with that full name; None for a part of the harness."""
        return self._by_name.get(owner)

    @cached_property
    def possible_publishers(self) -> tuple[NodeWiring, ...]:
        """Nodes that may publish any topic, because their publishers are not all known."""
        return tuple(node for node in self.nodes if not node.interface.publishes_all)

    @cached_property
    def possible_subscribers(self) -> tuple[NodeWiring, ...]:
        """Nodes that may subscribe to any topic, because their subscriptions are not all known."""
        return tuple(node for node in self.nodes if not node.interface.subscribes_all)

    def downstream_of(self, topics: Iterable[str]) -> frozenset[str]:
        """Return the topics reachable from `topics` through nodes, including themselves."""
        import networkx as nx

        starts: list[Vertex] = [("topic", topic) for topic in topics]
        reached = (nx.descendants(self.graph, start) for start in starts if start in self.graph)
        return frozenset(_topics(chain(starts, *reached)))

    def upstream_of(self, topic: str) -> frozenset[str]:
        """Return the topics from which `topic` is reachable through nodes, including itself."""
        import networkx as nx

        end: Vertex = ("topic", topic)
        return frozenset(
            {topic, *_topics(nx.ancestors(self.graph, end) if end in self.graph else ())}
        )

    @cached_property
    def _cycles(self) -> tuple[set[Vertex], ...]:
        import networkx as nx

        return tuple(nx.strongly_connected_components(self.graph))

    def is_in_cycle(self, endpoint: WiredEndpoint) -> bool:
        """Return True if the topic of an endpoint depends on itself through its owner."""
        ends: set[Vertex] = {("topic", endpoint.topic), ("owner", endpoint.owner)}
        return any(ends <= component for component in self._cycles)


def _topics(vertices: Iterable[Vertex]) -> Iterator[str]:
    return (name for kind, name in vertices if kind == "topic")


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
        """Return the full name of a topic that the spec names outside of a node."""
        return expand(name, "", self.namespace)
