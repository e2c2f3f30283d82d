"""What surfaces look like: the texture where a ray ends, and the paint."""

from __future__ import annotations

import random
from functools import lru_cache
from typing import TYPE_CHECKING

from r2bspec.datasets.scene import texture
from r2bspec.datasets.scene.room import FACES_PER_BOX, Room

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

_LUMINANCE = (0.299, 0.587, 0.114)

# Light falls from above and a little from one side; faces in the order of surface numbers.
_LIGHT_BY_FACE = (0.86, 0.94, 0.78, 0.90, 0.97, 0.72)
_WALLS = (0.93, 0.90, 0.84)
_FLOOR = (0.66, 0.55, 0.45)
_CEILING = (0.95, 0.96, 0.97)
# Seen from inside: the ray that runs down meets the floor.
_SHELL = (_WALLS, _WALLS, _WALLS, _WALLS, _FLOOR, _CEILING)

# A lidar's spot is some centimetres wide.
_LIDAR_LEVEL = 2


def texture_level(
    surface: NDArray[np.int32],
    directions: tuple[NDArray[np.floating], ...],
    distance: NDArray[np.floating],
    focal_px: float,
) -> NDArray[np.int32]:
    """The texture level whose finest feature a pixel can still show, by distance and slant.

    Args:
        surface: what each ray meets.
        directions: of the rays, world x, y and z, of length 1 along the optical axis.
        distance: along the optical axis, metres.
        focal_px: of the camera.
    """
    import numpy as np

    axis = surface % FACES_PER_BOX // 2
    along_normal = np.where(
        axis == 0, directions[0], np.where(axis == 1, directions[1], directions[2])
    )
    pixel_m = distance / (np.float32(focal_px) * np.abs(along_normal))
    level = np.zeros(surface.shape, np.int32)
    for limit in texture.LEVEL_LIMITS_M:
        level += pixel_m > np.float32(limit)
    return level


def texture_values(
    room: Room,
    surface: NDArray[np.int32],
    points: tuple[NDArray[np.floating], ...],
    level: NDArray[np.int32],
) -> NDArray[np.float32]:
    """The texture in [0, 1] at points (world x, y, z in metres) of surfaces."""
    import numpy as np

    axis = surface % FACES_PER_BOX // 2
    shifts = _texture_offsets(room)
    u = np.where(axis == 0, points[1], points[0]) + shifts[0].take(surface)
    v = np.where(axis == 2, points[1], points[2]) + shifts[1].take(surface)
    return texture.sample(u.astype(np.float32, copy=False), v.astype(np.float32, copy=False), level)


def surface_brightness(
    paint: NDArray[np.float32], surface: NDArray[np.int32], shade: NDArray[np.float32]
) -> NDArray[np.float32]:
    """One channel's brightness, 0 to 255.

    Args:
        paint: dark and light end of every surface's range, (2, surfaces).
        surface: what is seen.
        shade: where in the range it is, 0 to 1.
    """
    dark = paint[0].take(surface)
    brightness: NDArray[np.float32] = dark + (paint[1].take(surface) - dark) * shade
    return brightness


def lidar_brightness(
    room: Room, surface: NDArray[np.int32], points: tuple[NDArray[np.floating], ...]
) -> NDArray[np.float32]:
    """Brightness 0 to 255 of points on surfaces, as a lidar's returns are strong."""
    import numpy as np

    shade = texture_values(room, surface, points, np.full(surface.shape, _LIDAR_LEVEL, np.int32))
    return surface_brightness(brightness_ranges(room, "mono8")[0], surface, shade)


@lru_cache(maxsize=16)
def brightness_ranges(room: Room, encoding: str) -> NDArray[np.float32]:
    """Dark and light end of each surface's range, 0 to 255, (channels, 2, surfaces)."""
    import numpy as np

    if encoding == "mono8":
        colour = brightness_ranges(room, "rgb8")
        red, green, blue = (np.float32(weight) for weight in _LUMINANCE)
        grey: NDArray[np.float32] = (colour[:1] * red + colour[1:2] * green) + colour[2:] * blue
        return grey
    rng = random.Random(room.seed + 1000)  # noqa: S311 -- scenery, not secrets
    table = np.empty((3, 2, room.surface_count), np.float32)
    for box in range(room.surface_count // FACES_PER_BOX):
        tint, accent = _colour(rng), _colour(rng)
        for face, light in enumerate(_LIGHT_BY_FACE):
            bright = _SHELL[face] if box == 0 else tint
            for channel in range(3):
                light_end = 240 * light * bright[channel]
                surface = box * FACES_PER_BOX + face
                table[channel, 0, surface] = light_end * 0.45 * accent[channel]
                table[channel, 1, surface] = light_end
    return table


def _colour(rng: random.Random) -> tuple[float, float, float]:
    """A colour of moderate saturation, each channel 0 to 1."""
    grey = rng.uniform(0.5, 0.8)
    red, green, blue = (grey * rng.uniform(0.7, 1.25) for _ in range(3))
    return (red, green, blue)


@lru_cache(maxsize=16)
def _texture_offsets(room: Room) -> NDArray[np.float32]:
    """Where in the texture each surface lies, metres, (2, surfaces): no two look alike."""
    import numpy as np

    rng = random.Random(room.seed)  # noqa: S311 -- scenery, not secrets
    return np.array(
        [[rng.uniform(0, 5) for _ in range(room.surface_count)] for _ in range(2)], np.float32
    )
