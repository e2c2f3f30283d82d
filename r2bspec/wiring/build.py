"""From a spec to its wiring.

Harness and nodes meet on topics: in the preprocess phase the loader writes what `data_loader`
names and the recorder reads the `from` of every playback input; in the measure phase the player
writes the playback inputs and each monitor reads its topic.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from r2bspec.diagnostics.model import Path
from r2bspec.spec.model import Node, Spec
from r2bspec.wiring.interfaces import Table, interface_of, reference_table
from r2bspec.wiring.model import Endpoint, NodeWiring, PhaseWiring, Wiring
from r2bspec.wiring.names import expand, join_namespaces, node_name, remap


def build_wiring(
    spec: Spec, *, bag_types: Mapping[str, str] | None = None, table: Table | None = None
) -> Wiring:
    """Work out who writes and who reads which topic.

    Args:
        spec: the spec; it may hold any mistake that a rule reports.
        bag_types: type of each topic of the bag that is known, by the name that the spec uses.
        table: interfaces of Python nodes by path; by default those of the reference nodes.
    """
    table = reference_table() if table is None else table
    namespace = join_namespaces("/", spec.namespace)
    before = _nodes(spec.preprocessors, ("preprocessors",), namespace, table)
    under_test = _nodes(spec.graph.nodes, ("graph", "nodes"), namespace, table)
    return Wiring(
        namespace=namespace,
        preprocess=PhaseWiring(
            "preprocess",
            before,
            (*_data_endpoints(spec, namespace, bag_types or {}), *_node_endpoints(before)),
        ),
        measure=PhaseWiring(
            "measure",
            under_test,
            (*_play_endpoints(spec, namespace), *_node_endpoints(under_test)),
        ),
    )


def harness_topic(name: str, namespace: str) -> str:
    """The full name of a topic that the spec names outside of any node."""
    return expand(name, "", namespace)


def speaks_ros(node: Node) -> bool:
    """Whether the spec says anything of a node that only a ROS process can follow.

    A bare `command` may be anything, and is run exactly as written.
    """
    return node.kind != "command" or bool(
        node.namespace or node.parameters or node.remappings or node.publishes or node.subscribes
    )


def _nodes(
    nodes: Mapping[str, Node], section: Path, namespace: str, table: Table
) -> tuple[NodeWiring, ...]:
    return tuple(
        NodeWiring(
            key=key,
            name=node_name(key, inside := join_namespaces(namespace, node.namespace)),
            namespace=inside,
            path=(*section, key),
            node=node,
            interface=interface_of(node, table),
            names_known=speaks_ros(node),
        )
        for key, node in nodes.items()
    )


def _data_endpoints(spec: Spec, namespace: str, types: Mapping[str, str]) -> Iterator[Endpoint]:
    for bag_topic, target in spec.data_loader.topics.items():
        yield Endpoint(
            owner="loader",
            writes=True,
            topic=harness_topic(target, namespace),
            type=types.get(bag_topic, ""),
            path=("data_loader", "topics", bag_topic),
        )
    for name, each in spec.playback.inputs.items():
        place: Path = ("playback", "inputs", name)
        yield Endpoint(
            owner="recorder",
            writes=False,
            topic=harness_topic(each.source, namespace),
            type=each.format,
            path=(*place, "from"),
            type_path=(*place, "format"),
        )


def _play_endpoints(spec: Spec, namespace: str) -> Iterator[Endpoint]:
    for name, each in spec.playback.inputs.items():
        place: Path = ("playback", "inputs", name)
        yield Endpoint(
            owner="player",
            writes=True,
            topic=harness_topic(name, namespace),
            type=each.format,
            path=place,
            at_key=True,
            type_path=(*place, "format"),
        )
    for name, monitor in spec.monitors.items():
        place = ("monitors", name)
        yield Endpoint(
            owner="monitor",
            writes=False,
            topic=harness_topic(monitor.topic, namespace),
            type=monitor.format,
            path=(*place, "topic"),
            type_path=(*place, "format"),
            monitor=name,
        )


def _node_endpoints(nodes: tuple[NodeWiring, ...]) -> Iterator[Endpoint]:
    for node in nodes:
        interface = node.interface
        for own_name, kind in (interface.subscribes or {}).items():
            stated = interface.subscribes_from == "spec"
            yield _endpoint(node, own_name, kind, "subscribes" if stated else "", writes=False)
        for own_name, kind in (interface.publishes or {}).items():
            stated = interface.publishes_from == "spec"
            yield _endpoint(node, own_name, kind, "publishes" if stated else "", writes=True)


def _endpoint(
    node: NodeWiring, own_name: str, kind: str, stated_under: str, *, writes: bool
) -> Endpoint:
    """An endpoint of a node, placed at what decides its topic: remapping, statement or node."""
    topic, rule = remap(own_name, node.node.remappings, node.key, node.namespace)
    stated = (*node.path, stated_under, own_name) if stated_under else ()
    path = (*node.path, "remappings", rule) if rule is not None else stated or node.path
    parameter = "" if stated else node.interface.type_parameters.get(own_name, "")
    chosen = parameter in node.node.parameters
    return Endpoint(
        owner=node.name,
        writes=writes,
        topic=topic,
        type=kind,
        path=path,
        at_key=rule is None,
        own_name=own_name,
        type_path=(*node.path, "parameters", parameter) if chosen else stated,
        type_parameter=parameter,
    )
