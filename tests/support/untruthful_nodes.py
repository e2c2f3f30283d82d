"""Nodes whose outputs a naive measurement gets wrong. Benchmarks take copies of this file."""

from __future__ import annotations

import time
from collections import deque
from typing import Any

from rclpy.node import Node
from sensor_msgs.msg import Image

QUEUE = 500


class Answering(Node):
    """Takes images of any number; what it publishes is up to `answer`."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("node", **kwargs)
        self.received = 0
        self.out = self.create_publisher(Image, "output", QUEUE)
        self.create_subscription(Image, "input", self._take, QUEUE)

    def _take(self, message: Image) -> None:
        self.received += 1
        self.answer(message)

    def answer(self, message: Image) -> None:
        """Publish whatever this node publishes for a message."""
        self.out.publish(message)


class BatchesLossy(Answering):
    """Publishes 20 outputs at once, and loses three of them; flushes what is left after a pause."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.batch: list[Image] = []
        self.last_s = 0.0
        self.create_timer(0.05, self._flush)

    def answer(self, message: Image) -> None:
        self.last_s = time.monotonic()
        self.batch.append(message)
        if len(self.batch) == 20:
            self._publish()

    def _flush(self) -> None:
        if self.batch and time.monotonic() - self.last_s > 1.0:
            self._publish()

    def _publish(self) -> None:
        for message in self.batch[3:]:
            self.out.publish(message)
        self.batch.clear()


class StopsOnce(Answering):
    """Answers everything, and stops once for 1.2 s.

    After the usual ten messages of warm-up, or up to 60 of them, that is in the second iteration.
    """

    def answer(self, message: Image) -> None:
        if self.received == 70:
            time.sleep(1.2)
        self.out.publish(message)


class DropsAndDoubles(Answering):
    """Answers every second message twice, and the others not at all."""

    def answer(self, message: Image) -> None:
        if self.received % 2:
            self.out.publish(message)
            self.out.publish(message)


class Doubles(Answering):
    """Answers every message twice."""

    def answer(self, message: Image) -> None:
        self.out.publish(message)
        self.out.publish(message)


class DropsSome(Answering):
    """Answers nine of ten messages."""

    def answer(self, message: Image) -> None:
        if self.received % 10:
            self.out.publish(message)


class Restamps(Answering):
    """Writes its own time into each output."""

    def answer(self, message: Image) -> None:
        message.header.stamp = self.get_clock().now().to_msg()
        self.out.publish(message)


class SecondsLate(Answering):
    """Answers every message after three seconds."""

    delay_s = 3.0

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.waiting: deque[tuple[float, Image]] = deque()
        self.create_timer(0.01, self._publish)

    def answer(self, message: Image) -> None:
        self.waiting.append((time.monotonic() + self.delay_s, message))

    def _publish(self) -> None:
        while self.waiting and self.waiting[0][0] <= time.monotonic():
            self.out.publish(self.waiting.popleft()[1])
