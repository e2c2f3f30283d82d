"""The surface pattern of the world: value noise, made once, looked up everywhere.

Only +, -, *, / and whole-number hashing are used, which give the same bits on every machine.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

TEXELS: Final = 1024
TEXELS_PER_M: Final = 200.0

# Lattice points across the texture, coarse to fine, and their weights: features of 64 cm to 1 cm.
_OCTAVES: Final = (
    (8, 0.4),
    (16, 0.5),
    (32, 0.7),
    (64, 0.9),
    (128, 1.0),
    (256, 0.9),
    (512, 0.7),
)
_CONTRAST: Final = 0.95

# Seams between panels, every 64 cm, a centimetre wide and so much darker.
_SEAM_TEXELS: Final = 128
_SEAM_HALF_TEXELS: Final = 1.5
_SEAM_DEPTH: Final = 0.55

# Level k leaves out the k finest octaves: for surfaces that pass several of them in a pixel.
LEVELS: Final = 6
# A pixel must stay below half the finest feature of its level.
_FINEST_M: Final = 0.01
LEVEL_LIMITS_M: Final = tuple(_FINEST_M / 2 * 2**level for level in range(LEVELS - 1))


def hash_noise(x: NDArray[np.uint32], y: NDArray[np.uint32], seed: int) -> NDArray[np.float32]:
    """Noise in [0, 1) for whole-number points, by multiplying and folding 32-bit integers."""
    import numpy as np

    mixed = (
        x * np.uint32(0x9E3779B1) + y * np.uint32(0x85EBCA77) + np.uint32(seed * 0xC2B2AE3D % 2**32)
    )
    for multiplier in (0x7FEB352D, 0x846CA68B):
        mixed ^= mixed >> np.uint32(15)
        mixed *= np.uint32(multiplier)
    mixed ^= mixed >> np.uint32(16)
    return (mixed >> np.uint32(8)).astype(np.float32) * np.float32(2**-24)


@lru_cache(maxsize=1)
def pyramid() -> NDArray[np.float32]:
    """The texture's levels, flattened: LEVELS * TEXELS * TEXELS values in [0, 1]; periodic."""
    import numpy as np

    total = np.zeros((TEXELS, TEXELS), np.float32)
    weight = 0.0
    levels: list[NDArray[np.float32]] = []
    for number, (points, octave_weight) in enumerate(_OCTAVES):
        total = total + (_octave(points, number) - np.float32(0.5)) * np.float32(octave_weight)
        weight += octave_weight
        if number >= len(_OCTAVES) - LEVELS:
            levels.insert(0, total)
    # One scale for all levels: leaving out an octave must not change the others' contrast.
    scale = np.float32(_CONTRAST * 2 / weight)
    flat = [
        (np.clip(noise * scale + np.float32(0.55), 0, 1) * _seams(level)).ravel()
        for level, noise in enumerate(levels)
    ]
    return np.concatenate(flat)


def _seams(level: int) -> NDArray[np.float32]:
    """Brightness around the seams, 1 away from them; coarser levels blur them out."""
    import numpy as np

    place = np.arange(TEXELS, dtype=np.float32) % np.float32(_SEAM_TEXELS)
    away = np.minimum(place, np.float32(_SEAM_TEXELS) - place)
    reach = np.float32(_SEAM_HALF_TEXELS * 2**level)
    dark = np.maximum(1 - away / reach, 0) * np.float32(_SEAM_DEPTH / 2**level)
    bright: NDArray[np.float32] = 1 - np.maximum(dark[:, None], dark[None, :])
    return bright


def _octave(points: int, seed: int) -> NDArray[np.float32]:
    """Noise on a periodic lattice, eased between its points; (TEXELS, TEXELS)."""
    import numpy as np

    lattice = np.arange(points, dtype=np.uint32)
    values = hash_noise(lattice[None, :], lattice[:, None], seed)
    place = np.arange(TEXELS, dtype=np.float32) * np.float32(points / TEXELS)
    before = place.astype(np.intp)
    share = place - before
    share = share * share * (3 - 2 * share)
    after = (before + 1) % points
    rows = values[before] * (1 - share[:, None]) + values[after] * share[:, None]
    octave: NDArray[np.float32] = rows[:, before] * (1 - share) + rows[:, after] * share
    return octave


def sample(
    u_m: NDArray[np.float32], v_m: NDArray[np.float32], level: NDArray[np.int32]
) -> NDArray[np.float32]:
    """Look the texture up between its texels; arrays of one shape, result in [0, 1]."""
    import numpy as np

    texture = pyramid()
    u = u_m * np.float32(TEXELS_PER_M)
    v = v_m * np.float32(TEXELS_PER_M)
    left, top = np.floor(u), np.floor(v)
    u -= left
    v -= top
    mask = np.int32(TEXELS - 1)
    column = left.astype(np.int32) & mask
    row = (top.astype(np.int32) & mask) * np.int32(TEXELS)
    next_column = (column + np.int32(1)) & mask
    next_row = (row + np.int32(TEXELS)) & np.int32(TEXELS * TEXELS - 1)
    base = level * np.int32(TEXELS * TEXELS)
    row += base
    next_row += base
    upper = texture.take(row + column)
    upper += (texture.take(row + next_column) - upper) * u
    lower = texture.take(next_row + column)
    lower += (texture.take(next_row + next_column) - lower) * u
    result: NDArray[np.float32] = upper + (lower - upper) * v
    return result
