"""The steps from which a monitor expects an output: those with messages of all its inputs.

Inputs of a timeline have rates of their own, and a step has messages of those that were recorded
with one stamp. A monitor of the camera expects no output of the steps of the IMU.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from r2bspec.measure.live_segments import source_times_ns
from r2bspec.measure.matching import Matching, match, ratio_of
from r2bspec.plan.plan import InputPlan, MonitorPlan
from r2bspec.record.run_folder import Run
from r2bspec.record.run_record import Segment
from r2bspec.record.sample_arrays import PLAYBACK_DTYPE, Rows


def select_expected_steps(
    playback: Rows, inputs: Sequence[InputPlan], monitor: MonitorPlan
) -> Rows:
    """The steps that count for a monitor.

    Args:
        playback: rows of type `PLAYBACK_DTYPE`.
        inputs: of the plan.
        monitor: of the plan; without 'answers', every step counts.
    """
    wanted = np.int64(input_mask(inputs, monitor.answers))
    found: Rows = playback[(playback["inputs"] & wanted) == wanted]
    return found


def input_mask(inputs: Sequence[InputPlan], topics: Sequence[str]) -> int:
    """The set of the inputs on these topics, as bits."""
    return sum(1 << number for number, each in enumerate(inputs) if each.topic in topics)


def match_segment(run: Run, segment: Segment, monitor: MonitorPlan) -> tuple[Rows, Rows, Matching]:
    """The steps of a segment that count for a monitor, what it received, and how they match.

    In a live segment, in which nothing is played, each message is its own step, published when its
    source stamped it; there are none if that is not known.

    Raises:
        RecordError: a file of the segment is missing or damaged.
    """
    rows = run.monitor(segment, monitor.name)
    if not segment.live:
        steps = select_expected_steps(run.playback(segment), run.plan.inputs, monitor)
        ratio = ratio_of(monitor, segment.played_before)
        return steps, rows, match(steps, rows, monitor.match, ratio)
    stamped = source_times_ns(segment, rows)
    steps = np.zeros(0 if stamped is None else rows.size, PLAYBACK_DTYPE)
    if stamped is not None:
        steps["stamp_ns"] = rows["stamp_ns"]
        for name in ("due_ns", "published_ns", "done_ns"):
            steps[name] = stamped
    return steps, rows, match(steps, rows, "order")
