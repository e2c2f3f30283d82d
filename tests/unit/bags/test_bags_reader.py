"""Messages come in time order, as they were published, and damage is reported."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import pytest

from data_bags import START_NS, change_storage, refusal_of
from r2bspec.bags.bag_index import index_bag
from r2bspec.bags.bag_reader import read_messages
from r2bspec.bags.recording import DataError, TimeWindow


def read(bag: Path, topics: Iterable[str] = ("/ping", "/pong")) -> list[tuple[str, int, bytes]]:
    return [
        (message.topic, message.time_ns - START_NS, message.data)
        for message in read_messages(bag, list(topics))
    ]


def test_touches_only_the_named_topics(bag: Path) -> None:
    change_storage(
        bag,
        "UPDATE messages SET data = x'DEAD' WHERE topic_id ="
        " (SELECT id FROM topics WHERE name = '/pong')",
    )
    assert [topic for topic, _, _ in read(bag, ["ping"])] == ["/ping"] * 3
    with pytest.raises(DataError, match="is not CDR"):
        read(bag, ["/pong"])


@pytest.mark.parametrize(
    ("start_ns", "end_ns"), [(50_000_001, None), (5, 5), (5, 4), (-1, None), (-5, -1)]
)
def test_refuses_windows_that_hold_nothing(bag: Path, start_ns: int, end_ns: int | None) -> None:
    assert (
        refusal_of(read_messages, bag, ["/ping"], TimeWindow(start_ns=start_ns, end_ns=end_ns)).code
        == "R2B309"
    )


def test_proposes_the_topic_that_was_meant(bag: Path) -> None:
    with pytest.raises(DataError, match="no topic /pingg") as caught:
        read_messages(bag, ["/pingg"])
    assert (caught.value.code, caught.value.hint) == ("R2B308", "did you mean /ping?")


def test_refuses_a_foreign_serialization_only_where_it_is_named(bag: Path) -> None:
    change_storage(bag, "UPDATE topics SET serialization_format = 'protobuf' WHERE name = '/ping'")
    foreign = [
        name for name, info in index_bag(bag).topics.items() if info.serialization == "protobuf"
    ]
    assert len(read(bag, {"/ping", "/pong"}.difference(foreign))) == 3
    assert refusal_of(read_messages, bag, foreign).code == "R2B306"
