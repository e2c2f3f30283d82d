"""The tracks of an observed iteration in a trace: every thread with its callbacks and messages.

A process of the graph is a group of tracks, and a thread a track: takes, callbacks and
publications are slices, and an arrow leads from each publication to each of its takes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, Final

import numpy as np

from r2bspec.judge.measure.anatomy_events import NONE, UNKNOWN_NS, Events
from r2bspec.judge.measure.observed_runs import join_segment, last_run, observed_segments
from r2bspec.record.run_folder import Run
from r2bspec.record.run_record import AnatomyKind, AnatomyRecord

MAX_ROWS: Final = 100_000
"""Events of an iteration that are drawn, from its beginning on: about 30 MB of text."""

_FIRST_GROUP: Final = 1000
"""The number of the first group: those before are of the run, and of its monitors."""

_WORDS: Final = {
    AnatomyKind.PUBLISH: "publish",
    AnatomyKind.TAKE: "take",
    AnatomyKind.DEQUEUE: "take",
    AnatomyKind.SEND_REQUEST: "request",
    AnatomyKind.TAKE_REQUEST: "take request",
    AnatomyKind.SEND_RESPONSE: "respond",
    AnatomyKind.TAKE_RESPONSE: "take response",
}

_At = Callable[[int], float]


def observed_events(run: Run, at: _At) -> Iterator[dict[str, Any]]:
    """The events of all iterations that reports show the anatomy of.

    Args:
        run: the run.
        at: converts CLOCK_MONOTONIC nanoseconds to the microseconds of the trace.

    Raises:
        RecordError: a file of the run is missing or damaged.
    """
    group = _FIRST_GROUP
    run = last_run(run)
    for segment, record in observed_segments(run):
        events = join_segment(run, segment, record).events
        yield from _groups(events, record, segment.id, group)
        yield from _slices(events, at, group)
        group += len(record.processes)


def _groups(
    events: Events, record: AnatomyRecord, segment: str, group: int
) -> Iterator[dict[str, Any]]:
    for number, process in enumerate(record.processes):
        args = {"name": f"{process.name} ({segment})"}
        yield {"ph": "M", "name": "process_name", "pid": group + number, "tid": 0, "args": args}
    threads, rows = np.unique(events.thread, return_index=True)
    for thread, row in zip(threads.tolist(), rows.tolist(), strict=True):
        args = {"name": f"thread {thread + 1}"}
        pid = group + int(events.process[row])
        yield {"ph": "M", "name": "thread_name", "pid": pid, "tid": thread + 1, "args": args}


def _slices(events: Events, at: _At, group: int) -> Iterator[dict[str, Any]]:
    acts = np.flatnonzero(events.is_take | events.is_send | events.is_start)
    acts = acts[np.argsort(events.began_ns[acts], kind="stable")][:MAX_ROWS]
    names, node, topic = events.names, events.node, events.topic
    for row in acts.tolist():
        place = {"pid": group + int(events.process[row]), "tid": int(events.thread[row]) + 1}
        began, ended = int(events.began_ns[row]), int(events.ended_ns[row])
        about = names.topics[topic[row]]
        owner = names.nodes[node[row]]
        kind = AnatomyKind(int(events.kind[row]))
        if kind in _WORDS:
            yield _slice(f"{_WORDS[kind]} {about}", kind.name.lower(), at, began, ended, place)
        if events.is_start[row] and events.callback_began_ns[row] != UNKNOWN_NS:
            began, ended = int(events.callback_began_ns[row]), int(events.callback_ended_ns[row])
            if ended >= began:
                name = f"{owner}: {about or 'timer'}"
                yield _slice(name, "callback", at, began, ended, place)
        send = int(events.send[row])
        if send != NONE:
            shared = {"cat": "message", "name": about, "id": f"anatomy.{group}.{row}"}
            sender = {
                "pid": group + int(events.process[send]),
                "tid": int(events.thread[send]) + 1,
            }
            yield {"ph": "s", "ts": at(int(events.began_ns[send])), **sender, **shared}
            yield {"ph": "f", "bp": "e", "ts": at(int(events.began_ns[row])), **place, **shared}


def _slice(
    name: str, category: str, at: _At, began: int, ended: int, place: dict[str, int]
) -> dict[str, Any]:
    duration = round((ended - began) / 1e3, 3)
    return {"ph": "X", "name": name, "cat": category, "ts": at(began), "dur": duration, **place}
