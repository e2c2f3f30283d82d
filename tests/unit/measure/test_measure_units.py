"""Values as a person writes them."""

from __future__ import annotations

import pytest

from r2bspec.judge.measure.units import show, show_range


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (0.0123456, "s", "12.3 ms"),
        (0.9997, "s", "1 s"),
        (0.99949, "s", "999 ms"),
        (0.0000005, "s", "500 ns"),
        (75.0, "s", "75 s"),
        (0.0, "s", "0 s"),
        (-0.0003, "s", "-300 µs"),
        (float("inf"), "s", "lost"),
        (29.98333, "Hz", "29.98 Hz"),
        (1234.5, "Hz", "1,234 Hz"),
        (3.4123e9, "Hz", "3.41 GHz"),
        (8e8, "Hz", "800 MHz"),
        (0.00467, "share", "0.467 %"),
        (1.2, "share", "120 %"),
        (3000.0, "count", "3,000"),
        (64 * 2**20, "B", "64 MiB"),
        (512, "B", "512 B"),
        (None, "s", "-"),
    ],
)
def test_show(value: float | None, unit: str, text: str) -> None:
    assert show(value, unit) == text


@pytest.mark.parametrize(
    ("low", "high", "unit", "text"),
    [
        (0.0112, 0.0129, "s", "11.2–12.9 ms"),
        (0.00012, 0.0129, "s", "0.12–12.9 ms"),
        (0.01, 0.01, "s", "10 ms"),
        (29.83, 30, "Hz", "29.83–30 Hz"),
        (8e8, 3.4123e9, "Hz", "0.8–3.41 GHz"),
        (0, 0.03, "share", "0–3 %"),
        (2**20, 3 * 2**20, "B", "1–3 MiB"),
    ],
)
def test_show_range(low: float, high: float, unit: str, text: str) -> None:
    assert show_range(low, high, unit) == text
