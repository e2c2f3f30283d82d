"""Wrong detections are missed and false ones, and right ones are neither."""

from __future__ import annotations

import math

import pytest

from r2bspec.judge.measure.metric_catalogue import TAG_FALSE, TAG_MISSED, TAG_POSITION_ERROR
from r2bspec.judge.measure.truth_accuracy import TagAccuracy, TagPose, angle_deg


def turned(degrees: float) -> tuple[float, float, float, float]:
    """A rotation about the viewing direction."""
    half = math.radians(degrees) / 2
    return (0.0, 0.0, math.sin(half), math.cos(half))


TRUE = TagPose((0.1, -0.2, 2.0), turned(10.0))
DISTANCE = math.hypot(0.1, -0.2, 2.0)


def at(dx: float = 0.0, degrees: float = 10.0) -> TagPose:
    """The tag, moved by a share of its distance and turned."""
    x, y, z = TRUE.position_m
    return TagPose((x + dx * DISTANCE, y, z), turned(degrees))


def values(*images: list[TagPose], true: TagPose | None = TRUE) -> dict[str, float]:
    counted = TagAccuracy()
    for found in images:
        counted.add(found, true)
    return counted.values


def test_the_truth_itself_has_no_errors() -> None:
    assert values([TRUE]) == {TAG_MISSED: 0.0, TAG_FALSE: 0.0, TAG_POSITION_ERROR: 0.0}


def test_a_small_error_is_measured_as_a_share_of_the_distance() -> None:
    found = values([at(0.01)], [at(0.03)])
    assert found[TAG_POSITION_ERROR] == pytest.approx(0.02)
    assert (found[TAG_MISSED], found[TAG_FALSE]) == (0.0, 0.0)


@pytest.mark.parametrize(
    "wrong",
    [
        at(0.11),
        at(degrees=31.0),
        at(degrees=190.0),
        TagPose((0.1, -0.2, -2.0), TRUE.orientation_xyzw),
        TagPose(TRUE.position_m, (0.0, 0.0, 0.0, 0.0)),
        TagPose((math.nan, 0.0, 2.0), TRUE.orientation_xyzw),
        TagPose((100.0, -200.0, 2000.0), TRUE.orientation_xyzw),  # millimetres
    ],
)
def test_a_wrong_pose_is_a_missed_tag_and_a_false_detection(wrong: TagPose) -> None:
    assert values([wrong]) == {TAG_MISSED: 1.0, TAG_FALSE: 1.0}


def test_an_image_without_a_detection_misses_the_tag() -> None:
    assert values([TRUE], [], [TRUE], [])[TAG_MISSED] == 0.5
    assert values([]) == {TAG_MISSED: 1.0, TAG_FALSE: 0.0}


def test_a_second_detection_of_the_tag_is_false() -> None:
    found = values([at(0.02), at(0.01)])
    assert found[TAG_FALSE] == 0.5
    assert found[TAG_MISSED] == 0.0
    assert found[TAG_POSITION_ERROR] == pytest.approx(0.01)


def test_a_detection_where_there_is_no_tag_is_false() -> None:
    assert values([TRUE], true=None) == {TAG_FALSE: 1.0}
    assert values([], true=None) == {TAG_FALSE: 0.0}


def test_a_quaternion_and_its_negative_are_one_rotation() -> None:
    x, y, z, w = TRUE.orientation_xyzw
    same = TagPose(TRUE.position_m, (-x, -y, -z, -w))
    assert angle_deg(same, TRUE) == pytest.approx(0.0, abs=1e-5)
    assert angle_deg(at(degrees=55.0), TRUE) == pytest.approx(45.0)


def test_nothing_compared_has_no_values() -> None:
    assert TagAccuracy().values == {}
