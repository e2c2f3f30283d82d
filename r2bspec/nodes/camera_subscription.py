"""Subscribing to an image and its camera_info, and to other topics of equal stamps."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from rclpy.node import Node
from sensor_msgs.msg import CameraInfo, Image

from r2bspec.nodes.stamp_sets import StampSets

QOS_DEPTH = 10
_LOG_INTERVAL_S = 5.0


def subscribe_pair(
    node: Node, image_topic: str, info_topic: str, on_pair: Callable[[Any, Any], None]
) -> None:
    """Call `on_pair(image, camera_info)` for each two messages with the same stamp.

    See `subscribe_set`.
    """
    subscribe_set(node, {image_topic: Image, info_topic: CameraInfo}, on_pair)


def subscribe_set(node: Node, topics: Mapping[str, type], on_set: Callable[..., None]) -> None:
    """Call `on_set` with one message of each topic, in their order, all with the same stamp.

    If more than `QOS_DEPTH` messages of a topic wait for the others, the oldest is dropped, and
    that is logged at most every few seconds. A ValueError of `on_set` means an unusable message:
    it is logged, and the node continues with the next one.
    """
    sets = StampSets(tuple(topics), QOS_DEPTH)
    logger: Any = node.get_logger()
    others = " and ".join(list(topics)[1:])
    reported = 0

    def receive(topic: str, message: Any) -> None:
        nonlocal reported
        found = sets.add(topic, _stamp_ns(message), message)
        if found is not None:
            try:
                on_set(*found)
            except ValueError as unusable:
                logger.error(f"message dropped: {unusable}", throttle_duration_sec=_LOG_INTERVAL_S)
        elif sets.discarded > reported:
            reported = sets.discarded
            logger.warning(
                f"{reported} messages dropped so far, without a partner of the same stamp; "
                f"each message on {next(iter(topics))} needs one on {others}",
                throttle_duration_sec=_LOG_INTERVAL_S,
            )

    def receiver(topic: str) -> Callable[[Any], None]:
        return lambda message: receive(topic, message)

    for topic, kind in topics.items():
        node.create_subscription(kind, topic, receiver(topic), QOS_DEPTH)


def _stamp_ns(message: Any) -> int:
    stamp = message.header.stamp
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)
