"""The functions of rclpy that every role needs: message classes, QoS, and a fast wait loop."""

from __future__ import annotations

import contextlib
import importlib
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import rclpy
from rclpy.duration import Duration
from rclpy.executors import SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation as _implementation
from rclpy.node import Node, NodeNameNonExistentError
from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    LivelinessPolicy,
    QoSCompatibility,
    QoSProfile,
    ReliabilityPolicy,
    qos_check_compatible,
)
from rclpy.signals import SignalHandlerOptions
from rclpy.topic_endpoint_info import TopicEndpointInfo
from rclpy.utilities import get_rmw_implementation_identifier, ok, try_shutdown

from r2bspec.errors import R2bspecError
from r2bspec.ipc.protocol import Endpoint, weakest_offer
from r2bspec.language.spec import QoS
from r2bspec.plan.package_advice import ros_package_advice

_to_destroy: list[Node] = []
_init_lock = threading.Lock()


_KINDS = {"srv": "service", "action": "action"}


class TypeNotFoundError(R2bspecError):
    """The type of a message, a service or an action is not installed."""

    code = "R2B681"

    def __init__(self, type_name: str) -> None:
        package, _, rest = type_name.partition("/")
        kind = _KINDS.get(rest.partition("/")[0], "message")
        super().__init__(
            f"{kind} type {type_name} is not installed",
            hint=f"To install it: {ros_package_advice(package)}.",
        )


def interface_class(type_name: str) -> Any:
    """Return the class of a type such as ``sensor_msgs/msg/Image`` or ``std_srvs/srv/Trigger``.

    Raises:
        TypeNotFoundError: the package is not installed or has no such type.
    """
    module, _, name = type_name.rpartition("/")
    try:
        return getattr(importlib.import_module(module.replace("/", ".")), name)
    except (ImportError, AttributeError, ValueError) as error:
        raise TypeNotFoundError(type_name) from error


def is_installed(type_name: str) -> bool:
    """Return True if a message type is installed."""
    try:
        interface_class(type_name)
    except TypeNotFoundError:
        return False
    return True


def begins_with_header(type_name: str) -> bool:
    """Return True if the first field of a type is a std_msgs/Header, with a readable stamp.

    Raises:
        TypeNotFoundError: the type is not installed.
    """
    fields = interface_class(type_name).get_fields_and_field_types()
    return next(iter(fields.values()), "") == "std_msgs/Header"


def profile(qos: QoS) -> QoSProfile:
    """Return the rclpy profile for a QoS of the spec."""
    limits = {
        "deadline": qos.deadline,
        "lifespan": qos.lifespan,
        "liveliness_lease_duration": qos.lease_duration,
    }
    return QoSProfile(
        reliability=ReliabilityPolicy[qos.reliability.upper()],
        durability=DurabilityPolicy[qos.durability.upper()],
        history=HistoryPolicy[qos.history.upper()],
        depth=qos.depth,
        liveliness=LivelinessPolicy[qos.liveliness.upper()],
        **{
            name: Duration(nanoseconds=limit.ns)
            for name, limit in limits.items()
            if limit is not None
        },
    )


def profile_matching_publishers(node: Node, topic: str) -> QoSProfile | None:
    """Return a profile compatible with every publisher of a topic; None without any."""
    publishers = [*map(describe_endpoint, node.get_publishers_info_by_topic(topic))]
    return profile(weakest_offer(publishers)) if publishers else None


def describe_endpoint(info: TopicEndpointInfo) -> Endpoint:
    """Return an endpoint that discovery shows."""
    return Endpoint(
        node=full_name(info),
        type=info.topic_type,
        reliability=info.qos_profile.reliability.name.lower(),
        durability=info.qos_profile.durability.name.lower(),
    )


def full_name(info: TopicEndpointInfo) -> str:
    """Return the full name of the node of an endpoint."""
    return f"{info.node_namespace.rstrip('/')}/{info.node_name}"


def qos_mismatch_reason(offered: QoSProfile, requested: QoSProfile) -> str:
    """Return the reason of the middleware why a pair never matches; empty if it may."""
    compatibility, why = qos_check_compatible(offered, requested)
    if compatibility != QoSCompatibility.ERROR:
        return ""
    return str(why).replace("ERROR: ", "").strip("; ").lower()


class RawSubscription:
    """A subscription that is read by `take`, as serialised bytes, without an executor."""

    def __init__(self, node: Node, topic: str, type_name: str, qos: QoSProfile) -> None:
        self._node = node
        self._class = interface_class(type_name)
        # The callback is never called, because no executor has this node.
        self._subscription = node.create_subscription(
            self._class, topic, lambda _message: None, qos, raw=True
        )
        self.handle = self._subscription.handle

    def take(self) -> tuple[bytes, int] | None:
        """Return the next message and its arrival time (system clock, ns), or None."""
        taken = self.handle.take_message(self._class, True)
        if taken is None:
            return None
        data, info = taken
        return data, int(info["received_timestamp"])

    def matches(self) -> int:
        """Return how many publishers this subscription is matched with."""
        return int(self.handle.get_publisher_count())

    def destroy(self) -> None:
        """Unsubscribe; no message may be taken afterwards."""
        self._node.destroy_subscription(self._subscription)


class RawPublisher:
    """A publisher of serialised bytes."""

    def __init__(self, node: Node, topic: str, type_name: str, qos: QoSProfile) -> None:
        self._publisher = node.create_publisher(interface_class(type_name), topic, qos)
        self._handle = self._publisher.handle

    def publish(self, message: bytes | bytearray) -> None:
        """Publish a serialised message.

        The handle accepts a bytearray; `Publisher.publish` would need `bytes`, and thus a copy of
        every message whose stamp is changed in place.
        """
        self._handle.publish_raw(message)

    def wait_for_acknowledgements(self) -> None:
        """Wait until all matched subscriptions have received all messages, for two seconds."""
        self._publisher.wait_for_all_acked(Duration(seconds=2.0))

    def matches(self) -> int:
        """Return how many subscriptions this publisher is matched with."""
        return int(self._handle.get_subscription_count())


class WaitLoop:
    """Waits on raw subscriptions with rclpy's wait set.

    An rclpy executor takes a multiple of this time per message, because it rebuilds its wait set
    and dispatches through tasks; this would affect the measurements of the monitor.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._guard = _implementation.GuardCondition(node.context.handle)
        self._subscriptions: list[RawSubscription] = []
        self._set: Any = None

    def add(self, subscription: RawSubscription) -> None:
        """Add a subscription, from the next `wait` on."""
        self._subscriptions.append(subscription)
        self._set = None

    def wake(self) -> None:
        """End the current or next `wait`; may be called from another thread."""
        self._guard.trigger_guard_condition()

    def wait(self, timeout_s: float) -> list[int]:
        """Wait at most `timeout_s` seconds, and return the positions with waiting messages."""
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
        positions = range(len(self._subscriptions))
        return [position for position in positions if ready.is_ready("subscription", position)]


def start_node(name: str) -> Node:
    """Initialise rclpy and create the harness node of a role.

    The node has no parameter services, no /rosout and no clock subscription, so that these take no
    time and are not part of the graph under test.
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


def init(ros_arguments: Sequence[str] = ()) -> bool:
    """Initialise rclpy, unless it is already initialised.

    It logs to the log of the process and not to a file of its own.

    Args:
        ros_arguments: for every node of the process, without ``--ros-args``.

    Returns:
        Whether it was not initialised yet, so that the arguments apply.
    """
    arguments = ["--ros-args", "--disable-external-lib-logs", *ros_arguments]
    with _init_lock:
        if ok():
            return False
        rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)
        return True


def loaded_rmw() -> str:
    """Return the middleware (RMW implementation) that this process has loaded."""
    return str(get_rmw_implementation_identifier())


def destroy_on_shutdown(node: Node) -> None:
    """Register a node that `finish` will destroy."""
    _to_destroy.append(node)


def finish() -> None:
    """Destroy the nodes and shut rclpy down, so that no shared memory is left."""
    for node in _to_destroy:
        with contextlib.suppress(Exception):
            node.destroy_node()
    _to_destroy.clear()
    with contextlib.suppress(Exception):
        try_shutdown()


_SPIN_S = 0.02


def spin_until(
    node: Node,
    condition: Callable[[], Any],
    timeout_s: float,
    interrupted: Callable[[], bool] = lambda: False,
) -> None:
    """Serve a node, which no other executor may have, until a condition holds.

    Args:
        node: has what the condition waits for.
        condition: is asked again and again.
        timeout_s: the longest time.
        interrupted: whether the condition is not waited for any more.
    """
    deadline = time.monotonic() + timeout_s
    executor = SingleThreadedExecutor(context=node.context)
    executor.add_node(node)
    try:
        while not (condition() or interrupted() or time.monotonic() > deadline):
            executor.spin_once(timeout_sec=_SPIN_S)
    finally:
        executor.remove_node(node)
        executor.shutdown()


def ask_services(
    node: Node,
    kind: Any,
    services: Iterable[str],
    timeout_s: float,
    request: Any = None,
    interrupted: Callable[[], bool] = lambda: False,
) -> dict[str, Any]:
    """Ask services of one type, in parallel, each as soon as it is available.

    Args:
        node: asks; no other executor may have it.
        kind: the class of the services.
        services: their full names.
        timeout_s: how long to wait for them and for their responses.
        request: to all of them; with the defaults of its type if None.
        interrupted: whether the responses are not needed any more.

    Returns:
        The responses by the names of the services, without those that did not come in time.
    """
    clients = {service: node.create_client(kind, service) for service in services}
    futures: dict[str, Any] = {}

    def all_have_responded() -> bool:
        for service, client in clients.items():
            if service not in futures and client.service_is_ready():
                futures[service] = client.call_async(kind.Request() if request is None else request)
        return len(futures) == len(clients) and all(each.done() for each in futures.values())

    try:
        spin_until(node, all_have_responded, timeout_s, interrupted)
        return {
            service: future.result()
            for service, future in futures.items()
            if future.done() and future.exception() is None
        }
    finally:
        for client in clients.values():
            node.destroy_client(client)


def names_of(node: Node, name: str, namespace: str) -> tuple[str, ...]:
    """Return the topics and services of a node as another node knows them; none if it has ended."""
    asks = (
        node.get_publisher_names_and_types_by_node,
        node.get_subscriber_names_and_types_by_node,
        node.get_service_names_and_types_by_node,
        node.get_client_names_and_types_by_node,
    )
    try:
        return tuple(sorted({each for ask in asks for each, _ in ask(name, namespace)}))
    except NodeNameNonExistentError:
        return ()
