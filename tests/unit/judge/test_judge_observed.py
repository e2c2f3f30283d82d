"""Verdicts on what was observed from inside, and on reactions, where something is missing."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import msgspec
import numpy as np
import pytest

from r2bspec.judge.judge_run import result_of
from r2bspec.judge.measure.reactions import EVENT, MET, UNFINISHED, marks_of
from r2bspec.judge.measure.run_samples import SegmentRows
from r2bspec.judge.pipeline import judge
from r2bspec.judge.verdict import RequirementVerdict
from r2bspec.plan.plan import Plan, ReactionPlan
from r2bspec.record.run_record import AnatomyKind, Segment
from r2bspec.record.sample_arrays import MONITOR_DTYPE, Rows
from run_simulation import Played, Simulation, objective
from simulated_anatomies import CHAIN, START_NS, Graph, Observed, ObservedSimulation

GRAPH = replace(CHAIN, rate_hz=60.0, steps=600)
SHORT_QUEUE = GRAPH.with_stage("blur", service_s=0.027, depth=1)
"""It answers about six of ten messages."""


def judged(
    folder: Path,
    *requirements: str,
    graph: Graph = GRAPH,
    lost: int = 0,
    left: Callable[[Observed], Rows] | None = None,
) -> list[RequirementVerdict]:
    simulation = ObservedSimulation.of(
        graph, objectives={"slo": objective(*requirements, at="60 Hz")}, lost=lost
    )
    if left is not None:
        simulation = replace(simulation, left=left)
    return [*result_of(simulation.write(folder / "run")).verdict.requirements]


def test_an_output_that_never_came_is_the_slowest_on_its_path(tmp_path: Path) -> None:
    path, latency, mean, longest = judged(
        tmp_path,
        "out.path.p99 < 80 ms",
        "latency.p99 < 80 ms",
        "out.path.mean < 80 ms",
        "out.path.max < 80 ms",
        graph=SHORT_QUEUE,
    )
    assert path.outcome == latency.outcome == longest.outcome == "fail"
    assert path.share is not None
    assert latency.share is not None
    assert (path.share.lost, path.share.n) == (latency.share.lost, 600)
    assert path.share.bursts == latency.share.bursts
    assert mean.outcome == "inconclusive"


def test_all_outputs_that_came_are_on_a_path(tmp_path: Path) -> None:
    (path,) = judged(tmp_path, "out.path.p99 < 80 ms")
    assert path.share is not None
    assert (path.outcome, path.share.n, path.share.lost) == ("pass", 600, 0)


def test_what_is_not_whole_decides_nothing(tmp_path: Path) -> None:
    def half(found: Observed) -> Rows:
        rows: Rows = found.rows[np.random.default_rng(0).random(found.rows.size) > 0.3]
        return rows

    metrics = ("out.path.p99 < 4 ms", "blur.callback.p99 < 8 ms", "path.blur.share < 20 %")
    for one in judged(tmp_path, *metrics, left=half, lost=9):
        assert one.outcome == "inconclusive"
        assert "There was no room for 45 events of the graph" in one.reason


def hangs(found: Observed, name: str) -> Rows:
    """A process that does not return from the callback of half of its messages on."""
    names = [process.name for process in found.record.processes]
    rows = found.rows
    own = rows["process"] == names.index(name)
    taken = rows["began_ns"][own & (rows["kind"] == AnatomyKind.TAKE)]
    since = taken[taken < START_NS + 5_000_000_000].max()
    # rclpy triggers before the callback and after it.
    first = (rows["kind"] == AnatomyKind.TRIGGER) & (rows["began_ns"] < since + 50_000)
    left: Rows = rows[~own | (rows["began_ns"] <= since) | first]
    return left


@pytest.mark.parametrize("name", ["decode", "blur"])
def test_a_callback_that_hangs_lasts_to_the_end(name: str, tmp_path: Path) -> None:
    left = partial(hangs, name=name)
    (longest,) = judged(tmp_path, f"{name}.callback.max < 50 ms", left=left)
    assert longest.outcome == "fail"
    assert longest.estimate == pytest.approx(5.0, abs=0.1)


def test_messages_that_nobody_takes_any_more_are_overtaken(tmp_path: Path) -> None:
    (share,) = judged(tmp_path, "blur.overtaken < 1 %", left=partial(hangs, name="blur"))
    # Those of the last second may be on their way.
    assert share.estimate == pytest.approx(0.44, abs=0.02)


def test_a_thread_of_which_no_end_is_seen_does_not_hang(tmp_path: Path) -> None:
    """C on rcl waits at the end, and says so when it has waited."""
    for name in ("decode", "blur", "detect"):
        (longest,) = judged(tmp_path / name, f"{name}.callback.max < 50 ms")
        assert longest.outcome == "pass"


@dataclass(frozen=True)
class Reacting(Simulation):
    """A run with a monitor of reactions to every tenth step.

    Attributes:
        late: by how many steps outputs meet the condition later than the event.
        order: whether outputs are matched by order; they have a pace of their own otherwise.
        since: the step with which events begin.
        dropped: an output that never comes.
        unfinished: whether the last event of each iteration lasts to its end.
    """

    late: int = 2
    since: int = 0
    order: bool = False
    dropped: int | None = None
    unfinished: bool = False

    def plan(self) -> Plan:
        plan = super().plan()
        (monitor,) = plan.monitors
        monitor = msgspec.structs.replace(
            monitor,
            match="order" if self.order else "own_pace",
            reaction=ReactionPlan(when="data > 0.5", since="data > 0", input="/in", input_type=""),
        )
        return msgspec.structs.replace(plan, monitors=(monitor,))

    def _played(self) -> list[tuple[Segment, SegmentRows]]:
        return [(segment, self._marked(rows)) for segment, rows in super()._played()]

    def _marked(self, rows: SegmentRows) -> SegmentRows:
        played = rows.playback
        steps = np.arange(played.size)
        outputs = np.zeros(steps.size, MONITOR_DTYPE)
        outputs["received_ns"] = played["published_ns"] + 1_000_000
        outputs["taken_ns"] = outputs["received_ns"] + 1
        meets = (steps >= self.late + self.since) & ((steps - self.late - self.since) % 10 < 4)
        if self.dropped is not None:
            outputs = np.delete(outputs, self.dropped)
            meets = np.delete(meets, self.dropped)
        events = steps[self.since :: 10]
        whole = events.size - int(self.unfinished)
        marks = [marks_of(EVENT, events[:whole]), marks_of(MET, np.flatnonzero(meets))]
        marks.append(marks_of(UNFINISHED, events[whole:]))
        return replace(
            rows,
            monitors=dict.fromkeys(rows.monitors, outputs),
            marks=dict.fromkeys(rows.monitors, np.concatenate(marks)),
        )


def reaction(simulation: Reacting, requirement: str) -> RequirementVerdict:
    segments = [Played(100.0, [0.001] * 1000)] * 5
    samples = replace(simulation, segments=segments).samples()
    return judge({"slo": objective(requirement, at="100 Hz")}, samples).requirements[0]


def test_reactions_that_are_late_by_more_than_an_event_do_not_pass() -> None:
    fast = reaction(Reacting(), "reaction.p90 < 50 ms")
    assert (fast.outcome, fast.notes) == ("pass", ())
    slow = reaction(Reacting(late=12), "reaction.p90 < 50 ms")
    # The first event of each iteration has none until the next one.
    assert (slow.outcome, slow.n) == ("fail", 5)
    assert "495 of 500 events do not count" in " ".join(slow.notes)


def test_events_that_find_the_condition_met_decide_nothing() -> None:
    # Before the first one of an iteration, there is no output.
    often = reaction(Reacting(late=-2), "reaction.p90 < 50 ms")
    assert (often.outcome, often.n) == ("inconclusive", 5)
    assert "495 of 500 events do not count" in " ".join(often.notes)
    always = reaction(Reacting(late=-2, since=5), "reaction.p90 < 50 ms")
    assert always.outcome == "inconclusive"
    assert always.reason.startswith("500 of 500 events do not count")
    assert "stamp" in always.remedy


def test_an_iteration_without_an_event_is_no_failure() -> None:
    found = reaction(Reacting(since=999), "reaction.mean < 50 ms")
    assert found.outcome == "fail"  # the only event is the last step, and has no reaction
    found = reaction(Reacting(since=1000), "reaction.mean < 50 ms")
    assert (found.outcome, found.reason[:14]) == ("inconclusive", "No event began")
    some = replace(Reacting(since=400), segments=[Played(100.0, [0.001] * n) for n in (900, 300)])
    (found,) = judge(
        {"slo": objective("reaction.mean < 50 ms", at="100 Hz")}, some.samples()
    ).requirements
    assert found.outcome == "inconclusive"
    assert found.reason == "No event that counts began in iteration 2 for monitor 'detections'."


@pytest.mark.parametrize("requirement", ["reaction.p90 < 50 ms", "missed == 0", "drop_rate < 1 %"])
def test_an_output_by_order_too_few_leaves_open_what_was_missed(requirement: str) -> None:
    whole = reaction(Reacting(order=True, late=0), requirement)
    assert whole.outcome == "pass"
    found = reaction(Reacting(order=True, late=0, dropped=7), requirement)
    assert found.outcome == "inconclusive"
    assert "matched by order" in found.reason


def test_events_that_last_to_the_end_of_the_iteration_are_said_not_to_count() -> None:
    found = reaction(Reacting(order=True, unfinished=True), "reaction.p90 < 50 ms")
    assert (found.outcome, found.n) == ("pass", 495)
    assert "5 of 500 events do not count: 'from' held until the end" in " ".join(found.notes)


def test_few_events_are_counted_as_events() -> None:
    segments = [Played(100.0, [0.001] * 20)] * 3
    samples = replace(Reacting(order=True), segments=segments).samples()
    requirement = objective("reaction.p90 < 50 ms", at="100 Hz")
    (found,) = judge({"slo": requirement}, samples).requirements
    assert found.outcome == "inconclusive"
    assert "0 of 6 events" in found.reason
    assert "events" in found.remedy
    assert "messages" not in found.remedy
