"""Buffers: serialised messages on disk, and what is in them."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from r2bspec.ipc.buffers import (
    BufferWriter,
    buffer_path,
    largest_message_bytes,
    read_index,
    read_messages,
)

TYPE = "sensor_msgs/msg/Image"

TOPICS = st.from_regex(r"(/[a-zA-Z_][a-zA-Z0-9_]*){1,4}", fullmatch=True)


def write(
    folder: Path, topic: str, messages: list[tuple[int, bytes]], *, header: bool = True
) -> None:
    writer = BufferWriter(folder, topic, TYPE, has_header=header)
    for stamp_ns, data in messages:
        writer.append(stamp_ns, data)
    assert len(writer) == len(messages)
    writer.close()


@given(messages=st.lists(st.tuples(st.integers(0, 2**62), st.binary(max_size=40)), max_size=20))
def test_what_was_buffered_is_read_back(
    tmp_path_factory: pytest.TempPathFactory, messages: list[tuple[int, bytes]]
) -> None:
    folder = tmp_path_factory.mktemp("buffers")
    write(folder, "/r2b/image", messages)
    index = read_index(folder, "/r2b/image")
    assert index.topic == "/r2b/image"
    assert index.type == TYPE
    assert index.has_header
    assert index.stamps_ns == tuple(stamp_ns for stamp_ns, _ in messages)
    assert index.sizes == tuple(len(data) for _, data in messages)
    read = read_messages(folder, "/r2b/image", set(range(len(messages))))
    assert [bytes(read[position]) for position in sorted(read)] == [data for _, data in messages]


def test_only_the_messages_that_are_wanted_are_read_each_to_be_patched(tmp_path: Path) -> None:
    write(tmp_path, "/image", [(n, bytes([n]) * (n + 1)) for n in range(6)])
    read = read_messages(tmp_path, "/image", {1, 4})
    read[1][0:1] = b"X"
    assert read == {1: bytearray(b"X\1"), 4: bytearray(b"\4\4\4\4\4")}


def test_a_buffer_that_was_not_closed_is_not_there(tmp_path: Path) -> None:
    writer = BufferWriter(tmp_path, "/image", TYPE, has_header=True)
    writer.append(1, b"abc")
    with pytest.raises(FileNotFoundError):
        read_index(tmp_path, "/image")
    assert largest_message_bytes(tmp_path) == 0
    writer.close()
    assert read_index(tmp_path, "/image").sizes == (3,)


@settings(max_examples=40)
@given(first=TOPICS, second=TOPICS)
def test_distinct_topics_have_distinct_files_in_the_folder(first: str, second: str) -> None:
    folder = Path("buffers")
    paths = [buffer_path(folder, topic, "cdr") for topic in (first, second)]
    assert all(path.parent == folder for path in paths)
    assert (paths[0] == paths[1]) == (first == second)


def test_the_largest_message_is_found_over_all_buffers(tmp_path: Path) -> None:
    assert largest_message_bytes(tmp_path) == 0
    write(tmp_path, "/empty", [])
    assert largest_message_bytes(tmp_path) == 0
    write(tmp_path, "/a", [(1, b"123"), (2, b"12345")])
    write(tmp_path, "/b/c", [(1, b"1234")])
    assert largest_message_bytes(tmp_path) == 5
