"""Recording whole messages, for an iteration that counts for nothing.

What is timed is not recorded here: messages are copied, by an interpreter.
"""

from __future__ import annotations

import threading
from collections.abc import Iterable
from pathlib import Path
from typing import BinaryIO

from rclpy.node import Node
from rclpy.qos import QoSProfile

from r2bspec.harness import rclpy_tools
from r2bspec.ipc.arrivals import ARRIVAL_FIELDS, read_clocks
from r2bspec.ipc.sample_files import BUFFER_BYTES, RowWriter, message_size
from r2bspec.ipc.stamps import read_stamp
from r2bspec.plan.plan import MonitorPlan

_WAIT_S = 1.0


class MessageRecorder:
    """Records the messages of some topics on a thread, until it is closed.

    A topic that has no publisher now, or whose type is not installed, is left out. The others have
    the quality of service of their publishers.

    Args:
        node: that subscribes.
        monitors: the topics, with the names of their files.
        folder: receives ``NAME.rows``, as a monitor writes them, and ``NAME.messages``
            (`r2bspec.ipc.sample_files`).

    Raises:
        OSError: a file cannot be written.
    """

    def __init__(self, node: Node, monitors: Iterable[MonitorPlan], folder: Path) -> None:
        self._loop = rclpy_tools.WaitLoop(node)
        self._topics: list[_RecordedTopic] = []
        self._ends = threading.Event()
        self._error: Exception | None = None
        for each in monitors:
            qos = rclpy_tools.profile_matching_publishers(node, each.topic)
            if qos is not None and rclpy_tools.is_installed(each.type):
                self._topics.append(_RecordedTopic(node, each, qos, folder))
                self._loop.add(self._topics[-1].subscription)
        self._thread = threading.Thread(target=self._record, daemon=True)
        self._thread.start()

    def matches(self) -> dict[str, int]:
        """How many publishers the subscription of each recorded topic is matched with."""
        return {each.topic: each.subscription.matches() for each in self._topics}

    def close(self) -> None:
        """Record what has arrived, and complete the files.

        Raises:
            Exception: what ended the recording before.
        """
        self._ends.set()
        self._loop.wake()
        self._thread.join()
        for each in self._topics:
            each.close()
        if self._error is not None:
            raise self._error

    def _record(self) -> None:
        try:
            while not self._ends.is_set():
                for position in self._loop.wait(_WAIT_S):
                    self._topics[position].drain()
            for each in self._topics:
                each.drain()
        except Exception as error:
            self._error = error


class _RecordedTopic:
    def __init__(self, node: Node, plan: MonitorPlan, qos: QoSProfile, folder: Path) -> None:
        self.topic = plan.topic
        self.subscription = rclpy_tools.RawSubscription(node, plan.topic, plan.type, qos)
        self._has_header = rclpy_tools.begins_with_header(plan.type)
        self._rows = RowWriter(folder / f"{plan.name}.rows", len(ARRIVAL_FIELDS))
        self._messages: BinaryIO = (folder / f"{plan.name}.messages").open("xb", BUFFER_BYTES)

    def drain(self) -> None:
        """Record every message that has arrived."""
        while (taken := self.subscription.take()) is not None:
            data, arrived_system_ns = taken
            taken_ns, difference_ns = read_clocks()
            stamp_ns = read_stamp(data) if self._has_header else 0
            # Before its row: each row has a message.
            self._messages.write(message_size(data))
            self._messages.write(data)
            self._rows.append(stamp_ns, arrived_system_ns, taken_ns, len(data), difference_ns)

    def close(self) -> None:
        """Unsubscribe, and complete the files."""
        self.subscription.destroy()
        self._rows.close()
        self._messages.close()
