"""An index states what a bag holds, or says clearly why it cannot."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Literal

import msgspec
import pytest

from data_bags import START_NS, STRING, chatter, edit_metadata, storage_file, write_bag
from r2bspec.bags.bag_index import index_bag
from r2bspec.bags.recording import BagIndex, DataError

LFS_POINTER = (
    "version https://git-lfs.github.com/spec/v1\n"
    "oid sha256:db0548f20f3d9a153b3da6b11f934013f5e54da2a950066a95e8d04fcca5c797\nsize 1451\n"
)


@pytest.mark.parametrize(
    ("storage", "compression"),
    [
        ("sqlite3", "none"),
        ("sqlite3", "message"),
        ("sqlite3", "file"),
        ("mcap", "none"),
        ("mcap", "storage"),
    ],
)
def test_states_topics_counts_and_times(
    tmp_path: Path,
    storage: Literal["sqlite3", "mcap"],
    compression: Literal["none", "message", "file", "storage"],
) -> None:
    index = index_bag(
        write_bag(tmp_path / "bag", chatter(6), storage=storage, compression=compression)
    )

    assert index.name == "bag"
    assert index.storage == storage
    assert {name: (info.type, info.count) for name, info in index.topics.items()} == {
        "/ping": (STRING, 3),
        "/pong": (STRING, 3),
    }
    assert (index.start_ns, index.end_ns) == (START_NS, START_NS + 50_000_000)
    assert index.message_count == 6
    assert not index.synthetic
    assert index.topics["/ping"].rate_hz == pytest.approx(40.0)
    assert index.topics["/ping"].max_message_bytes is None


def test_survives_json(tmp_path: Path) -> None:
    index = index_bag(write_bag(tmp_path / "bag", chatter()))
    assert msgspec.json.decode(msgspec.json.encode(index), type=BagIndex) == index


@pytest.mark.parametrize("storage", ["sqlite3", "mcap"])
def test_takes_a_lone_storage_file(tmp_path: Path, storage: Literal["sqlite3", "mcap"]) -> None:
    file = storage_file(write_bag(tmp_path / "bag", chatter(), storage=storage))
    alone = file.rename(tmp_path / file.name)
    index = index_bag(alone)
    assert index.message_count == 6
    assert index.files == (alone.name,)
    assert index.topics["/pong"].count == 3


def test_takes_a_bag_without_messages(tmp_path: Path) -> None:
    index = index_bag(write_bag(tmp_path / "bag", [], topics=["/quiet"]))
    assert index.topics["/quiet"].count == 0
    assert (index.start_ns, index.end_ns) == (0, 0)


def test_finds_topics_with_or_without_the_slash(tmp_path: Path) -> None:
    index = index_bag(write_bag(tmp_path / "bag", chatter()))
    assert index.find("ping") == index.find("/ping") == index.topics["/ping"]
    assert index.find("/ding") is None


def test_normalises_types_of_early_ros2(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", chatter())
    edit_metadata(bag, "std_msgs/msg/String", "std_msgs/String")
    assert index_bag(bag).topics["/ping"].type == STRING


def test_believes_the_storage_about_times_and_says_so(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", chatter())
    edit_metadata(bag, str(START_NS), str(START_NS - 7))
    index = index_bag(bag)
    assert index.start_ns == START_NS
    assert "metadata.yaml states" in index.notes[0]


def test_states_a_foreign_serialization_without_refusing_the_bag(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", chatter())
    edit_metadata(bag, "serialization_format: cdr", "serialization_format: protobuf")
    assert index_bag(bag).topics["/ping"].serialization == "protobuf"


def refusal(path: Path) -> DataError:
    with pytest.raises(DataError) as caught:
        index_bag(path)
    assert str(path) in str(caught.value)
    assert caught.value.hint
    assert caught.value.exit_code == 2
    return caught.value


def test_refuses_what_does_not_exist(tmp_path: Path) -> None:
    assert refusal(tmp_path / "nothing").code == "R2B301"


def test_refuses_a_file_that_is_no_bag(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("hello")
    assert refusal(tmp_path / "notes.txt").code == "R2B304"


@pytest.mark.parametrize(
    "content",
    [
        "",
        "- a list",
        "rosbag2_bagfile_information: {version: 5}",
        "rosbag2_bagfile_information: {version: 99}",
        "rosbag2_bagfile_information: [unclosed",
        "rosbag2_bagfile_information: null",
        "\x00\x01",
    ],
)
def test_refuses_metadata_that_is_not_rosbag2s(tmp_path: Path, content: str) -> None:
    bag = write_bag(tmp_path / "bag", chatter())
    (bag / "metadata.yaml").write_text(content)
    error = refusal(bag)
    assert error.code == "R2B302"
    assert "ros2 bag reindex" in error.hint


def test_refuses_metadata_that_is_no_text(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", chatter())
    (bag / "metadata.yaml").write_bytes(b"\xff\xfe\xfd")
    assert refusal(bag).code == "R2B302"


def test_refuses_a_folder_without_metadata(tmp_path: Path) -> None:
    assert refusal(tmp_path).code == "R2B302"


@pytest.mark.parametrize(
    ("pattern", "replacement"),
    [
        ("storage_identifier: sqlite3", "storage_identifier: rosbag_v2"),
        ("compression_mode: message", "compression_mode: chunk"),
        ("compression_format: zstd", "compression_format: lz4"),
    ],
)
def test_refuses_formats_it_cannot_read(tmp_path: Path, pattern: str, replacement: str) -> None:
    bag = write_bag(tmp_path / "bag", chatter(), compression="message")
    edit_metadata(bag, pattern, replacement)
    assert refusal(bag).code == "R2B302"


def test_refuses_a_bag_whose_storage_is_missing(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", chatter())
    storage_file(bag).unlink()
    assert refusal(bag).code == "R2B303"


@pytest.mark.parametrize("victim", ["metadata.yaml", "bag.db3"])
def test_names_git_lfs_pointers(tmp_path: Path, victim: str) -> None:
    bag = write_bag(tmp_path / "bag", chatter())
    (bag / victim).write_text(LFS_POINTER)
    error = refusal(bag)
    assert error.code == "R2B305"
    assert victim in str(error)
    assert "git lfs pull" in error.hint


@pytest.mark.parametrize("storage", ["sqlite3", "mcap"])
def test_refuses_truncated_storage(tmp_path: Path, storage: Literal["sqlite3", "mcap"]) -> None:
    bag = write_bag(tmp_path / "bag", chatter(), storage=storage)
    file = storage_file(bag)
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    assert refusal(bag).code == "R2B304"


def test_refuses_storage_of_another_kind(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", chatter())
    with closing(sqlite3.connect(storage_file(bag))) as database, database:
        database.execute("DROP TABLE messages")
    assert refusal(bag).code == "R2B304"


@pytest.mark.parametrize(
    ("pattern", "replacement"),
    [
        (r"message_count: 3\b", "message_count: 4"),
        (r"message_count: 6\b", "message_count: 7"),
        (r"name: /ping", "name: /king"),
        (r"type: std_msgs/msg/String", "type: std_msgs/msg/Header"),
    ],
)
def test_refuses_metadata_that_promises_other_content(
    tmp_path: Path, pattern: str, replacement: str
) -> None:
    bag = write_bag(tmp_path / "bag", chatter())
    edit_metadata(bag, pattern, replacement)
    assert refusal(bag).code == "R2B310"


@pytest.mark.parametrize(
    ("name", "messages"),
    [
        ("wbag", 6074),
        ("convert_b_mcap", 75),
        ("cdr_test", 7),
        ("service_events_mcap", 10),
        ("wrong_rmw_test", 7),
        ("talker", 20),
        ("seek_mcap", 5),
        ("empty_bag", 0),
    ],
)
def test_indexes_recordings_of_others(real_bags: Path, name: str, messages: int) -> None:
    index = index_bag(real_bags / name)
    assert index.message_count == messages
    assert sum(info.count for info in index.topics.values()) == messages
    assert list(index.topics) == sorted(index.topics)
    assert all(info.type.count("/") == 2 for info in index.topics.values())


def test_names_the_pointer_of_a_clone_without_lfs(real_bags: Path) -> None:
    assert refusal(real_bags / "lfs_pointer").code == "R2B305"
