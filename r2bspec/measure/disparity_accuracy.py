"""How many disparities are wrong, as the Middlebury stereo evaluation counts them.

A pixel is compared if its true disparity is known and both cameras see it: what another surface
hides from the right camera, or what lies outside of its image, cannot be matched
(``nonocc`` there). It is answered if it has a disparity, and bad if that is off by more than
`BAD_PX` pixels of the recorded image (``bad 2.0``).

    bad pixels = bad / answered        density = answered / compared
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from r2bspec.measure.truth_metrics import BAD_PIXELS, DENSITY

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
