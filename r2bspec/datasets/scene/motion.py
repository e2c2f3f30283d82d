"""How the rig moves: sums of sines, so that every derivative is known exactly."""

from __future__ import annotations

import math
from dataclasses import dataclass

from r2bspec.datasets.scene.geometry import (
    Pose,
    Vector,
    apply,
    from_yaw_pitch_roll,
    transpose,
)
from r2bspec.datasets.scene.waves import cosine, sine

GRAVITY_M_S2 = 9.80665


@dataclass(frozen=True, slots=True)
class Track:
    """One coordinate over time: a rest value and waves of (amplitude, hertz, phase in radians)."""

    rest: float
    waves: tuple[tuple[float, float, float], ...] = ()

    def at(self, seconds: float) -> tuple[float, float, float]:
        """Value and first and second derivative, in the track's unit and seconds."""
        value, speed, acceleration = self.rest, 0.0, 0.0
        for amplitude, hertz, phase in self.waves:
            omega = 2 * math.pi * hertz
            wave = amplitude * sine(omega * seconds + phase)
            value += wave
            speed += amplitude * omega * cosine(omega * seconds + phase)
            acceleration -= omega * omega * wave
        return value, speed, acceleration

    def value(self, seconds: float) -> float:
        """The value alone, with the bits that `at` gives."""
        value = self.rest
        for amplitude, hertz, phase in self.waves:
            value += amplitude * sine(2 * math.pi * hertz * seconds + phase)
        return value


@dataclass(frozen=True, slots=True)
class Motion:
    """The body's path through the world: metres and radians."""

    x: Track
    y: Track
    z: Track
    yaw: Track
    pitch: Track
    roll: Track

    def pose(self, seconds: float) -> Pose:
        """World from body at a time after the sequence's start."""
        return Pose(
            (self.x.value(seconds), self.y.value(seconds), self.z.value(seconds)),
            from_yaw_pitch_roll(
                self.yaw.value(seconds), self.pitch.value(seconds), self.roll.value(seconds)
            ),
        )

    def angular_velocity_rad_s(self, seconds: float) -> Vector:
        """Angular velocity in body axes, from the derivatives of yaw, pitch and roll."""
        _, yaw_rate, _ = self.yaw.at(seconds)
        pitch, pitch_rate, _ = self.pitch.at(seconds)
        roll, roll_rate, _ = self.roll.at(seconds)
        return (
            roll_rate - yaw_rate * sine(pitch),
            pitch_rate * cosine(roll) + yaw_rate * sine(roll) * cosine(pitch),
            yaw_rate * cosine(roll) * cosine(pitch) - pitch_rate * sine(roll),
        )

    def specific_force_m_s2(self, seconds: float) -> Vector:
        """What an accelerometer at the origin reads: acceleration less gravity, body axes."""
        force = (
            self.x.at(seconds)[2],
            self.y.at(seconds)[2],
            self.z.at(seconds)[2] + GRAVITY_M_S2,
        )
        return apply(transpose(self.pose(seconds).rotation), force)
