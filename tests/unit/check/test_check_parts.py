"""The pieces that rules are made of."""

from __future__ import annotations

from typing import Any

import pytest
from rosbags.interfaces import Nodetype

from r2bspec.bags import message_types
from r2bspec.check.rules.node_settings import parameter_type
from r2bspec.diagnostics.quote import quoted_list, suggestion


def test_the_frequent_types_are_what_rosbags_says() -> None:
    fields = message_types.typestore().fielddefs
    for name in message_types.WITH_HEADER | message_types.WITHOUT_HEADER:
        begins = fields[name][1][0][1] == (Nodetype.NAME, "std_msgs/msg/Header")
        assert begins is (name in message_types.WITH_HEADER)
    assert message_types.begins_with_header("geometry_msgs/msg/WrenchStamped") is True
    assert message_types.begins_with_header("geometry_msgs/msg/Wrench") is False
    assert message_types.begins_with_header("my_msgs/msg/Thing") is None


def test_the_types_of_a_package() -> None:
    assert "sensor_msgs/msg/Range" in message_types.types_of_same_package("sensor_msgs/msg/Rnage")
    assert message_types.types_of_same_package("my_msgs/msg/Thing") == frozenset()


@pytest.mark.parametrize(
    ("value", "kind"),
    [
        (True, "bool"),
        (1, "integer"),
        (1.0, "double"),
        ("1", "string"),
        ([True], "bool_array"),
        ([1, 2], "integer_array"),
        ([1.0], "double_array"),
        (["a"], "string_array"),
        ([], None),
        ([1, 2.0], None),
        ([True, 1], None),
        ([[1]], None),
        ([1, [1]], None),
    ],
)
def test_parameter_types(value: Any, kind: str | None) -> None:
    assert parameter_type(value) == kind


def test_lists_in_sentences() -> None:
    assert quoted_list([]) == ""
    assert quoted_list(["a"]) == "'a'"
    assert quoted_list(["a", "b", "a"]) == "'a' and 'b'"
    assert quoted_list(["a", "b", "c"]) == "'a', 'b' and 'c'"
    assert quoted_list([str(n) for n in range(20)]).endswith("'7' and 12 more")


def test_suggestions() -> None:
    assert suggestion("imgae", ["image", "depth"], "topics") == "did you mean 'image'?"
    assert suggestion("x", ["image", "depth"], "topics") == "topics: 'depth' and 'image'"
    assert suggestion("x", [], "topics") == ""
