"""Which callbacks messages wait for: those that run between the arrival of a message and its take.

A callback blocks a subscription or service of its process if messages that arrive while it runs are
not taken before it has ended. Either the executor has one thread, or both belong to one mutually
exclusive callback group. rclcpp and rclpy do not tell to which group a callback belongs: with
several threads, the group is concluded from what never ran at the same time.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Final

import msgspec
import numpy as np

from r2bspec.judge.measure.anatomy_events import UNKNOWN_NS, Events, Ints, clipped_sum, grouped
from r2bspec.plan.plan import Plan
from r2bspec.record.run_record import AnatomyKind, AnatomyRecord

_MIN_SHARE: Final = 0.25
"""Of the time that the messages of a topic wait; a callback that takes less of it is not named."""

_MAX_EVADING: Final = 0.05
"""Of the messages that arrive during a callback, how many may be taken during the same one: the
clocks of arrival and take are not read at once."""


class Blocker(msgspec.Struct, frozen=True, kw_only=True):
    """A callback for which messages of a topic wait; times are seconds.

    Attributes:
        node: the node whose messages wait.
        topic: the topic of the messages, or the service.
        by_node: the node of the callback.
        by: the topic or service of the callback; empty if a timer calls it.
        period: the period of the timer; 0 if it was called once, or is none.
        n: how many messages waited for it.
        mean: how long they waited for it, on average.
        share: the share of the time that all messages of the topic waited.
        threads: the threads of the executor, as far as the spec or the observed calls tell.
    """

    node: str
    topic: str
    by_node: str
    by: str
    period: float
    n: int
    mean: float
    share: float
    threads: int


def find_blockers(
    events: Events, record: AnatomyRecord, plan: Plan, waiting: Iterable[tuple[str, str]]
) -> Iterator[Blocker]:
    """Yield the callbacks for which messages wait, for each topic those first that take most.

    Args:
        events: joined.
        record: the record of the processes.
        plan: the plan of the run.
        waiting: nodes, and topics or services that they take.
    """
    names = events.names
    known = (events.callback_began_ns != UNKNOWN_NS) & (
        events.callback_ended_ns > events.callback_began_ns
    )
    own = ~names.is_harness[events.object]
    starts = np.flatnonzero(events.is_start & own & known)
    timed = events.is_take & own & (events.received_ns != UNKNOWN_NS)
    timed &= events.received_ns <= events.began_ns
    stated = {process.name: process.threads for process in plan.processes}
    for node, topic in waiting:
        takes = np.flatnonzero(
            timed
            & (events.node == names.nodes.index(node))
            & (events.topic == names.topics.index(topic))
        )
        if not takes.size:
            continue
        process = int(events.process[takes[0]])
        calling = starts[events.process[starts] == process]
        seen = int(np.unique(events.thread[calling]).size)
        threads = max(stated.get(record.processes[process].name, 0), seen)
        found = [
            blocker
            for callback in grouped(events.object[calling], calling).values()
            if (blocker := _blocker(events, takes, callback, threads)) is not None
        ]
        yield from sorted(found, key=lambda blocker: -blocker.share)


def _blocker(events: Events, takes: Ints, callback: Ints, threads: int) -> Blocker | None:
    """Return what a callback means for some takes; None if they do not wait for it.

    Args:
        events: joined.
        takes: the rows of the takes of a topic by a node.
        callback: the rows of the starts of a callback.
        threads: the threads of the executor.
    """
    names = events.names
    arrived, taken = events.received_ns[takes], events.began_ns[takes]
    began = np.sort(events.callback_began_ns[callback])
    ended = np.sort(events.callback_ended_ns[callback])
    origin = int(min(arrived.min(), began[0]))
    waited = _time_within(taken, began, ended, origin) - _time_within(arrived, began, ended, origin)
    whole = float((taken - arrived).sum())
    # At its arrival the callback runs, or begins before the take.
    during = np.searchsorted(began, arrived, side="right") > np.searchsorted(ended, arrived)
    still = np.searchsorted(ended, arrived) == np.searchsorted(ended, taken)
    if (
        waited.sum() < _MIN_SHARE * whole
        or not waited.any()
        or np.count_nonzero(during & still) > _MAX_EVADING * max(int(np.count_nonzero(during)), 1)
    ):
        return None
    first = callback[0]
    blocked = waited > 0
    is_timer = events.kind[first] == AnatomyKind.TIMER
    return Blocker(
        node=names.nodes[events.node[takes[0]]],
        topic=names.topics[events.topic[takes[0]]],
        by_node=names.nodes[events.node[first]],
        by="" if is_timer else names.topics[events.topic[first]],
        period=float(np.median(np.diff(began))) / 1e9 if is_timer and began.size > 1 else 0.0,
        n=int(np.count_nonzero(blocked)),
        mean=float(waited[blocked].mean()) / 1e9,
        share=float(waited.sum()) / whole,
        threads=threads,
    )


def _time_within(
    times: Ints, began: Ints, ended: Ints, origin: int
) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Return for each time how long callbacks ran before it."""
    at = (times - origin).astype(np.float64)
    first, last = ((limits - origin).astype(np.float64) for limits in (began, ended))
    return clipped_sum(last, at) - clipped_sum(first, at)
