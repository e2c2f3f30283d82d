"""Values as text: three significant digits, and the unit that keeps them short."""

from __future__ import annotations

import math

_TIMES = ((1.0, "s"), (1e-3, "ms"), (1e-6, "µs"), (1e-9, "ns"))
_POWERS = ((1e3, "kW"), (1.0, "W"), (1e-3, "mW"))
_ENERGIES = ((1e3, "kJ"), (1.0, "J"), (1e-3, "mJ"), (1e-6, "µJ"))
_FREQUENCIES = ((1e9, "GHz"), (1e6, "MHz"))
_SIZES = ((2.0**40, "TiB"), (2.0**30, "GiB"), (2.0**20, "MiB"), (2.0**10, "KiB"))


def show(value: float | None, unit: str, digits: int = 3) -> str:
    """Write a value with its unit: ``12.3 ms``, ``29.98 Hz``, ``0.47 %``, ``64 MiB``, ``3,000``.

    A frequency that is not a rate of messages, such as that of a processor, is in GHz.

    Args:
        value: in the catalogue's unit; None is ``-``, and infinity is ``lost`` for a time,
            because it is a message that never arrived.
        unit: ``s``, ``Hz``, ``share``, ``B``, ``W``, ``J``, ``count``, or empty.
        digits: significant digits; a rate gets one more, and a count all it has.
    """
    if value is None:
        return "-"
    if math.isinf(value):
        return "lost" if unit == "s" and value > 0 else ("∞" if value > 0 else "-∞")
    match unit:
        case "s":
            return _scaled(value, _TIMES, digits)
        case "B":
            return _scaled(value, _SIZES, digits) if abs(value) >= 2**10 else f"{value:.0f} B"
        case "W":
            return _scaled(value, _POWERS, digits)
        case "J":
            return _scaled(value, _ENERGIES, digits)
        case "Hz" if abs(value) >= _FREQUENCIES[-1][0]:
            return _scaled(value, _FREQUENCIES, digits)
        case "Hz":
            return f"{significant(value, digits + 1)} Hz"
        case "share":
            return f"{significant(value * 100, digits)} %"
        case "count":
            return f"{value:,.0f}"
    return significant(value, digits)


def show_rate(rate_hz: float, pace: str = "") -> str:
    """Write an offered rate; a rate of 0 as its source: ``as recorded``, ``live``.

    Args:
        rate_hz: the offered rate; 0 for none.
        pace: see `r2bspec.judge.measure.metrics.Pace`; empty where that is not known.
    """
    if rate_hz:
        return show(rate_hz, "Hz")
    return {"recording": "as recorded", "source": "live"}.get(pace, "its own rate")


def at_rate(rate_hz: float, pace: str = "") -> str:
    """Write the rate of a value: ``at 30 Hz``, ``as recorded``, ``live``."""
    text = show_rate(rate_hz, pace)
    return text if text in {"as recorded", "live"} else f"at {text}"


def show_range(low: float, high: float, unit: str) -> str:
    """Write a range with one unit, that of the larger end: ``11.2–12.9 ms``."""
    text = show(high, unit)
    number, _, name = text.partition(" ")
    shown = significant(low / unit_scale(unit, name), 4 if name == "Hz" else 3)
    return f"{shown}–{text}" if shown != number else text


def unit_scale(unit: str, name: str) -> float:
    """Return the factor from a number with the unit `name` to `unit`."""
    factors = {
        label: factor for factor, label in (*_TIMES, *_SIZES, *_POWERS, *_ENERGIES, *_FREQUENCIES)
    }
    if unit == "share":
        return 0.01
    return factors.get(name, 1.0) if unit in {"s", "B", "W", "J", "Hz"} else 1.0


def _scaled(value: float, scales: tuple[tuple[float, str], ...], digits: int) -> str:
    if value == 0:
        return f"0 {scales[0][1]}"
    for scale, name in scales:
        # Decided on the rounded number, so that 999.7 ms becomes 1 s and not 1,000 ms.
        if abs(float(f"{value / scale:.{digits}g}")) >= 1:
            return f"{significant(value / scale, digits)} {name}"
    scale, name = scales[-1]
    return f"{significant(value / scale, digits)} {name}"


def significant(value: float, digits: int = 3) -> str:
    """Return a number with `digits` significant digits, no exponent, and no trailing zeros."""
    if value == 0:
        return "0"
    decimals = max(0, digits - 1 - math.floor(math.log10(abs(value))))
    text = f"{value:,.{min(decimals, 12)}f}"
    return text.rstrip("0").rstrip(".") if "." in text else text
