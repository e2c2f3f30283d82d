"""Matches messages to the steps of the playback."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from r2bspec.plan.plan import MonitorPlan
from r2bspec.record.sample_arrays import Rows

NO_MATCH = -1
"""The step of a message that matches none."""

CLOCK_ERROR_NS = 100_000
"""Times of two processes may differ by this much (see `r2bspec.ipc.clocks`): an output that was
received up to this long before its step was published is not early."""


@dataclass(frozen=True)
class Ratio:
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
        """The step after which each expected output can come: the last one of its group.

        Steps after the last whole group have no expected output.
        """
        first = self.inputs - 1 - self.before % self.inputs
        return np.repeat(np.arange(first, steps, self.inputs, dtype=np.int64), self.outputs)


ONE_TO_ONE = Ratio()


def ratio_of(plan: MonitorPlan, played_before: int) -> Ratio:
    """The ratio of a monitor in a segment; by stamp it is always one to one.

    Args:
        plan: the monitor.
        played_before: see `Segment`.
    """
    if plan.match == "stamp":
        return ONE_TO_ONE
    return Ratio(plan.ratio_inputs, plan.ratio_outputs, played_before)


@dataclass(frozen=True)
class Matching:
    """How the messages of one monitor match the steps of one segment.

    With e expected outputs (as many as steps, unless the ratio is another) and m messages::

        expected = e = answered + missed
        received = m = answered + duplicates + unmatched

    Attributes:
        step: shape (m,), the step that each message matches, or `NO_MATCH`.
        trigger_steps: shape (e,), the step after which each expected output can come.
        first_row: shape (e,), the row of the first message that is each expected output, or
            `NO_MATCH` where none is.
        duplicates: messages that match a step which an earlier message had matched.
        reordered: first outputs that arrived after the output of a later step (RFC 4737,
            section 3: the step is below the highest one seen before).
        unmatched: messages that match no step.
        early: first outputs that arrived before their step was published, which is impossible:
            matching by order has gone wrong.
        surplus: by order, messages after the last expected output; they are unmatched, too.
        per_step: expected outputs per step, on average.
        by_order: whether messages were matched by order.
    """

    step: NDArray[np.int64]
    trigger_steps: NDArray[np.int64]
    first_row: NDArray[np.int64]
    duplicates: int
    reordered: int
    unmatched: int
    early: int = 0
    surplus: int = 0
    per_step: float = 1.0
    by_order: bool = False

    @property
    def pairs_known(self) -> bool:
        """Whether it is known which step each output answers.

        By order it is not as soon as one output is missing, too many, or early: every later one
        may then answer another step.
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


def match(
    playback: Rows,
    monitor: Rows,
    by: Literal["stamp", "order"],
    ratio: Ratio = ONE_TO_ONE,
) -> Matching:
    """Match messages to steps.

    By stamp: a message matches the step with its unique stamp. By order: the k-th message is the
    k-th expected output, and messages after the last of them, or before anything was published,
    match nothing; losses and duplicates within the order cannot be detected that way, and a loss
    shifts all later pairs (see `Matching.pairs_known`).

    Args:
        playback: rows of type `PLAYBACK_DTYPE`, one per step, in the order of publication.
        monitor: rows of type `MONITOR_DTYPE`, in the order of arrival.
        by: by stamp or by order.
        ratio: of outputs to inputs; by stamp it is one to one.
    """
    if by == "order":
        trigger_steps = ratio.trigger_steps(playback.size)
        answer = _answers_by_order(playback, monitor, trigger_steps.size)
    else:
        trigger_steps = np.arange(playback.size, dtype=np.int64)
        answer = _steps_by_stamp(playback["stamp_ns"], monitor["stamp_ns"])
    rows = np.flatnonzero(answer != NO_MATCH)
    answered, first = np.unique(answer[rows], return_index=True)
    first_row = np.full(trigger_steps.size, NO_MATCH, dtype=np.int64)
    first_row[answered] = rows[first]
    in_order_of_arrival = answered[np.argsort(first)]
    highest_before = np.maximum.accumulate(in_order_of_arrival)[:-1]
    step = np.full(monitor.size, NO_MATCH, dtype=np.int64)
    step[rows] = trigger_steps[answer[rows]]
    published_ns = playback["published_ns"][trigger_steps[answered]]
    early = monitor["received_ns"][first_row[answered]] < published_ns - CLOCK_ERROR_NS
    return Matching(
        step=step,
        trigger_steps=trigger_steps,
        first_row=first_row,
        duplicates=int(rows.size - answered.size),
        reordered=int(np.count_nonzero(in_order_of_arrival[1:] < highest_before)),
        unmatched=int(monitor.size - rows.size),
        early=int(np.count_nonzero(early)),
        surplus=_surplus(playback, monitor, trigger_steps.size) if by == "order" else 0,
        per_step=ratio.per_step if by == "order" else 1.0,
        by_order=by == "order",
    )


def _answers_by_order(playback: Rows, monitor: Rows, expected: int) -> NDArray[np.int64]:
    """The number of the expected output that each message is, or `NO_MATCH`."""
    answer = np.full(monitor.size, NO_MATCH, dtype=np.int64)
    if playback.size:
        # A message still in flight from before must not be taken for the first output.
        since_ns = playback["published_ns"][0] - CLOCK_ERROR_NS
        can = np.flatnonzero(monitor["received_ns"] >= since_ns)[:expected]
        answer[can] = np.arange(can.size)
    return answer


def _surplus(playback: Rows, monitor: Rows, expected: int) -> int:
    """Messages beyond the expected outputs; those still in flight from before do not count."""
    if not playback.size:
        return 0
    since_ns = playback["published_ns"][0] - CLOCK_ERROR_NS
    return max(0, int(np.count_nonzero(monitor["received_ns"] >= since_ns)) - expected)


def _steps_by_stamp(sent: NDArray[np.int64], received: NDArray[np.int64]) -> NDArray[np.int64]:
    """The index into `sent` of each stamp in `received`, or `NO_MATCH`."""
    if not sent.size:
        return np.full(received.size, NO_MATCH, dtype=np.int64)
    order = np.argsort(sent, kind="stable")
    ordered = sent[order]
    place = np.minimum(np.searchsorted(ordered, received), sent.size - 1)
    return np.where(ordered[place] == received, order[place], NO_MATCH).astype(np.int64)
