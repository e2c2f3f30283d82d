"""Reaction times: from an input event to the first output that meets a condition.

A run marks which played messages and which outputs meet the conditions of a monitor; everything
else follows here. With h(s) whether the message of step s meets ``from``:

    an event begins at step s    h(s), and not h of the step before it with this input; without
                                 ``from``, at every step
    it is over                   when the next one begins
    it counts                    if the iteration has all messages that follow and meet ``from``
    an output belongs to it      if the step that it answers is between the two: by its stamp, or by
                                 order. An output of a pace of its own without the stamp of a step
                                 belongs to the last step that was published before it arrived
    its reaction                 the first of its outputs that meets ``when``
    reaction time                reception of that output - publication of the event's step

In a live graph, the messages that a monitor received of the input are the steps.

Time alone does not tell to which event an output belongs that has no stamp of a step: a reaction
that comes after the next event has begun looks like a fast one to that. So two kinds of events are
set aside then: those that follow, in their iteration, one without a reaction, which may only have
been late; and those that begin when the last output meets ``when`` already. The latter are not
where each output is a reaction: all of them meet ``when``, and there are at most three an event.

In place of steps such a monitor has events, so that whatever is known of steps and latencies is
known of events and reaction times: losses, windows, confidence.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from r2bspec.judge.measure.matching import (
    CLOCK_ERROR_NS,
    NO_MATCH,
    ONE_TO_ONE,
    MatchedMonitor,
    Matching,
    live_steps,
    match,
    match_monitor,
)
from r2bspec.plan.plan import MonitorPlan, Plan
from r2bspec.record.run_record import Segment
from r2bspec.record.sample_arrays import MARK_DTYPE, Rows

EVENT: Final = 0
MET: Final = 1
UNREADABLE: Final = 2
UNFINISHED: Final = 3
"""What a mark says: that the step of this row begins an event, that the output of this row meets
the condition, or that it could not be read; or that the step begins an event which does not count,
because the iteration ends while ``from`` holds."""


def marks_of(what: int, rows: NDArray[np.intp]) -> Rows:
    """Marks of some rows of the player or of a monitor."""
    marks = np.empty(rows.size, MARK_DTYPE)
    marks["what"], marks["row"] = what, rows
    return marks


def begin_events(holds: NDArray[np.bool_], held_before: bool) -> NDArray[np.bool_]:
    """Which of some messages of an input begin an event.

    Args:
        holds: whether each meets the condition, in the order of playing.
        held_before: whether the message before the first one did.
    """
    before = np.concatenate(([held_before], holds[:-1]))[: holds.size]
    begins: NDArray[np.bool_] = holds & ~before
    return begins


def match_reactions(playback: Rows, matched: MatchedMonitor, marks: Rows) -> MatchedMonitor:
    """The events of a segment as the steps of a monitor, each answered by its reaction.

    Args:
        playback: rows of type `PLAYBACK_DTYPE`: all steps of the segment.
        matched: how the outputs of the monitor match the steps.
        marks: rows of type `MARK_DTYPE`.
    """
    events = _rows(marks, EVENT, playback.size)
    met = _rows(marks, MET, matched.rows.size)
    steps = _steps_of(playback, matched)[met]
    event = np.searchsorted(events, steps, side="right") - 1
    received = matched.rows["received_ns"][met]
    published = playback["published_ns"][events]
    belongs = (event >= 0) & (steps != NO_MATCH)
    belongs[belongs] = received[belongs] >= published[event[belongs]] - CLOCK_ERROR_NS
    order = np.argsort(received[belongs], kind="stable")
    reacted, first = np.unique(event[belongs][order], return_index=True)
    first_row = np.full(events.size, NO_MATCH, np.int64)
    first_row[reacted] = met[belongs][order][first]
    counts = _shown(matched, published, first_row != NO_MATCH, met)
    events, first_row = events[counts], first_row[counts]
    reacted = np.flatnonzero(first_row != NO_MATCH)
    rows = matched.rows[np.sort(first_row[reacted])]
    first_row[reacted] = np.argsort(np.argsort(first_row[reacted]))
    step = np.full(rows.size, NO_MATCH, np.int64)
    step[first_row[reacted]] = events[reacted]
    aside = int(np.count_nonzero(~counts))
    matching = Matching(
        step=step,
        trigger_steps=events,
        first_row=first_row,
        aside=aside,
        unfinished=_rows(marks, UNFINISHED, playback.size).size,
    )
    return replace(matched, steps=playback, rows=rows, matching=matching, own_pace=False)


_OUTPUTS_OF_EVENT: Final = 3
"""More outputs than this an event are not all reactions."""


def _shown(
    matched: MatchedMonitor,
    published_ns: NDArray[np.int64],
    reacted: NDArray[np.bool_],
    met: NDArray[np.int64],
) -> NDArray[np.bool_]:
    """Which events show whether and when there was a reaction; the others are set aside.

    Args:
        matched: the outputs.
        published_ns: when each event began, ascending.
        reacted: which of them have a reaction.
        met: the outputs that meet ``when``.
    """
    by_time = matched.matching.step == NO_MATCH
    shown = np.ones(published_ns.size, np.bool_)
    if not matched.own_pace or not by_time.any():
        return shown
    shown[np.cumsum(~reacted) - ~reacted > 0] = False
    meets = np.zeros(by_time.size, np.bool_)
    meets[met] = True
    order = np.argsort(matched.rows["received_ns"], kind="stable")
    received_ns, meets = matched.rows["received_ns"][order], meets[order]
    if meets.all() and meets.size <= _OUTPUTS_OF_EVENT * (published_ns.size + 1):
        return shown
    last = np.searchsorted(received_ns, published_ns, side="right") - 1
    shown &= (last < 0) | ~meets[last]
    return shown


def live_source(plan: Plan, monitor: MonitorPlan) -> MonitorPlan | None:
    """The monitor of a live graph whose messages begin the events of another one."""
    topic = monitor.reaction.input if monitor.reaction else ""
    return next((each for each in plan.monitors if each.topic == topic), None)


def match_live_reactions(events: Rows, rows: Rows, marks: Rows) -> MatchedMonitor:
    """The events of a live segment, each answered by its reaction.

    A message of the monitored input is a step, published when it arrived at its monitor.

    Args:
        events: rows of type `MONITOR_DTYPE` of the input.
        rows: of the monitor, of the same type.
        marks: rows of type `MARK_DTYPE`.
    """
    stamps = events["stamp_ns"]
    # Without a stamp of its own for each message, an output belongs to the one before it.
    unique = bool((np.diff(stamps) > 0).all()) and bool((stamps > 0).all())
    stamps = stamps if unique else np.arange(-events.size, 0)
    steps = live_steps(stamps, np.maximum.accumulate(events["received_ns"]))
    matching = match(steps, rows, "own_pace")
    matched = MatchedMonitor(steps, rows, ONE_TO_ONE, matching, own_pace=True)
    return match_reactions(steps, matched, marks)


def match_monitors(
    plan: Plan, segment: Segment, playback: Rows, received: Mapping[str, Rows]
) -> dict[str, MatchedMonitor]:
    """How the outputs of each monitor match the steps of a segment; nothing if the graph is live.

    Args:
        plan: of the run.
        segment: one of its segments.
        playback: rows of type `PLAYBACK_DTYPE`: all its steps.
        received: the rows of each monitor, by name.
    """
    if segment.live:
        return {}
    inputs, before = plan.step_sources, segment.played_before
    return {
        monitor.name: match_monitor(playback, received[monitor.name], monitor, inputs, before)
        for monitor in plan.monitors
    }


def find_reactions(
    plan: Plan,
    segment: Segment,
    playback: Rows,
    received: Mapping[str, Rows],
    marks: Mapping[str, Rows],
    matched: Mapping[str, MatchedMonitor],
) -> dict[str, MatchedMonitor]:
    """The events and reactions of each monitor of reactions of a segment, by its name.

    Args:
        plan: of the run.
        segment: one of its segments.
        playback: see `match_reactions`.
        received: the rows of each monitor, by name.
        marks: those of each monitor of reactions, by name.
        matched: of each of them, how its outputs match the steps; nothing where the graph is live.
    """
    found = {}
    for monitor in plan.monitors:
        name = monitor.name
        if name not in marks:
            continue
        if not segment.live:
            found[name] = match_reactions(playback, matched[name], marks[name])
        elif (source := live_source(plan, monitor)) is not None:
            found[name] = match_live_reactions(received[source.name], received[name], marks[name])
    return found


def _rows(marks: Rows, what: int, limit: int) -> NDArray[np.int64]:
    """The rows that are marked, in their order; what a file cannot mean is passed over."""
    rows = marks["row"][marks["what"] == what].astype(np.int64)
    return np.unique(rows[(rows >= 0) & (rows < limit)])


def _steps_of(playback: Rows, matched: MatchedMonitor) -> NDArray[np.int64]:
    """The step among all that each output belongs to, or `NO_MATCH`."""
    step = matched.matching.step
    answered = np.searchsorted(playback["stamp_ns"], matched.steps["stamp_ns"])
    steps = np.full(step.size, NO_MATCH, np.int64)
    known = step != NO_MATCH
    steps[known] = answered[step[known]]
    if matched.own_pace:
        received = matched.rows["received_ns"][~known]
        steps[~known] = np.searchsorted(playback["published_ns"], received, side="right") - 1
    return steps
