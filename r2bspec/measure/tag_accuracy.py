"""Whether a tag is detected, and where it is.

A detection answers the tag if its position is off by at most `MAX_OFFSET` of the tag's distance and
its rotation by at most `MAX_ANGLE_DEG`; of several that do, the nearest one. All others are false.

    missed = images in which no detection answers the visible tag / images in which it is visible
    false = false detections / detections
    position error = mean of |found - true| / |true|, over the detections that answer
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from r2bspec.measure.truth_metrics import TAG_FALSE, TAG_MISSED, TAG_POSITION_ERROR

MAX_OFFSET = 0.1
MAX_ANGLE_DEG = 20.0

Position = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]


@dataclass(frozen=True, slots=True)
class TagPose:
    """A tag in the camera's optical frame: metres, and a quaternion x, y, z, w."""

    position_m: Position
    orientation_xyzw: Quaternion


@dataclass(slots=True)
class TagAccuracy:
    """Counts over all images that were compared."""

    images: int = 0
    visible: int = 0
    detections: int = 0
    errors: list[float] = field(default_factory=list)

    def add(self, found: Sequence[TagPose], true: TagPose | None) -> None:
        """Compare the detections in one image.

        Args:
            found: the detections.
            true: the tag; None if it is not wholly in the image.
        """
        self.images += 1
        self.detections += len(found)
        if true is None:
            return
        self.visible += 1
        answers = [offset(each, true) for each in found if answers_tag(each, true)]
        if answers:
            self.errors.append(min(answers))

    @property
    def values(self) -> dict[str, float]:
        """The metrics that have a value."""
        values = {}
        if self.visible:
            values[TAG_MISSED] = 1 - len(self.errors) / self.visible
        if self.images:
            wrong = self.detections - len(self.errors)
            values[TAG_FALSE] = wrong / self.detections if self.detections else 0.0
        if self.errors:
            values[TAG_POSITION_ERROR] = math.fsum(self.errors) / len(self.errors)
        return values

    @property
    def text(self) -> str:
        """What was compared, in a sentence."""
        return (
            f"The tag is visible in {self.visible:,} images and found in {len(self.errors):,}, "
            f"with {self.detections:,} detections in all."
        )


def offset(found: TagPose, true: TagPose) -> float:
    """The distance of both positions, as a share of the tag's distance from the camera."""
    distance = math.dist(true.position_m, (0.0, 0.0, 0.0))
    return math.dist(found.position_m, true.position_m) / distance if distance else math.inf


def angle_deg(found: TagPose, true: TagPose) -> float:
    """The angle between both rotations: 2 acos |p . q| of unit quaternions."""
    lengths = [math.hypot(*each.orientation_xyzw) for each in (found, true)]
    if not all(length and math.isfinite(length) for length in lengths):
        return 180.0
    dot = math.fsum(
        a * b for a, b in zip(found.orientation_xyzw, true.orientation_xyzw, strict=True)
    )
    return math.degrees(2 * math.acos(min(1.0, abs(dot) / math.prod(lengths))))


def answers_tag(found: TagPose, true: TagPose) -> bool:
    """Whether a detection is of the tag."""
    return offset(found, true) <= MAX_OFFSET and angle_deg(found, true) <= MAX_ANGLE_DEG
