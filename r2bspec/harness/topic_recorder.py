"""Recording one output topic of the preprocessors, and matching it with the source messages."""

from __future__ import annotations

import time
from pathlib import Path

from r2bspec.harness import rclpy_tools
from r2bspec.ipc import buffers
from r2bspec.ipc.stamps import read_stamp


class TopicRecorder:
    """One recorded topic.

    An output answers the source message with the same stamp. Outputs without a stamp, or with a
    new one, answer the source messages in order of arrival.
    """

    def __init__(
        self, topic: str, type_name: str, folder: Path, subscription: rclpy_tools.RawSubscription
    ) -> None:
        self.topic = topic
        self.subscription = subscription
        self._stamped = rclpy_tools.begins_with_header(type_name)
        self._buffer = buffers.BufferWriter(folder, topic, type_name, has_header=self._stamped)
        self._sources: dict[int, int] = {}
        self._answers: set[int] = set()
        self._unmatched_count = 0

    def expect(self, sources: dict[int, int]) -> None:
        """Set the stamps of the source messages, each with its number."""
        self._sources = sources

    def answered(self, stamp_ns: int) -> bool:
        """Whether the output of a source message has arrived."""
        return stamp_ns in self._answers or self._unmatched_count > self._sources[stamp_ns]

    def drain(self) -> int:
        """Record every message that has arrived; returns their number."""
        count = 0
        while (taken := self.subscription.take()) is not None:
            data, received_ns = taken
            # Some middlewares give no time of reception.
            received_ns = received_ns or time.time_ns()
            stamp_ns = read_stamp(data) if self._stamped else received_ns
            self._buffer.append(stamp_ns, data, received_ns)
            if stamp_ns in self._sources:
                self._answers.add(stamp_ns)
            else:
                self._unmatched_count += 1
            count += 1
        return count

    def finish(self) -> int:
        """Complete the buffer; returns the number of its messages."""
        self._buffer.close()
        return len(self._buffer)
