"""The observer: reports what discovery shows of the graph, and records messages, on request.

Nothing here is timed: messages are copied, by an interpreter. It publishes /tf_static and /clock if
the spec has them, like the loader (`GraphParticipant`). Between requests it only looks, five times
a second and for microseconds, for publishers that are of no process of the run.

A domain keeps runs apart that r2bspec started, but it is no fence: a program of another user that
joins it can publish on the topics of the run. What it publishes is measured, or handed to the
nodes, like anything else. `PublisherGuard` therefore looks at who publishes.

States of lifecycle nodes are asked for and changed by the services that every such node has, in C++
as in Python.
"""

from __future__ import annotations

import contextlib
import os
import struct
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Final, Literal

import msgspec
import psutil
from rclpy.node import Node

from r2bspec.harness import rclpy_tools
from r2bspec.harness.control_channel import Channel
from r2bspec.harness.rclpy_tools import ask_services, interface_class
from r2bspec.ipc import buffers, protocol
from r2bspec.ipc.process_cleanup import carries_run_id
from r2bspec.ipc.protocol import RUN_ID_VARIABLE, ForeignPublisher
from r2bspec.language.spec import QoS
from r2bspec.middleware.middleware import PROC, middleware_of
from r2bspec.plan.plan import InputPlan

_CHANGE, _CHANGE_TYPE = "/change_state", "lifecycle_msgs/srv/ChangeState"
_TRANSITION_IDS: Final = {"configure": 1, "activate": 3}
"""Of lifecycle_msgs/msg/Transition."""

_STATE_S = 2.0


def lifecycle_nodes(services: Iterable[tuple[str, Sequence[str]]]) -> list[str]:
    """Return the nodes with a service that changes their state."""
    return sorted(
        name.removesuffix(_CHANGE)
        for name, types in services
        if name.endswith(_CHANGE) and _CHANGE_TYPE in types
    )


def list_states(node: Node, command: protocol.ListLifecycle) -> protocol.LifecycleStates:
    """Ask all lifecycle nodes that discovery shows for their states, in parallel.

    Args:
        node: asks; no executor may spin it.
        command: how long to wait for the answers.
    """
    found = lifecycle_nodes(node.get_service_names_and_types())
    return protocol.LifecycleStates(states=_states(node, found, command.timeout_ns / 1e9))


def _states(node: Node, names: Iterable[str], timeout_s: float) -> dict[str, str]:
    """Return the states of nodes by their names; empty for one that does not answer."""
    services = {name: f"{name}/get_state" for name in names}
    kind = interface_class("lifecycle_msgs/srv/GetState")
    answers = ask_services(node, kind, services.values(), timeout_s)
    return {
        name: str(answers[service].current_state.label) if service in answers else ""
        for name, service in services.items()
    }


def change_state(
    node: Node, command: protocol.ChangeState, interrupted: Callable[[], bool]
) -> protocol.StateChanged:
    """Ask a lifecycle node to make a transition, and wait until it has.

    Args:
        node: asks; no executor may spin it.
        command: the transition, and how long it may take.
        interrupted: whether the answer is not needed any more.
    """
    change = interface_class(_CHANGE_TYPE)
    request = change.Request()
    request.transition.id = _TRANSITION_IDS[command.transition]
    service = f"{command.node}{_CHANGE}"
    answers = ask_services(node, change, [service], command.timeout_ns / 1e9, request, interrupted)
    if service not in answers:
        return protocol.StateChanged(result="no answer")
    state = _states(node, [command.node], _STATE_S)[command.node]
    result: Literal["success", "failure"] = "success" if answers[service].success else "failure"
    return protocol.StateChanged(result=result, state=state)


def discover(node: Node, topics: tuple[str, ...]) -> protocol.Discovered:
    """Return the endpoints that discovery shows on these topics, including those of the harness."""
    publishers = {topic: node.get_publishers_info_by_topic(topic) for topic in topics}
    subscriptions = {topic: node.get_subscriptions_info_by_topic(topic) for topic in topics}
    return protocol.Discovered(
        writers={
            topic: tuple(map(rclpy_tools.describe_endpoint, infos))
            for topic, infos in publishers.items()
        },
        readers={
            topic: tuple(map(rclpy_tools.describe_endpoint, infos))
            for topic, infos in subscriptions.items()
        },
        qos_mismatches=tuple(
            protocol.QosMismatch(
                rclpy_tools.full_name(publisher), rclpy_tools.full_name(subscription), topic, why
            )
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


def list_graph(node: Node) -> protocol.GraphSnapshot:
    """Return the full names of the nodes, services and topics that discovery shows."""
    return protocol.GraphSnapshot(
        nodes=tuple(
            f"{namespace.rstrip('/')}/{name}"
            for name, namespace in node.get_node_names_and_namespaces()
        ),
        services=tuple(name for name, _ in node.get_service_names_and_types()),
        topics=tuple(name for name, _ in node.get_topic_names_and_types()),
    )


_LIST = "/list_parameters"


def list_parameters(command: protocol.ListParameters) -> protocol.ParameterLists:
    """Ask all nodes that have parameter services, in parallel.

    A node that does not respond in time is left out. A node of its own asks, so that the
    subscriptions of the process are not touched.
    """
    from rcl_interfaces.srv import ListParameters

    asking = rclpy_tools.start_node("parameters")
    try:
        services = dict(asking.get_service_names_and_types())
        wanted = [name for name in sorted(services) if name.endswith(_LIST)]
        wanted = [name for name in wanted if name.removesuffix(_LIST) not in command.exclude]
        answers = rclpy_tools.ask_services(asking, ListParameters, wanted, command.timeout_ns / 1e9)
        return protocol.ParameterLists(
            parameters={
                name.removesuffix(_LIST): tuple(sorted(answer.result.names))
                for name, answer in answers.items()
            },
            lifecycle=tuple(lifecycle_nodes(services.items())),
        )
    finally:
        asking.destroy_node()


LOOK_PERIOD_S = 0.2
_MAX_PROCESSES = 3


class PublisherGuard:
    """Remembers every publisher on some topics that no process of the run may have created."""

    def __init__(self, node: Node, topics: tuple[str, ...]) -> None:
        self._node = node
        self._counts = dict.fromkeys(topics, 0)
        self._known: set[tuple[str, str]] = set()
        self._foreign: dict[tuple[str, str], ForeignPublisher] = {}
        self._next_s = 0.0

    def foreign(self) -> tuple[ForeignPublisher, ...]:
        """Return all foreign publishers seen so far."""
        self.look(now=True)
        return tuple(self._foreign.values())

    def look(self, *, now: bool = False) -> None:
        """Look for publishers at most five times a second, unless told `now`.

        Counting publishers takes some microseconds, so that is done while a run measures.
        """
        if not now and time.monotonic() < self._next_s:
            return
        self._next_s = time.monotonic() + LOOK_PERIOD_S
        for topic, before in self._counts.items():
            count = self._node.count_publishers(topic)
            if now or count != before:
                self._counts[topic] = count
                self._look_at(topic)

    def _look_at(self, topic: str) -> None:
        for info in self._node.get_publishers_info_by_topic(topic):
            gid = bytes(info.endpoint_gid)
            key = (topic, gid.hex())
            node = rclpy_tools.full_name(info)
            if key in self._foreign:
                # An endpoint is discovered before its node: the name may come with a later look.
                self._foreign[key] = msgspec.structs.replace(self._foreign[key], node=node)
            elif key not in self._known:
                self._known.add(key)
                processes = list(_processes_of(gid))
                own = os.environ.get(RUN_ID_VARIABLE, "")
                if not any(carries_run_id(int(folder.name), own) for folder in processes):
                    self._foreign[key] = ForeignPublisher(
                        topic=topic,
                        node=node,
                        gid=gid.hex(),
                        processes=tuple(map(_describe, processes[:_MAX_PROCESSES])),
                    )


def _processes_of(gid: bytes) -> Iterator[Path]:
    """Yield the processes of this host that an endpoint can belong to, by its identifier."""
    middleware = middleware_of(os.environ)
    for folder in PROC.glob("[0-9]*"):
        if middleware.may_be_endpoint_of(gid, (int(folder.name),)):
            yield folder


def _describe(folder: Path) -> str:
    name, user = "?", "?"
    with contextlib.suppress(psutil.Error):
        process = psutil.Process(int(folder.name))
        name, user = process.name(), process.username()
    return f"{name} ({folder.name}) of user {user}"


CLOCK, CLOCK_TYPE = "/clock", "rosgraph_msgs/msg/Clock"

_PERIOD_S = 0.01
_CLOCK_QOS = QoS(depth=1)


def clock_message(time_ns: int) -> bytes:
    """Return a serialised rosgraph_msgs/Clock (XCDR1, little-endian: int32 s, uint32 ns).

    Args:
        time_ns: nanoseconds since the epoch.
    """
    seconds, nanoseconds = divmod(time_ns, 10**9)
    return b"\x00\x01\x00\x00" + struct.pack("<iI", seconds, nanoseconds)


class ClockPublisher:
    """Publishes the system time on /clock 100 times per second, from its construction.

    The player writes stamps of the system clock, so that both agree for a node. Each message has
    the time at which it is published; periods that were missed are left out.
    """

    def __init__(self, node: Node) -> None:
        self._publisher = rclpy_tools.RawPublisher(
            node, CLOCK, CLOCK_TYPE, rclpy_tools.profile(_CLOCK_QOS)
        )
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._publish, name="clock", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop publishing; the node may then be destroyed."""
        self._ended.set()
        self._thread.join()

    def _publish(self) -> None:
        due_s = time.monotonic() + _PERIOD_S
        while not self._ended.wait(max(0.0, due_s - time.monotonic())):
            self._publisher.publish(clock_message(time.time_ns()))
            due_s = max(due_s + _PERIOD_S, time.monotonic())


class GraphParticipant:
    """A role that publishes what nodes need first, and reports what discovery shows.

    Args:
        channel: of the controller.
        name: of its node.
        buffer_dir: has the buffers of `latched`.
        latched: topics of which one message is published, for late subscriptions, too.
        clock: whether the system time is published on /clock.
    """

    def __init__(
        self,
        channel: Channel,
        name: str,
        buffer_dir: Path,
        latched: tuple[InputPlan, ...],
        *,
        clock: bool,
    ) -> None:
        self._channel = channel
        self._node = rclpy_tools.start_node(name)
        # Before anything else, so that all nodes, which are started later, receive them.
        self._clock = ClockPublisher(self._node) if clock else None
        self._latched = {
            each.topic: rclpy_tools.RawPublisher(
                self._node, each.topic, each.type, rclpy_tools.profile(each.qos)
            )
            for each in latched
        }
        for each in latched:
            message = buffers.read_messages(buffer_dir, each.source, {0})[0]
            self._latched[each.topic].publish(message)

    def serve(self) -> None:
        """Answer commands until told to shut down."""
        try:
            self._serve()
        finally:
            if self._clock is not None:
                self._clock.close()

    def _serve(self) -> None:
        raise NotImplementedError

    def _await_latched(self) -> None:
        for publisher in self._latched.values():
            publisher.wait_for_acknowledgements()

    def _latched_matches(self) -> dict[str, int]:
        return {topic: publisher.matches() for topic, publisher in self._latched.items()}

    def _is_interrupted(self) -> bool:
        """Return whether a command has arrived: during an answer, this can only be the shutdown."""
        return self._channel.wait(0.0)

    def _answer(self, command: protocol.Command) -> None:
        """Answer a question about what discovery shows; any other command is left alone."""
        match command:
            case protocol.Discover(topics=topics):
                self._channel.send(discover(self._node, topics))
            case protocol.ListGraph():
                self._channel.send(list_graph(self._node))
            case protocol.ListParameters() as question:
                self._channel.send(list_parameters(question))
            case protocol.ListLifecycle() as question:
                self._channel.send(list_states(self._node, question))
            case protocol.ChangeState() as change:
                self._channel.send(change_state(self._node, change, self._is_interrupted))


class Observer(GraphParticipant):
    """Answers questions about nodes, topics and publishers."""

    def __init__(self, channel: Channel, settings: protocol.ConfigureObserver) -> None:
        folder = Path(settings.buffer_dir)
        super().__init__(channel, "observer", folder, settings.latched, clock=settings.clock)
        self._guard = PublisherGuard(self._node, settings.guarded)
        # Without topics to guard there is nothing to look at.
        self._period_s = LOOK_PERIOD_S if settings.guarded else None

    def _serve(self) -> None:
        self._channel.send(protocol.Ready(rmw=rclpy_tools.loaded_rmw()))
        while True:
            if not self._channel.wait(self._period_s):
                self._guard.look()
                continue
            match self._channel.receive():
                case protocol.ListForeign():
                    self._channel.send(protocol.ForeignPublishers(publishers=self._guard.foreign()))
                case protocol.AwaitLatched():
                    self._await_latched()
                    self._send_matches()
                case protocol.CountMatches():
                    self._send_matches()
                case protocol.Shutdown():
                    return
                case command:
                    self._answer(command)

    def _send_matches(self) -> None:
        self._channel.send(protocol.Matched(counts=self._latched_matches()))
