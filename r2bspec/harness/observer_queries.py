"""Q."""

from __future__ import annotations

from rclpy.node import Node
from rclpy.topic_endpoint_info import TopicEndpointInfo

from r2bspec.harness import rclpy_tools
from r2bspec.ipc import protocol


def discover(node: Node, topics: tuple[str, ...]) -> protocol.Discovered:
    """The endpoints that discovery shows on these topics, including those of the harness."""
    publishers = {each: node.get_publishers_info_by_topic(each) for each in topics}
    subscriptions = {each: node.get_subscriptions_info_by_topic(each) for each in topics}
    return protocol.Discovered(
        writers={topic: tuple(map(_endpoint, infos)) for topic, infos in publishers.items()},
        readers={topic: tuple(map(_endpoint, infos)) for topic, infos in subscriptions.items()},
        qos_mismatches=tuple(
            protocol.QosMismatch(_full_name(publisher), _full_name(subscription), topic, why)
            for topic in topics
            for publisher in publishers[topic]
            for subscription in subscriptions[topic]
            if (
                why := rclpy_tools.qos_mismatch_reason(
                    publisher.qos_profile, subscription.qos_profile
                )
            )
        ),
    )


def _endpoint(info: TopicEndpointInfo) -> protocol.Endpoint:
    return protocol.Endpoint(
        node=_full_name(info),
        type=info.topic_type,
        reliability=info.qos_profile.reliability.name.lower(),
        durability=info.qos_profile.durability.name.lower(),
    )


def _full_name(info: TopicEndpointInfo) -> str:
    return f"{info.node_namespace.rstrip('/')}/{info.node_name}"


def list_graph(node: Node) -> protocol.GraphSnapshot:
    """The full names of the nodes, services and topics that discovery shows."""
    return protocol.GraphSnapshot(
        nodes=tuple(
            f"{namespace.rstrip('/')}/{name}"
            for name, namespace in node.get_node_names_and_namespaces()
        ),
        services=tuple(name for name, _ in node.get_service_names_and_types()),
        topics=tuple(name for name, _ in node.get_topic_names_and_types()),
    )
