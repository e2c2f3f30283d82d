"""Reads the ground truth that a made dataset keeps with its bag."""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray

from r2bspec.bags.recording import DISPARITY_NAME, GROUND_TRUTH_NAME
from r2bspec.datasets.ground_truth import DISPARITY_PARTS, GroundTruth


def read_ground_truth(folder: Path) -> GroundTruth:
    text = (folder / GROUND_TRUTH_NAME).read_bytes()
    return msgspec.json.decode(text, type=GroundTruth)


def read_disparity(folder: Path, pair: str, stamp_ns: int) -> NDArray[np.float32]:
    """True disparity of a pair at a stamp, in pixels of the left image, (height, width)."""
    with np.load(folder / DISPARITY_NAME) as archive:
        parts = archive[f"{pair}/{stamp_ns}"]
    disparity: NDArray[np.float32] = parts.astype(np.float32) / np.float32(DISPARITY_PARTS)
    return disparity
