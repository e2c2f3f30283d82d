"""Stamps inside serialised transforms are found wherever CDR puts them, and nowhere else."""

from __future__ import annotations

import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from r2bspec.execute.fill_buffers import merge_static
from r2bspec.ipc.buffers import transform_stamps
from transform_bags import read_transforms, transforms

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
