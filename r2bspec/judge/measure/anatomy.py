"""The anatomy of an iteration: where each message spent its time, and what each node did.

It is made of the events of an iteration in which every process was observed from inside. It has the
paths to the monitors; for every node the durations of its callbacks, the waits of its messages and
the load of its threads; and for every topic the duration of the transport.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from r2bspec.judge.measure.anatomy_causes import find_causes
from r2bspec.judge.measure.anatomy_events import (
    NONE,
    UNKNOWN_NS,
    Events,
    Ints,
    Mask,
    clipped_sum,
    grouped,
    join_events,
)
from r2bspec.judge.measure.anatomy_paths import Path, PathSearch
from r2bspec.judge.measure.times import Seconds
from r2bspec.plan.plan import MonitorPlan, Plan
from r2bspec.record.run_record import AnatomyKind, AnatomyRecord
from r2bspec.record.sample_arrays import Rows

WINDOWS: Final = 20
"""Parts of an iteration in which loads are computed, and means are compared."""

NODE_TIMES: Final = ("wait", "take", "dispatch", "callback")
"""Of a node, in the order in which a message meets them."""


@dataclass(frozen=True)
class NodeAnatomy:
    """What a node did in the observed iteration.

    Attributes:
        name: as in the spec; that of ROS for a node which the spec does not name.
        process: the process that it is in.
        wait: from the arrival of a message in the middleware to its take.
        take: of a message by the client library.
        dispatch: from the end of a take to its callback.
        callback: whole callbacks, of messages, timers and services.
        publish: calls that publish.
        threads: the threads that call the node's callbacks, by number.
        loads: in each of `WINDOWS` parts of the iteration, the time in callbacks of the node over
            the length of the part: above 1 where several threads call it at once.
        taken: how many messages it took, by topic.
        published: how many it published, by topic.
        overtaken: how many were sent to it and never taken, by topic: lost, overwritten in its
            queue, or still in it at the end.
    """

    name: str
    process: str
    wait: Seconds
    take: Seconds
    dispatch: Seconds
    callback: Seconds
    publish: Seconds
    threads: tuple[int, ...]
    loads: Seconds
    taken: Mapping[str, int]
    published: Mapping[str, int]
    overtaken: Mapping[str, int]

    @property
    def load(self) -> float:
        """The mean of the loads."""
        return float(np.mean(self.loads)) if self.loads.size else 0.0


@dataclass(frozen=True)
class Anatomy:
    """Where the time of messages went.

    Attributes:
        paths: to each monitor, by its name, those that most messages took first.
        nodes: the nodes of the graph, by name.
        transports: of each topic and service, from the stamp of the publisher's middleware to that
            of the reader's.
        monitored: how many messages each monitor received in the window.
        window_ns: the observed iteration, from its first step to the end of its last period.
        lost: events that were not written, for lack of room.
        left_out: rows that could not be.
        events: joined, for drawings of single messages.
    """

    paths: Mapping[str, tuple[Path, ...]]
    nodes: Mapping[str, NodeAnatomy]
    transports: Mapping[str, Seconds]
    monitored: Mapping[str, int]
    window_ns: tuple[int, int]
    lost: int
    left_out: int
    events: Events

    @cached_property
    def series(self) -> Mapping[str, Seconds]:
        """The values of each metric that has some, in seconds or as shares, by its name.

        ``NODE.callback``, ``NODE.wait``, ``NODE.take``, ``NODE.dispatch`` and ``NODE.publish`` have
        a value for each event, ``TOPIC.transport`` for each message, ``MONITOR.path`` the latency
        of each message of the monitor on the path that it followed, ``NODE.load`` a value for each
        of `WINDOWS` parts of the iteration, ``NODE.overtaken`` the share of the messages sent to
        the node that it never took, and ``path.NODE.share`` (or a topic's), for each message of
        every monitor, the share of its latency that it spent there, on the path that it followed.
        """
        found: dict[str, Seconds] = {}
        for name, node in self.nodes.items():
            for what in (*NODE_TIMES, "publish"):
                found[f"{name}.{what}"] = getattr(node, what)
            missed, taken = sum(node.overtaken.values()), sum(node.taken.values())
            found[f"{name}.load"] = node.loads
            found[f"{name}.overtaken"] = np.array(
                [missed / (missed + taken)] if missed + taken else []
            )
        for topic, transport in self.transports.items():
            found[f"{topic}.transport"] = transport
        for monitor, paths in self.paths.items():
            followed = [path.seconds[path.last] for path in paths]
            found[f"{monitor}.path"] = np.concatenate([np.empty(0), *followed])
        owners = dict.fromkeys(
            part.owner for paths in self.paths.values() for path in paths for part in path.parts
        )
        found |= {f"path.{owner}.share": self._shares(owner) for owner in owners}
        return {name: values for name, values in found.items() if values.size}

    def _shares(self, owner: str) -> Seconds:
        found = [np.empty(0)]
        for path in (path for paths in self.paths.values() for path in paths):
            spent = np.zeros(path.began_ns.size)
            for part in path.parts:
                if part.owner == owner:
                    spent += np.nan_to_num(part.seconds)
            counts = path.last & (path.seconds > 0)
            found.append(spent[counts] / path.seconds[counts])
        return np.concatenate(found)


def anatomy(
    record: AnatomyRecord,
    rows: Rows,
    plan: Plan,
    window_ns: tuple[int, int],
) -> Anatomy:
    """Join the events of an observed iteration.

    Rows that are missing, forged or damaged make parts unknown, or messages; they raise nothing.

    Args:
        record: what was observed.
        rows: of type `ANATOMY_DTYPE`.
        plan: the plan of the run.
        window_ns: the iteration, from its first step to the end of its last period.
    """
    events = join_events(record, rows, plan)
    live = plan.playback_mode == "live"
    search = PathSearch(events, find_causes(events), live=live, window=window_ns)
    takes = _takes_of_monitors(events, record, plan)
    # What was played in the window belongs to it, whenever the graph gets to it: without the
    # slowest messages, every percentile would be too small.
    ended_ns = window_ns[1] if live or not rows.size else int(rows["ended_ns"].max())
    counted_ns = window_ns[0], max(ended_ns, window_ns[1])
    within = _within(events.began_ns, counted_ns)
    for monitor in plan.monitors:
        if monitor.own_pace:
            # Of its outputs, those count that arrive while inputs are played.
            of_it = takes[monitor.name]
            takes[monitor.name] = of_it[_within(events.ended_ns[of_it], window_ns)]
    return Anatomy(
        paths={name: search.paths_to(name, places) for name, places in takes.items()},
        nodes={node.name: node for node in _nodes(events, record, window_ns, within)},
        transports=_transports(events, within),
        monitored={name: int(within[places].sum()) for name, places in takes.items()},
        window_ns=window_ns,
        lost=sum(process.lost for process in record.processes),
        left_out=events.left_out,
        events=events,
    )


def _within(times: Ints, window: tuple[int, int]) -> Mask:
    return np.asarray((times >= window[0]) & (times <= window[1]))


def _takes_of_monitors(events: Events, record: AnatomyRecord, plan: Plan) -> dict[str, Ints]:
    """Return the rows of the takes of each monitor."""
    readers: dict[str, frozenset[str]] = {
        monitor.name: frozenset(
            process.name
            for process in plan.processes
            if process.role in {"monitor", "harness", "player", "caller"}
            or (process.join is not None and monitor.name in process.join.monitors)
        )
        for monitor in plan.monitors
    }
    harness = events.names.is_harness[events.object]
    own = np.flatnonzero(events.is_take & harness)
    found: dict[str, Ints] = {}
    used: set[int] = set()
    for monitor in plan.monitors:
        numbers = [
            number
            for number, process in enumerate(record.processes)
            if process.name in readers[monitor.name]
        ]
        of_topic = own[_is_end(events, own, monitor, plan)]
        of_it = of_topic[np.isin(events.process[of_topic], numbers)]
        # Monitors of one topic have a subscription each.
        objects = [each for each in np.unique(events.object[of_it]) if each not in used]
        used.update(objects[:1])
        found[monitor.name] = of_it[np.isin(events.object[of_it], objects[:1])]
    return found


def _is_end(events: Events, takes: Ints, monitor: MonitorPlan, plan: Plan) -> Mask:
    """Return which takes are messages of a monitor, or answers to the calls that it stands for."""
    ends, kind = {monitor.topic}, AnatomyKind.TAKE
    if (call := plan.called.get(monitor.name)) is not None:
        of_action = f"{call.target}/_action"
        match monitor.name:
            case call.feedback:
                ends = {f"{of_action}/feedback"}
            case call.accepted:
                ends, kind = {f"{of_action}/send_goal"}, AnatomyKind.TAKE_RESPONSE
            case _:
                ends, kind = {call.target, f"{of_action}/get_result"}, AnatomyKind.TAKE_RESPONSE
    numbers = [number for number, name in enumerate(events.names.topics) if name in ends]
    is_end: Mask = np.isin(events.topic[takes], numbers) & (events.kind[takes] == kind)
    return is_end


def _transports(events: Events, within: Mask) -> dict[str, Seconds]:
    known = (
        events.is_take
        & within
        & (events.sent_ns != UNKNOWN_NS)
        & (events.received_ns != UNKNOWN_NS)
    )
    rows = np.flatnonzero(known)
    return {
        events.names.topics[number]: _timed(events.sent_ns, events.received_ns, of_topic)
        for number, of_topic in grouped(events.topic[rows], rows).items()
        if events.names.topics[number]
    }


def _timed(began_ns: Ints, ended_ns: Ints, rows: Ints) -> Seconds:
    """Durations of rows that have both times, by their begin."""
    rows = rows[(began_ns[rows] != UNKNOWN_NS) & (ended_ns[rows] >= began_ns[rows])]
    rows = rows[np.argsort(began_ns[rows], kind="stable")]
    took: Seconds = (ended_ns[rows] - began_ns[rows]) / 1e9
    return took


def _nodes(
    events: Events, record: AnatomyRecord, window: tuple[int, int], within: Mask
) -> Iterator[NodeAnatomy]:
    names = events.names
    harness = names.is_harness[events.object]
    node = events.node
    acts = (events.is_start | events.is_send) & ~harness & (events.object > 0)
    rows = np.flatnonzero(acts & within)
    overtaken = _overtaken(events, window)
    for number, of_node in grouped(node[rows], rows).items():
        starts = of_node[events.is_start[of_node]]
        takes = of_node[events.is_take[of_node]]
        sends = of_node[events.is_send[of_node]]
        yield NodeAnatomy(
            name=names.nodes[number],
            process=record.processes[int(events.process[of_node[0]])].name,
            wait=_timed(events.received_ns, events.began_ns, takes),
            take=_timed(events.began_ns, events.ended_ns, takes),
            dispatch=_timed(events.ended_ns, events.callback_began_ns, starts),
            callback=_timed(events.callback_began_ns, events.callback_ended_ns, starts),
            publish=_timed(events.began_ns, events.ended_ns, sends),
            threads=tuple(int(each) for each in np.unique(events.thread[starts])),
            loads=_loads(events, starts, window),
            taken=_counts(events, takes),
            # The client library announces what it publishes within a process, and may then publish
            # it to others, too.
            published=_counts(events, sends[events.is_intra[sends]])
            | _counts(events, sends[~events.is_intra[sends]]),
            overtaken=overtaken.get(number, {}),
        )


def _counts(events: Events, rows: Ints) -> dict[str, int]:
    numbers, counts = np.unique(events.topic[rows], return_counts=True)
    return {
        events.names.topics[number]: int(count)
        for number, count in zip(numbers, counts, strict=True)
        if events.names.topics[number]
    }


def _loads(events: Events, starts: Ints, window: tuple[int, int]) -> Seconds:
    """Return the callbacks that ran at a time, on average, in each part of the window."""
    began, ended = events.callback_began_ns[starts], events.callback_ended_ns[starts]
    known = (began != UNKNOWN_NS) & (ended >= began)
    width = (window[1] - window[0]) / WINDOWS
    if not known.any() or width <= 0:
        return np.empty(0)
    edges = np.linspace(0.0, float(window[1] - window[0]), WINDOWS + 1)
    first, last = (np.sort(times[known] - window[0]).astype(np.float64) for times in (began, ended))
    # The time in callbacks before t is the sum of min(end, t) - min(begin, t) over all of them.
    loads: Seconds = np.diff(clipped_sum(last, edges) - clipped_sum(first, edges)) / width
    return loads


_ON_ITS_WAY_NS: Final = 1_000_000_000


def _overtaken(events: Events, window: tuple[int, int]) -> dict[int, dict[str, int]]:
    """By node and topic: the publications that a subscription never took.

    A message that was sent after the last one that was taken may be still on its way, until it is
    older than `_ON_ITS_WAY_NS`. What a node gets within its process is not sent to it by the
    middleware as well.
    """
    old_ns = int(events.ended_ns.max(initial=0)) - _ON_ITS_WAY_NS
    found: dict[int, dict[str, int]] = {}
    names, topic = events.names, events.topic
    taken = np.flatnonzero(
        events.is_take
        & ~names.is_harness[events.object]
        & (events.send != NONE)
        & np.isin(events.kind, (AnatomyKind.TAKE, AnatomyKind.DEQUEUE))
    )
    sends = np.flatnonzero((events.kind == AnatomyKind.PUBLISH) & _within(events.began_ns, window))
    buffered = {
        (int(events.process[row]), int(topic[row]))
        for row in taken[np.unique(events.object[taken], return_index=True)[1]]
        if names.buffer[events.object[row]]
    }
    by_topic = grouped(topic[sends], sends)
    for of_object in grouped(events.object[taken], taken).values():
        row = of_object[0]
        process, number = int(events.process[row]), int(topic[row])
        sent = by_topic.get(number, np.empty(0, np.int64))
        local = events.process[sent] == process
        intra = events.is_intra[sent]
        if names.buffer[events.object[row]]:
            sent = sent[local & intra]
        else:
            sent = sent[~intra & ~(local & ((process, number) in buffered))]
        got = events.send[of_object]
        before = events.began_ns[sent] < max(int(events.began_ns[got].max()), old_ns)
        missed = int(np.count_nonzero(before & ~np.isin(sent, got)))
        own = found.setdefault(int(names.node_of[events.object[row]]), {})
        own[names.topics[number]] = own.get(names.topics[number], 0) + missed
    return found
