"""A graph of real nodes in this process, spun until what a test waits for is true."""

from __future__ import annotations

import os
import time
from array import array
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar
from unittest import mock

import numpy as np
import rclpy
from builtin_interfaces.msg import Time
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from sensor_msgs.msg import Image
from std_msgs.msg import Header

# Generous: it is only ever used up by a test that fails.
_DEADLINE_S = 30.0

N = TypeVar("N", bound=Node)


class NodeGraph:
    """Nodes on one executor, and a tester node that writes to them and listens."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self._executor = SingleThreadedExecutor(context=context)
        self._nodes: list[Node] = []
        self.tester = self.add(Node, "tester")

    def add(
        self, kind: Callable[..., N], *names: str, parameters: dict[str, Any] | None = None
    ) -> N:
        """Start a node with these parameters."""
        overrides = [
            Parameter(name, value=value)  # type: ignore[no-untyped-call]
            for name, value in (parameters or {}).items()
        ]
        node = kind(*names, context=self._context, parameter_overrides=overrides)
        self._nodes.append(node)
        self._executor.add_node(node)
        return node

    def writer(self, kind: type, topic: str) -> Any:
        """A publisher that a subscription is matched with."""
        publisher = self.tester.create_publisher(kind, topic, 10)
        self.spin_until(lambda: publisher.get_subscription_count() > 0)
        return publisher

    def listen(self, kind: type, topic: str, *, raw: bool = False) -> list[Any]:
        """A list that fills with what a matched publisher sends."""
        heard: list[Any] = []
        self.tester.create_subscription(kind, topic, heard.append, 10, raw=raw)
        self.spin_until(lambda: self.tester.count_publishers(topic) > 0)
        return heard

    def spin_until(self, condition: Callable[[], object]) -> None:
        """Run callbacks until the condition holds.

        Raises:
            AssertionError: it did not hold within the deadline.
        """
        deadline = time.monotonic() + _DEADLINE_S
        while not condition():
            assert time.monotonic() < deadline, "what the test waits for did not happen"
            self._executor.spin_once(timeout_sec=0.05)

    def close(self) -> None:
        self._executor.shutdown()
        for node in self._nodes:
            node.destroy_node()  # type: ignore[no-untyped-call]


@contextmanager
def node_graph() -> Iterator[NodeGraph]:
    """A graph that shares its domain with no other test process on this host."""
    with mock.patch.dict(os.environ, ROS_AUTOMATIC_DISCOVERY_RANGE="LOCALHOST"):
        context = Context()
        rclpy.init(context=context, domain_id=40 + os.getpid() % 60)
        graph = NodeGraph(context)
        try:
            yield graph
        finally:
            graph.close()
            context.try_shutdown()


def header(step: int, frame: str = "camera") -> Header:
    """The header of the message of a step."""
    return Header(stamp=Time(sec=1_700_000_000, nanosec=step), frame_id=frame)


def image(step: int, pixels: np.ndarray[Any, Any], encoding: str) -> Image:
    """An image of these pixels, of shape (height, width) or (height, width, 3)."""
    height, width = pixels.shape[:2]
    return Image(
        header=header(step),
        width=width,
        height=height,
        encoding=encoding,
        step=pixels.size // height,
        data=array("B", pixels.tobytes()),
    )
