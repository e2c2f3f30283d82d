"""Wrong disparities are counted as wrong, and right ones as right."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from r2bspec.judge.measure.metric_catalogue import BAD_PIXELS, DENSITY
from r2bspec.judge.measure.truth_accuracy import DisparityAccuracy, visible_to_both

HEIGHT, WIDTH = 40, 120
WALL_PX, BOX_PX = 10.0, 20.0


def scene() -> NDArray[np.float32]:
    """A wall, and a box before it in columns 60 to 79."""
    true = np.full((HEIGHT, WIDTH), WALL_PX, np.float32)
    true[10:30, 60:80] = BOX_PX
    return true


def accuracy(found: NDArray[np.float32], true: NDArray[np.float32]) -> dict[str, float]:
    counted = DisparityAccuracy()
    counted.add(found, 0.0, true)
    return counted.values


def test_the_truth_itself_has_no_errors() -> None:
    assert accuracy(scene(), scene()) == {BAD_PIXELS: 0.0, DENSITY: 1.0}


@pytest.mark.parametrize(("shift", "bad"), [(1.9, 0.0), (-1.9, 0.0), (2.1, 1.0), (-2.1, 1.0)])
def test_a_shift_of_over_two_pixels_is_bad_everywhere(shift: float, bad: float) -> None:
    found = accuracy(scene() + np.float32(shift), scene())
    assert found[BAD_PIXELS] == pytest.approx(bad)
    assert found[DENSITY] == 1.0


def test_missing_disparities_lower_the_density_and_are_not_bad() -> None:
    found = scene()
    found[: HEIGHT // 2] = -1.0
    values = accuracy(found, scene())
    assert values[BAD_PIXELS] == 0.0
    assert values[DENSITY] == pytest.approx(0.5, abs=0.02)


@pytest.mark.parametrize("nothing", [-1.0, np.nan, np.inf])
def test_without_any_disparity_there_is_no_share_of_bad_ones(nothing: float) -> None:
    values = accuracy(np.full((HEIGHT, WIDTH), nothing, np.float32), scene())
    assert values == {DENSITY: 0.0}


def test_a_constant_guess_is_bad_where_it_is_wrong() -> None:
    values = accuracy(np.full((HEIGHT, WIDTH), WALL_PX, np.float32), scene())
    seen = visible_to_both(scene())
    assert values[BAD_PIXELS] == pytest.approx((scene() == BOX_PX)[seen].mean())
    assert values[BAD_PIXELS] > 0.05


def test_what_the_right_camera_cannot_see_is_not_compared() -> None:
    seen = visible_to_both(scene())
    # Left of column 10, a wall of disparity 10 lies outside of the right image.
    assert not seen[:, :10].any()
    assert seen[0, 10:].all()
    # The box hides, in the right image, ten columns of the wall to the left of it.
    assert not seen[15, 50:60].any()
    assert seen[15, 40:50].all()
    assert seen[15, 60:80].all()
    assert seen[15, 80:].all()
    wrong = scene()
    wrong[15, 50:60] = 55.0
    assert accuracy(wrong, scene())[BAD_PIXELS] == 0.0


def test_a_smaller_image_is_compared_in_pixels_of_the_recorded_one() -> None:
    true = np.kron(scene(), np.ones((2, 2), np.float32)) * 2
    assert accuracy(scene(), true)[BAD_PIXELS] == 0.0
    # A pixel of the small image is two of the recorded one.
    assert accuracy(scene() + np.float32(0.9), true)[BAD_PIXELS] == 0.0
    assert accuracy(scene() + np.float32(1.1), true)[BAD_PIXELS] == 1.0
    # Disparities that are not scaled with the image are wrong.
    assert accuracy(scene() * 2, true)[BAD_PIXELS] == 1.0


def test_images_add_up() -> None:
    counted = DisparityAccuracy()
    counted.add(scene(), 0.0, scene())
    counted.add(scene() + 5, 0.0, scene())
    assert counted.values[BAD_PIXELS] == 0.5
    assert counted.images == 2
    assert "the mean error is 2.5 pixels" in counted.text


def test_what_is_below_the_smallest_disparity_is_none() -> None:
    counted = DisparityAccuracy()
    counted.add(scene(), BOX_PX, scene())
    seen = visible_to_both(scene())
    assert counted.values[DENSITY] == pytest.approx((scene() == BOX_PX)[seen].mean())
