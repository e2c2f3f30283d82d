"""What a run says beside its numbers is told by every report that people read."""

from __future__ import annotations

import html
from collections.abc import Callable
from dataclasses import replace
from functools import cache

import msgspec
import pytest

from profiled_runs import MISSING, WHOLE
from r2bspec.compare.report_input import ReportInput
from r2bspec.judge.judge_run import from_json, result_of, to_json
from r2bspec.judge.measure.distribution import Distribution
from r2bspec.judge.measure.metrics import HopMetrics
from r2bspec.judge.result import Result
from r2bspec.record.graph_identity import GraphIdentity, Revision
from r2bspec.record.run_folder import Run
from r2bspec.record.run_record import (
    Difference,
    HarnessOverheadRecord,
    OutputGapRecord,
    StartRecord,
    UnplayedMessages,
)
from r2bspec.report.format_registry import renderer
from report_runs import with_starts

SECOND_NS = 10**9
PARTS = (0.001, 0.002, 0.0021, 0.003, 0.004, 0.0047, 0.005, 0.006)
HOP = HopMetrics(
    source="/r2b/<b>&",
    target="/r2b/out",
    matched=98,
    missed=2,
    latency=Distribution(
        **dict(zip(Distribution.__struct_fields__, (98, *PARTS), strict=True))  # type: ignore[arg-type]
    ),
)
FLOOR = HarnessOverheadRecord(
    topic="/r2b/image",
    bytes=240,
    rate_hz=30.0,
    sent=30,
    received=29,
    latency_p50_ns=120_000,
    latency_p99_ns=980_000,
    lateness_p50_ns=1_000,
    lateness_p99_ns=2_000,
    placement="separate",
    processes=2,
)
STARTS = (
    StartRecord(number=1, began_ns=0, ready_ns=9 * SECOND_NS),
    *(
        StartRecord(
            number=number,
            began_ns=0,
            ready_ns=3 * SECOND_NS,
            disturbed=("other processes used 1.9 of 2 cores",),
            taken=0.9,
        )
        for number in (2, 3)
    ),
)
GAP = OutputGapRecord(
    segment="rate-30Hz-002",
    topic="/r2b/detections",
    reason="/r2b/a publishes nothing on /r2b/detections",
    way=(),
)
DIFFERENCE = Difference(
    code="R2B204",
    message="node /r2b/a has no topic 'x' that could be remapped to /r2b/y",
    part="remapping",
    owner="/r2b/a",
    name="x",
    help="its topics: /r2b/z",
    harmless=True,
)
UNPLAYED = UnplayedMessages(topic="/r2b/right", count=1, total=56)
HEAD, BASE = (
    GraphIdentity(digest=revision.commit, nodes={}, packages={}, revision=revision)
    for revision in (
        Revision(commit="3f2a1c4d" + "0" * 32, dirty=True),
        Revision(commit="9b1e44f0" + "0" * 32, dirty=False, name="origin/main"),
    )
)


@pytest.fixture(scope="module")
def result(usual_run: Run) -> Result:
    """A result about which there is everything to say."""
    judged = result_of(with_starts(usual_run, *STARTS))
    put = msgspec.structs.replace
    rates = tuple(
        put(
            rate,
            pooled=put(
                rate.pooled,
                monitors={
                    name: put(seen, hops=(HOP,), late=3, overdue=2, unmatched=5, early=1)
                    for name, seen in rate.pooled.monitors.items()
                },
            ),
        )
        for rate in judged.metrics.rates
    )
    return put(
        judged,
        metrics=put(judged.metrics, rates=rates),
        monitor_labels={"detections": "Tag detections"},
        versions=judged.versions | {"rmw": "rmw_cyclonedds_cpp"},
        harness_overhead=(FLOOR,),
        output_gaps=(GAP,),
        differences=(DIFFERENCE,),
        profiles=(WHOLE, MISSING),
        unplayed=(UNPLAYED,),
        gate=("allowed: objective fast",),
        identity=HEAD,
        base_identity=BASE,
    )


@pytest.fixture(scope="module")
def text(result: Result) -> Callable[[str], str]:
    """The report of a format, without escapes and line breaks."""

    @cache
    def shown(name: str) -> str:
        verbose = name not in {"html", "github"}
        found = renderer(name)(ReportInput(result=result, verbose=verbose)).decode()
        found = html.unescape(found).replace("\\", "").replace("%25", "%").replace("%3A", ":")
        return " ".join(found.split())

    return shown


@pytest.mark.parametrize(
    ("words", "formats"),
    [
        ("ver 3 starts of the processes: ", "text markdown html junit github json"),
        ("3 starts, 3 s each", "text markdown html"),
        (
            "while 2 of 3 starts came up: 2 (other processes used 1.9 of 2 cores); 3 (other",
            "text markdown html junit",
        ),
        ("1 of 56 messages of /r2b/right have no partner of", "text markdown html junit github"),
        ("No more messages on /r2b/detections in rate-30Hz-002. /r2b/a publishes nothing", "text"),
        ("R2B204: node /r2b/a has no topic 'x' that could be remapped", "text"),
        ("3 matched no input, 2 arrived in a later segment (counted as missed)", "text"),
        ("1 arrived before the input", "text"),
        ("/r2b/<b>& → /r2b/out 2.1 ms 4.7 ms 98 2", "text"),
        ("| /r2b/<b>& → /r2b/out | 2.1 ms | 4.7 ms | 98 | 2 |", "markdown"),
        ("Hops to Tag detections", "html"),
        ('<data value="0.0047" data-path="metrics/rates/0/pooled/monitors/detections/hops', "html"),
        ("between two processes (harness.placement: separate)", "text markdown html junit"),
        ("120 µs", "text markdown html junit"),
        (
            "Profile of relay at 30 Hz, with perf: profile/relay/relay.folded, profile/relay/",
            "text markdown html",
        ),
        (
            "Profile of camera, with py-spy, is missing: process camera was killed",
            "text markdown html",
        ),
        ("Tag detections (detections)", "text markdown html"),
        ("rmw_cyclonedds_cpp", "text markdown html"),
        ("Allowed: objective fast", "text markdown html junit"),
        ("head 3f2a1c4+dirty, base origin/main@9b1e44f", "text markdown html junit"),
    ],
)
def test_it_is_told(text: Callable[[str], str], words: str, formats: str) -> None:
    assert [name for name in formats.split() if words not in text(name)] == []


def test_what_there_is_nothing_of_is_not_spoken_of(reported: Callable[[str], ReportInput]) -> None:
    usual = ReportInput(result=reported("usual").result)
    for name in ("text", "markdown", "junit", "github", "html"):
        shown = " ".join(renderer(name)(replace(usual, verbose=name == "text")).decode().split())
        assert "f this start of the processes: " in shown
        assert name in {"text", "junit"} or "of this start" in heading(name, shown)
        for words in ("starts of the", "starts came up", "rmw_", "no partner", 'id="profile"'):
            assert words not in shown, name
        # Nor is said what every run would have alike.
        for words in ("another hour may differ", "of a kind not met", "resembles the one before"):
            assert words not in shown, name


def heading(name: str, shown: str) -> str:
    """The first thing that a report says: of how many starts it is."""
    first = shown.partition("<title>")[2].partition("</title>")[0] if name == "html" else shown
    return first.partition("drop_rate")[0]


def test_the_first_line_says_only_of_one_start_that_it_is_about_one(
    text: Callable[[str], str],
) -> None:
    for name in ("markdown", "github", "html"):
        assert "of this start" not in heading(name, text(name)), name


def test_names_of_strangers_are_no_markup(result: Result) -> None:
    source = ReportInput(result=result)
    assert "/r2b/&lt;b&gt;&amp;" in renderer("html")(source).decode()
    assert "/r2b/&lt;b&gt;&amp; → " in renderer("markdown")(source).decode()


def test_what_programs_read_keeps_the_names_and_has_the_overhead(
    result: Result, text: Callable[[str], str]
) -> None:
    for name in ("csv", "openmetrics", "bencher"):
        assert "detections" in text(name)
        assert "Tag detections" not in text(name)
    labels = 'topic="/r2b/image",offered_hz="30",placement="separate",processes="2"'
    assert f'{labels},quantile="0.5"}} 0.00012' in text("openmetrics")
    rows = renderer("csv")(ReportInput(result=result)).decode().splitlines()
    overhead = {row.split(",")[-3]: row.split(",")[-1] for row in rows if "/r2b/image" in row}
    assert overhead == {
        "harness_overhead.p50": "0.00012",
        "harness_overhead.p99": "0.00098",
        "harness_overhead.received": "29.0",
        "harness_overhead.processes": "2.0",
    }


def test_a_result_comes_back_unchanged(result: Result) -> None:
    assert from_json(to_json(result)) == result
