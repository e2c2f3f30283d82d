"""Promise: messages that a synchroniser in the graph would pair are one step, and only these."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from r2bspec.execute.build_schedule import align
from r2bspec.ipc.buffers import BufferIndex
from r2bspec.plan.nearest_stamps import pair_nearest

MS = 1_000_000

STAMPS = st.lists(st.integers(0, 2000), min_size=1, max_size=30, unique=True)


def recorded(topic: str, *stamps_ns: int) -> BufferIndex:
    return BufferIndex(
        topic=topic,
        type="sensor_msgs/msg/Image",
        has_header=True,
        stamps_ns=stamps_ns,
        sizes=(100,) * len(stamps_ns),
        times_ns=stamps_ns,
    )


def test_two_cameras_three_milliseconds_apart_are_pairs_and_keep_their_difference() -> None:
    left = recorded("/left", *(step * 33 * MS for step in range(10)))
    right = recorded("/right", *(step * 33 * MS + 3 * MS for step in range(10) if step != 4))
    aligned = align([left, right], 0, [10 * MS, 10 * MS])
    assert len(aligned.steps) == 9
    assert (4, 4) not in aligned.steps
    assert aligned.unpaired == {"/left": 1}
    assert set(aligned.stamp_offsets_ns) == {(-3 * MS, 0)}


def test_a_slop_that_nothing_needs_changes_nothing() -> None:
    left, right = recorded("/left", 10, 20, 30), recorded("/right", 10, 20, 30)
    assert align([left, right], 0, [5, 5]) == align([left, right], 0)


def test_the_larger_slop_of_a_pair_counts() -> None:
    assert pair_nearest([[0, 100], [8, 108]], [0, 10]) == ((0, 0), (1, 1))
    assert pair_nearest([[0, 100], [8, 108]], [0, 5]) == ()


def test_the_input_with_the_fewest_messages_leads() -> None:
    camera, imu = [0, 33, 66], list(range(1, 70, 5))
    pairs = pair_nearest([camera, imu], [10, 10])
    assert [camera[one] for one, _ in pairs] == camera
    assert [imu[other] for _, other in pairs] == [1, 31, 66]


def test_a_message_goes_to_the_nearer_one_of_two() -> None:
    assert pair_nearest([[0, 6], [5, 90]], [10, 10]) == ((1, 0),)


@given(left=STAMPS, right=STAMPS, slop=st.integers(0, 100))
def test_pairs_are_within_the_slop_ordered_and_disjoint(
    left: list[int], right: list[int], slop: int
) -> None:
    pairs = pair_nearest([left, right], [slop, slop])
    stamps = [(left[one], right[other]) for one, other in pairs]
    assert all(abs(one - other) <= slop for one, other in stamps)
    assert stamps == sorted(stamps)
    assert len({one for one, _ in pairs}) == len({other for _, other in pairs}) == len(pairs)
    # Neither of a pair has a nearer partner.
    for one, other in stamps:
        assert min(abs(one - each) for each in right) == abs(one - other)
        assert min(abs(other - each) for each in left) == abs(one - other)


@given(left=STAMPS, right=STAMPS)
def test_without_a_slop_stamps_are_equal(left: list[int], right: list[int]) -> None:
    pairs = pair_nearest([left, right], [0, 0])
    assert [left[one] for one, _ in pairs] == sorted(set(left) & set(right))
