"""The publisher of /tf_static."""

from __future__ import annotations

from pathlib import Path

from rclpy.node import Node

from r2bspec.harness import rclpy_tools
from r2bspec.ipc import buffers
from r2bspec.ipc.stamps import TF_STATIC, TF_TYPE
from r2bspec.language.spec import QoS

_QOS = QoS(durability="transient_local", depth=1)


def publish_static_transforms(node: Node, folder: Path) -> rclpy_tools.RawPublisher:
    """Publish the buffered /tf_static as transient local, so that late subscriptions receive it.

    Returns:
        The publisher, which must be kept as long as the transforms must be available.
    """
    publisher = rclpy_tools.RawPublisher(node, TF_STATIC, TF_TYPE, rclpy_tools.profile(_QOS))
    publisher.publish(buffers.read_messages(folder, TF_STATIC, {0})[0])
    return publisher
