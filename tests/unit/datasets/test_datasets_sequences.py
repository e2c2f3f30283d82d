"""The catalogue describes what will be made, to the byte, without making it."""

from __future__ import annotations

import subprocess
import sys

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from data_bags import WINDOW, refusal_of
from r2bspec.bags.bag_index import index_bag
from r2bspec.bags.bag_reader import read_messages
from r2bspec.bags.recording import SyntheticDataset, TimeWindow
from r2bspec.datasets.catalogue import DURATION_NS, SEQUENCES, describe, message_times_ns


def test_carries_the_sequences_of_r2b_2023() -> None:
    assert set(SEQUENCES) == {
        "r2b_lounge",
        "r2b_storage",
        "r2b_hallway",
        "r2b_datacenter",
        "r2b_cafe",
        "r2b_hideaway",
        "r2b_mezzanine",
        "r2b_hope",
    }
    topics = describe("r2b_storage").topics
    assert {
        name: (info.type.rpartition("/")[2], info.rate_hz, info.count)
        for name, info in topics.items()
        if not name.endswith("camera_info")
    } == {
        "/d455_1_depth": ("Image", 30.0, 300),
        "/d455_1_imu": ("Imu", 200.0, 2000),
        "/d455_1_left_ir_image": ("Image", 30.0, 300),
        "/d455_1_right_ir_image": ("Image", 30.0, 300),
        "/d455_1_rgb_image": ("Image", 30.0, 300),
        "/hawk_0_left_rgb_image": ("Image", 30.0, 300),
        "/hawk_0_right_rgb_image": ("Image", 30.0, 300),
        "/pandar_xt_32_0_lidar": ("PointCloud2", 10.0, 100),
    }
    assert sum(name.endswith("camera_info") for name in topics) == 5
    assert set(describe("r2b_hope").topics) == {"/image"}


def test_the_description_is_the_index_of_what_is_made(storage_room: SyntheticDataset) -> None:
    described = describe("r2b_storage", None, WINDOW)
    index = index_bag(storage_room.path)
    assert msgspec.structs.replace(index, files=()) == described


def test_sizes_are_exact(storage_room: SyntheticDataset) -> None:
    topics = describe("r2b_storage", None, WINDOW).topics
    sizes = {name: set[int]() for name in topics}
    for message in read_messages(storage_room.path, topics):
        sizes[message.topic].add(len(message.data))
    assert sizes == {name: {info.max_message_bytes} for name, info in topics.items()}


WHOLE = [
    (source, message_times_ns(source, TimeWindow(start_ns=0, end_ns=DURATION_NS)))
    for source in SEQUENCES["r2b_lounge"].sources
]


@given(
    st.integers(0, DURATION_NS - 1).flatmap(
        lambda start: st.tuples(st.just(start), st.integers(start + 1, DURATION_NS))
    )
)
def test_counts_in_a_window_are_those_of_the_whole_inside_it(ends: tuple[int, int]) -> None:
    window = TimeWindow(start_ns=ends[0], end_ns=ends[1])
    for source, whole in WHOLE:
        inside = [time_ns for time_ns in whole if window.contains(time_ns)]
        assert message_times_ns(source, window) == inside


@pytest.mark.parametrize(
    ("name", "topics", "window", "code", "words"),
    [
        ("r2b_loung", None, None, "R2B307", "did you mean r2b_lounge?"),
        ("kitchen", None, None, "R2B307", "known datasets: r2b_cafe"),
        ("r2b_storage", ["/d455_rgb_image"], None, "R2B308", "did you mean /d455_1_rgb_image?"),
        ("r2b_storage", None, TimeWindow(end_ns=DURATION_NS + 1), "R2B309", "between"),
        ("r2b_storage", None, TimeWindow(start_ns=5, end_ns=5), "R2B309", "between"),
        ("r2b_storage", None, TimeWindow(start_ns=-1), "R2B309", "between"),
    ],
)
def test_refuses_what_it_does_not_carry(
    name: str, topics: list[str] | None, window: TimeWindow | None, code: str, words: str
) -> None:
    error = refusal_of(describe, name, topics, window)
    assert error.code == code
    assert words in error.hint


def test_describing_loads_neither_numpy_nor_rosbags() -> None:
    program = (
        "import sys, r2bspec.datasets.catalogue as data; data.describe('r2b_storage');"
        "sys.exit(bool({'numpy', 'rosbags', 'yaml', 'filelock'} & set(sys.modules)))"
    )
    assert subprocess.run([sys.executable, "-c", program], check=False).returncode == 0
