"""The drawings of a suite whose benchmarks ran on several hosts."""

from __future__ import annotations

import itertools
import json
import re
import xml.etree.ElementTree as ET
from collections.abc import Callable, Mapping

import msgspec
import pytest

from r2bspec.compare.report_input import ReportInput
from r2bspec.judge.measure.distribution import PARTS, part_value
from r2bspec.judge.measure.metrics import MonitorMetrics
from r2bspec.judge.result import Result
from r2bspec.report.suite import SuiteRun, SuiteSummary, render, run_with_result
from report_runs import HOSTILE, with_monitors

HOSTS = ("carter", "desk", "lab")


@pytest.fixture
def result(reported: Callable[[str], ReportInput]) -> Result:
    return reported("usual").result


def changed(result: Result, change: Callable[[MonitorMetrics], MonitorMetrics]) -> Result:
    """The same with other metrics of every monitor at every rate."""
    return with_monitors(
        result, lambda seen: {name: change(monitor) for name, monitor in seen.items()}
    )


def slower(result: Result, factor: float) -> Result:
    """The same with times and throughput that differ by a factor."""

    def change(seen: MonitorMetrics) -> MonitorMetrics:
        times = {part: (part_value(seen.latency, part) or 0.0) * factor for part in PARTS}
        latency = msgspec.structs.replace(seen.latency, **times)
        throughput_hz = seen.throughput_hz / factor
        return msgspec.structs.replace(seen, latency=latency, throughput_hz=throughput_hz)

    return changed(result, change)


def silent(seen: MonitorMetrics) -> MonitorMetrics:
    """A monitor that received nothing."""
    latency = msgspec.structs.replace(seen.latency, n=0, **dict.fromkeys(PARTS))
    return msgspec.structs.replace(seen, latency=latency, throughput_hz=0.0)


def page_of(results: Mapping[str, Result], *, name: str = "relay") -> str:
    runs: list[SuiteRun] = [
        run_with_result(one, spec="a.r2b.yaml", folder=host, name=name, host=host)
        for host, one in results.items()
    ]
    summary = SuiteSummary(started_at="a", ended_at="b", exit_status=0, runs=tuple(runs))
    return render("html", summary, results).decode()


def charts(page: str) -> dict[str, ET.Element]:
    """The drawings of a page, by their names."""
    found = [ET.fromstring(each) for each in re.findall(r"<svg.*?</svg>", page, re.DOTALL)]  # noqa: S314
    return {each.get("id", ""): each for each in found}


def curves(chart: ET.Element) -> dict[str, list[float]]:
    """The heights of the points of each curve, from the bottom up, by its label."""
    heights = {}
    for group in chart.iter("g"):
        if label := group.get("data-label"):
            path = next(group.iter("path")).get("d", "")
            heights[label] = [-float(each) for each in re.findall(r"[ML] [\d.]+ ([\d.]+)", path)]
    return heights


def test_each_host_has_a_curve_and_a_slower_host_is_above(result: Result) -> None:
    results = {host: slower(result, factor) for host, factor in zip(HOSTS, (1, 2, 3), strict=True)}
    drawn = charts(page_of(results))
    monitors = [*result.metrics.rates[0].pooled.monitors]
    assert list(drawn) == [
        f"hosts-0-{kind}-{number}"
        for number in range(len(monitors))
        for kind in ("latency", "throughput")
    ]
    found = curves(drawn["hosts-0-latency-0"])
    rates = len(result.metrics.rates)
    assert len(found) == rates * len(HOSTS)
    by_host = [[points for label, points in found.items() if host in label] for host in HOSTS]
    for first, second in itertools.pairwise(by_host):
        for lower, upper in zip(first, second, strict=True):
            assert lower == sorted(lower)
            assert len(lower) == len(upper) > 4
            assert all(a < b for a, b in zip(lower, upper, strict=True))
    axes = json.loads(drawn["hosts-0-latency-0"].get("data-axes", ""))
    assert axes[0]["x"][3] == "percentile"


def test_bars_of_throughput_are_as_long_as_their_numbers(result: Result) -> None:
    results = {"carter": result, "desk": slower(result, 2)}
    chart = charts(page_of(results))["hosts-0-throughput-0"]
    drawn = ET.tostring(chart, encoding="unicode")
    assert all(drawn.count(host) >= 1 for host in results)
    widths = []
    for path in chart.iter("path"):
        places = [float(each) for each in re.findall(r"[ML] ([\d.]+) ", path.get("d", ""))]
        if "f-s" in (path.get("class") or "") and len(places) == 4:
            widths.append(max(places) - min(places))
    rates = len(result.metrics.rates)
    assert len(widths) == 2 * rates
    for full, half in zip(widths[:rates], widths[rates:], strict=True):
        assert full == pytest.approx(2 * half, abs=0.3)


def test_one_host_and_no_host_are_not_drawn(result: Result) -> None:
    assert charts(page_of({"carter": result})) == {}
    summary = SuiteSummary(
        started_at="a",
        ended_at="b",
        exit_status=0,
        runs=tuple(
            run_with_result(result, spec="a", folder=each, name="relay") for each in ("x", "y")
        ),
    )
    assert charts(render("html", summary, {"x": result, "y": result}).decode()) == {}


def test_hosts_for_which_there_is_no_room_are_counted(result: Result) -> None:
    page = page_of({f"host{number:02}": result for number in range(15)})
    assert "3 more hosts are in the table only." in page
    assert "host14" not in "".join(re.findall(r"<svg.*?</svg>", page, re.DOTALL))
    assert "host14" in page


def test_names_of_strangers_do_not_leave_their_place(result: Result) -> None:
    page = page_of({"a": result, "b" + HOSTILE: result}, name=HOSTILE)
    assert "<script" not in page
    assert "<img" not in page
    assert charts(page)


def test_a_run_without_latencies_is_drawn_the_same_each_time(result: Result) -> None:
    empty = changed(result, silent)
    page = page_of({"carter": result, "desk": empty})
    assert page == page_of({"carter": result, "desk": empty})
    drawn = charts(page)
    assert not any("desk" in label for label in curves(drawn["hosts-0-latency-0"]))
    assert len(charts(page_of({"carter": empty, "desk": empty}))) == len(drawn)
