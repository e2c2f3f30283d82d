"""What the reference nodes share: declared parameters, and images of equal stamps."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeVar

from rcl_interfaces.msg import ParameterDescriptor
from rclpy.exceptions import InvalidParameterTypeException
from rclpy.node import Node

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


def positive() -> Constraint:
    """Allow finite numbers greater than 0."""
    return Constraint("above 0", lambda value: math.isfinite(value) and value > 0)


def at_least(limit: float) -> Constraint:
    """Allow finite numbers that are `limit` or more."""
    return Constraint(f"{limit:g} or more", lambda value: math.isfinite(value) and value >= limit)


def any_bool() -> Constraint:
    """Allow both truth values."""
    return Constraint("true or false", lambda _: True)


QOS_DEPTH = 10
_LOG_INTERVAL_S = 5.0


class ReferenceNode(Node):
    """A node of this package.

    Attributes:
        name_by_default: its name where none is given.
    """

    name_by_default = ""

    def __init__(self, node_name: str = "", **kwargs: Any) -> None:
        super().__init__(node_name or self.name_by_default, **kwargs)
        try:
            self.start()
        except ValueError:
            # A node whose parameters are invalid must not be left in the graph.
            self.destroy_node()
            raise

    def start(self) -> None:
        """Declare the parameters, and create publishers and subscriptions.

        Raises:
            ValueError: the value of a parameter is not allowed.
        """
        raise NotImplementedError

    def declare(self, name: str, default: T, meaning: str, constraint: Constraint) -> T:
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
            value: T = self.declare_parameter(name, default, descriptor).value
        except InvalidParameterTypeException as refused:
            why = str(refused.args[0]).removesuffix(f": {name}")
            raise ValueError(f"parameter '{name}' must be {words} ({why})") from refused
        if not constraint.is_met_by(value):
            raise ValueError(f"parameter '{name}' must be {words}; it is {value!r}")
        return value

    def subscribe_set(self, topics: Mapping[str, type], on_set: Callable[..., None]) -> None:
        """Call `on_set` with a message of each topic, in their order, all with the same stamp.

        If more than `QOS_DEPTH` messages of a topic wait for the others, the oldest is dropped, and
        that is logged at most every few seconds. A ValueError of `on_set` means an unusable
        message: it is logged, and the node continues with the next set.
        """
        sets = StampSets(tuple(topics), QOS_DEPTH)
        logger: Any = self.get_logger()
        others = " and ".join(list(topics)[1:])
        reported = 0

        def receive(topic: str, message: Any) -> None:
            nonlocal reported
            stamp = message.header.stamp
            stamp_ns = int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)
            messages = sets.add(topic, stamp_ns, message)
            if messages is not None:
                try:
                    on_set(*messages)
                except ValueError as unusable:
                    logger.error(
                        f"message dropped: {unusable}", throttle_duration_sec=_LOG_INTERVAL_S
                    )
            elif sets.discarded > reported:
                reported = sets.discarded
                logger.warning(
                    f"{reported} messages dropped so far, without a partner of the same stamp; "
                    f"each message on {next(iter(topics))} needs one on {others}",
                    throttle_duration_sec=_LOG_INTERVAL_S,
                )

        for topic, kind in topics.items():
            self.create_subscription(kind, topic, partial(receive, topic), QOS_DEPTH)
