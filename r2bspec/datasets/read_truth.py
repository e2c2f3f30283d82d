"""Reading the ground truth of a recording, from its folder."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from r2bspec.bags.dataset_record import DISPARITY_NAME, GROUND_TRUTH_NAME
from r2bspec.datasets.ground_truth import DISPARITY_PARTS, GroundTruth
from r2bspec.untrusted.safe_json import read_json
from r2bspec.untrusted.safe_npz import read_npz_array

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


def read_ground_truth(folder: Path) -> GroundTruth | None:
    """The ground truth of a recording; None if its folder has none that can be read."""
    try:
        return read_json(folder / GROUND_TRUTH_NAME, GroundTruth)
    except (OSError, msgspec.MsgspecError):
        return None


def read_disparity(folder: Path, pair: str, stamp_ns: int) -> NDArray[np.float32]:
    """The true disparities of a stereo pair at a stamp.

    Returns:
        Pixels of the rectified left image, shape (height, width).

    Raises:
        KeyError: there are none of that pair and stamp.
        RefusedDataError: the file is damaged.
        OSError: it cannot be read.
    """
    import numpy as np

    parts = read_npz_array(folder / DISPARITY_NAME, f"{pair}/{stamp_ns}")
    disparity: NDArray[np.float32] = parts.astype(np.float32) / np.float32(DISPARITY_PARTS)
    return disparity
