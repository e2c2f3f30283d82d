"""Messages compared with the truth of a synthetic dataset; made-up wrong ones must not pass."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from data_bags import truth_of, typestore
from r2bspec.bags.recording import DISPARITY_NAME, GROUND_TRUTH_NAME, SyntheticDataset
from r2bspec.datasets.ground_truth import GroundTruth, TagSighting, read_disparity
from r2bspec.execute.measurement.further_iterations import compare_outputs
from r2bspec.judge.measure.metric_catalogue import (
    BAD_PIXELS,
    DENSITY,
    TAG_FALSE,
    TAG_MISSED,
    TAG_POSITION_ERROR,
    TRUTHS,
)
from r2bspec.language.spec import Truth
from r2bspec.plan.plan import MonitorPlan
from r2bspec.record.run_record import AccuracyRecord

TAG = Truth(kind="tag", name="/d455_1_left_ir_image")
DISPARITY = Truth(kind="disparity", name="d455_1_ir")


@pytest.fixture(scope="module")
def dataset(storage_room: SyntheticDataset) -> Path:
    """Two frames of a stereo pair that shows the tag, and more."""
    return storage_room.path


@pytest.fixture(scope="module")
def truth(dataset: Path) -> GroundTruth:
    return truth_of(dataset)


def header(stamp_ns: int = 0) -> Any:
    types = typestore().types
    stamp = types["builtin_interfaces/msg/Time"](sec=1, nanosec=stamp_ns)
    return types["std_msgs/msg/Header"](stamp=stamp, frame_id="camera")


def disparity_image(found: NDArray[np.float32], *, bigendian: bool = False) -> bytes:
    types, (height, width) = typestore().types, found.shape
    data = found.astype(">f4" if bigendian else "<f4").tobytes()
    image = types["sensor_msgs/msg/Image"](
        header=header(),
        height=height,
        width=width,
        encoding="32FC1",
        is_bigendian=int(bigendian),
        step=4 * width,
        data=np.frombuffer(data, np.uint8),
    )
    window = types["sensor_msgs/msg/RegionOfInterest"](
        x_offset=0, y_offset=0, height=0, width=0, do_rectify=False
    )
    kind = TRUTHS["disparity"].format
    message = types[kind](
        header=header(),
        image=image,
        f=641.5,
        t=0.095,
        valid_window=window,
        min_disparity=0.0,
        max_disparity=127.0,
        delta_d=0.0625,
    )
    return bytes(typestore().serialize_cdr(message, kind))


def poses(*found: tuple[tuple[float, ...], tuple[float, ...]]) -> bytes:
    types = typestore().types
    made = [
        types["geometry_msgs/msg/Pose"](
            position=types["geometry_msgs/msg/Point"](*position),
            orientation=types["geometry_msgs/msg/Quaternion"](*orientation),
        )
        for position, orientation in found
    ]
    kind = TRUTHS["tag"].format
    return bytes(typestore().serialize_cdr(types[kind](header=header(), poses=made), kind))


def compare(
    truth: Truth, outputs: list[tuple[frozenset[int], bytes]], *datasets: Path
) -> AccuracyRecord:
    kind = TRUTHS[truth.kind].format
    monitor = MonitorPlan(name="out", topic="/out", type=kind, match="stamp", qos=None, truth=truth)
    empty = AccuracyRecord(
        monitor="out", kind=truth.kind, of=truth.name, outputs=0, steps=len(outputs), values={}
    )
    return compare_outputs(empty, monitor, truth, outputs, datasets)


def test_true_disparities_are_right(dataset: Path, truth: GroundTruth) -> None:
    outputs = [
        (frozenset({stamp}), disparity_image(read_disparity(dataset, DISPARITY.name, stamp)))
        for stamp in truth.stereo[DISPARITY.name].stamps_ns
    ]
    found = compare(DISPARITY, outputs, dataset)
    assert (found.outputs, found.steps, found.problem) == (2, 2, "")
    assert found.values == {BAD_PIXELS: 0.0, DENSITY: 1.0}


def test_the_byte_order_of_the_message_counts(dataset: Path, truth: GroundTruth) -> None:
    (stamp, *_) = truth.stereo[DISPARITY.name].stamps_ns
    true = read_disparity(dataset, DISPARITY.name, stamp)
    message = disparity_image(true, bigendian=True)
    found = compare(DISPARITY, [(frozenset({stamp}), message)], dataset)
    assert found.values[BAD_PIXELS] == 0.0


def sightings(truth: GroundTruth) -> tuple[TagSighting, ...]:
    assert truth.tag is not None
    return truth.tag.sightings[TAG.name]


def test_true_poses_are_right(dataset: Path, truth: GroundTruth) -> None:
    outputs = [
        (frozenset({sighting.stamp_ns}), poses((sighting.position_m, sighting.orientation_xyzw)))
        for sighting in sightings(truth)
    ]
    found = compare(TAG, outputs, dataset)
    assert found.values == {TAG_MISSED: 0.0, TAG_FALSE: 0.0, TAG_POSITION_ERROR: 0.0}
    assert found.outputs == 2


def test_a_topic_may_be_named_without_its_slash_and_the_truth_found_among_several(
    dataset: Path, truth: GroundTruth, tmp_path: Path
) -> None:
    name = Truth(kind="tag", name=TAG.name.removeprefix("/"))
    outputs = [(frozenset({sightings(truth)[0].stamp_ns}), poses())]
    compared = compare(name, outputs, tmp_path, dataset)
    assert (compared.problem, compared.values[TAG_MISSED]) == ("", 1.0)


@pytest.mark.parametrize(
    ("wanted", "has_truth", "problem"),
    [
        (TAG, False, "The recording has no ground truth."),
        (
            Truth(kind="disparity", name="hawk_9"),
            True,
            "The ground truth has no disparity of hawk_9.",
        ),
        (TAG, True, "The ground truth has none of the stamps of the outputs."),
    ],
)
def test_what_cannot_be_compared_is_said(
    dataset: Path, tmp_path: Path, wanted: Truth, has_truth: bool, problem: str
) -> None:
    output = poses() if wanted is TAG else disparity_image(np.ones((2, 2), "f4"))
    compared = compare(wanted, [(frozenset({1}), output)], dataset if has_truth else tmp_path)
    assert compared.problem == problem


def damaged(dataset: Path, folder: Path, content: bytes) -> Path:
    """The truth of the dataset, with another archive."""
    (folder / GROUND_TRUTH_NAME).write_bytes((dataset / GROUND_TRUTH_NAME).read_bytes())
    (folder / DISPARITY_NAME).write_bytes(content)
    return folder


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 no archive", b"x" * 1000])
def test_a_damaged_truth_is_said(
    dataset: Path, truth: GroundTruth, tmp_path: Path, content: bytes
) -> None:
    (stamp, *_) = truth.stereo[DISPARITY.name].stamps_ns
    outputs = [(frozenset({stamp}), disparity_image(np.ones((4, 4), "f4")))]
    found = compare(DISPARITY, outputs, damaged(dataset, tmp_path, content))
    assert found.problem.startswith("The ground truth cannot be read: ")


def test_an_array_that_states_too_much_is_refused(
    dataset: Path, truth: GroundTruth, tmp_path: Path
) -> None:
    (stamp, *_) = truth.stereo[DISPARITY.name].stamps_ns
    entry = f"{DISPARITY.name}/{stamp}.npy"
    path = tmp_path / DISPARITY_NAME
    with zipfile.ZipFile(path, "w") as archive, archive.open(entry, "w") as stream:
        np.lib.format.write_array_header_1_0(
            stream, {"descr": "<u2", "fortran_order": False, "shape": (10**6, 10**6)}
        )
    outputs = [(frozenset({stamp}), disparity_image(np.ones((4, 4), "f4")))]
    found = compare(DISPARITY, outputs, damaged(dataset, tmp_path, path.read_bytes()))
    assert "it states 2,000,000,000,000 bytes" in found.problem
