"""OpenCV, or an ImportError that explains how to install it."""

from __future__ import annotations

try:
    import cv2
except ImportError as missing:
    raise ImportError(
        "this node needs OpenCV, which is not installed: pip install 'r2bspec[vision]'"
    ) from missing

__all__ = ["cv2"]
