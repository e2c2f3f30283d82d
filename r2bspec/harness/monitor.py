"""The monitor: records the arrival time of each message on its topics, without deserialising it.

The arrival time is the one that the middleware records when the sample reaches the subscription, so
it does not include the monitor's copy of the message. It is on the system clock and is converted to
the monotonic one (`r2bspec.ipc.clocks`).
"""

from __future__ import annotations

import contextlib
import queue
import threading
import time
from pathlib import Path

from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.topic_endpoint_info import TopicEndpointInfo

from r2bspec.harness import rclpy_tools
from r2bspec.harness.control_channel import Channel, ChannelClosedError
from r2bspec.harness.parameter_lists import list_parameters
from r2bspec.harness.publisher_guard import PublisherGuard
from r2bspec.ipc import protocol
from r2bspec.ipc.clocks import ClockOffsetTracker
from r2bspec.ipc.header_stamps import read_stamp
from r2bspec.ipc.message_log import MessageLogWriter
from r2bspec.ipc.sample_files import RowWriter
from r2bspec.ipc.stall_log import StallLogWriter
from r2bspec.plan.plan import MonitorPlan

_IDLE_S = 0.05
_DISCOVERY_POLL_S = 0.02


class _WatchedTopic:
    """One watched topic: its subscription and its rows."""

    def __init__(
        self,
        plan: MonitorPlan,
        rows: RowWriter,
        subscription: rclpy_tools.RawSubscription,
        content: MessageLogWriter | None = None,
    ) -> None:
        self.plan = plan
        self._content = content
        self._rows = rows
        self.subscription = subscription
        self._stamped = rclpy_tools.begins_with_header(plan.type)

    def matches(self) -> int:
        return self.subscription.matches()

    def close(self) -> None:
        """Unsubscribe; the rows stay in their file."""
        self.subscription.destroy()
        self._rows.close()
        if self._content is not None:
            self._content.close()

    def drain(self, clocks: ClockOffsetTracker) -> None:
        """Record every message that has arrived."""
        if self._content is not None:
            self._drain_content(self._content, clocks)
            return
        while (taken := self.subscription.take_head()) is not None:
            head, size, received_system_ns = taken
            received_ns, taken_ns = clocks.arrival(received_system_ns)
            stamp_ns = read_stamp(head) if self._stamped else 0
            self._rows.append(stamp_ns, received_ns, taken_ns, size)

    def _drain_content(self, content: MessageLogWriter, clocks: ClockOffsetTracker) -> None:
        """The same with the whole message, before its row: each row has a message."""
        while (taken := self.subscription.take()) is not None:
            data, received_system_ns = taken
            received_ns, taken_ns = clocks.arrival(received_system_ns)
            stamp_ns = read_stamp(data) if self._stamped else 0
            content.append(data)
            self._rows.append(stamp_ns, received_ns, taken_ns, len(data))


class Monitor:
    """Monitors topics; a thread receives commands, which are executed between messages."""

    def __init__(self, channel: Channel, settings: protocol.ConfigureMonitor) -> None:
        self._channel = channel
        self._node = rclpy_tools.start_node("monitor")
        self._loop = rclpy_tools.WaitLoop(self._node)
        self._waiting = list(settings.monitors)
        for plan in settings.monitors:
            rclpy_tools.message_class(plan.type)
        self._rows = {
            plan.name: RowWriter(Path(settings.rows_dir) / f"{plan.name}.rows", width=4)
            for plan in settings.monitors
        }
        self._topics = [plan.topic for plan in settings.monitors]
        self._stall_log = StallLogWriter(Path(settings.rows_dir))
        self._watched_topics: list[_WatchedTopic] = []
        self._temporary_topics: list[_WatchedTopic] = []
        self._rows_dir = Path(settings.rows_dir)
        self._guard = PublisherGuard(self._node, settings.guarded)
        self._commands: queue.SimpleQueue[protocol.Command] = queue.SimpleQueue()

    def serve(self) -> None:
        """Record and answer commands until told to shut down."""
        self._channel.send(protocol.Ready(rmw=rclpy_tools.loaded_rmw()))
        threading.Thread(target=self._listen, daemon=True).start()
        subscribing = False
        clocks = ClockOffsetTracker()
        began_ns, cpu_ns = clocks.update(), time.thread_time_ns()
        while True:
            timeout_s = _DISCOVERY_POLL_S if subscribing and self._waiting else _IDLE_S
            waiting = self._loop.wait(timeout_s)
            # From wait to wait, since the process can be stopped in any part of a round.
            last_ns, last_cpu_ns = began_ns, cpu_ns
            began_ns, cpu_ns = clocks.update(), time.thread_time_ns()
            active_ns = int(timeout_s * 1e9) + cpu_ns - last_cpu_ns
            self._stall_log.record_round(last_ns, began_ns, active_ns)
            for position in waiting:
                self._watched_topics[position].drain(clocks)
            if subscribing and self._waiting:
                self._subscribe()
            self._guard.look()
            with contextlib.suppress(queue.Empty):
                while True:
                    match self._commands.get_nowait():
                        case protocol.Subscribe():
                            subscribing = True
                            self._subscribe()
                            self._channel.send(protocol.Matched(counts=self._matches()))
                        case protocol.Watch(monitors=plans, with_content=with_content):
                            self._watch(plans, with_content=with_content)
                            self._channel.send(protocol.Matched(counts=self._matches()))
                        case protocol.Unwatch():
                            self._unwatch()
                            self._channel.send(protocol.Matched(counts=self._matches()))
                        case protocol.CountMatches():
                            self._channel.send(protocol.Matched(counts=self._matches()))
                        case protocol.Discover(topics=topics):
                            self._channel.send(discover(self._node, topics))
                        case protocol.Survey():
                            self._channel.send(survey(self._node))
                        case protocol.ListParameters() as question:
                            self._channel.send(list_parameters(question))
                        case protocol.ListForeign():
                            self._channel.send(
                                protocol.ForeignPublishers(publishers=self._guard.foreign())
                            )
                        case protocol.Shutdown():
                            return
                        case _:
                            continue

    def _listen(self) -> None:
        with contextlib.suppress(ChannelClosedError):
            while True:
                command = self._channel.receive()
                self._commands.put(command)
                self._loop.wake()
        self._commands.put(protocol.Shutdown())
        self._loop.wake()

    def _subscribe(self) -> None:
        """Subscribe to every pending topic whose QoS is known."""
        still_waiting = []
        for plan in self._waiting:
            qos = (
                rclpy_tools.profile(plan.qos)
                if plan.qos is not None
                else rclpy_tools.profile_matching_publishers(self._node, plan.topic)
            )
            if qos is None:
                still_waiting.append(plan)
                continue
            self._add(plan, self._rows[plan.name], qos)
        self._waiting = still_waiting

    def _add(
        self,
        plan: MonitorPlan,
        rows: RowWriter,
        qos: QoSProfile,
        content: MessageLogWriter | None = None,
    ) -> None:
        subscription = rclpy_tools.RawSubscription(self._node, plan.topic, plan.type, qos)
        self._watched_topics.append(_WatchedTopic(plan, rows, subscription, content))
        self._loop.add(subscription)

    def _watch(self, plans: tuple[MonitorPlan, ...], *, with_content: bool) -> None:
        """Subscribe temporarily to topics without a monitor."""
        for plan in plans:
            with contextlib.suppress(rclpy_tools.TypeNotFoundError):
                rclpy_tools.message_class(plan.type)
                qos = (
                    rclpy_tools.profile(plan.qos)
                    if plan.qos is not None
                    else rclpy_tools.profile_matching_publishers(self._node, plan.topic)
                )
                if qos is not None:
                    rows = RowWriter(self._rows_dir / f"{plan.name}.rows", width=4)
                    path = self._rows_dir / f"{plan.name}.messages"
                    self._add(plan, rows, qos, MessageLogWriter(path) if with_content else None)
                    self._temporary_topics.append(self._watched_topics[-1])

    def _unwatch(self) -> None:
        for watch in self._temporary_topics:
            self._watched_topics.remove(watch)
            self._loop.remove(watch.subscription)
            watch.close()
        self._temporary_topics.clear()

    def _matches(self) -> dict[str, int]:
        counts = dict.fromkeys(self._topics, 0)
        for watch in self._watched_topics:
            counts[watch.plan.topic] = watch.matches()
        return counts


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


def survey(node: Node) -> protocol.Surveyed:
    """The full names of the nodes, services and topics that discovery shows."""
    return protocol.Surveyed(
        nodes=tuple(
            f"{namespace.rstrip('/')}/{name}"
            for name, namespace in node.get_node_names_and_namespaces()
        ),
        services=tuple(name for name, _ in node.get_service_names_and_types()),
        topics=tuple(name for name, _ in node.get_topic_names_and_types()),
    )
