"""Which message answers which step of the playback."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from r2bspec.record.arrays import Rows

UNKNOWN = -1
"""The step of a message that answers none."""


@dataclass(frozen=True)
class Matching:
    """How the messages of one monitor answer the steps of one segment.

    With n steps and m messages::

        sent     = n = answered + missed
        received = m = answered + duplicates + unmatched

    Attributes:
        step: shape (m,), the step that each message answers, or `UNKNOWN`.
        first_row: shape (n,), the row of the first message that answers each step, or
            `UNKNOWN` where none does.
        duplicates: messages that answer a step which an earlier message had answered.
        reordered: first answers that came after the answer of a later step (RFC 4737,
            section 3: the step is below the highest one seen before).
        unmatched: messages that answer no step.
    """

    step: NDArray[np.int64]
    first_row: NDArray[np.int64]
    duplicates: int
    reordered: int
    unmatched: int

    @property
    def answered(self) -> NDArray[np.bool_]:
        """Shape (n,): whether each step was answered."""
        return np.not_equal(self.first_row, UNKNOWN)

    @property
    def missed(self) -> int:
        """Steps that no message answered."""
        return int(np.count_nonzero(self.first_row == UNKNOWN))


def match(playback: Rows, monitor: Rows, by: Literal["stamp", "order"]) -> Matching:
    """Match messages to steps.

    By stamp: a message answers the step whose unique stamp it carries. By order: the k-th
    message answers the k-th step, and what comes after the last step answers none; losses and
    duplicates within the order cannot be seen that way.

    Args:
        playback: rows of type `PLAYBACK`, one per step, in the order of publication.
        monitor: rows of type `MONITOR`, in the order of arrival.
        by: how.
    """
    if by == "order":
        step = np.arange(monitor.size, dtype=np.int64)
        step[playback.size :] = UNKNOWN
    else:
        step = _steps_by_stamp(playback["stamp_ns"], monitor["stamp_ns"])
    rows = np.flatnonzero(step != UNKNOWN)
    answered, first = np.unique(step[rows], return_index=True)
    first_row = np.full(playback.size, UNKNOWN, dtype=np.int64)
    first_row[answered] = rows[first]
    in_order_of_arrival = answered[np.argsort(first)]
    highest_before = np.maximum.accumulate(in_order_of_arrival)[:-1]
    return Matching(
        step=step,
        first_row=first_row,
        duplicates=int(rows.size - answered.size),
        reordered=int(np.count_nonzero(in_order_of_arrival[1:] < highest_before)),
        unmatched=int(monitor.size - rows.size),
    )


def _steps_by_stamp(sent: NDArray[np.int64], received: NDArray[np.int64]) -> NDArray[np.int64]:
    """The index into `sent` of each stamp in `received`, or `UNKNOWN`."""
    if not sent.size:
        return np.full(received.size, UNKNOWN, dtype=np.int64)
    order = np.argsort(sent, kind="stable")
    ordered = sent[order]
    place = np.minimum(np.searchsorted(ordered, received), sent.size - 1)
    return np.where(ordered[place] == received, order[place], UNKNOWN).astype(np.int64)
