"""The AprilTag node's detector against the ground truth of the synthetic r2b_storage.

Stated tolerances, for a tag of 0.162 m about 1.3 m away and a focal length of 639 pixels: the id
always; the position within 1 % of the distance; the rotation within 1.5 degrees; corners within
half a pixel.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("cv2")

from tag_rendering import angle_deg, rotation_of

from data_bags import truth_of, typestore
from r2bspec.bags.bag_reader import read_messages
from r2bspec.bags.recording import TimeWindow
from r2bspec.datasets.ground_truth import TagSighting
from r2bspec.datasets.synthesis import make
from r2bspec.nodes import camera, images, tag_poses

IMAGE = "d455_1_rgb_image"
CAMERA_INFO = "d455_1_rgb_camera_info"
# A window of one frame each, spread over the ten seconds of the sequence.
STARTS_NS = (0, 4_900_000_000, 9_900_000_000)
FRAME_NS = 33_000_000

POSITION_SHARE = 0.01
ANGLE_DEG = 1.5
CORNER_PX = 0.5


@dataclass(frozen=True)
class Frame:
    """An image, its camera, and what is true of the tag in it."""

    image: Any
    info: Any
    family: str
    tag_id: int
    size_m: float
    sighting: TagSighting


@pytest.fixture(scope="module")
def frames(tmp_path_factory: pytest.TempPathFactory) -> list[Frame]:
    cache = tmp_path_factory.mktemp("datasets")
    return [_frame(start_ns, cache) for start_ns in STARTS_NS]


def _frame(start_ns: int, cache: Path) -> Frame:
    window = TimeWindow(start_ns=start_ns, end_ns=start_ns + FRAME_NS)
    made = make("r2b_storage", [IMAGE, CAMERA_INFO], window, cache_dir=cache)
    kinds = {IMAGE: "sensor_msgs/msg/Image", CAMERA_INFO: "sensor_msgs/msg/CameraInfo"}
    read = {
        message.topic.removeprefix("/"): message.data
        for message in read_messages(made.path, list(kinds))
    }
    image, info = (typestore().deserialize_cdr(read[topic], kind) for topic, kind in kinds.items())
    tag = truth_of(made.path).tag
    assert tag is not None
    (sightings,) = tag.sightings.values()
    return Frame(image, info, tag.family, tag.id, tag.size_m, sightings[0])


def _detect(frame: Frame) -> tag_poses.Detection:
    gray = images.gray(images.view(frame.image), frame.image.encoding)
    lens = camera.matrix(frame.info), camera.distortion(frame.info)
    (found,) = tag_poses.detect(gray, *lens, frame.family, frame.size_m)
    return found


def test_the_tag_is_found_where_it_is(frames: list[Frame]) -> None:
    for frame in frames:
        found, true = _detect(frame), frame.sighting
        assert found.id == frame.tag_id
        error_m = np.linalg.norm(np.subtract(found.position_m, true.position_m))
        assert error_m < POSITION_SHARE * np.linalg.norm(true.position_m)
        assert angle_deg(found.quaternion_xyzw, rotation_of(true.orientation_xyzw)) < ANGLE_DEG
        np.testing.assert_allclose(found.corners_px, true.corners_px, atol=CORNER_PX)
