"""What one monitor received in one segment, matched to the steps that count for it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from r2bspec.measure.expected_steps import select_expected_steps
from r2bspec.measure.matching import Matching, Ratio, match, ratio_of
from r2bspec.plan.plan import InputPlan, MonitorPlan
from r2bspec.record.sample_arrays import Rows


@dataclass(frozen=True)
class MatchedMonitor:
    """The match of one monitor. It is costly, and therefore computed once.

    Attributes:
        steps: rows of type `PLAYBACK_DTYPE`: the steps that count for the monitor.
        rows: rows of type `MONITOR_DTYPE`: what it received.
        ratio: of outputs to steps.
        matching: how `rows` match `steps`.
    """

    steps: Rows
    rows: Rows
    ratio: Ratio
    matching: Matching


def match_monitor(
    playback: Rows,
    rows: Rows,
    plan: MonitorPlan,
    inputs: Sequence[InputPlan] = (),
    played_before: int = 0,
) -> MatchedMonitor:
    """Match what a monitor received to what was played.

    Args:
        playback: rows of type `PLAYBACK_DTYPE`: all steps of the segment.
        rows: rows of type `MONITOR_DTYPE`.
        plan: the monitor.
        inputs: of the plan.
        played_before: see `Segment`.
    """
    steps = select_expected_steps(playback, inputs, plan)
    ratio = ratio_of(plan, played_before)
    return MatchedMonitor(steps, rows, ratio, match(steps, rows, plan.match, ratio))
