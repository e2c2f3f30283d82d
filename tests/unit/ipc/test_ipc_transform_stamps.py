"""Stamps inside serialised transforms are found wherever CDR puts them, and shifted in place."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from r2bspec.execute.fill_buffers import merge_static
from r2bspec.ipc.buffers import StampedTransforms
from transform_bags import read_transforms, transforms

SECOND = 10**9

FRAMES = st.text(st.characters(min_codepoint=33, max_codepoint=126), max_size=12)
TRANSFORMS = st.lists(
    st.tuples(FRAMES, FRAMES, st.integers(10 * SECOND, 2**31 * SECOND - 1)), max_size=6
)


@settings(deadline=None)
@given(found=TRANSFORMS, by_ns=st.integers(-10 * SECOND, 0), big_endian=st.booleans())
def test_stamps_are_shifted_and_nothing_else(
    found: list[tuple[str, str, int]], by_ns: int, big_endian: bool
) -> None:
    message = bytearray(transforms(*found, big_endian=big_endian))
    stamped = StampedTransforms(message)
    assert stamped.stamps_ns == tuple(stamp_ns for _, _, stamp_ns in found)
    stamped.shift(by_ns)
    moved = [(frame, child, stamp_ns + by_ns) for frame, child, stamp_ns in found]
    assert message == transforms(*moved, big_endian=big_endian)


def test_shifting_again_starts_from_what_was_recorded() -> None:
    message = bytearray(transforms(("map", "odom", 5 * SECOND)))
    stamped = StampedTransforms(message)
    stamped.shift(SECOND)
    stamped.shift(2 * SECOND)
    assert read_transforms(bytes(message)) == [("map", "odom", 7 * SECOND)]


@pytest.mark.parametrize("length", range(0, 100, 7))
def test_a_message_that_is_cut_short_is_refused(length: int) -> None:
    whole = transforms(("map", "odom", 5 * SECOND), ("odom", "base", 5 * SECOND))
    with pytest.raises(ValueError, match="truncated"):
        StampedTransforms(bytearray(whole[:length]))


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
