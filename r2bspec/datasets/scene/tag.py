"""The AprilTag on its board, and how it looks between pixels."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from r2bspec.datasets.scene.geometry import BODY_FROM_OPTICAL, Pose, Vector

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

FAMILY: Final = "36h11"

# Number 3 of the family, as its authors publish and print it: the 6x6 cells inside the black
# border row by row from the top left, the first the highest bit, 1 is white. OpenCV's dictionary
# has it upside down up to 5.0.
_ID: Final = 3
_CODE: Final = 0xE479E9C98
_PAYLOAD_CELLS: Final = 6

MARKER_CELLS: Final = _PAYLOAD_CELLS + 2
# A white quiet zone of one cell surrounds the black border.
BOARD_CELLS: Final = MARKER_CELLS + 2

WHITE: Final = 232.0
BLACK: Final = 22.0


@dataclass(frozen=True, slots=True)
class Tag:
    """A tag on a face that looks along the world's -x.

    Its frame has x right and y down in the tag's own image, as its authors print it, and z into
    the tag, so that a tag seen frontally is not rotated against the camera's optical frame.

    Attributes:
        size_m: edge of the outer square of the black border.
        center_m: in the world.
    """

    size_m: float
    center_m: Vector
    id: int = _ID

    @property
    def pose(self) -> Pose:
        """World from tag. In a view along x, right is -y and down is -z."""
        return Pose(self.center_m, BODY_FROM_OPTICAL)


def board_cells() -> NDArray[np.float32]:
    """Brightness of the board's cells, shape (12, 12): the board and a rim that repeats it."""
    import numpy as np

    cells = np.full((BOARD_CELLS + 2, BOARD_CELLS + 2), WHITE, np.float32)
    cells[2:-2, 2:-2] = BLACK
    for place in range(_PAYLOAD_CELLS**2):
        if _CODE >> (_PAYLOAD_CELLS**2 - 1 - place) & 1:
            row, column = divmod(place, _PAYLOAD_CELLS)
            cells[3 + row, 3 + column] = WHITE
    return cells


def sample_board(
    across: NDArray[np.float64],
    down: NDArray[np.float64],
    across_width: NDArray[np.float64],
    down_width: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Brightness and coverage of the board, averaged over a box around each sample.

    A box that is smaller than a cell straddles at most one cell border in each direction, so
    its exact mean is a linear ramp across the border.

    Args:
        across: position from the board's left edge, in cells.
        down: position from its top edge, in cells.
        across_width: extent of the box in cells.
        down_width: likewise downwards.

    Returns:
        Brightness 0 to 255, and the share of the box that the board covers.
    """
    import numpy as np

    cells = board_cells()
    left, right_share, inside_across = _ramp(across, across_width)
    top, bottom_share, inside_down = _ramp(down, down_width)
    # The rim shifts the cells by one: cell k of the board is cells[k + 1].
    upper = cells[top, left] * (1 - right_share) + cells[top, left + 1] * right_share
    lower = cells[top + 1, left] * (1 - right_share) + cells[top + 1, left + 1] * right_share
    brightness = upper * (1 - bottom_share) + lower * bottom_share
    return np.asarray(brightness), inside_across * inside_down


def _ramp(
    position: NDArray[np.float64], width: NDArray[np.float64]
) -> tuple[NDArray[np.intp], NDArray[np.float64], NDArray[np.float64]]:
    """The cell before the nearest border, the share beyond that border, the share on the board."""
    import numpy as np

    border = np.clip(np.floor(position + 0.5), 0, BOARD_CELLS)
    share = np.clip((position - border) / width + 0.5, 0.0, 1.0)
    inside = np.clip(position / width + 0.5, 0.0, 1.0) * np.clip(
        (BOARD_CELLS - position) / width + 0.5, 0.0, 1.0
    )
    return border.astype(np.intp), share, inside
