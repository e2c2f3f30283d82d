"""Building the wiring of a spec.

The harness and the nodes are connected by topics. In the preprocess phase, the loader publishes the
topics in `data_loader`, and the recorder subscribes to the `from` topic of every input or call. In
the measure phase, the player publishes the playback inputs, and each monitor subscribes to its
topic. Recorded transforms are published by the loader and then by the player, if the spec says so.
A live benchmark has only monitors.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import msgspec

from r2bspec.diagnostics.diagnostic import Path
from r2bspec.language.spec import Node, PlaybackInput, QoS, Spec
from r2bspec.plan.wiring import node_interface
from r2bspec.plan.wiring.companion_files import NO_COMPANION_FILES, CompanionFiles
from r2bspec.plan.wiring.name_resolution import Remapper, expand, join_namespaces, node_name
from r2bspec.plan.wiring.parameter_files import merged_parameters
from r2bspec.plan.wiring.wiring import NodeWiring, PhaseWiring, WiredEndpoint, Wiring

TF_MESSAGE_TYPE = "tf2_msgs/msg/TFMessage"

_HARNESS_QOS = QoS()
"""The profile of loader and recorder: the default profile with a depth of 10."""


def build_wiring(
    spec: Spec,
    *,
    bag_types: Mapping[str, str] | None = None,
    companion_files: CompanionFiles = NO_COMPANION_FILES,
) -> Wiring:
    """Build the wiring of a spec: the endpoints of every topic in both phases.

    Args:
        spec: the spec; it may have any problem that a rule reports.
        bag_types: the known types of topics in the bag, by their names in the spec.
        companion_files: the content of companion files; by default none.
    """
    namespace = join_namespaces("/", spec.namespace)
    before = tuple(_nodes(spec.preprocessors, ("preprocessors",), namespace, companion_files))
    under_test = tuple(_nodes(spec.graph.nodes, ("graph", "nodes"), namespace, companion_files))
    return Wiring(
        namespace=namespace,
        preprocess=PhaseWiring(
            "preprocess",
            before,
            (
                *_data_endpoints(spec, namespace, bag_types or {}),
                *(_transform_endpoints(spec, "loader") if before else ()),
                *_node_endpoints(before),
            ),
        ),
        measure=PhaseWiring(
            "measure",
            under_test,
            (
                *_play_endpoints(spec, namespace),
                *_transform_endpoints(spec, "player"),
                *_node_endpoints(under_test),
            ),
        ),
    )


def _has_ros_settings(node: Node) -> bool:
    """Return whether the spec has settings of a node that need a ROS process.

    A `command` without such settings may be any program, and is run exactly as written.
    """
    return not node.kind.any_program or bool(
        node.namespace
        or node.parameters
        or node.parameter_sources
        or node.remappings
        or node.publishes
        or node.subscribes
    )


def _nodes(
    nodes: Mapping[str, Node], section: Path, namespace: str, files: CompanionFiles
) -> Iterator[NodeWiring]:
    table = node_interface.reference_node_interfaces()
    for key, node in nodes.items():
        inner = join_namespaces(namespace, node.namespace)
        names = Remapper(node.remappings, key, inner)
        name = node_name(key, inner)
        parameters = merged_parameters(node, name, files.parameter_files)
        sources = (
            files.interfaces.get(key),
            node_interface.catalogue_entry(node),
            table.get(node.python) or files.sources.get(node_interface.node_target(node)),
        )
        entries = [entry for entry in sources if entry is not None]
        yield NodeWiring(
            key=key,
            name=name,
            namespace=inner,
            path=(*section, key),
            node=node,
            names=names,
            interface=node_interface.interface_of(node, entries, names, parameters),
            is_ros_process=_has_ros_settings(node),
            parameters=parameters,
            start=files.starts.get(node.python, "keywords"),
        )


def _data_endpoints(
    spec: Spec, namespace: str, types: Mapping[str, str]
) -> Iterator[WiredEndpoint]:
    for bag_topic, target in spec.data_loader.topics.items():
        yield WiredEndpoint(
            owner="loader",
            is_publisher=True,
            topic=expand(target, "", namespace),
            type=types.get(bag_topic, ""),
            path=("data_loader", "topics", bag_topic),
            qos=_HARNESS_QOS,
        )
    for name, played in spec.playback.inputs.items():
        place: Path = ("playback", "inputs", name)
        yield WiredEndpoint(
            owner="recorder",
            is_publisher=False,
            topic=expand(played.source, "", namespace),
            type=played.format,
            path=(*place, "from"),
            type_path=(*place, "format"),
        )
    for name, call in spec.recorded_calls.items():
        yield WiredEndpoint(
            owner="recorder",
            is_publisher=False,
            topic=expand(call.source or "", "", namespace),
            type="",
            path=("playback", "calls", name, "from"),
        )


def _transform_endpoints(spec: Spec, owner: str) -> Iterator[WiredEndpoint]:
    """Yield the recorded transforms, if the spec publishes them."""
    loader = spec.data_loader
    static = QoS(durability="transient_local", depth=1)
    for enabled, topic, qos in (
        (loader.publish_tf, "/tf", QoS(depth=100)),
        (loader.publish_tf_static, "/tf_static", static),
    ):
        if enabled:
            yield WiredEndpoint(
                owner=owner,
                is_publisher=True,
                topic=topic,
                type=TF_MESSAGE_TYPE,
                path=("data_loader", f"publish_{topic[1:]}"),
                topic_is_key=True,
                qos=qos,
            )


def latched_qos(played: PlaybackInput) -> QoS:
    """Return the QoS of an input: a message that is published once is kept for late subscribers."""
    if played.rate != "once":
        return played.qos
    return msgspec.structs.replace(played.qos, reliability="reliable", durability="transient_local")


def _play_endpoints(spec: Spec, namespace: str) -> Iterator[WiredEndpoint]:
    for name, played in spec.playback.inputs.items():
        place: Path = ("playback", "inputs", name)
        yield WiredEndpoint(
            owner="player",
            is_publisher=True,
            topic=expand(name, "", namespace),
            type=played.format,
            path=place,
            topic_is_key=True,
            type_path=(*place, "format"),
            qos=latched_qos(played),
            qos_path=(*place, "qos"),
        )
    for name, monitor in spec.monitors.items():
        place = ("monitors", name)
        yield WiredEndpoint(
            owner="monitor",
            is_publisher=False,
            topic=expand(monitor.topic, "", namespace),
            type=monitor.format,
            path=(*place, "topic"),
            type_path=(*place, "format"),
            monitor=name,
            qos=monitor.qos,
            qos_path=(*place, "qos"),
        )


def _node_endpoints(nodes: tuple[NodeWiring, ...]) -> Iterator[WiredEndpoint]:
    for node in nodes:
        interface = node.interface
        for section, topics, origin in (
            ("subscribes", interface.subscribes, interface.subscribes_from),
            ("publishes", interface.publishes, interface.publishes_from),
        ):
            declared_under = section if origin == "spec" else ""
            publishes = section == "publishes"
            for own_name, kind in (topics or {}).items():
                yield _endpoint(node, own_name, kind, declared_under, is_publisher=publishes)


def _endpoint(
    node: NodeWiring, own_name: str, kind: str, declared_under: str, *, is_publisher: bool
) -> WiredEndpoint:
    """Return an endpoint, with the place that decides its topic: remapping, key or node."""
    topic, rule = node.names.resolve(own_name)
    declared = (*node.path, declared_under, own_name) if declared_under else ()
    path = (*node.path, "remappings", rule) if rule is not None else declared or node.path
    parameter = "" if declared else node.interface.type_parameters.get(own_name, "")
    parameter_is_set = parameter in node.node.parameters
    declared_qos = node.node.qos.get(own_name)
    return WiredEndpoint(
        owner=node.name,
        is_publisher=is_publisher,
        topic=topic,
        type=kind,
        path=path,
        topic_is_key=rule is None,
        own_name=own_name,
        type_path=(*node.path, "parameters", parameter) if parameter_is_set else declared,
        type_parameter=parameter,
        qos=node.interface.qos.get(own_name) if declared_qos is None else declared_qos,
        qos_path=() if declared_qos is None else (*node.path, "qos", own_name),
    )
