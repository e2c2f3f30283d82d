"""Messages put together by their stamps, whatever their order."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from r2bspec.nodes.stamp_sets import StampSets


def test_the_oldest_waiting_message_is_given_up_first() -> None:
    pairs = StampSets(("A", "B"), 2)
    for stamp in (5, 1, 3):
        pairs.add("A", stamp, str(stamp))
    assert pairs.discarded == 1
    assert pairs.add("B", 5, 0) is None
    assert pairs.add("B", 1, 0) == ("1", 0)
    assert pairs.add("B", 3, 0) == ("3", 0)


def test_a_repeated_stamp_replaces_and_is_counted() -> None:
    pairs = StampSets(("A", "B"), 2)
    pairs.add("A", 1, "old")
    pairs.add("A", 1, "new")
    assert pairs.discarded == 1
    assert pairs.add("B", 1, 0) == ("new", 0)


@given(st.permutations([(topic, stamp) for topic in "ABCD" for stamp in range(4)]))
def test_any_order_of_complete_sets_gives_all_of_them(order: list[tuple[str, int]]) -> None:
    sets = StampSets("ABCD", 4)
    made = [sets.add(topic, stamp, f"{topic}{stamp}") for topic, stamp in order]
    expected = [tuple(f"{topic}{stamp}" for topic in "ABCD") for stamp in range(4)]
    assert sorted(each for each in made if each) == expected
    assert sets.discarded == 0
