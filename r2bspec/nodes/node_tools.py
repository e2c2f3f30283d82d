"""What the reference nodes share: parameters that are declared, and images of equal stamps."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, TypeVar

from rcl_interfaces.msg import ParameterDescriptor
from rclpy.exceptions import InvalidParameterTypeException
from rclpy.node import Node
from sensor_msgs.msg import CameraInfo, Image

from r2bspec.nodes.stamp_sets import StampSets

T = TypeVar("T", bool, int, float, str)

_TYPES = {bool: "a bool", int: "an integer", float: "a double", str: "a string"}


@dataclass(frozen=True, slots=True)
class Constraint:
    """The allowed values of a parameter: a test, and its description."""

    text: str
    is_met_by: Callable[[Any], bool]


def one_of(*values: object) -> Constraint:
    """Allow the values listed."""
    return Constraint(f"one of {', '.join(map(str, values))}", lambda value: value in values)


def greater_than(limit: float) -> Constraint:
    """Allow finite numbers greater than `limit`."""
    return Constraint(f"above {limit:g}", lambda value: math.isfinite(value) and value > limit)


def at_least(limit: float) -> Constraint:
    """Allow finite numbers that are `limit` or more."""
    return Constraint(f"{limit:g} or more", lambda value: math.isfinite(value) and value >= limit)


def any_bool() -> Constraint:
    """Allow both truth values."""
    return Constraint("true or false", lambda _: True)


@contextmanager
def destroy_on_value_error(node: Any) -> Iterator[None]:
    """Destroy a node whose parameters are invalid, so that it is not left in the graph."""
    try:
        yield
    except ValueError:
        node.destroy_node()
        raise


def declare(node: Node, name: str, default: T, meaning: str, constraint: Constraint) -> T:
    """Declare a parameter that is fixed when the node starts, and return its value.

    The parameter's type is that of `default`; as always in ROS, 5 is not a double.

    Raises:
        ValueError: the value has another type, or is not allowed.
    """
    words = f"{_TYPES[type(default)]}, {constraint.text}"
    descriptor = ParameterDescriptor(
        description=meaning, additional_constraints=words, read_only=True
    )
    try:
        value: T = node.declare_parameter(name, default, descriptor).value
    except InvalidParameterTypeException as refused:
        why = str(refused.args[0]).removesuffix(f": {name}")
        raise ValueError(f"parameter '{name}' must be {words} ({why})") from refused
    if not constraint.is_met_by(value):
        raise ValueError(f"parameter '{name}' must be {words}; it is {value!r}")
    return value


QOS_DEPTH = 10
_LOG_INTERVAL_S = 5.0


def subscribe_pair(
    node: Node, image_topic: str, info_topic: str, on_pair: Callable[[Any, Any], None]
) -> None:
    """Call `on_pair(image, camera_info)` for each two messages with the same stamp.

    See `subscribe_set`.
    """
    subscribe_set(node, {image_topic: Image, info_topic: CameraInfo}, on_pair)


def subscribe_set(node: Node, topics: Mapping[str, type], on_set: Callable[..., None]) -> None:
    """Call `on_set` with one message of each topic, in their order, all with the same stamp.

    If more than `QOS_DEPTH` messages of a topic wait for the others, the oldest is dropped, and
    that is logged at most every few seconds. A ValueError of `on_set` means an unusable message:
    it is logged, and the node continues with the next one.
    """
    sets = StampSets(tuple(topics), QOS_DEPTH)
    logger: Any = node.get_logger()
    others = " and ".join(list(topics)[1:])
    reported = 0

    def receive(topic: str, message: Any) -> None:
        nonlocal reported
        found = sets.add(topic, _stamp_ns(message), message)
        if found is not None:
            try:
                on_set(*found)
            except ValueError as unusable:
                logger.error(f"message dropped: {unusable}", throttle_duration_sec=_LOG_INTERVAL_S)
        elif sets.discarded > reported:
            reported = sets.discarded
            logger.warning(
                f"{reported} messages dropped so far, without a partner of the same stamp; "
                f"each message on {next(iter(topics))} needs one on {others}",
                throttle_duration_sec=_LOG_INTERVAL_S,
            )

    def receiver(topic: str) -> Callable[[Any], None]:
        return lambda message: receive(topic, message)

    for topic, kind in topics.items():
        node.create_subscription(kind, topic, receiver(topic), QOS_DEPTH)


def _stamp_ns(message: Any) -> int:
    stamp = message.header.stamp
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)
