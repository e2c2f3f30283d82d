"""Declaring node parameters whose values are checked, and refused in words."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, TypeVar

from rcl_interfaces.msg import ParameterDescriptor
from rclpy.exceptions import InvalidParameterTypeException
from rclpy.node import Node

T = TypeVar("T", bool, int, float, str)

_TYPES = {bool: "a bool", int: "an integer", float: "a double", str: "a string"}


@dataclass(frozen=True, slots=True)
class Allowed:
    """Which values a parameter may have: a test, and the same in words."""

    words: str
    holds: Callable[[Any], bool]


def one_of(*values: object) -> Allowed:
    """Allow the values listed."""
    return Allowed(f"one of {', '.join(map(str, values))}", lambda value: value in values)


def above(limit: float) -> Allowed:
    """Allow finite numbers greater than `limit`."""
    return Allowed(f"above {limit:g}", lambda value: math.isfinite(value) and value > limit)


def at_least(limit: float) -> Allowed:
    """Allow finite numbers that are `limit` or more."""
    return Allowed(f"{limit:g} or more", lambda value: math.isfinite(value) and value >= limit)


def either() -> Allowed:
    """Allow both truth values."""
    return Allowed("true or false", lambda _: True)


@contextmanager
def destroyed_if_refused(node: Any) -> Iterator[None]:
    """Leave no half-made node in the graph where its parameters are refused."""
    try:
        yield
    except ValueError:
        node.destroy_node()
        raise


def declare(node: Node, name: str, default: T, meaning: str, allowed: Allowed) -> T:
    """Declare a parameter that is fixed when the node starts, and return its value.

    The parameter's type is that of `default`; as everywhere in ROS, 5 is no double.

    Raises:
        ValueError: the value given is of another type, or not an allowed one.
    """
    words = f"{_TYPES[type(default)]}, {allowed.words}"
    descriptor = ParameterDescriptor(
        description=meaning, additional_constraints=words, read_only=True
    )
    try:
        value: T = node.declare_parameter(name, default, descriptor).value
    except InvalidParameterTypeException as refused:
        why = str(refused.args[0]).removesuffix(f": {name}")
        raise ValueError(f"parameter '{name}' must be {words} ({why})") from refused
    if not allowed.holds(value):
        raise ValueError(f"parameter '{name}' must be {words}; it is {value!r}")
    return value
