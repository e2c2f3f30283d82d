"""Buffers: serialised messages on disk, and the stamps inside them."""

from __future__ import annotations

import struct
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_typestore

from r2bspec.bags.message_types import read_stamp
from r2bspec.execute.fill_buffers import merge_static
from r2bspec.ipc.buffers import (
    BufferIndex,
    BufferWriter,
    largest_message_bytes,
    read_index,
    read_messages,
    transform_stamps,
)
from transform_bags import read_transforms, transforms

TYPE = "sensor_msgs/msg/Image"


def write(folder: Path, topic: str, messages: list[tuple[int, bytes]]) -> None:
    writer = BufferWriter(folder, topic, TYPE, has_header=True)
    for stamp_ns, data in messages:
        writer.append(stamp_ns, data)
    assert len(writer) == len(messages)
    writer.close()


@settings(max_examples=20)  # each writes files
@given(messages=st.lists(st.tuples(st.integers(0, 2**62), st.binary(max_size=40)), max_size=20))
def test_what_was_buffered_is_read_back(
    tmp_path_factory: pytest.TempPathFactory, messages: list[tuple[int, bytes]]
) -> None:
    folder = tmp_path_factory.mktemp("buffers")
    write(folder, "/r2b/image", messages)
    stamps_ns = tuple(stamp_ns for stamp_ns, _ in messages)
    assert read_index(folder, "/r2b/image") == BufferIndex(
        topic="/r2b/image",
        type=TYPE,
        has_header=True,
        stamps_ns=stamps_ns,
        sizes=tuple(len(data) for _, data in messages),
        times_ns=stamps_ns,
    )
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


STORE = get_typestore(Stores.ROS2_JAZZY)


def header(stamp_ns: int, frame: str, *, little: bool) -> bytearray:
    """A std_msgs/Header as an independent serialiser writes it."""
    time = STORE.types["builtin_interfaces/msg/Time"]
    kind = STORE.types["std_msgs/msg/Header"]
    message = kind(time(*divmod(stamp_ns, 10**9)), frame)
    return bytearray(STORE.serialize_cdr(message, "std_msgs/msg/Header", little_endian=little))


@pytest.mark.parametrize("size", [4, 11])
def test_a_message_that_is_too_short_is_refused(size: int) -> None:
    with pytest.raises(struct.error):
        read_stamp(header(1, "", little=True)[:size])


SECOND = 10**9

FRAMES = st.text(st.characters(min_codepoint=33, max_codepoint=126), max_size=12)
TRANSFORMS = st.lists(
    st.tuples(FRAMES, FRAMES, st.integers(10 * SECOND, 2**31 * SECOND - 1)), max_size=6
)


@settings(deadline=None)
@given(found=TRANSFORMS, big_endian=st.booleans())
def test_each_stamp_is_found_at_its_place(
    found: list[tuple[str, str, int]], big_endian: bool
) -> None:
    message = transforms(*found, big_endian=big_endian)
    stamps = transform_stamps(message)
    assert [stamp_ns for _, stamp_ns in stamps] == [stamp_ns for _, _, stamp_ns in found]
    moved = bytearray(message)
    for place, stamp_ns in stamps:
        layout = ">iI" if big_endian else "<iI"
        struct.pack_into(layout, moved, place, *divmod(stamp_ns - SECOND, SECOND))
    earlier = [(frame, child, stamp_ns - SECOND) for frame, child, stamp_ns in found]
    assert moved == transforms(*earlier, big_endian=big_endian)


@pytest.mark.parametrize("length", range(0, 100, 7))
def test_a_message_that_is_cut_short_is_refused(length: int) -> None:
    whole = transforms(("map", "odom", 5 * SECOND), ("odom", "base", 5 * SECOND))
    with pytest.raises(ValueError, match="truncated"):
        transform_stamps(whole[:length])


def test_static_transforms_become_one_message_with_the_last_one_to_each_child() -> None:
    merged = merge_static(
        [
            transforms(("base", "camera", SECOND), ("base", "lidar", SECOND)),
            transforms(("arm", "camera", 2 * SECOND)),
            transforms(("camera", "optical", 3 * SECOND), big_endian=True),
        ]
    )
    assert read_transforms(merged) == [
        ("arm", "camera", 2 * SECOND),
        ("base", "lidar", SECOND),
        ("camera", "optical", 3 * SECOND),
    ]
