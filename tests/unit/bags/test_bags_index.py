"""An index states what a bag holds, or says clearly why it cannot."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path

import pytest

from data_bags import START_NS, STRING, chatter, edit_metadata, refusal_of, storage_file, write_bag
from r2bspec.bags.bag_index import index_bag
from r2bspec.bags.integrity import verify
from r2bspec.bags.recording import DataError, TopicInfo, merge_topics
from r2bspec.cli.main import main

LFS_POINTER = (
    "version https://git-lfs.github.com/spec/v1\n"
    "oid sha256:db0548f20f3d9a153b3da6b11f934013f5e54da2a950066a95e8d04fcca5c797\nsize 1451\n"
)


def test_takes_a_bag_without_messages(tmp_path: Path) -> None:
    index = index_bag(write_bag(tmp_path / "bag", [], topics=["/quiet"]))
    assert index.topics["/quiet"].count == 0
    assert (index.start_ns, index.end_ns) == (0, 0)


def test_finds_topics_with_or_without_the_slash(bag: Path) -> None:
    index = index_bag(bag)
    assert index.find("ping") == index.find("/ping") == index.topics["/ping"]
    assert index.find("/ding") is None


def test_normalises_types_of_early_ros2(bag: Path) -> None:
    edit_metadata(bag, "std_msgs/msg/String", "std_msgs/String")
    assert index_bag(bag).topics["/ping"].type == STRING


def test_times_are_those_of_the_storage(bag: Path) -> None:
    edit_metadata(bag, str(START_NS), str(START_NS - 7))
    assert index_bag(bag).start_ns == START_NS


def refusal(path: Path) -> DataError:
    error = refusal_of(index_bag, path)
    assert str(path) in str(error)
    assert error.hint
    assert error.exit_code == 2
    return error


def test_refuses_what_is_no_bag(tmp_path: Path) -> None:
    assert refusal(tmp_path / "nothing").code == "R2B301"
    (tmp_path / "notes.txt").write_text("hello")
    assert refusal(tmp_path / "notes.txt").code == "R2B304"
    assert refusal(tmp_path).code == "R2B302"


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"- a list",
        b"rosbag2_bagfile_information: {version: 5}",
        b"rosbag2_bagfile_information: {version: 99}",
        b"rosbag2_bagfile_information: [unclosed",
        b"rosbag2_bagfile_information: null",
        b"\x00\x01",
        b"\xff\xfe\xfd",
    ],
)
def test_refuses_metadata_that_is_not_rosbag2s(bag: Path, content: bytes) -> None:
    (bag / "metadata.yaml").write_bytes(content)
    error = refusal(bag)
    assert error.code == "R2B302"
    assert "ros2 bag reindex" in error.hint


@pytest.mark.parametrize(
    ("pattern", "replacement", "code"),
    [
        # Formats that it cannot read.
        ("compression_mode: message", "compression_mode: chunk", "R2B302"),
        ("compression_format: zstd", "compression_format: lz4", "R2B302"),
        # Promises of other content.
        (r"message_count: 3\b", "message_count: 4", "R2B310"),
        (r"name: /ping", "name: /king", "R2B310"),
        (r"type: std_msgs/msg/String", "type: std_msgs/msg/Header", "R2B310"),
    ],
)
def test_refuses_metadata_that_storage_or_reader_contradict(
    tmp_path: Path, pattern: str, replacement: str, code: str
) -> None:
    bag = write_bag(tmp_path / "bag", chatter(), compression="message")
    edit_metadata(bag, pattern, replacement)
    assert refusal(bag).code == code


def test_refuses_storage_without_messages_and_none(bag: Path) -> None:
    file = storage_file(bag)
    with closing(sqlite3.connect(file)) as database, database:
        database.execute("DROP TABLE messages")
    assert refusal(bag).code == "R2B304"
    file.unlink()
    assert refusal(bag).code == "R2B303"


def test_refuses_an_unknown_storage_format(bag: Path) -> None:
    storage_file(bag).rename(bag / "bag.bag")
    edit_metadata(bag, "bag.db3", "bag.bag")
    edit_metadata(bag, "storage_identifier: sqlite3", "storage_identifier: rosbag_v2")
    assert refusal(bag).code == "R2B302"


@pytest.mark.parametrize("named", ["bag_1.db3", ""], ids=["another file", "no file"])
def test_names_the_files_that_metadata_does_not_name(bag: Path, named: str) -> None:
    edit_metadata(bag, r"relative_file_paths:\n.*\n", f"relative_file_paths: [{named}]\n")
    error = refusal(bag)
    assert error.code == "R2B303"
    assert "write metadata.yaml anew for bag.db3" in error.hint


@pytest.mark.parametrize("name", ["/bag.db3", "../bag.db3", "bag/bag.db3"])
def test_files_outside_of_the_folder_are_those_inside(bag: Path, name: str) -> None:
    edit_metadata(bag, "bag.db3", name)
    assert index_bag(bag).files == ("bag.db3",)


def into_folder(bag: Path) -> None:
    (bag / "data").mkdir()
    storage_file(bag).rename(bag / "data" / "bag.db3")


def test_another_file_beside_those_of_metadata_is_said(
    bag: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (bag / "bag_1.db3").write_bytes(storage_file(bag).read_bytes())
    assert verify(bag) == ["bag_1.db3 is no part of the bag: metadata.yaml does not name it"]
    main(["data", "info", str(bag)])
    assert "bag_1.db3 is not part of it" in capsys.readouterr().out


def test_a_folder_of_bags_names_them(tmp_path: Path) -> None:
    write_bag(tmp_path / "one", chatter())
    assert "one" in refusal(tmp_path).hint


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "it is empty, as after a crash of the recorder"),
        (b"\x89MCAP0\r\n", "it ends before its footer"),
    ],
)
def test_an_unfinished_file_is_no_damaged_one(tmp_path: Path, content: bytes, said: str) -> None:
    (tmp_path / "bag.mcap").write_bytes(content)
    error = refusal(tmp_path / "bag.mcap")
    assert (error.code, said in str(error)) == ("R2B304", True)
    assert ("mcap recover" in error.hint) is bool(content)


def test_a_topic_of_several_types_or_encodings_has_them_all() -> None:
    infos = [
        TopicInfo(name="/a", type=kind, count=2, serialization=encoding)
        for kind, encoding in ((STRING, "cdr"), (STRING, "json"), ("std_msgs/msg/Header", "cdr"))
    ]
    (merged,) = merge_topics(infos, 0).values()
    assert merged.type == f"{STRING} and std_msgs/msg/Header"
    assert (merged.serialization, merged.count) == ("cdr and json", 6)


@pytest.mark.parametrize("victim", ["metadata.yaml", "bag.db3"])
def test_names_git_lfs_pointers(bag: Path, victim: str) -> None:
    (bag / victim).write_text(LFS_POINTER)
    error = refusal(bag)
    assert error.code == "R2B305"
    assert victim in str(error)
    assert "git lfs pull" in error.hint
