"""The few things of rclpy that every role needs: message classes, QoS, and a lean wait loop."""

from __future__ import annotations

import contextlib
import functools
import importlib
import threading
from collections.abc import Callable
from typing import Any

import rclpy
from rclpy.duration import Duration
from rclpy.impl.implementation_singleton import rclpy_implementation as _implementation
from rclpy.node import Node
from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    QoSCompatibility,
    QoSProfile,
    ReliabilityPolicy,
    qos_check_compatible,
)
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import get_rmw_implementation_identifier, ok, try_shutdown

from r2bspec.harness import rcl_calls
from r2bspec.language.spec import QoS

_to_destroy: list[Node] = []
_init_lock = threading.Lock()

SUBSCRIPTION_DEPTH = 1000
"""History depth of what the harness reads: a second at 1 kHz, so that a monitor that was not
scheduled for a while loses nothing. Memory is taken only for messages that wait; with 100 a busy
machine was seen to lose some."""


class TypeNotFoundError(Exception):
    """A message type that is not installed here."""


def message_class(type_name: str) -> Any:
    """The class of a message type such as ``sensor_msgs/msg/Image``.

    Raises:
        TypeNotFoundError: the package is not installed or has no such message.
    """
    package, _, name = type_name.partition("/msg/")
    try:
        return getattr(importlib.import_module(f"{package}.msg"), name)
    except (ImportError, AttributeError, ValueError) as error:
        raise TypeNotFoundError(f"message type {type_name} is not installed here") from error


def begins_with_header(type_name: str) -> bool:
    """Whether the first field of a type is a std_msgs/Header, so that its stamp can be reached.

    Raises:
        TypeNotFoundError: the type is not installed.
    """
    fields = message_class(type_name).get_fields_and_field_types()
    return next(iter(fields.values()), "") == "std_msgs/Header"


def profile(qos: QoS) -> QoSProfile:
    """The rclpy profile of a QoS of the language."""
    return QoSProfile(
        reliability=ReliabilityPolicy[qos.reliability.upper()],
        durability=DurabilityPolicy[qos.durability.upper()],
        history=HistoryPolicy[qos.history.upper()],
        depth=qos.depth,
    )


def profile_matching_publishers(node: Node, topic: str) -> QoSProfile | None:
    """A profile that hears every publisher of a topic, or None while there is no publisher.

    A subscription that asks for less than a publisher offers still hears it, so the weakest offer
    decides.
    """
    publishers = node.get_publishers_info_by_topic(topic)
    if not publishers:
        return None
    offers = [publisher.qos_profile for publisher in publishers]
    reliable = all(offer.reliability == ReliabilityPolicy.RELIABLE for offer in offers)
    transient = all(offer.durability == DurabilityPolicy.TRANSIENT_LOCAL for offer in offers)
    return QoSProfile(
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if transient else DurabilityPolicy.VOLATILE,
        history=HistoryPolicy.KEEP_LAST,
        depth=SUBSCRIPTION_DEPTH,
    )


def qos_mismatch_reason(offered: QoSProfile, asked: QoSProfile) -> str:
    """Why a subscription never matches a publisher, in the middleware's words; empty if it may."""
    found, why = qos_check_compatible(offered, asked)
    if found != QoSCompatibility.ERROR:
        return ""
    return str(why).replace("ERROR: ", "").strip("; ").lower()


class RawSubscription:
    """A subscription that is read by `take`, as serialised bytes, without an executor."""

    def __init__(self, node: Node, topic: str, type_name: str, qos: QoSProfile) -> None:
        self._node = node
        self._class = message_class(type_name)
        # The callback is never called: no executor knows this node.
        self._subscription = node.create_subscription(
            self._class, topic, lambda _message: None, qos, raw=True
        )
        self.handle = self._subscription.handle
        self._taker: rcl_calls.MessageTaker | None = None
        with contextlib.suppress(rcl_calls.RclError):
            self._taker = rcl_calls.MessageTaker(self.handle)

    def take(self) -> tuple[bytes, int] | None:
        """The next message and its time of arrival (system clock, ns), or None if there is none."""
        taken = self.handle.take_message(self._class, True)
        if taken is None:
            return None
        data, info = taken
        return data, int(info["received_timestamp"])

    def take_head(self) -> tuple[bytes, int, int] | None:
        """As `take`, but of the message only the first bytes, and its size.

        Whoever only counts and times messages is spared a copy of each.
        """
        if self._taker is not None:
            return self._taker.take()
        taken = self.take()
        return (
            None if taken is None else (taken[0][: rcl_calls.HEAD_BYTES], len(taken[0]), taken[1])
        )

    def matches(self) -> int:
        """How many publishers this subscription is matched with."""
        return int(self.handle.get_publisher_count())

    def destroy(self) -> None:
        """Stop reading; nothing may be taken any more."""
        self._taker = None
        self._node.destroy_subscription(self._subscription)


class RawPublisher:
    """A publisher of serialised bytes."""

    def __init__(self, node: Node, topic: str, type_name: str, qos: QoSProfile) -> None:
        self._publisher = node.create_publisher(message_class(type_name), topic, qos)
        self._handle = self._publisher.handle

    def publish(self, message: bytes | bytearray) -> None:
        """Publish one serialised message.

        The handle takes a bytearray as it is, where `Publisher.publish` would want `bytes` and
        with it a copy of every message whose stamp is patched in place.
        """
        self._handle.publish_raw(message)

    def publication(self, message: bytearray) -> Callable[[], None]:
        """A function that publishes what is in `message` at the time it is called.

        The message is handed over where it is; only where that is impossible it is copied.
        """
        made = rcl_calls.publication(self._handle, message)
        return made or functools.partial(self._handle.publish_raw, message)

    def wait_for_acknowledgements(self, timeout_s: float = 2.0) -> None:
        """Wait until all readers that are matched have got everything, but not for ever."""
        self._publisher.wait_for_all_acked(Duration(seconds=timeout_s))

    def matches(self) -> int:
        """How many readers this publisher is matched with."""
        return int(self._handle.get_subscription_count())


class WaitLoop:
    """Waits on raw readers through rclpy's wait set.

    An rclpy executor costs a multiple of this per message, because it rebuilds its wait set and
    dispatches through tasks; a monitor must not be what it measures.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._guard = _implementation.GuardCondition(node.context.handle)
        self._subscriptions: list[RawSubscription] = []
        self._set: Any = None

    def add(self, subscription: RawSubscription) -> None:
        """Wait on one more subscription, from the next `wait` on."""
        self._subscriptions.append(subscription)
        self._set = None

    def remove(self, subscription: RawSubscription) -> None:
        """Wait on a subscription no more; the positions of those after it move up."""
        self._subscriptions.remove(subscription)
        self._set = None

    def wake(self) -> None:
        """End the current or next `wait`; may be called from another thread."""
        self._guard.trigger_guard_condition()

    def wait(self, timeout_s: float) -> list[int]:
        """Wait at most `timeout_s` seconds; returns the positions of readers with messages."""
        if self._set is None:
            self._set = _implementation.WaitSet(
                len(self._subscriptions), 1, 0, 0, 0, 0, self._node.context.handle
            )
        ready = self._set
        ready.clear_entities()
        ready.add_guard_condition(self._guard)
        for subscription in self._subscriptions:
            ready.add_subscription(subscription.handle)
        ready.wait(int(timeout_s * 1e9))
        return [
            index
            for index in range(len(self._subscriptions))
            if ready.is_ready("subscription", index)
        ]


def start_node(name: str) -> Node:
    """Initialise rclpy and make the harness node of a role.

    The node has no parameter services, no /rosout and no clock subscription: what does not exist
    takes no time and does not show in the graph under test.
    """
    init()
    node = Node(
        name,
        namespace="/r2bspec",
        use_global_arguments=False,
        enable_rosout=False,
        start_parameter_services=False,
    )
    destroy_on_shutdown(node)
    return node


def init() -> None:
    """Initialise rclpy, unless that is done.

    What it logs goes to the log of the process and into no file of its own.
    """
    arguments = ["--ros-args", "--disable-external-lib-logs"]
    with _init_lock:
        if not ok():
            rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)


def loaded_rmw() -> str:
    """The middleware (RMW implementation) that this process has loaded."""
    return str(get_rmw_implementation_identifier())


def destroy_on_shutdown(node: Node) -> None:
    """Have `finish` destroy a node."""
    _to_destroy.append(node)


def finish() -> None:
    """Destroy the nodes and shut rclpy down, so that no shared memory stays behind."""
    for node in _to_destroy:
        with contextlib.suppress(Exception):
            node.destroy_node()
    _to_destroy.clear()
    with contextlib.suppress(Exception):
        try_shutdown()
