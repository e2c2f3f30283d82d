"""The stereo nodes against the ground truth of a synthetic stereo pair.

Rectification and block matching of raw 1920x1200 images, at half of their size: under 5 % of the
disparities are off by more than 2 pixels of the recorded image, and over 75 % of the pixels have
one. Without rectification, or with the cameras exchanged, that is not so.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

pytest.importorskip("cv2")

import cv2

from data_bags import typestore
from r2bspec.bags.bag_reader import read_messages
from r2bspec.bags.recording import TimeWindow
from r2bspec.datasets.ground_truth import read_disparity
from r2bspec.datasets.synthesis import make
from r2bspec.nodes import camera, images, rectification, stereo

WIDTH, HEIGHT = 960, 540
KINDS = {"image": "sensor_msgs/msg/Image", "camera_info": "sensor_msgs/msg/CameraInfo"}
TOPICS = [f"/hawk_0_{side}_rgb_{part}" for side in ("left", "right") for part in KINDS]
Gray = NDArray[np.uint8]


class Pair:
    """One frame of both cameras, resized, with its truth."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        read = {message.topic: message for message in read_messages(folder, TOPICS)}
        self.stamp_ns = read[TOPICS[0]].time_ns
        self._messages = {
            name: typestore().deserialize_cdr(each.data, KINDS[name.split("_rgb_")[1]])
            for name, each in read.items()
        }

    def gray(self, side: str) -> Gray:
        image = self._messages[f"/hawk_0_{side}_rgb_image"]
        gray = images.gray(images.view(image), image.encoding)
        resized = cv2.resize(gray, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA)
        return np.asarray(resized, np.uint8)

    def rectified(self, side: str) -> Gray:
        name = f"/hawk_0_{side}_rgb_camera_info"
        kind = KINDS["camera_info"]
        store = typestore()
        info: Any = store.deserialize_cdr(store.serialize_cdr(self._messages[name], kind), kind)
        camera.scale(info, WIDTH / info.width, HEIGHT / info.height)
        gray = self.gray(side)
        target = np.empty_like(gray)
        rectification.rectify(gray, info, target)
        return target

    def accuracy(self, left: Gray, right: Gray) -> tuple[float, float]:
        """The share of disparities that are off by more than 2 recorded pixels, and the density.

        What only one of the cameras sees counts, too.
        """
        matcher = stereo.make_matcher(stereo.MatcherParameters())
        true = read_disparity(self._folder, "hawk_0", self.stamp_ns)
        # The nearest pixel of the recorded image, which has other proportions.
        rows, columns = (
            ((np.arange(size) + 0.5) * (recorded / size)).astype(int)
            for size, recorded in zip((HEIGHT, WIDTH), true.shape, strict=True)
        )
        expected, scale = true[rows[:, None], columns], WIDTH / true.shape[1]
        found = stereo.disparity(matcher, left, right)
        answered = found >= 0
        errors = np.abs(found[answered] / scale - expected[answered])
        return float((errors > 2).mean()), float(answered.mean())


@pytest.fixture(scope="module")
def pair(tmp_path_factory: pytest.TempPathFactory) -> Pair:
    window = TimeWindow(start_ns=0, end_ns=10_000_000)
    cache = tmp_path_factory.mktemp("datasets")
    return Pair(make("r2b_datacenter", TOPICS, window, cache_dir=cache).path)


def test_rectified_images_have_the_true_disparities(pair: Pair) -> None:
    bad, density = pair.accuracy(pair.rectified("left"), pair.rectified("right"))
    assert bad < 0.05
    assert density > 0.75


def test_raw_images_do_not_and_one_rectified_camera_is_not_enough(pair: Pair) -> None:
    raw = pair.gray("right")
    for left in (pair.gray("left"), pair.rectified("left")):
        assert pair.accuracy(left, raw)[0] > 0.1


def test_exchanged_cameras_do_not(pair: Pair) -> None:
    bad, density = pair.accuracy(pair.rectified("right"), pair.rectified("left"))
    assert bad > 0.5
    assert density < 0.5
