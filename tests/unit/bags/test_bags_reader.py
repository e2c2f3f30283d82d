"""Messages come in time order, as they were published, and damage is reported."""

from __future__ import annotations

import random
import shutil
import sqlite3
from collections.abc import Iterable
from contextlib import closing
from pathlib import Path
from typing import Literal

import pytest
import yaml

from data_bags import START_NS, chatter, edit_metadata, storage_file, text, write_bag
from r2bspec.bags.bag_index import index_bag
from r2bspec.bags.bag_reader import read_messages
from r2bspec.bags.recording import DataError, Window


def read(
    bag: Path, topics: Iterable[str] = ("/ping", "/pong"), window: Window | None = None
) -> list[tuple[str, int, bytes]]:
    return [
        (message.topic, message.time_ns - START_NS, message.data)
        for message in read_messages(bag, list(topics), window)
    ]


@pytest.mark.parametrize(
    ("storage", "compression"),
    [
        ("sqlite3", "none"),
        ("sqlite3", "message"),
        ("sqlite3", "file"),
        ("mcap", "none"),
        ("mcap", "message"),
        ("mcap", "storage"),
    ],
)
def test_gives_the_published_bytes(
    tmp_path: Path,
    storage: Literal["sqlite3", "mcap"],
    compression: Literal["none", "message", "file", "storage"],
) -> None:
    bag = write_bag(tmp_path / "bag", chatter(), storage=storage, compression=compression)
    assert read(bag) == chatter()


def test_touches_only_the_named_topics(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", chatter())
    with closing(sqlite3.connect(storage_file(bag))) as database, database:
        database.execute(
            "UPDATE messages SET data = x'DEAD' WHERE topic_id ="
            " (SELECT id FROM topics WHERE name = '/pong')"
        )
    assert [topic for topic, _, _ in read(bag, ["ping"])] == ["/ping"] * 3
    with pytest.raises(DataError, match="is not CDR"):
        read(bag, ["/pong"])


@pytest.mark.parametrize("storage", ["sqlite3", "mcap"])
@pytest.mark.parametrize(
    ("start_ns", "end_ns", "expected"),
    [
        (0, None, [0, 1, 2, 3, 4, 5]),
        (0, 1, [0]),
        (1, 20_000_000, [1]),
        (20_000_000, 20_000_001, [2]),
        (21_000_000, 22_000_000, []),
        (50_000_000, None, [5]),
        (30_000_000, 900_000_000, [3, 4, 5]),
    ],
)
def test_windows_are_half_open_and_count_from_the_start(
    tmp_path: Path,
    storage: Literal["sqlite3", "mcap"],
    start_ns: int,
    end_ns: int | None,
    expected: list[int],
) -> None:
    bag = write_bag(tmp_path / "bag", chatter(), storage=storage)
    window = Window(start_ns=start_ns, end_ns=end_ns)
    assert read(bag, window=window) == [chatter()[number] for number in expected]


@pytest.mark.parametrize(
    ("start_ns", "end_ns"), [(50_000_001, None), (5, 5), (5, 4), (-1, None), (-5, -1)]
)
def test_refuses_windows_that_hold_nothing(
    tmp_path: Path, start_ns: int, end_ns: int | None
) -> None:
    bag = write_bag(tmp_path / "bag", chatter())
    with pytest.raises(DataError) as caught:
        read_messages(bag, ["/ping"], Window(start_ns=start_ns, end_ns=end_ns))
    assert caught.value.code == "R2B309"


def test_proposes_the_topic_that_was_meant(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", chatter())
    with pytest.raises(DataError, match="no topic /pingg") as caught:
        read_messages(bag, ["/pingg"])
    assert (caught.value.code, caught.value.hint) == ("R2B308", "did you mean /ping?")


def test_refuses_a_foreign_serialization_only_where_it_is_named(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", chatter())
    edit_metadata(bag, "serialization_format: cdr", "serialization_format: protobuf", count=1)
    foreign = [
        name for name, info in index_bag(bag).topics.items() if info.serialization == "protobuf"
    ]
    assert len(read(bag, {"/ping", "/pong"}.difference(foreign))) == 3
    with pytest.raises(DataError) as caught:
        read_messages(bag, foreign)
    assert caught.value.code == "R2B306"


def test_merges_files_that_overlap_in_time(tmp_path: Path) -> None:
    first = write_bag(tmp_path / "first", chatter()[::2])
    second = write_bag(tmp_path / "second", chatter()[1::2])
    shutil.copy(storage_file(second), first)
    document, other = (
        yaml.safe_load((bag / "metadata.yaml").read_text()) for bag in (first, second)
    )
    metadata, addition = (each["rosbag2_bagfile_information"] for each in (document, other))
    for key in ("relative_file_paths", "topics_with_message_count", "message_count"):
        metadata[key] += addition[key]
    (first / "metadata.yaml").write_text(yaml.safe_dump(document))

    assert read(first) == chatter()


@pytest.mark.parametrize("storage", ["sqlite3", "mcap"])
def test_any_damage_is_a_data_error(tmp_path: Path, storage: Literal["sqlite3", "mcap"]) -> None:
    choose = random.Random(7)  # noqa: S311
    bag = write_bag(tmp_path / "bag", chatter(40), storage=storage)
    file = storage_file(bag)
    whole = file.read_bytes()
    refused = 0
    for attempt in range(60):
        damaged = bytearray(whole)
        if attempt % 3:
            for _ in range(40):
                damaged[choose.randrange(len(damaged))] ^= 1 << choose.randrange(8)
        else:
            del damaged[choose.randrange(len(damaged)) :]
        file.write_bytes(damaged)
        try:
            list(read_messages(bag, ["/ping", "/pong"]))
        except DataError:
            refused += 1
    assert refused > 30


def test_a_message_whose_compression_is_damaged_is_reported(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", chatter(), compression="message")
    with closing(sqlite3.connect(storage_file(bag))) as database, database:
        database.execute("UPDATE messages SET data = substr(data, 1, 9) WHERE rowid = 3")
    messages = read_messages(bag, ["/ping", "/pong"])
    assert [next(messages).time_ns, next(messages).time_ns] == [START_NS, START_NS + 10_000_000]
    with pytest.raises(DataError) as caught:
        next(messages)
    assert caught.value.code == "R2B304"
    assert "bag.db3" in str(caught.value)


@pytest.mark.parametrize(
    "name",
    [
        "wbag",
        "convert_b_mcap",
        "cdr_test",
        "service_events_mcap",
        "talker",
        "seek_mcap",
        "empty_bag",
    ],
)
def test_reads_recordings_of_others(real_bags: Path, name: str) -> None:
    index = index_bag(real_bags / name)
    messages = list(read_messages(real_bags / name, index.topics))
    assert len(messages) == index.message_count
    times = [message.time_ns for message in messages]
    assert times == sorted(times)


def test_large_messages_keep_their_order_among_small_ones(tmp_path: Path) -> None:
    """Those are uncompressed ahead, in threads."""
    choose = random.Random(5)  # noqa: S311
    messages = [
        (
            "/ping" if number % 3 else "/pong",
            number * 10_000_000,
            text(choose.randbytes(100_000).hex() if number % 3 else "small"),
        )
        for number in range(20)
    ]
    bag = write_bag(tmp_path / "bag", messages, compression="message")
    assert read(bag) == messages
    with closing(sqlite3.connect(storage_file(bag))) as database, database:
        database.execute("UPDATE messages SET data = substr(data, 1, 70000) WHERE rowid = 12")
    found = read_messages(bag, ["/ping", "/pong"])
    assert [next(found).data for _ in range(11)] == [data for _, _, data in messages[:11]]
    with pytest.raises(DataError) as caught:
        next(found)
    assert caught.value.code == "R2B304"
