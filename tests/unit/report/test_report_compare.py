"""``r2bspec compare``: what may be compared, and what is said of each metric."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest

from r2bspec.compare.comparison import Comparison, ComparisonLine, compare, read_compared_result
from r2bspec.compare.report_input import UnreadableResultError
from r2bspec.judge.judge_run import result_of
from r2bspec.judge.judge_run import to_json as result_json
from r2bspec.judge.measure.distribution import Distribution
from r2bspec.judge.measure.metrics import SegmentMetrics, distribution
from r2bspec.plan.comparability import IncomparableError
from r2bspec.plan.plan import Plan
from r2bspec.record.run_record import SearchRecord
from r2bspec.report.comparison_document import render
from report_runs import GraphSimulation, skewed
from run_simulation import Played, Simulation, probe


def simulated(factor: float = 1.0, lost: int = 0, n: int = 6) -> Simulation:
    """Iterations whose latencies vary by a percent or so around `factor` times 20 ms."""
    return Simulation(segments=[Played(30, _iteration(factor, lost, each)) for each in range(n)])


def _iteration(factor: float, lost: int, number: int) -> Sequence[float]:
    values = skewed(300, 0.02 * factor * (1 + 0.003 * (-1) ** number), number * 300)
    values[:lost] = np.nan
    return [float(value) for value in values]


def compared(
    tmp_path: Path, base: Simulation, head: Simulation, *, force: bool = False
) -> Comparison:
    first = base.write(tmp_path / "base").folder
    second = head.write(tmp_path / "head").folder
    return compare(read_compared_result(first), read_compared_result(second), force=force)


def line(comparison: Comparison, metric: str) -> ComparisonLine:
    (found,) = (output_line for output_line in comparison.lines if output_line.metric == metric)
    return found


def test_a_run_is_the_same_as_itself(tmp_path: Path) -> None:
    comparison = compared(tmp_path, simulated(), simulated())
    assert {output_line.outcome for output_line in comparison.lines} == {"same"}
    assert all(output_line.ratio == pytest.approx(1) for output_line in comparison.lines)


@pytest.mark.parametrize(
    ("factor", "outcome"),
    # At the margin nothing is claimed.
    [(1.2, "worse"), (0.8, "improved"), (1.01, "same"), (1.05, "can't tell")],
)
def test_latency_is_better_when_it_is_less(tmp_path: Path, factor: float, outcome: str) -> None:
    mean = line(compared(tmp_path, simulated(), simulated(factor)), "latency.mean")
    assert mean.outcome == outcome
    assert mean.ratio == pytest.approx(factor, rel=0.02)


def test_losses_are_worse_although_their_ratio_is_none(tmp_path: Path) -> None:
    comparison = compared(tmp_path, simulated(), simulated(lost=30))
    drops = line(comparison, "drop_rate")
    assert (drops.base, drops.outcome) == (0, "worse")
    assert drops.head == pytest.approx(0.1)
    # The p99 of the head is a message that never came.
    assert line(comparison, "latency.p99").outcome == "worse"
    assert line(comparison, "latency.p99").head is None


class Timer(Simulation):
    """A graph whose output comes at a pace of its own."""

    def plan(self) -> Plan:
        plan = super().plan()
        monitors = [msgspec.structs.replace(each, match="own_pace") for each in plan.monitors]
        return msgspec.structs.replace(plan, monitors=tuple(monitors))


def test_what_no_side_can_have_is_left_out(tmp_path: Path) -> None:
    timer = Timer(segments=simulated().segments)
    both = compared(tmp_path / "both", timer, timer)
    assert {each.metric for each in both.lines if each.monitor} == {"throughput.mean"}
    one = compared(tmp_path / "one", simulated(), timer, force=True)
    assert line(one, "drop_rate").outcome == "worse"
    other = compared(tmp_path / "other", timer, simulated(), force=True)
    assert line(other, "drop_rate").outcome == "can't tell"


@pytest.mark.parametrize(
    ("holds", "fails", "outcome"),
    [(80, 82, "worse"), (125, 128, "improved"), (100, 102, "same"), (96, 99, "can't tell")],
)
def test_peaks_are_compared_by_their_brackets(
    tmp_path: Path, holds: float, fails: float, outcome: str
) -> None:
    def peak(low: float, high: float) -> Simulation:
        search = SearchRecord(
            probes=(probe(low, holds=True), probe(high, holds=False)),
            holds_hz=low,
            fails_hz=high,
            limited_by="graph",
        )
        return replace(simulated(), search=search)

    comparison = compared(tmp_path, peak(100, 102), peak(holds, fails))
    assert line(comparison, "peak.rate").outcome == outcome


class Other(Simulation):
    """A plan that differs in what it does."""

    def plan(self) -> Plan:
        return msgspec.structs.replace(super().plan(), buffer=7, title="another title")


def test_other_plans_are_refused_and_the_difference_told(tmp_path: Path) -> None:
    other = Other(segments=simulated().segments)
    with pytest.raises(IncomparableError) as caught:
        compared(tmp_path, simulated(), other)
    assert "plan, buffer: 0 -> 7" in str(caught.value)
    assert "title" not in str(caught.value)
    assert "--force" in caught.value.hint
    forced = compared(tmp_path / "forced", simulated(), other, force=True)
    assert forced.differences == ("plan, buffer: 0 -> 7",)


class OtherGraph(GraphSimulation):
    """The same load on a graph with other nodes."""

    def plan(self) -> Plan:
        plan = super().plan()
        host = plan.processes[-1]
        more = msgspec.structs.replace(host, name="second", argv=("x" * 500,))
        fewer_nodes = msgspec.structs.replace(host, nodes=())
        return msgspec.structs.replace(
            plan, processes=(plan.processes[0], fewer_nodes, more), namespace="/other"
        )


def test_graphs_that_differ_are_compared_with_a_line_for_each_difference(tmp_path: Path) -> None:
    segments = simulated().segments
    comparison = compared(
        tmp_path, GraphSimulation(segments=segments), OtherGraph(segments=segments)
    )
    assert comparison.lines
    said = comparison.differences
    assert "plan, processes.second: only in the head" in said
    assert any("/r2b/apriltag" in each and each.endswith("only in the base") for each in said)
    assert any(each.endswith(' -> "/other"') for each in said)
    assert all(len(each) <= 120 and "\n" not in each for each in said)


def test_a_result_by_itself_is_enough(tmp_path: Path) -> None:
    run = simulated().write(tmp_path / "run")
    path = tmp_path / "result.json"
    path.write_bytes(result_json(result_of(run)))
    comparison = compare(read_compared_result(path), read_compared_result(run.folder), force=False)
    assert {output_line.outcome for output_line in comparison.lines} == {"same"}


def test_what_was_observed_from_inside_is_compared(tmp_path: Path) -> None:
    run = simulated().write(tmp_path / "run")

    def written(name: str, factor: float) -> Path:
        def observed(number: int) -> dict[str, Distribution]:
            seconds = skewed(300, 0.004 * factor, number)
            return {"relay.callback": distribution(seconds), "relay.load": distribution(seconds)}

        def with_observed(one: SegmentMetrics) -> SegmentMetrics:
            values = {**one.values, **observed(one.index or 0)}
            return msgspec.structs.replace(one, values=values)

        result = result_of(run)
        (rate,) = result.metrics.rates
        rate = msgspec.structs.replace(
            rate,
            iterations=tuple(map(with_observed, rate.iterations)),
            pooled=with_observed(rate.pooled),
        )
        metrics = msgspec.structs.replace(result.metrics, rates=(rate,))
        path = tmp_path / name
        path.write_bytes(result_json(msgspec.structs.replace(result, metrics=metrics)))
        return path

    comparison = compare(
        read_compared_result(written("base.json", 1.0)),
        read_compared_result(written("head.json", 1.5)),
        force=False,
    )
    assert line(comparison, "relay.callback.p50").outcome == "worse"
    assert not [each for each in comparison.lines if "load" in each.metric]


def test_what_is_no_result_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "x.json"
    path.write_text("{}")
    with pytest.raises(UnreadableResultError, match="is not a result"):
        read_compared_result(path)


def test_every_form_says_the_same(tmp_path: Path) -> None:
    comparison = compared(tmp_path, simulated(), simulated(1.2, lost=30))
    (plain,) = json.loads(render([comparison], "json"))
    assert msgspec.convert(plain, Comparison) == comparison
    for name in ("text", "markdown"):
        text = render([comparison], name).decode()
        assert "▼ worse" in text
        assert "latency.p50 at 30 Hz" in text
        assert "are advisory" in text
