"""Declaring node parameters with constraints on their values."""

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
