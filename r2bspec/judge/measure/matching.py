"""Matches the messages of a monitor to the steps of the playback that count for it.

A monitor expects an output of each step with messages of all its inputs: inputs of a timeline have
rates of their own, a step has messages of the inputs that were recorded with the same stamp, and a
monitor of the camera expects no output of the steps of the IMU.

In a live run the graph has its own source, and what that sent is unknown. What arrived is known,
and when. A message with a header carries the time at which its source stamped it, in the clock of
this machine, so that

    latency = received - stamp

This is known for an iteration only if the stamps are times of that clock: not if more than one in a
hundred is after the reception of its message or more than an hour before it, as with stamps that
were never set, or come from a simulation or a recording; and not if the clock was set meanwhile.
What was sent, missed, duplicated or reordered is unknown, and no metric of it has a value.

The same is true of a monitor with `match: own_pace`, whose messages come whether inputs do or not.
A stamp that is that of a step tells how old the newest input in a message is.

An output carries the stamp of one of its inputs, whichever the node copies. Where stamps within a
step differ (`r2bspec.plan.nearest_stamps`), the stamp of an output is therefore replaced by that of
its step before anything is matched or recorded (`StepStamps`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from r2bspec.ipc.schedule import Schedule, TimelineSchedule
from r2bspec.language.spec_benchmark import Match
from r2bspec.plan.plan import MonitorPlan, StepSources
from r2bspec.record.run_record import Segment
from r2bspec.record.sample_arrays import PLAYBACK_DTYPE, Rows

NO_MATCH = -1
"""The step of a message that matches none."""

CLOCK_ERROR_NS = 100_000
"""Times of two processes may differ by this much (see `r2bspec.ipc.sample_files`): an output that
was received up to this long before its step was published is not early."""


@dataclass(frozen=True)
class StepRatio:
    """How many outputs belong to how many steps, and the position of the graph's count.

    Attributes:
        inputs: the number of steps of a group.
        outputs: the number of outputs of each group.
        before: steps that the graph received before these. A node with one output for every
            third message continues its count from the last segment.
    """

    inputs: int = 1
    outputs: int = 1
    before: int = 0

    @property
    def per_step(self) -> float:
        """Outputs for each step."""
        return self.outputs / self.inputs

    def trigger_steps(self, steps: int) -> NDArray[np.int64]:
        """Return the step after which each expected output can come: the last of its group.

        Steps after the last whole group have no expected output.
        """
        first = self.inputs - 1 - self.before % self.inputs
        return np.repeat(np.arange(first, steps, self.inputs, dtype=np.int64), self.outputs)


ONE_TO_ONE = StepRatio()


def ratio_of(plan: MonitorPlan, played_before: int) -> StepRatio:
    """Return the ratio of a monitor in a segment.

    Args:
        plan: the monitor.
        played_before: see `Segment`.
    """
    if plan.match == "stamp" and plan.ratio_inputs == plan.ratio_outputs:
        return ONE_TO_ONE
    return StepRatio(plan.ratio_inputs, plan.ratio_outputs, played_before)


class MessageKind(IntEnum):
    """The kind of a row of the samples: an expected output, or another received message."""

    EXPECTED = 0
    """By stamp or by order, the first message that answers."""
    DUPLICATE = 1
    """Matches a step which an earlier message had matched."""
    UNMATCHED = 2
    """Matches no step, as the following."""
    OVERDUE = 3
    """Has the stamp of a step of an earlier segment."""
    SURPLUS = 4
    """By order, comes after the last expected output."""


@dataclass(frozen=True)
class Matching:
    """How the messages of a monitor match the steps of a segment.

    With e expected outputs (as many as steps, unless the ratio is not 1) and m messages::

        expected = e = answered + missed
        received = m = answered + duplicates + unmatched

    Attributes:
        step: shape (m,), the step that each message matches, or `NO_MATCH`.
        trigger_steps: shape (e,), the step after which each expected output can come; by stamp,
            the step whose stamp it has.
        first_row: shape (e,), the row of the first message that is each expected output, or
            `NO_MATCH` where none is.
        kind: shape (m,), the `MessageKind` of each message.
        early: first outputs that arrived before their step was published, which is impossible:
            matching by order has gone wrong.
        per_step: expected outputs per step, on average.
        by_order: whether messages were matched by order.
    """

    step: NDArray[np.int64]
    trigger_steps: NDArray[np.int64]
    first_row: NDArray[np.int64]
    kind: NDArray[np.int8]
    early: int = 0
    per_step: float = 1.0
    by_order: bool = False

    @property
    def pairs_known(self) -> bool:
        """Whether it is known which step each output answers.

        With matching by order it is unknown as soon as an output is missing, surplus, or early:
        every later output may then answer another step.
        """
        return not self.by_order or not (self.missed or self.surplus or self.early)

    @property
    def answered(self) -> NDArray[np.bool_]:
        """Shape (e,): whether each expected output arrived."""
        return np.not_equal(self.first_row, NO_MATCH)

    @property
    def missed(self) -> int:
        """Expected outputs that never arrived."""
        return int(np.count_nonzero(self.first_row == NO_MATCH))

    @property
    def duplicates(self) -> int:
        """Messages that match a step which an earlier message had matched."""
        return int(np.count_nonzero(self.kind == MessageKind.DUPLICATE))

    @property
    def unmatched(self) -> int:
        """Messages that match no step."""
        return int(np.count_nonzero(self.kind >= MessageKind.UNMATCHED))

    @property
    def surplus(self) -> int:
        """With matching by order, messages after the last expected output; also unmatched."""
        return int(np.count_nonzero(self.kind == MessageKind.SURPLUS))


def match(
    playback: Rows,
    monitor: Rows,
    by: Match,
    ratio: StepRatio = ONE_TO_ONE,
) -> Matching:
    """Match messages to steps.

    By stamp: a message matches the step with its unique stamp. By order: the k-th message is the
    k-th expected output, and messages after the last of them, or before anything was published,
    match nothing; losses and duplicates within the order cannot be detected that way, and a loss
    shifts all later pairs (see `Matching.pairs_known`).

    By stamp with a ratio, as of a node that answers a timer or fuses several messages: each group
    of steps expects its outputs, with the stamp of any step of the group. The phase of the timer
    is unknown, so an output of a neighbouring group will do. What exceeds the ratio is a duplicate.

    Where a step may have any number of outputs, each message with the stamp of a step is an
    expected output, and none can miss.

    With a pace of its own, no output is expected: a message has the step with its stamp, and is
    neither an answer nor a fault.

    Args:
        playback: rows of type `PLAYBACK_DTYPE`, one per step, in the order of publication.
        monitor: rows of type `MONITOR_DTYPE`, in the order of arrival.
        by: by stamp, by order, or not at all.
        ratio: the ratio of outputs to inputs.
    """
    if by == "own_pace":
        return Matching(
            step=_steps_by_stamp(playback["stamp_ns"], monitor["stamp_ns"]),
            trigger_steps=np.empty(0, np.int64),
            first_row=np.empty(0, np.int64),
            kind=np.full(monitor.size, MessageKind.UNMATCHED, np.int8),
        )
    kind = np.full(monitor.size, MessageKind.UNMATCHED, np.int8)
    if by == "any":
        found = _steps_by_stamp(playback["stamp_ns"], monitor["stamp_ns"])
        came = np.flatnonzero(found != NO_MATCH)
        answer, trigger_steps = np.full(monitor.size, NO_MATCH, np.int64), found[came]
        answer[came] = np.arange(came.size)
    elif by == "order":
        trigger_steps = ratio.trigger_steps(playback.size)
        answer, surplus = _answers_by_order(playback, monitor, trigger_steps.size)
        kind[surplus] = MessageKind.SURPLUS
    else:
        answer = _steps_by_stamp(playback["stamp_ns"], monitor["stamp_ns"])
        kind[answer != NO_MATCH] = MessageKind.DUPLICATE
        trigger_steps = np.arange(playback.size, dtype=np.int64)
        if ratio.inputs != ratio.outputs:
            answer, trigger_steps = _answers_of_groups(answer, playback.size, ratio)
    rows = np.flatnonzero(answer != NO_MATCH)
    answered, first = np.unique(answer[rows], return_index=True)
    first_row = np.full(trigger_steps.size, NO_MATCH, dtype=np.int64)
    first_row[answered] = rows[first]
    kind[rows[first]] = MessageKind.EXPECTED
    step = np.full(monitor.size, NO_MATCH, dtype=np.int64)
    step[rows] = trigger_steps[answer[rows]]
    published_ns = playback["published_ns"][trigger_steps[answered]]
    early = monitor["received_ns"][first_row[answered]] < published_ns - CLOCK_ERROR_NS
    return Matching(
        step=step,
        trigger_steps=trigger_steps,
        first_row=first_row,
        kind=kind,
        early=int(np.count_nonzero(early)),
        per_step=ratio.per_step,
        by_order=by == "order",
    )


def arrivals(monitor: Rows, match: Matching) -> NDArray[np.int64]:
    """Return when each first output was received, in ascending nanoseconds; shape (answered,).

    Duplicates and messages that match no step are left out: they are counted elsewhere, and
    would make a graph look faster than it is.
    """
    return np.sort(monitor["received_ns"][match.first_row[match.answered]])


def count_reordered(in_order_of_arrival: NDArray[np.int64]) -> int:
    """Return how many outputs arrived after the output of a later step.

    See RFC 4737, section 3: the step is below the highest step so far.
    """
    highest_before = np.maximum.accumulate(in_order_of_arrival)[:-1]
    return int(np.count_nonzero(in_order_of_arrival[1:] < highest_before))


def _answers_by_order(
    playback: Rows, monitor: Rows, expected: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the number of the expected output that each message is, or `NO_MATCH`.

    And the surplus.
    """
    answer = np.full(monitor.size, NO_MATCH, dtype=np.int64)
    if not playback.size:
        return answer, np.empty(0, np.int64)
    # A message still in flight from before must not be taken for the first output.
    since_ns = playback["published_ns"][0] - CLOCK_ERROR_NS
    can = np.flatnonzero(monitor["received_ns"] >= since_ns)
    answers = can[:expected]
    answer[answers] = np.arange(answers.size)
    return answer, can[expected:]


def _answers_of_groups(
    matched: NDArray[np.int64], steps: int, ratio: StepRatio
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Assign messages to the expected outputs of their groups, as many as possible.

    In the order of their steps, each message takes the first expected output that is free, of its
    own group or a neighbouring one; with one step in a group, of its own only. As the ranges of
    allowed outputs are ordered as the messages are, no other assignment answers more.

    Args:
        matched: the step of each message, or `NO_MATCH`; in the order of arrival.
        steps: their number.
        ratio: other than one to one.

    Returns:
        For each message the number of the expected output that it is, or `NO_MATCH`; and the step
        of each expected output.
    """
    triggers = ratio.trigger_steps(steps)
    groups = np.arange(triggers.size) // ratio.outputs
    first = int(triggers[0]) if triggers.size else 0
    slack = 0 if ratio.inputs == 1 else 1
    answer = np.full(matched.size, NO_MATCH, dtype=np.int64)
    rows = np.flatnonzero(matched != NO_MATCH)
    free, last_step, of_step = 0, NO_MATCH, 0
    answered = np.zeros(triggers.size, dtype=np.bool_)
    for row in rows[np.argsort(matched[rows], kind="stable")]:
        step = int(matched[row])
        of_step = of_step + 1 if step == last_step else 1
        last_step = step
        # The first group can be shorter: it ends with the first trigger step.
        group = max(0, -(-(step - first) // ratio.inputs))
        while free < triggers.size and groups[free] < group - slack:
            free += 1
        if (
            of_step <= math.ceil(ratio.per_step)
            and free < triggers.size
            and groups[free] <= group + slack
        ):
            answer[row], triggers[free], answered[free] = free, step, True
            free += 1
    if answered.any():
        # The step of a missed output is between those of its neighbours, so that steps ascend.
        later = np.minimum.accumulate(np.where(answered, triggers, steps)[::-1])[::-1]
        triggers = np.maximum.accumulate(np.minimum(triggers, later))
    return answer, triggers


def _steps_by_stamp(sent: NDArray[np.int64], received: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the index into `sent` of each stamp in `received`, or `NO_MATCH`."""
    if not sent.size:
        return np.full(received.size, NO_MATCH, dtype=np.int64)
    order = np.argsort(sent, kind="stable")
    ordered = sent[order]
    place = np.minimum(np.searchsorted(ordered, received), sent.size - 1)
    return np.where(ordered[place] == received, order[place], NO_MATCH).astype(np.int64)


_MAX_CLOCK_SKEW_NS = 1_000_000
"""Two clock readings may be this far apart, if a process was interrupted between them."""

_MAX_STAMP_AGE_NS = 3_600_000_000_000
_MAX_IMPLAUSIBLE_SHARE = 0.01


def source_times_ns(segment: Segment, rows: Rows) -> NDArray[np.int64] | None:
    """Return when the source stamped each message, on the monotonic clock.

    Args:
        segment: the segment of a live run.
        rows: what a monitor received in it, of type `MONITOR_DTYPE`; the stamps are of the system
            clock.

    Returns:
        Shape (messages,); None if that is not known.
    """
    offset_ns = segment.clock_offset_ns
    if offset_ns is None or not rows.size:
        return None
    stamped: NDArray[np.int64] = rows["stamp_ns"] - offset_ns
    age_ns = rows["received_ns"] - stamped
    odd = np.count_nonzero((age_ns < -_MAX_CLOCK_SKEW_NS) | (age_ns > _MAX_STAMP_AGE_NS))
    return None if odd > _MAX_IMPLAUSIBLE_SHARE * rows.size else stamped


def live_steps(stamps_ns: NDArray[np.int64], times_ns: NDArray[np.int64]) -> Rows:
    """Return messages as steps of a live graph, due and published at these times."""
    steps = np.zeros(stamps_ns.size, PLAYBACK_DTYPE)
    steps["stamp_ns"] = stamps_ns
    for name in ("due_ns", "published_ns", "done_ns"):
        steps[name] = times_ns
    return steps


def select_expected_steps(playback: Rows, inputs: StepSources, monitor: MonitorPlan) -> Rows:
    """Return the steps that count for a monitor.

    Args:
        playback: rows of type `PLAYBACK_DTYPE`.
        inputs: `step_sources` of the plan.
        monitor: the monitor of the plan; without 'answers', every step counts.
    """
    mask = np.int64(input_mask(inputs, monitor.answers))
    rows: Rows = playback[(playback["inputs"] & mask) == mask]
    return rows


def input_mask(inputs: StepSources, topics: Sequence[str]) -> int:
    """Return the set of the inputs on these topics, as bits."""
    return sum(1 << number for number, input_ in enumerate(inputs) if input_.topic in topics)


@dataclass(frozen=True)
class MatchedMonitor:
    """The match of one monitor. It is costly, and therefore computed once.

    Attributes:
        steps: rows of type `PLAYBACK_DTYPE`: the steps that count for the monitor.
        rows: rows of type `MONITOR_DTYPE`: what it received.
        matching: how `rows` match `steps`.
        match: how they are matched.
    """

    steps: Rows
    rows: Rows
    matching: Matching
    match: Match = "stamp"


def match_monitor(
    playback: Rows,
    rows: Rows,
    plan: MonitorPlan,
    inputs: StepSources = (),
    played_before: int = 0,
) -> MatchedMonitor:
    """Match the messages of a monitor to the steps that were played.

    Args:
        playback: rows of type `PLAYBACK_DTYPE`: all steps of the segment.
        rows: rows of type `MONITOR_DTYPE`.
        plan: the monitor.
        inputs: `step_sources` of the plan.
        played_before: see `Segment`.
    """
    steps = select_expected_steps(playback, inputs, plan)
    ratio = ratio_of(plan, played_before)
    matching = match(steps, rows, plan.match, ratio)
    return MatchedMonitor(steps, rows, matching, plan.match)


class StepStamps:
    """Replaces the stamps of received messages by those of their steps.

    It remembers earlier steps, so that their late outputs are recognised in a later segment.
    """

    def __init__(self, schedule: Schedule) -> None:
        self._offsets_ns = np.array(schedule.stamp_offsets_ns, dtype=np.int64)
        self._restarts = isinstance(schedule, TimelineSchedule)
        # Of all inputs played before, ascending, and the stamp of the step of each.
        self._inputs_ns: NDArray[np.int64] = np.empty(0, dtype=np.int64)
        self._steps_ns: NDArray[np.int64] = np.empty(0, dtype=np.int64)

    def replace(self, received: Rows, playback: Rows, first: int) -> Rows:
        """Return the rows, with the stamp of the step instead of that of an input of the step.

        Args:
            received: rows of type `MONITOR_DTYPE`.
            playback: rows of type `PLAYBACK_DTYPE` that were played in one go.
            first: the number of the first of them among all that the player has played.
        """
        if not self._offsets_ns.size or not received.size:
            return received
        rows = received.copy()
        # Where a stamp belongs to two steps, the earlier one counts.
        for inputs_ns, steps_ns in (
            _ascending(*self._stamps(playback, first)),
            (self._inputs_ns, self._steps_ns),
        ):
            if not inputs_ns.size:
                continue
            place = np.searchsorted(inputs_ns, received["stamp_ns"])
            place = np.minimum(place, inputs_ns.size - 1)
            belongs = inputs_ns[place] == received["stamp_ns"]
            rows["stamp_ns"][belongs] = steps_ns[place[belongs]]
        return rows

    def remember(self, playback: Rows, first: int) -> None:
        """Keep the stamps of steps that have been played; arguments as in `replace`."""
        if not self._offsets_ns.size:
            return
        inputs_ns, steps_ns = _ascending(*self._stamps(playback, first))
        # Later steps have later stamps, as a rule; then nothing is moved.
        place = np.searchsorted(self._inputs_ns, inputs_ns, side="right")
        self._inputs_ns = np.insert(self._inputs_ns, place, inputs_ns)
        self._steps_ns = np.insert(self._steps_ns, place, steps_ns)

    def _stamps(self, playback: Rows, first: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return the stamps of all inputs of some steps, and for each that of its step.

        Shape (n,).
        """
        # A timeline begins anew with each playback, a cyclic schedule goes on.
        begin = 0 if self._restarts else first
        places = (begin + np.arange(playback.size)) % len(self._offsets_ns)
        offsets_ns = self._offsets_ns[places]
        steps_ns = np.broadcast_to(playback["stamp_ns"][:, np.newaxis], offsets_ns.shape)
        return (steps_ns + offsets_ns).ravel(), steps_ns.ravel()


def _ascending(
    inputs_ns: NDArray[np.int64], steps_ns: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    order = np.argsort(inputs_ns, kind="stable")
    return inputs_ns[order], steps_ns[order]
