"""Messages paired by their stamps, whatever their order."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from r2bspec.nodes.stamp_pairs import StampPairs


def test_either_side_may_come_first() -> None:
    pairs: StampPairs[str, int] = StampPairs(3)
    assert pairs.add_first(1, "a") is None
    assert pairs.add_second(1, 10) == ("a", 10)
    assert pairs.add_second(2, 20) is None
    assert pairs.add_first(2, "b") == ("b", 20)


def test_a_pair_is_made_once() -> None:
    pairs: StampPairs[str, int] = StampPairs(3)
    pairs.add_first(1, "a")
    pairs.add_second(1, 10)
    assert pairs.add_second(1, 11) is None


def test_a_lost_message_leaves_the_others_paired() -> None:
    pairs: StampPairs[str, int] = StampPairs(3)
    made = [pairs.add_first(stamp, f"image {stamp}") for stamp in (1, 2, 3)]
    made += [pairs.add_second(stamp, stamp) for stamp in (1, 3)]
    assert [pair for pair in made if pair] == [("image 1", 1), ("image 3", 3)]


def test_the_oldest_waiting_message_is_given_up_first() -> None:
    pairs: StampPairs[str, int] = StampPairs(2)
    for stamp in (5, 1, 3):
        pairs.add_first(stamp, str(stamp))
    assert pairs.discarded == 1
    assert pairs.add_second(5, 0) is None
    assert pairs.add_second(1, 0) == ("1", 0)
    assert pairs.add_second(3, 0) == ("3", 0)


def test_a_repeated_stamp_replaces_and_is_counted() -> None:
    pairs: StampPairs[str, int] = StampPairs(2)
    pairs.add_first(1, "old")
    pairs.add_first(1, "new")
    assert pairs.discarded == 1
    assert pairs.add_second(1, 0) == ("new", 0)


@given(st.permutations([(side, stamp) for side in "AB" for stamp in range(6)]))
def test_any_order_of_complete_pairs_gives_all_of_them(order: list[tuple[str, int]]) -> None:
    pairs: StampPairs[int, int] = StampPairs(6)
    made = [
        pairs.add_first(stamp, stamp) if side == "A" else pairs.add_second(stamp, stamp)
        for side, stamp in order
    ]
    assert sorted(pair for pair in made if pair) == [(stamp, stamp) for stamp in range(6)]
    assert pairs.discarded == 0
