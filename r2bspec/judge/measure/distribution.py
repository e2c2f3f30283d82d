"""The parts of a distribution of times, and which of them are shown where.

To show another percentile in the reports, add it to `MAIN_PERCENTILES` or `SHORT_PERCENTILES`. To
compute one that no result has yet, add a field with the default None to `Distribution`: results,
the catalogue of metrics and the complete tables and exports then have it.
"""

from __future__ import annotations

import re
from typing import Final

import msgspec


class Distribution(msgspec.Struct, frozen=True, kw_only=True):
    """A summary of `n` times, in seconds. Percentiles are observed values (nearest rank).

    Latencies are those of the outputs that arrived; missed outputs are in `MonitorMetrics.missed`,
    and count as over every bound when a requirement is judged.
    """

    n: int
    min: float | None
    mean: float | None
    p50: float | None
    p90: float | None
    p95: float | None
    p99: float | None
    p99_9: float | None
    max: float | None


_PERCENTILE = re.compile(r"p(\d{1,2})(?:_(\d{1,4}))?")


def quantile(part: str) -> float | None:
    """Return the fraction of a percentile's name: ``p99`` is 0.99, ``p99_9`` is 0.999.

    None if `part` is no percentile; p0 and p00 are not, because they are the minimum.
    """
    percentile = _PERCENTILE.fullmatch(part)
    if percentile is None or int(percentile[1]) == 0:
        return None
    return float(f"0.{int(percentile[1]):02d}{percentile[2] or ''}")


def _ascending(part: str) -> tuple[int, float]:
    """Percentiles between the mean and the maximum, in ascending order."""
    return ("min", "mean", "", "max").index("" if quantile(part) else part), quantile(part) or 0.0


PARTS: Final = tuple(
    sorted((name for name in Distribution.__struct_fields__ if name != "n"), key=_ascending)
)
"""Every part, as complete tables and exports have them, in ascending order except the mean."""

PERCENTILES: Final = {part: q for part in PARTS if (q := quantile(part)) is not None}
"""Every percentile that a result has, and its fraction."""

MAIN_PERCENTILES: Final = ("p50", "p90", "p99")
"""In tables, in exports that track a few numbers, and in comparisons of runs."""

SHORT_PERCENTILES: Final = ("p50", "p99")
"""Where there is little room: narrow terminals, hops, single iterations, lateness."""

PROPOSED_PERCENTILES: Final = ("p50", "p90", "p95", "p99")
"""Of which an objective can be proposed from one run; a higher one would need more messages."""

TAIL_PERCENTILE: Final = "p99"
"""Where there is room for one number."""


def part_title(part: str) -> str:
    """Return the name of a part as a heading, such as p99.9."""
    return part.replace("_", ".")


def part_value(times: Distribution, part: str) -> float | None:
    """Return the value of a part, in seconds."""
    value: float | None = getattr(times, part)
    return value
