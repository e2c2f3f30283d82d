"""The pieces that rules are made of."""

from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from r2bspec.bags import has_header
from r2bspec.check import message_types
from r2bspec.check.message_text import pluralize, quoted_list, suggestion
from r2bspec.check.parameter_types import parameter_type
from r2bspec.check.sample_size import DEFAULT_CONFIDENCE, min_sample_size


@pytest.mark.parametrize(
    ("allowed", "needed"), [(0.01, 299), (0.001, 2995), (0.1, 29), (0.5, 5), (0.005, 598)]
)
def test_the_messages_that_a_share_needs(allowed: float, needed: int) -> None:
    assert min_sample_size(allowed) == needed


def test_nothing_shows_that_nothing_is_ever_lost() -> None:
    assert min_sample_size(0) is None
    assert min_sample_size(1) == 1


@given(st.floats(1e-6, 0.999))
def test_it_is_the_least_number_that_is_enough(allowed: float) -> None:
    needed = min_sample_size(allowed)
    assert needed is not None

    def doubt(number: int) -> float:
        return math.exp(number * math.log1p(-allowed))

    assert doubt(needed) <= (1 - DEFAULT_CONFIDENCE) * (1 + 1e-6)
    assert needed == 1 or doubt(needed - 1) > (1 - DEFAULT_CONFIDENCE) * (1 - 1e-6)


def test_the_statistics_of_verdicts_agree() -> None:
    from r2bspec.judge.statistics.binomial import upper_bound
    from r2bspec.judge.verdict import CONFIDENCE as OF_VERDICTS

    assert DEFAULT_CONFIDENCE == OF_VERDICTS
    for allowed in (0.001, 0.01, 0.05, 0.5):
        needed = min_sample_size(allowed) or 0
        assert upper_bound(0, needed, DEFAULT_CONFIDENCE) <= allowed + 1e-12
        assert upper_bound(0, needed - 1, DEFAULT_CONFIDENCE) > allowed


def test_the_frequent_types_are_what_rosbags_says() -> None:
    for name in message_types.WITH_HEADER | message_types.WITHOUT_HEADER:
        assert has_header.begins_with_header(name) is (name in message_types.WITH_HEADER)
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


def test_counts() -> None:
    assert pluralize(1, "message") == "1 message"
    assert pluralize(3000, "message") == "3,000 messages"
