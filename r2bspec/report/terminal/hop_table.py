"""The latency of the hops on the path to a tapped monitor, one line a hop."""

from __future__ import annotations

from collections.abc import Iterator

from rich.console import Group, RenderableType

from r2bspec.measure.distribution import SHORT_PERCENTILES, part_title, part_value
from r2bspec.measure.metrics import RunMetrics
from r2bspec.measure.units import at_rate, show
from r2bspec.report.terminal.style import heading, table


def hop_sections(metrics: RunMetrics) -> Iterator[RenderableType]:
    """A table for each tapped monitor at each rate."""
    for rate in metrics.rates:
        for name, seen in rate.pooled.monitors.items():
            if not seen.hops:
                continue
            made = table(["from → to", *map(part_title, SHORT_PERCENTILES), "matched", "missed"])
            for hop in seen.hops:
                made.add_row(
                    f"{hop.source} → {hop.target}",
                    *(show(part_value(hop.latency, part), "s") for part in SHORT_PERCENTILES),
                    show(hop.matched, "count"),
                    show(hop.missed, "count"),
                )
            at = at_rate(rate.offered_hz, rate.pace)
            aside = f"path to {name} {at}; percentiles do not add up"
            yield Group(heading("hops", aside), made)
