"""Subscribing to an image and its camera_info."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.node import Node
from sensor_msgs.msg import CameraInfo, Image

from r2bspec.nodes.stamp_pairs import StampPairs

QOS_DEPTH = 10
_LOG_INTERVAL_S = 5.0


def subscribe_pair(
    node: Node, image_topic: str, info_topic: str, on_pair: Callable[[Any, Any], None]
) -> None:
    """Call `on_pair(image, camera_info)` for each two messages with the same stamp.

    If more than `QOS_DEPTH` messages wait for their partners, the oldest is dropped, which is
    logged at most every few seconds. A ValueError of `on_pair` means an unusable message: it is
    logged, and the node continues with the next one.
    """
    pairs: StampPairs[Any, Any] = StampPairs(QOS_DEPTH)
    logger: Any = node.get_logger()

    reported = 0

    def deliver(pair: tuple[Any, Any] | None) -> None:
        nonlocal reported
        if pair is not None:
            try:
                on_pair(*pair)
            except ValueError as unusable:
                logger.error(f"message dropped: {unusable}", throttle_duration_sec=_LOG_INTERVAL_S)
        elif pairs.discarded > reported:
            reported = pairs.discarded
            logger.warning(
                f"{reported} messages dropped so far, without a partner of the same stamp; "
                f"each message on {image_topic} needs one on {info_topic}",
                throttle_duration_sec=_LOG_INTERVAL_S,
            )

    def on_image(message: Any) -> None:
        deliver(pairs.add_first(_stamp_ns(message), message))

    def on_info(message: Any) -> None:
        deliver(pairs.add_second(_stamp_ns(message), message))

    node.create_subscription(Image, image_topic, on_image, QOS_DEPTH)
    node.create_subscription(CameraInfo, info_topic, on_info, QOS_DEPTH)


def _stamp_ns(message: Any) -> int:
    stamp = message.header.stamp
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)
