"""A node that relays messages after a known time, to calibrate measurements."""

from __future__ import annotations

import importlib
import re
from time import perf_counter_ns, sleep

from r2bspec.nodes.node_tools import Constraint, ReferenceNode, any_bool, at_least, one_of
from r2bspec.nodes.service_times import JITTERS, service_times_ns


class RelayNode(ReferenceNode):
    """Copies ``input`` to ``output``, byte for byte, with a service time for each message.

    The time is measured from the start of the callback to the call of publish: `service_time_ms`
    for each message, or on average with `jitter` "exponential". The node uses the CPU in this time,
    or sleeps if `spin` is false, for graphs with more relays than the machine has cores. Messages
    of type `format` are relayed one by one in order of arrival; both topics are reliable and keep
    the last `queue_depth` messages.

    Raises:
        ValueError: the value of a parameter is not allowed.
    """

    name_by_default = "relay"

    def start(self) -> None:
        """Declare the parameters, and create publishers and subscriptions."""
        name = self.declare(
            "format",
            "sensor_msgs/msg/Image",
            "type of the messages",
            Constraint("a message type such as sensor_msgs/msg/Image", lambda _: True),
        )
        mean_ms = self.declare(
            "service_time_ms", 0.0, "how long a message takes, in milliseconds", at_least(0)
        )
        jitter = self.declare(
            "jitter", "none", "distribution of the service times", one_of(*JITTERS)
        )
        self._spin = self.declare("spin", True, "whether a core is kept busy meanwhile", any_bool())
        seed = self.declare("seed", 0, "seed of random service times", at_least(0))
        depth = self.declare(
            "queue_depth", 10, "messages that either topic keeps at most", at_least(1)
        )
        try:
            kind = message_type(name)
        except ValueError as unknown:
            raise ValueError(f"parameter 'format': {unknown}") from unknown
        self._service_times_ns = service_times_ns(mean_ms, jitter, seed)
        self._publisher = self.create_publisher(kind, "output", depth)
        self.create_subscription(kind, "input", self._on_message, depth, raw=True)

    def _on_message(self, serialized: bytes) -> None:
        end_ns = perf_counter_ns() + next(self._service_times_ns)
        if not self._spin:
            # A sleep that ends too early is made up for below, one that ends late is not.
            sleep(max(0, end_ns - perf_counter_ns()) / 1e9)
        while perf_counter_ns() < end_ns:
            pass
        self._publisher.publish(serialized)


_NAME = re.compile(r"([a-z][a-z0-9_]*)/msg/([A-Z][A-Za-z0-9]*)")


def message_type(name: str) -> type:
    """Find the class of a message type such as ``sensor_msgs/msg/Image``.

    Raises:
        ValueError: it is not the name of a message type, or the type is not installed.
    """
    parts = _NAME.fullmatch(name)
    if parts is None:
        raise ValueError(f"{name!r} is not a message type such as sensor_msgs/msg/Image")
    package, message = parts.groups()
    try:
        loaded_class: type = getattr(importlib.import_module(f"{package}.msg"), message)
    except ModuleNotFoundError as missing:
        raise ValueError(f"{name!r}: the package {package} is not installed") from missing
    except AttributeError as missing:
        raise ValueError(f"{name!r}: {package} has no message {message}") from missing
    return loaded_class
