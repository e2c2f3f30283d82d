"""Pixels of sensor_msgs/msg/Image as numpy arrays, and back, with as few copies as possible."""

from __future__ import annotations

import sys
from array import array
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from r2bspec.extras import install_command

try:
    import cv2 as cv2
except ImportError as missing:
    raise ImportError(
        f"this node needs OpenCV, which is not installed: {install_command('vision')}"
    ) from missing

if TYPE_CHECKING:
    from sensor_msgs.msg import Image

Pixels = NDArray[Any]


@dataclass(frozen=True, slots=True)
class PixelFormat:
    """How a pixel is stored: `channels` values of the numpy type `dtype`."""

    dtype: np.dtype[Any]
    channels: int

    @property
    def pixel_bytes(self) -> int:
        """The size of a pixel in bytes."""
        return self.dtype.itemsize * self.channels

    def shape(self, height: int, width: int) -> tuple[int, ...]:
        """Return the shape of an image's array: OpenCV's, without an axis for a single channel."""
        return (height, width) if self.channels == 1 else (height, width, self.channels)


PIXEL_FORMATS = MappingProxyType(
    {
        "mono8": PixelFormat(np.dtype(np.uint8), 1),
        "rgb8": PixelFormat(np.dtype(np.uint8), 3),
        "bgr8": PixelFormat(np.dtype(np.uint8), 3),
        "rgba8": PixelFormat(np.dtype(np.uint8), 4),
        "bgra8": PixelFormat(np.dtype(np.uint8), 4),
        "mono16": PixelFormat(np.dtype(np.uint16), 1),
        "16UC1": PixelFormat(np.dtype(np.uint16), 1),
        "32FC1": PixelFormat(np.dtype(np.float32), 1),
    }
)

# Image.is_bigendian of images made here.
NATIVE_BIGENDIAN = int(sys.byteorder == "big")

_TO_GRAY = MappingProxyType(
    {
        "rgb8": cv2.COLOR_RGB2GRAY,
        "bgr8": cv2.COLOR_BGR2GRAY,
        "rgba8": cv2.COLOR_RGBA2GRAY,
        "bgra8": cv2.COLOR_BGRA2GRAY,
    }
)

# In the order of image_proc's `interpolation`. The plain INTER_NEAREST takes the sample left of and
# above the pixel's centre, and so shifts the image against its camera_info.
_INTERPOLATIONS = (
    cv2.INTER_NEAREST_EXACT,
    cv2.INTER_LINEAR,
    cv2.INTER_CUBIC,
    cv2.INTER_AREA,
    cv2.INTER_LANCZOS4,
)


def pixel_format(encoding: str) -> PixelFormat:
    """Look an encoding up.

    Raises:
        ValueError: the encoding is none of `PIXEL_FORMATS`.
    """
    if encoding not in PIXEL_FORMATS:
        raise ValueError(f"image encoding {encoding!r} is not one of {', '.join(PIXEL_FORMATS)}")
    return PIXEL_FORMATS[encoding]


def layout(encoding: str, width: int, height: int) -> dict[str, Any]:
    """Return the fields of an Image without padding, in this machine's byte order."""
    return {
        "height": height,
        "width": width,
        "encoding": encoding,
        "is_bigendian": NATIVE_BIGENDIAN,
        "step": width * pixel_format(encoding).pixel_bytes,
    }


def view(image: Image) -> Pixels:
    """Return the pixels of an image message, in this machine's byte order.

    The result shares the memory of the message, even if rows are padded. Two kinds of pixels are
    copied: those of the other byte order, which OpenCV would read as native ones, and those whose
    row step is not a multiple of the size of a value, which OpenCV does not support.

    Returns:
        An array of shape (height, width), or (height, width, channels) for several channels.

    Raises:
        ValueError: the encoding is unknown, or size, step and data do not fit together.
    """
    form = pixel_format(image.encoding)
    height, width, step = image.height, image.width, image.step
    row_bytes = width * form.pixel_bytes
    if height < 1 or width < 1:
        raise ValueError(f"image of {width}x{height} pixels is empty")
    if step < row_bytes:
        raise ValueError(
            f"image step of {step} bytes is less than a row of {width} {image.encoding} pixels, "
            f"{row_bytes} bytes"
        )
    # The last row may end without the padding of the others.
    needed = step * (height - 1) + row_bytes
    data_bytes = memoryview(image.data).nbytes
    if data_bytes < needed:
        raise ValueError(f"image data has {data_bytes} bytes; its size and step need {needed}")

    foreign = bool(image.is_bigendian) != (sys.byteorder == "big") and form.dtype.itemsize > 1
    dtype = form.dtype.newbyteorder() if foreign else form.dtype
    strides = (step, form.pixel_bytes, form.dtype.itemsize)
    shape = form.shape(height, width)
    pixels: Pixels = np.ndarray(shape, dtype, buffer=image.data, strides=strides[: len(shape)])
    return pixels.astype(form.dtype) if foreign or step % form.dtype.itemsize else pixels


def allocate(encoding: str, height: int, width: int) -> tuple[array[int], Pixels]:
    """Allocate an image without padding.

    Returns:
        The memory, ready to be an Image's `data` (rclpy takes an ``array('B')`` as it is), and a
        writable view of it as pixels, shaped as `view` shapes them.

    Raises:
        ValueError: the encoding is unknown.
    """
    form = pixel_format(encoding)
    memory = array("B", [0]) * (height * width * form.pixel_bytes)
    return memory, np.frombuffer(memory, form.dtype).reshape(form.shape(height, width))


def gray(pixels: Pixels, encoding: str) -> NDArray[np.uint8]:
    """Reduce 8-bit pixels to luminance (ITU-R BT.601, as OpenCV weighs it).

    Returns:
        An array of shape (height, width); for mono8 the one given.

    Raises:
        ValueError: the encoding is not an 8-bit colour or gray one.
    """
    if encoding == "mono8":
        return pixels
    if encoding not in _TO_GRAY:
        raise ValueError(f"image encoding {encoding!r} is not one of mono8, {', '.join(_TO_GRAY)}")
    return np.asarray(cv2.cvtColor(pixels, _TO_GRAY[encoding]), dtype=np.uint8)


def resize(image: Image, width: int, height: int, interpolation: int) -> array[int]:
    """Resample an image, without padding and in this machine's byte order.

    Args:
        image: the message.
        width: the width of the result, pixels.
        height: the height of the result, pixels.
        interpolation: 0 nearest, 1 linear, 2 cubic, 3 area, 4 Lanczos over 8x8 pixels.

    Returns:
        The result's `data`.

    Raises:
        ValueError: see `view`.
    """
    memory, target = allocate(image.encoding, height, width)
    cv2.resize(
        view(image), (width, height), dst=target, interpolation=_INTERPOLATIONS[interpolation]
    )
    return memory
