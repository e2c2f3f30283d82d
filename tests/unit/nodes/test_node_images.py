"""Image messages seen as arrays, and back."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

pytest.importorskip("cv2")

from cameras import message

from r2bspec.nodes import images


def pixels_of(encoding: str, height: int = 5, width: int = 7) -> np.ndarray[Any, Any]:
    form = images.PIXEL_FORMATS[encoding]
    values = np.random.default_rng(1).integers(0, 60000, form.shape(height, width))
    return values.astype(form.dtype)


@pytest.mark.parametrize("padding", [0, 1, 6])
@pytest.mark.parametrize("encoding", images.PIXEL_FORMATS)
def test_a_view_holds_the_pixels_whatever_the_step(encoding: str, padding: int) -> None:
    pixels = pixels_of(encoding)
    seen = images.view(message(pixels, encoding, padding))
    assert seen.dtype == pixels.dtype
    np.testing.assert_array_equal(seen, pixels)


@pytest.mark.parametrize("encoding", ["16UC1", "mono16", "32FC1"])
def test_pixels_of_the_other_byte_order_are_swapped(encoding: str) -> None:
    pixels = pixels_of(encoding)
    foreign = message(pixels.astype(pixels.dtype.newbyteorder(">")), encoding, padding=1)
    seen = images.view(foreign)
    assert seen.dtype == pixels.dtype
    np.testing.assert_array_equal(seen, pixels)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"encoding": "yuv422"}, "encoding 'yuv422' is not one of mono8, rgb8"),
        ({"step": 20}, "step of 20 bytes is less than a row of 7 rgb8 pixels, 21 bytes"),
        ({"height": 6}, "has 105 bytes; its size and step need 126"),
        ({"width": 0}, "0x5 pixels is empty"),
    ],
)
def test_a_message_that_contradicts_itself_is_refused(change: dict[str, Any], words: str) -> None:
    sent = message(pixels_of("rgb8"), "rgb8")
    for name, value in change.items():
        setattr(sent, name, value)
    with pytest.raises(ValueError, match=words):
        images.view(sent)


@pytest.mark.parametrize(
    ("encoding", "red"), [("rgb8", 0), ("bgr8", 2), ("rgba8", 0), ("bgra8", 2)]
)
def test_gray_weighs_the_colours_by_their_names(encoding: str, red: int) -> None:
    pixels = np.zeros((2, 2, images.PIXEL_FORMATS[encoding].channels), np.uint8)
    pixels[..., red] = 200
    assert images.gray(pixels, encoding)[0, 0] == pytest.approx(0.299 * 200, abs=1)


@pytest.mark.parametrize("padding", [0, 3])
@pytest.mark.parametrize("encoding", images.PIXEL_FORMATS)
def test_resizing_fills_the_memory_that_it_returns(encoding: str, padding: int) -> None:
    pixels = np.full(
        images.PIXEL_FORMATS[encoding].shape(12, 16), 77, images.PIXEL_FORMATS[encoding].dtype
    )
    shape = images.PIXEL_FORMATS[encoding].shape(9, 8)
    for interpolation in range(5):
        data = images.resize(message(pixels, encoding, padding), 8, 9, interpolation)
        resized = np.frombuffer(data, pixels.dtype).reshape(shape)
        np.testing.assert_allclose(resized, 77, rtol=1e-6)
