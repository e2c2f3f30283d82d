"""A comparison as CSV: a line for each metric of each result that was compared."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence

from r2bspec.compare.comparison import Comparison

HEADER = (
    *("base", "head", "offered_hz", "monitor", "metric", "unit"),
    *("base_value", "head_value", "ratio", "lower", "upper", "margin", "outcome", "reason"),
)


def to_csv(comparisons: Sequence[Comparison]) -> bytes:
    """RFC 4180 with a header line; unknown values are empty."""
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\r\n")
    writer.writerow(HEADER)
    for one in comparisons:
        for line in one.lines:
            numbers = (line.base, line.head, line.ratio, line.lower, line.upper, line.margin)
            writer.writerow(
                (
                    one.base.source,
                    one.head.source,
                    "" if line.offered_hz is None else repr(line.offered_hz),
                    line.monitor,
                    line.metric,
                    line.unit,
                    *("" if each is None else repr(each) for each in numbers),
                    line.outcome,
                    line.reason,
                )
            )
    return buffer.getvalue().encode()
