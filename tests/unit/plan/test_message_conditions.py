"""Conditions on messages: the grammar, what a type allows, and serialised messages."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from r2bspec.bags.message_types import typestore
from r2bspec.language.comparison_grammar import ComparisonError, parse_condition
from r2bspec.plan import message_conditions
from r2bspec.plan.message_conditions import (
    ConditionMistake,
    MessageCondition,
    UnreadableError,
    message_condition,
)

POSES, STATUS = "geometry_msgs/msg/PoseArray", "diagnostic_msgs/msg/DiagnosticArray"


def new(kind: str, **fields: Any) -> Any:
    return typestore().types[kind](**fields)


def header(frame: str = "base") -> Any:
    stamp = new("builtin_interfaces/msg/Time", sec=12, nanosec=500_000_000)
    return new("std_msgs/msg/Header", stamp=stamp, frame_id=frame)


def poses(*xs: float, frame: str = "base") -> bytes:
    turned = new("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0)
    each = [
        new(
            "geometry_msgs/msg/Pose",
            position=new("geometry_msgs/msg/Point", x=x, y=0.0, z=0.0),
            orientation=turned,
        )
        for x in xs
    ]
    made = new(POSES, header=header(frame), poses=each)
    return bytes(typestore().serialize_cdr(made, POSES))


def diagnostics(*levels: int) -> bytes:
    value = new("diagnostic_msgs/msg/KeyValue", key="k", value="a longer value")
    status = [
        new(
            "diagnostic_msgs/msg/DiagnosticStatus",
            level=level,
            name=f"n{level}",
            message="",
            hardware_id="x",
            values=[value] * level,
        )
        for level in levels
    ]
    made = new(STATUS, header=header(), status=status)
    return bytes(typestore().serialize_cdr(made, STATUS))


def condition(text: str, kind: str) -> MessageCondition:
    found = message_condition(parse_condition(text), kind)
    assert isinstance(found, MessageCondition), found
    return found


@pytest.mark.parametrize("frame", ["", "a", "base", "camera_link_2"])
@pytest.mark.parametrize(
    ("text", "holds"),
    [
        ("len(poses) > 1", True),
        ("len(poses) == 3", False),
        ("poses[0].position.x == 1", True),
        ("poses[1].position.x < -1.5", True),
        ("poses[2].position.x != 0", False),
        ("poses[*].position.x < 0", True),
        ("poses[*].orientation.w < 1", False),
        ("header.stamp >= 12.5", True),
        ("header.stamp > 12.5", False),
        ("header.stamp.nanosec == 500000000", True),
    ],
)
def test_a_message_meets_a_condition(text: str, frame: str, holds: bool) -> None:
    assert condition(text, POSES).holds(poses(1.0, -2.0, frame=frame)) is holds


@pytest.mark.parametrize(
    ("text", "holds"),
    [
        ("status[*].level == ERROR", True),
        ("status[0].level == ERROR", False),
        ("status[*].name == 'n2'", True),
        ('status[1].values[1].value == "a longer value"', True),
        ("status[0].values[0].key == 'k'", False),
        ("len(status[1].hardware_id) == 1", True),
    ],
)
def test_texts_constants_and_lists_in_lists(text: str, holds: bool) -> None:
    assert condition(text, STATUS).holds(diagnostics(0, 2)) is holds


def test_a_constant_of_an_installed_type_is_known(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("diagnostic_msgs")
    monkeypatch.setattr(message_conditions, "_common", lambda _: None)
    message_conditions.message_fields.cache_clear()
    try:
        assert condition("status[*].level == STALE", STATUS).literal == 3
        assert condition("status[*].level == STALE", STATUS).holds(diagnostics(1, 3))
    finally:
        message_conditions.message_fields.cache_clear()


def test_arrays_of_a_fixed_size_are_passed_over() -> None:
    kind = "sensor_msgs/msg/Imu"
    vector = new("geometry_msgs/msg/Vector3", x=0.0, y=0.0, z=9.8)
    made = new(
        kind,
        header=header("i"),
        orientation=new("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0),
        orientation_covariance=np.arange(9.0),
        angular_velocity=vector,
        angular_velocity_covariance=np.zeros(9),
        linear_acceleration=vector,
        linear_acceleration_covariance=np.zeros(9),
    )
    data = bytes(typestore().serialize_cdr(made, kind))
    assert condition("linear_acceleration.z > 9", kind).holds(data)
    assert condition("orientation_covariance[8] == 8", kind).holds(data)
    assert condition("len(orientation_covariance) == 9", kind).holds(data)
    (wrong,) = [message_condition(parse_condition("orientation_covariance[9] == 0"), kind)]
    assert isinstance(wrong, ConditionMistake)


def test_what_is_cut_off_or_damaged_is_unreadable() -> None:
    data, wanted = poses(1.0, 2.0), condition("poses[1].position.x > 0", POSES)
    assert wanted.holds(data)
    for end in range(len(data) - 48):
        with pytest.raises(UnreadableError):
            wanted.holds(data[:end])
    for place in range(4, len(data)):
        damaged = bytearray(data)
        damaged[place] = 0xFF
        try:
            wanted.holds(bytes(damaged))
        except UnreadableError:
            continue


@pytest.mark.parametrize(
    ("text", "column"),
    [
        ("", 0),
        ("  > 3", 2),
        ("poses", 5),
        ("len(poses", 3),
        ("poses[x] > 3", 5),
        ("poses = 3", 6),
        ("poses > 3 ms", 8),
        ("data == maybe", 8),
        ("a == 'b", 5),
    ],
)
def test_what_is_no_condition_is_refused_at_its_place(text: str, column: int) -> None:
    with pytest.raises(ComparisonError) as refused:
        parse_condition(text)
    assert refused.value.column == column


@pytest.mark.parametrize(
    ("text", "kind", "part", "help_text"),
    [
        ("len(pose) > 0", POSES, "no field 'pose'", "poses"),
        ("poses.position.x > 0", POSES, "a list has no field", "[*]"),
        ("poses > 0", POSES, "a list cannot be compared", "len()"),
        ("header[0] > 0", POSES, "has no items", "brackets"),
        ("header > 0", POSES, "cannot be compared", "stamp"),
        ("len(header) > 0", POSES, "has no length", "len()"),
        ("header.frame_id > 3", POSES, "a text in quotes", ""),
        ("status[0].level == BROKEN", STATUS, "no constant 'BROKEN'", "ERROR"),
        ("data == 1", "std_msgs/msg/Bool", "true or false", ""),
        ("data == 'on'", "std_msgs/msg/Int32", "a number", ""),
    ],
)
def test_what_a_type_does_not_allow_is_said(
    text: str, kind: str, part: str, help_text: str
) -> None:
    found = message_condition(parse_condition(text), kind)
    assert isinstance(found, ConditionMistake)
    assert part in found.message
    assert help_text in found.help


def test_nothing_is_said_of_an_unknown_type() -> None:
    assert message_condition(parse_condition("a > 0"), "my_msgs/msg/Unknown") is None
