"""Which percentiles reports show is written once."""

from __future__ import annotations

from r2bspec.measure.distribution import (
    HISTORY_PARTS,
    MAIN_PERCENTILES,
    PARTS,
    PERCENTILES,
    SHORT_PERCENTILES,
    TAIL_PERCENTILE,
)


def test_the_lists_fit_together() -> None:
    assert PARTS == ("min", "mean", "p50", "p90", "p95", "p99", "p99_9", "max")
    assert PERCENTILES == {"p50": 0.5, "p90": 0.9, "p95": 0.95, "p99": 0.99, "p99_9": 0.999}
    assert set(SHORT_PERCENTILES) < set(MAIN_PERCENTILES) < set(PERCENTILES)
    assert TAIL_PERCENTILE in SHORT_PERCENTILES
    assert set(HISTORY_PARTS) < set(PARTS)
