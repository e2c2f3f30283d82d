"""Inputs of one step belong together by their stamps, never by the order of their arrival."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from r2bspec.execute.build_schedule import align
from r2bspec.execute.errors import RunError
from r2bspec.ipc.buffers import BufferIndex


def recorded(topic: str, *stamps_ns: int, header: bool = True) -> BufferIndex:
    return BufferIndex(
        topic=topic,
        type="sensor_msgs/msg/Image",
        has_header=header,
        stamps_ns=stamps_ns,
        sizes=(100,) * len(stamps_ns),
        times_ns=stamps_ns,
    )


def test_a_message_that_is_missing_on_one_side_shifts_no_later_pair() -> None:
    left = recorded("/left", 10, 20, 30, 40)
    right = recorded("/right", 10, 30, 40)
    aligned = align([left, right], 0)
    assert aligned.steps == ((0, 0), (2, 1), (3, 2))
    assert aligned.unpaired == {"/left": 1}


def test_both_sides_can_miss_messages() -> None:
    aligned = align([recorded("/left", 10, 20, 30), recorded("/right", 20, 30, 40)], 0)
    assert aligned.steps == ((1, 0), (2, 1))
    assert aligned.unpaired == {"/left": 1, "/right": 1}


def test_the_order_of_arrival_does_not_matter() -> None:
    aligned = align([recorded("/left", 20, 10, 30), recorded("/right", 30, 20, 10)], 0)
    assert aligned.steps == ((1, 2), (0, 1), (2, 0))
    assert aligned.unpaired == {}


def test_of_two_messages_with_one_stamp_one_is_played() -> None:
    aligned = align([recorded("/left", 10, 10, 20), recorded("/right", 10, 20)], 0)
    assert [step[1] for step in aligned.steps] == [0, 1]
    assert aligned.unpaired == {"/left": 1}


def test_the_limit_counts_steps() -> None:
    left, right = recorded("/left", 10, 20, 30, 40), recorded("/right", 20, 30, 40)
    assert align([left, right], 2).steps == ((1, 0), (2, 1))
    # What the limit cuts off has a partner all the same.
    assert align([left, right], 2).unpaired == {"/left": 1}
    assert len(align([left, right], 99).steps) == 3


def test_an_input_without_a_header_goes_by_order_and_starts_again_when_it_is_shorter() -> None:
    image = recorded("/image", 10, 20, 30, 40, 50)
    text = recorded("/text", 1, 2, header=False)
    assert align([image, text], 0).steps == ((0, 0), (1, 1), (2, 0), (3, 1), (4, 0))
    assert align([text, image], 0).unpaired == {}


def test_inputs_that_all_lack_headers_are_as_many_steps_as_the_longest() -> None:
    aligned = align([recorded("/a", 1, 2, 3, header=False), recorded("/b", 7, 8, header=False)], 0)
    assert aligned.steps == ((0, 0), (1, 1), (2, 0))


def test_one_input_is_played_in_the_order_of_its_stamps() -> None:
    assert align([recorded("/image", 30, 10, 20)], 0).steps == ((1,), (2,), (0,))


def test_an_input_that_got_no_message_is_named() -> None:
    with pytest.raises(RunError, match="no messages were buffered for /right") as raised:
        align([recorded("/left", 10), recorded("/right")], 0)
    assert raised.value.code == "R2B643"
    assert raised.value.exit_code == 4


def test_inputs_with_no_stamp_in_common_are_refused_with_their_counts() -> None:
    with pytest.raises(RunError, match="/left: 2, /right: 1") as raised:
        align([recorded("/left", 10, 20), recorded("/right", 11)], 0)
    assert (raised.value.code, raised.value.exit_code) == ("R2B644", 2)
    assert "stamps" in raised.value.hint


STAMPS = st.lists(st.integers(0, 30), min_size=1, max_size=40)


@given(inputs=st.lists(STAMPS, min_size=1, max_size=4), limit=st.integers(0, 10))
def test_all_inputs_of_a_step_have_one_stamp_and_none_is_played_twice(
    inputs: list[list[int]], limit: int
) -> None:
    indices = [recorded(f"/topic{n}", *stamps) for n, stamps in enumerate(inputs)]
    common = set(inputs[0]).intersection(*inputs[1:])
    if not common:
        with pytest.raises(RunError):
            align(indices, limit)
        return
    steps = align(indices, limit).steps
    stamps = [
        {indices[column].stamps_ns[position] for column, position in enumerate(step)}
        for step in steps
    ]
    assert all(len(each) == 1 for each in stamps)
    played = [each.pop() for each in stamps]
    assert played == sorted(common)[: limit or None]
