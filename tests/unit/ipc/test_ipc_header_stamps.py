"""Stamps inside serialised messages, in both byte orders."""

from __future__ import annotations

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_typestore

from r2bspec.ipc.buffers import read_stamp

STORE = get_typestore(Stores.ROS2_JAZZY)

# Seconds are int32 and nanoseconds are below one second.
STAMPS = st.integers(-(2**31) * 10**9, 2**31 * 10**9 - 1)


def header(stamp_ns: int, frame: str, *, little: bool) -> bytearray:
    """A std_msgs/Header as an independent serialiser writes it."""
    time = STORE.types["builtin_interfaces/msg/Time"]
    kind = STORE.types["std_msgs/msg/Header"]
    message = kind(time(*divmod(stamp_ns, 10**9)), frame)
    return bytearray(STORE.serialize_cdr(message, "std_msgs/msg/Header", little_endian=little))


@given(stamp_ns=STAMPS, frame=st.text(max_size=5), little=st.booleans())
def test_a_stamp_is_read_as_it_was_written(stamp_ns: int, frame: str, little: bool) -> None:
    assert read_stamp(header(stamp_ns, frame, little=little)) == stamp_ns


@pytest.mark.parametrize("size", [4, 11])
def test_a_message_that_is_too_short_is_refused(size: int) -> None:
    with pytest.raises(struct.error):
        read_stamp(header(1, "", little=True)[:size])
