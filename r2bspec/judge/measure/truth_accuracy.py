"""How accurate outputs are, compared with the truth of a dataset: disparities, and poses of tags.

Disparities are counted as the Middlebury stereo evaluation does. A pixel is compared if its true
disparity is known and both cameras see it: what another surface hides from the right camera, or
what lies outside of its image, cannot be matched (``nonocc`` there). It is answered if it has a
disparity, and bad if that is off by more than `BAD_PX` pixels of the recorded image (``bad 2.0``).

    bad pixels = bad / answered        density = answered / compared

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
from typing import Any

import numpy as np
from numpy.typing import NDArray

from r2bspec.judge.measure.metric_catalogue import (
    BAD_PIXELS,
    DENSITY,
    TAG_FALSE,
    TAG_MISSED,
    TAG_POSITION_ERROR,
)

BAD_PX = 2.0

# A surface that is nearer by less than this does not hide the one behind it.
_HIDES_PX = 1.0


@dataclass(slots=True)
class DisparityAccuracy:
    """Counts over all images that were compared; the errors are in pixels of the recorded one."""

    images: int = 0
    compared: int = 0
    answered: int = 0
    bad: int = 0
    error_px: float = 0.0

    def add(
        self, found: NDArray[np.float32], smallest_px: float, true: NDArray[np.float32]
    ) -> None:
        """Compare one image.

        Args:
            found: disparities in pixels of this image, shape (height, width).
            smallest_px: what is less is no disparity.
            true: those of the recorded image, which may be larger or smaller: both show the same.
        """
        scale = found.shape[1] / true.shape[1]
        expected = resampled(true, found.shape)
        seen = visible_to_both(expected * np.float32(scale))
        answered = seen & np.isfinite(found) & (found >= smallest_px)
        errors = np.abs(found[answered] / np.float32(scale) - expected[answered])
        self.images += 1
        self.compared += int(np.count_nonzero(seen))
        self.answered += int(errors.size)
        self.bad += int(np.count_nonzero(errors > BAD_PX))
        self.error_px += float(errors.sum(dtype=np.float64))

    @property
    def values(self) -> dict[str, float]:
        """The metrics that have a value."""
        values = {}
        if self.answered:
            values[BAD_PIXELS] = self.bad / self.answered
        if self.compared:
            values[DENSITY] = self.answered / self.compared
        return values

    @property
    def text(self) -> str:
        """What was compared, in a sentence."""
        if not self.answered:
            return f"Of {self.compared:,} compared pixels none has a disparity."
        return (
            f"{self.answered:,} of {self.compared:,} compared pixels have a disparity, "
            f"{self.bad:,} of these are off by more than {BAD_PX:g} pixels of the recorded image; "
            f"the mean error is {self.error_px / self.answered:.2g} pixels."
        )


def resampled(true: NDArray[np.float32], shape: tuple[int, ...]) -> NDArray[np.float32]:
    """Values of an image at the centres of the pixels of another size, the nearest one each."""
    rows, columns = (
        np.clip(np.round((np.arange(new) + 0.5) * (old / new) - 0.5).astype(np.intp), 0, old - 1)
        for new, old in zip(shape, true.shape, strict=True)
    )
    nearest: NDArray[np.float32] = true[rows[:, None], columns[None, :]]
    return nearest


def visible_to_both(disparity: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Which pixels of the left image the right camera sees, too.

    The right camera sees, in each of its columns, what has the largest disparity of all that falls
    into it.

    Args:
        disparity: true, in pixels of this image, shape (height, width).
    """
    height, width = disparity.shape
    columns = np.round(np.arange(width)[None, :] - disparity).astype(np.intp)
    inside = columns >= 0
    place = (np.arange(height)[:, None] * width + np.clip(columns, 0, width - 1)).ravel()
    nearest = np.zeros(height * width, np.float32)
    np.maximum.at(nearest, place[inside.ravel()], disparity.ravel()[inside.ravel()])
    visible: Any = inside & (nearest[place].reshape(disparity.shape) - disparity < _HIDES_PX)
    return np.asarray(visible, np.bool_)


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
        answers = [offset(answer, true) for answer in found if answers_tag(answer, true)]
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
    lengths = [math.hypot(*pose.orientation_xyzw) for pose in (found, true)]
    if not all(length and math.isfinite(length) for length in lengths):
        return 180.0
    dot = math.fsum(
        a * b for a, b in zip(found.orientation_xyzw, true.orientation_xyzw, strict=True)
    )
    return math.degrees(2 * math.acos(min(1.0, abs(dot) / math.prod(lengths))))


def answers_tag(found: TagPose, true: TagPose) -> bool:
    """Whether a detection is of the tag."""
    return offset(found, true) <= MAX_OFFSET and angle_deg(found, true) <= MAX_ANGLE_DEG
