"""Hops, output_gaps and differences: told by every report that people read."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest

from r2bspec.compare.report_input import ReportInput
from r2bspec.judge.judge_run import from_json, result_of, to_json
from r2bspec.judge.measure.distribution import Distribution
from r2bspec.judge.measure.metrics import HopMetrics
from r2bspec.judge.result import Result
from r2bspec.record.run_record import Difference, OutputGapRecord
from r2bspec.report.format_registry import renderer
from r2bspec.report.terminal import to_text
from report_runs import USUAL

HOP = HopMetrics(
    source="/r2b/<b>&",
    target="/r2b/out",
    matched=98,
    missed=2,
    latency=Distribution(
        n=98,
        min=0.001,
        mean=0.002,
        p50=0.0021,
        p90=0.003,
        p95=0.004,
        p99=0.0047,
        p99_9=0.005,
        max=0.006,
    ),
)


@pytest.fixture(name="result")
def tapped(tmp_path: Path) -> Result:
    """A result whose monitor is tapped, with an output that stopped and a remapping in vain."""
    result = result_of(USUAL.write(tmp_path / "run"))
    replace = msgspec.structs.replace
    rates = tuple(
        replace(
            rate,
            pooled=replace(
                rate.pooled,
                monitors={
                    name: replace(seen, hops=(HOP,), late=3, overdue=2, unmatched=5, early=1)
                    for name, seen in rate.pooled.monitors.items()
                },
            ),
        )
        for rate in result.metrics.rates
    )
    return replace(
        result,
        metrics=replace(result.metrics, rates=rates),
        output_gaps=(
            OutputGapRecord(
                segment="rate-30Hz-002",
                topic="/r2b/detections",
                reason="/r2b/a publishes nothing on /r2b/detections",
                way=(),
            ),
        ),
        differences=(
            Difference(
                code="R2B204",
                message="node /r2b/a has no topic 'x' that could be remapped to /r2b/y",
                part="remapping",
                owner="/r2b/a",
                name="x",
                help="its topics: /r2b/z",
                harmless=True,
            ),
        ),
    )


def test_the_terminal_shows_each_hop(result: Result) -> None:
    text = to_text(result)
    assert text.count("from → to") == len(result.metrics.rates)
    (line, *_) = [line for line in text.splitlines() if line.startswith("/r2b/<b>& → /r2b/out")]
    assert line.split()[-6:] == ["2.1", "ms", "4.7", "ms", "98", "2"]


def test_the_terminal_tells_where_an_output_stopped_and_what_is_odd(result: Result) -> None:
    text = " ".join(to_text(result).split())
    assert "No more messages on /r2b/detections in rate-30Hz-002. /r2b/a publishes nothing" in text
    assert "R2B204: node /r2b/a has no topic 'x' that could be remapped" in text
    assert "3 matched no input, 2 arrived in a later segment (counted as missed)" in text
    assert "1 arrived before the input" in text


def test_markdown_has_a_table_of_hops_in_which_names_are_no_markup(result: Result) -> None:
    text = renderer("markdown")(ReportInput(result=result)).decode()
    assert "| from → to |" in text
    assert "| /r2b/&lt;b&gt;&amp; → /r2b/out | 2.1 ms | 4.7 ms | 98 | 2 |" in text


def test_html_has_a_table_of_hops_with_exact_values(result: Result) -> None:
    text = renderer("html")(ReportInput(result=result)).decode()
    assert "Hops to detections" in text
    assert "/r2b/&lt;b&gt;&amp;" in text
    path = "metrics/rates/0/pooled/monitors/detections/hops/0/latency/p99"
    assert f'<data value="0.0047" data-path="{path}">' in text


def test_a_result_comes_back_unchanged(result: Result) -> None:
    assert from_json(to_json(result)) == result
