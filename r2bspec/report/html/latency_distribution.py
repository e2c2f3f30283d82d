"""The latency's distribution next to that of a baseline."""

from __future__ import annotations

import numpy as np

from r2bspec.measure.metrics import pace_of
from r2bspec.measure.samples import RunSamples, known_latencies
from r2bspec.measure.units import show_rate
from r2bspec.report.html.canvas import Chart, ChartBuilder, colour, draw

_MAX_POINTS = 300
_MAX_RATES = 4


def ecdf_chart(name: str, monitor: str, samples: RunSamples, baseline: RunSamples) -> Chart | None:
    """The share of messages within each latency, for rates that both runs have; None without."""
    rates = sorted(
        rate
        for rate in set(samples.iterations) & set(baseline.iterations)
        if monitor in samples.monitors and monitor in baseline.monitors
    )[-_MAX_RATES:]
    if not rates:
        return None
    description = (
        f"Share of all messages that arrived at {monitor} within each latency: this run as a full "
        "line, the baseline as a dashed one. The rest of a curve that ends below 100 % was lost."
    )

    def paint(sketch: ChartBuilder) -> None:
        axes = sketch.figure.subplots()
        for number, rate in enumerate(rates):
            for run, style, side in ((samples, "-", "this run"), (baseline, "--", "baseline")):
                seen = [one.monitors[monitor] for one in run.iterations[rate]]
                values = np.sort(known_latencies(seen))
                total = values.size + sum(one.missed for one in seen)
                if not values.size:
                    continue
                ranks = np.unique(np.linspace(1, values.size, _MAX_POINTS).astype(np.int64))
                label = f"{show_rate(rate, pace_of(run.mode))}, {side}"
                (line,) = axes.step(
                    values[ranks - 1] * 1e3,
                    ranks / total * 100,
                    where="post",
                    color=colour(number),
                    linestyle=style,
                    label=label,
                )
                sketch.series(line, label)
        axes.set_ylim(0, 103)
        axes.set_xlabel("latency, ms")
        axes.set_ylabel("messages within, %")
        if sketch.labels:
            axes.legend(loc="lower right")
        sketch.register_axes(axes, "ms", "%")

    return draw(name, f"Latency compared with the baseline: {monitor}", description, 3.2, paint)
