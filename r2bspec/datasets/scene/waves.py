"""Sine and cosine in plain arithmetic.

The C library's differ in the last bit between processors and versions, and a content hash sees
every bit. Sums and products of floats are the same everywhere.
"""

from __future__ import annotations

import math

_TURN = 2 * math.pi

# Taylor: x - x^3/3! + x^5/5! - ... up to x^21; the rest is below 1e-17 for a quarter turn.
_COEFFICIENTS = tuple((-1) ** (power // 2) / math.factorial(power) for power in range(21, 0, -2))


def sine(angle: float) -> float:
    """Sine of an angle in radians, to within 1e-15 for angles of a few turns."""
    angle -= _TURN * round(angle / _TURN)
    if angle > math.pi / 2:
        angle = math.pi - angle
    elif angle < -math.pi / 2:
        angle = -math.pi - angle
    square = angle * angle
    total = 0.0
    for coefficient in _COEFFICIENTS:
        total = total * square + coefficient
    return total * angle


def cosine(angle: float) -> float:
    """Cosine of an angle in radians, to within 1e-15 for angles of a few turns."""
    return sine(angle + math.pi / 2)
