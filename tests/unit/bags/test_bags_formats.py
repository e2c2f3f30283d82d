"""One recording in every form in which bags come: the same index, messages, windows and hash."""

from __future__ import annotations

import os
import random
import sqlite3
from collections.abc import Callable
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Any

import pytest
import yaml
from mcap.writer import CompressionType, IndexType

from data_bags import (
    START_NS,
    STRING,
    chatter,
    edit_metadata,
    refusal_of,
    split_bag,
    storage_file,
    write_bag,
    write_mcap,
)
from r2bspec.bags.bag_index import index_bag
from r2bspec.bags.bag_reader import read_messages
from r2bspec.bags.integrity import hash_content, hash_files, verify
from r2bspec.bags.recording import TimeWindow

MESSAGES = chatter(40)
TOPICS = ("/ping", "/pong")
_SHUFFLED = random.Random(3).sample(MESSAGES, len(MESSAGES))  # noqa: S311
_NO_MESSAGE_INDEX = IndexType.ALL & ~IndexType.MESSAGE


def _alone(bag: Path) -> Path:
    file = storage_file(bag)
    return file.rename(bag.parent / file.name)


def _of_version(folder: Path, version: int) -> Path:
    """What earlier versions of rosbag2 left out of metadata.yaml."""
    bag = write_bag(folder, MESSAGES, compression="message")
    path = bag / "metadata.yaml"
    document = yaml.safe_load(path.read_text())
    info = document["rosbag2_bagfile_information"]
    info["version"] = version
    added = {5: ["files"], 6: ["custom_data"], 8: ["ros_distro"]}
    for since, keys in added.items():
        for key in keys if version < since else ():
            info.pop(key, None)
    for entry in info["topics_with_message_count"]:
        topic = entry["topic_metadata"]
        if version < 7:
            topic.pop("type_description_hash", None)
        if version < 4:
            topic.pop("offered_qos_profiles", None)
        if version >= 9:
            topic["offered_qos_profiles"] = [{"history": "keep_last", "depth": 10}]
    if version < 4:
        info["relative_file_paths"] = [f"bag/{name}" for name in info["relative_file_paths"]]
    path.write_text(yaml.safe_dump(document))
    return bag


def _named(folder: Path, name: bytes) -> Path:
    return write_bag(folder, MESSAGES).rename(folder.with_name(os.fsdecode(name)))


def _without_index(folder: Path) -> Path:
    bag = write_bag(folder, _SHUFFLED)
    with closing(sqlite3.connect(storage_file(bag))) as database, database:
        database.execute("DROP INDEX timestamp_idx")
    return bag


def _without_metadata(folder: Path, **options: Any) -> Path:
    """What a recorder leaves that was killed after it had closed its files."""
    bag = split_bag(folder, [MESSAGES[:9], MESSAGES[9:]], **options)
    (bag / "metadata.yaml").unlink()
    return bag


def _identified(folder: Path, written: str) -> Path:
    bag = write_bag(folder, MESSAGES, storage="mcap")
    edit_metadata(bag, "storage_identifier: .*", written)
    return bag


def _renamed(folder: Path, before: str, now: str) -> Path:
    """What a recorder leaves that was killed while it compressed its files."""
    bag = write_bag(folder, MESSAGES, compression="file")
    edit_metadata(bag, before, now)
    return bag


def _not_compressed(folder: Path) -> Path:
    bag = write_bag(folder, MESSAGES, storage="mcap")
    edit_metadata(bag, "compression_format: .*", "compression_format: zstd")
    edit_metadata(bag, "compression_mode: .*", "compression_mode: FILE")
    edit_metadata(bag, "bag.mcap", "bag.mcap.zstd")
    return bag


def _linked(folder: Path) -> Path:
    real = write_bag(folder.with_name("real"), MESSAGES)
    storage_file(real).rename(real.parent / "elsewhere.db3")
    (real / "real.db3").symlink_to(real.parent / "elsewhere.db3")
    folder.symlink_to(real)
    return folder


FORMS: dict[str, Callable[[Path], Path]] = {
    "sqlite3": lambda at: write_bag(at, MESSAGES),
    "sqlite3, by file": lambda at: write_bag(at, MESSAGES, compression="file"),
    "sqlite3, unsorted": lambda at: write_bag(at, _SHUFFLED),
    "sqlite3, unsorted, without an index": _without_index,
    "sqlite3, split": lambda at: split_bag(at, [MESSAGES[:9], MESSAGES[9:31], MESSAGES[31:]]),
    "sqlite3, split, by file": lambda at: split_bag(
        at, [MESSAGES[:9], MESSAGES[9:31], MESSAGES[31:]], compression="file"
    ),
    "sqlite3, split, interleaved": lambda at: split_bag(at, [MESSAGES[::2], MESSAGES[1::2]]),
    "sqlite3, split, interleaved, by file": lambda at: split_bag(
        at, [MESSAGES[::2], MESSAGES[1::2]], compression="file"
    ),
    "sqlite3, split, without metadata": _without_metadata,
    "mcap, split, without metadata": lambda at: _without_metadata(at, storage="mcap"),
    **{
        f"mcap, storage identifier {written!r}": partial(_identified, written=written)
        for written in ("storage_identifier: ''", "storage_identifier: sqlite3", "")
    },
    "sqlite3, compressed, without metadata": lambda at: _without_metadata(at, compression="file"),
    "mcap, compressed, alone": lambda at: _alone(
        write_bag(at, MESSAGES, storage="mcap", compression="file")
    ),
    "sqlite3, by file, compressed after metadata": partial(_renamed, before="db3.zstd", now="db3"),
    "mcap, not compressed, as metadata says": _not_compressed,
    "sqlite3, alone": lambda at: _alone(write_bag(at, MESSAGES)),
    "sqlite3, odd name": lambda at: _named(at, b"100 % #1? bag"),
    "sqlite3, name that is not UTF-8": lambda at: _named(at, b"caf\xe9"),
    "sqlite3, linked": _linked,
    "mcap": lambda at: write_bag(at, MESSAGES, storage="mcap"),
    "mcap, by chunk": lambda at: write_bag(at, MESSAGES, storage="mcap", compression="storage"),
    "mcap, by message": lambda at: write_bag(at, MESSAGES, storage="mcap", compression="message"),
    "mcap, by file": lambda at: write_bag(at, MESSAGES, storage="mcap", compression="file"),
    "mcap, split": lambda at: split_bag(at, [MESSAGES[:9], MESSAGES[9:]], storage="mcap"),
    "mcap, alone": lambda at: _alone(write_bag(at, MESSAGES, storage="mcap")),
    "mcap, many small chunks, unsorted": lambda at: write_mcap(
        at.with_suffix(".mcap"), _SHUFFLED, chunk_size=100
    ),
    "mcap, lz4": lambda at: write_mcap(
        at.with_suffix(".mcap"), MESSAGES, chunk_size=100, compression=CompressionType.LZ4
    ),
    "mcap, no chunks, unsorted": lambda at: write_mcap(
        at.with_suffix(".mcap"), _SHUFFLED, use_chunking=False
    ),
    "mcap, no summary": lambda at: write_mcap(
        at.with_suffix(".mcap"),
        _SHUFFLED,
        use_chunking=False,
        index_types=IndexType.NONE,
        use_statistics=False,
        use_summary_offsets=False,
        repeat_channels=False,
        repeat_schemas=False,
    ),
    "mcap, schemas not repeated": lambda at: write_mcap(
        at.with_suffix(".mcap"), MESSAGES, repeat_schemas=False
    ),
    "mcap, channels not repeated": lambda at: write_mcap(
        at.with_suffix(".mcap"), MESSAGES, repeat_channels=False
    ),
    "mcap, chunks without an index of their messages": lambda at: write_mcap(
        at.with_suffix(".mcap"), _SHUFFLED, chunk_size=100, index_types=_NO_MESSAGE_INDEX
    ),
    "mcap, the same without statistics": lambda at: write_mcap(
        at.with_suffix(".mcap"),
        MESSAGES,
        chunk_size=100,
        index_types=_NO_MESSAGE_INDEX,
        use_statistics=False,
    ),
    **{
        f"metadata of version {version}": partial(_of_version, version=version)
        for version in (2, 4, 5, 6, 7, 9)
    },
}


@pytest.fixture(scope="module", params=FORMS)
def bag(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return FORMS[request.param](tmp_path_factory.mktemp("form") / "bag")


@pytest.fixture(scope="module")
def content_hash(tmp_path_factory: pytest.TempPathFactory) -> str:
    return hash_content(write_bag(tmp_path_factory.mktemp("plain") / "bag", MESSAGES))


def read(bag: Path, window: TimeWindow | None = None, topics: Any = TOPICS) -> list[Any]:
    return [
        (message.topic, message.time_ns - START_NS, message.data)
        for message in read_messages(bag, topics, window)
    ]


def test_index_messages_and_hash(bag: Path, content_hash: str) -> None:
    index = index_bag(bag)
    assert {
        name: (info.type, info.count, info.serialization) for name, info in index.topics.items()
    } == dict.fromkeys(TOPICS, (STRING, 20, "cdr"))
    assert (index.start_ns, index.end_ns) == (START_NS, START_NS + 390_000_000)
    assert index.message_count == 40
    assert read(bag) == MESSAGES
    assert read(bag, topics=["pong"]) == MESSAGES[1::2]
    assert len(hash_files(bag)) == 64
    assert hash_content(bag) == content_hash
    assert verify(bag) == []


def test_a_rate_counts_from_the_first_to_the_last_message_of_its_topic(
    bag: Path, request: pytest.FixtureRequest
) -> None:
    unknown = "by file" in request.node.callspec.params["bag"]
    ping, pong = index_bag(bag).topics.values()
    known = (START_NS, START_NS + 380_000_000), (START_NS + 10_000_000, START_NS + 390_000_000)
    assert (ping.span_ns, pong.span_ns) == ((None, None) if unknown else known)
    # 20 messages; over the length of the bag where the times of a topic are not known.
    assert [ping.rate_hz, pong.rate_hz] == pytest.approx([19 / 0.39 if unknown else 50] * 2)


def test_every_window(bag: Path) -> None:
    step = 10_000_000
    for start, end in ((0, 1), (0, 9), (8, 10), (9, 31), (13, 14), (30, 40), (31, None), (39, 99)):
        window = TimeWindow(start_ns=start * step, end_ns=None if end is None else end * step)
        assert read(bag, window) == MESSAGES[start:end], (start, end)
    between = TimeWindow(start_ns=90_000_001, end_ns=99_999_999)
    assert read(bag, between) == []


def test_nothing_is_left_in_the_temporary_folder(
    bag: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scratch = tmp_path / "scratch"
    scratch.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(scratch))
    messages = read_messages(bag, TOPICS)
    next(messages)
    messages.close()  # type: ignore[attr-defined]
    assert list(scratch.iterdir()) == []


def test_files_outside_of_the_window_are_not_unpacked(tmp_path: Path) -> None:
    bag = split_bag(
        tmp_path / "bag", [MESSAGES[:9], MESSAGES[9:31], MESSAGES[31:]], compression="file"
    )
    for name in ("bag_0.db3.zstd", "bag_2.db3.zstd"):
        (bag / name).write_bytes(b"no zstd")
    window = TimeWindow(start_ns=90_000_000, end_ns=310_000_000)
    assert read(bag, window) == MESSAGES[9:31]
    assert refusal_of(read, bag).code == "R2B304"


@pytest.mark.parametrize("profile", ["", "ros2", "x-mixed"])
def test_the_encoding_of_a_channel_decides_and_not_the_profile(
    tmp_path: Path, profile: str
) -> None:
    file = write_mcap(tmp_path / "bag.mcap", MESSAGES, profile=profile)
    assert read(file) == MESSAGES


def test_a_channel_of_another_encoding_is_refused_where_it_is_read(tmp_path: Path) -> None:
    file = write_mcap(tmp_path / "bag.mcap", MESSAGES, encoding="ros1")
    assert index_bag(file).message_count == len(MESSAGES)
    assert refusal_of(read, file).code == "R2B306"
