"""The events of processes that were observed from inside, joined: messages and callbacks.

A *send* is a publication, a request, a response, or the storing of a message in a buffer within a
process; a *take* is the other end of it. Both have the same stamp of the middleware (requests: the
same number; buffers: the same place), and a take belongs to the newest send with that stamp before
its end. A *start* is a take or the call of a timer: what a callback begins with.

The callback of a start is, by what its thread runs,

* rclcpp: the callback that says so itself, before the thread's next start or wait; of actions and
  responses, which never say it, the time from the end of the start to the next start or wait;
* rclpy: from the first guard condition after the start to the last one before the thread's next
  start or wait, because its executor triggers one before and one after each callback;
* otherwise, for programs on rcl: from the end of the start to the thread's next start or wait.

Rows that cannot be are left out and counted. Times are CLOCK_MONOTONIC nanoseconds.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from r2bspec.judge.measure.times import Seconds
from r2bspec.plan.plan import HARNESS_ROLES, Plan
from r2bspec.record.run_record import AnatomyKind, AnatomyRecord
from r2bspec.record.sample_arrays import Rows

Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]

NONE: Final = -1
"""In arrays of row numbers: no such row."""

UNKNOWN_NS: Final = -(1 << 62)
"""In arrays of times: a time that is not known."""

HARNESS: Final = "/r2bspec/"
"""The namespace of the nodes of player and monitor."""

_EMPTY_FLAG, _INTRA_FLAG = 1, 2

_CLOCK_TOLERANCE_NS = 100_000
"""The two clocks of a row are read one after the other; what differs by more is not believed."""

_SENDS = (
    AnatomyKind.PUBLISH,
    AnatomyKind.SEND_REQUEST,
    AnatomyKind.SEND_RESPONSE,
    AnatomyKind.ENQUEUE,
)
_TAKES = (
    AnatomyKind.TAKE,
    AnatomyKind.TAKE_REQUEST,
    AnatomyKind.TAKE_RESPONSE,
    AnatomyKind.DEQUEUE,
)
_MAY_BE_SILENT = (AnatomyKind.TAKE, AnatomyKind.TAKE_REQUEST, AnatomyKind.TAKE_RESPONSE)
"""Of rclcpp: what is taken for actions and clients, whose callbacks it traces nowhere."""

_MAY_LACK_OBJECT = (AnatomyKind.WAIT, AnatomyKind.TRIGGER, AnatomyKind.CALLBACK)


class Names:
    """The names in the spec to which rows belong.

    Attributes:
        nodes: the names of nodes, by number: the key in the spec where a node has one.
        topics: the names of topics and services, by number.
        node_of: the number of the node of each object; the first object is none.
        topic_of: the number of its topic or service.
        is_harness: whether it is one of the player, the monitor or the loader.
        buffer: whether it is a buffer within a process.
    """

    def __init__(self, record: AnatomyRecord, plan: Plan) -> None:
        keys = {
            (process.name, node.name): node.node
            for process in plan.processes
            for node in process.nodes
        }
        anywhere = {node: key for (_, node), key in keys.items()}
        alone = {
            process.name: process.nodes[0].node
            for process in plan.processes
            if len(process.nodes) == 1
        }
        harness = {each.name for each in plan.processes if each.role in HARNESS_ROLES}
        processes = [process.name for process in record.processes]
        # A program may name its node otherwise than the spec; a launch file has several.
        ros_names: dict[str, set[str]] = {}
        for each in record.objects:
            if 0 <= each.process < len(processes) and not each.node.startswith(HARNESS):
                ros_names.setdefault(processes[each.process], set()).add(each.node)
        renamed = {
            name: key for name, key in alone.items() if len(ros_names.get(name, set()) - {""}) == 1
        }
        nodes: dict[str, int] = {"": 0}
        topics: dict[str, int] = {"": 0}
        node_of, topic_of, is_harness = [0], [0], [False]
        for each in record.objects:
            process = processes[each.process] if 0 <= each.process < len(processes) else ""
            own = each.node.startswith(HARNESS) or (not each.node and process in harness)
            if own:
                name = each.node.removeprefix(HARNESS) or process
            elif each.node:
                name = (
                    keys.get((process, each.node))
                    or anywhere.get(each.node)
                    or renamed.get(process, each.node)
                )
            else:
                name = alone.get(process, process)
            node_of.append(nodes.setdefault(name, len(nodes)))
            topic_of.append(topics.setdefault(each.name, len(topics)))
            is_harness.append(own)
        self.nodes = tuple(nodes)
        self.topics = tuple(topics)
        self.node_of: Ints = np.array(node_of, np.int64)
        self.topic_of: Ints = np.array(topic_of, np.int64)
        self.is_harness: Mask = np.array(is_harness, np.bool_)
        self.buffer: Mask = np.array(
            [False, *(each.kind == "buffer" for each in record.objects)], np.bool_
        )


@dataclass(frozen=True)
class Events:
    """Events by thread, and within a thread by the time at which they began.

    Every array has a value for each row.

    Attributes:
        names: the names of nodes and topics.
        kind: an `AnatomyKind`.
        object: from 1 on; 0 is none.
        process: the number of the process.
        thread: the number of the thread, from 0 on.
        began_ns: the begin.
        ended_ns: the end.
        source: the stamp of the middleware; the number of requests and responses.
        header_ns: the header stamp, a number of the goal of an action, or 0.
        stamped_ns: the header stamp as a time; `UNKNOWN_NS` where there is none.
        send: of a take, the row of its publication, request or response; else `NONE`.
        sent_ns: of a take, when the middleware had its message; `UNKNOWN_NS` where not known.
        received_ns: of a take, when the middleware had received it; likewise.
        is_take: whether something was taken.
        is_send: whether something was sent; what a buffer stores is not, but the publication is.
        is_intra: whether it is a publication within a process, by the client library.
        is_start: whether a callback begins with it.
        callback_began_ns: of a start, the begin of its callback; `UNKNOWN_NS` where not known.
        callback_ended_ns: likewise its end.
        within: of a send, the start in whose callback it lies; else `NONE`.
        left_out: how many rows could not be.
    """

    names: Names
    kind: Ints
    object: Ints
    process: Ints
    thread: Ints
    began_ns: Ints
    ended_ns: Ints
    source: Ints
    header_ns: Ints
    stamped_ns: Ints
    send: Ints
    sent_ns: Ints
    received_ns: Ints
    is_take: Mask
    is_send: Mask
    is_intra: Mask
    is_start: Mask
    callback_began_ns: Ints
    callback_ended_ns: Ints
    within: Ints
    left_out: int

    @cached_property
    def node(self) -> Ints:
        """The number of the node of each row."""
        return self.names.node_of[self.object]

    @cached_property
    def topic(self) -> Ints:
        """The number of the topic or service of each row."""
        return self.names.topic_of[self.object]

    @cached_property
    def end(self) -> Ints:
        """A number for node and topic (or service and direction); equal for equal pairs."""
        way = np.isin(self.kind, (AnatomyKind.SEND_RESPONSE, AnatomyKind.TAKE_RESPONSE))
        return (self.node * len(self.names.topics) + self.topic) * 2 + way


def join_events(record: AnatomyRecord, rows: Rows, plan: Plan) -> Events:
    """Return the events of a record, joined.

    Args:
        record: what was observed.
        rows: of type `ANATOMY_DTYPE`, in any order.
        plan: the plan of the run, for the names of nodes.
    """
    names = Names(record, plan)
    sound = _sound(record, rows)
    left_out = int(rows.size - np.count_nonzero(sound))
    where = rows["process"].astype(np.int64) << 32 | rows["thread"]
    order = np.lexsort((rows["began_ns"], where))
    rows = rows[order[sound[order]]]
    column = {name: rows[name].astype(np.int64) for name in rows.dtype.names or ()}
    kind, began = column["kind"], column["began_ns"]
    thread = _numbered(column["process"] << 32 | column["thread"])
    ended = np.maximum(column["ended_ns"], began)
    empty = (column["flags"] & _EMPTY_FLAG) != 0
    is_take = np.isin(kind, _TAKES) & ~empty
    is_start = is_take | (kind == AnatomyKind.TIMER)
    callback_began, callback_ended, until = _callbacks(
        kind, thread, column["object"], began, ended, column["ended_ns"], is_start
    )
    hangs = _hanging(kind, thread, column["object"], is_start, callback_began, callback_ended)
    callback_began[hangs] = np.where(
        callback_began[hangs] == UNKNOWN_NS, ended[hangs], callback_began[hangs]
    )
    # It lasts for longer: as long as there are events.
    callback_ended[hangs] = ended.max(initial=0)
    intra = (kind == AnatomyKind.PUBLISH) & ((column["flags"] & _INTRA_FLAG) != 0)
    send, sent, received = _messages(names, column, thread, ended, is_take, intra)
    is_send = np.isin(kind, _SENDS) & (kind != AnatomyKind.ENQUEUE)
    start = _previous(is_start, thread)
    header = column["header_ns"]
    inside = is_send & (start != NONE) & (began <= until[start])
    return Events(
        names=names,
        kind=kind,
        object=column["object"],
        process=column["process"],
        thread=thread,
        began_ns=began,
        ended_ns=ended,
        source=column["source_ns"],
        header_ns=header,
        stamped_ns=np.where(header == 0, UNKNOWN_NS, header - column["clock_ns"]),
        send=send,
        sent_ns=sent,
        received_ns=received,
        is_take=is_take,
        is_send=is_send,
        is_intra=intra,
        is_start=is_start,
        callback_began_ns=callback_began,
        callback_ended_ns=callback_ended,
        within=np.where(inside, start, NONE),
        left_out=left_out,
    )


def _numbered(ascending: Ints) -> Ints:
    """Values in their order as numbers from 0 on."""
    return np.cumsum(np.append(0, ascending[1:] != ascending[:-1]))[: ascending.size]


def _sound(record: AnatomyRecord, rows: Rows) -> Mask:
    """Return which rows can be: of a known kind, process and object, at a time."""
    kinds = rows["kind"]
    sound: Mask = (
        np.isin(kinds, [*AnatomyKind])
        & (rows["process"] < len(record.processes))
        & (rows["object"] <= len(record.objects))
        & ((rows["object"] > 0) | np.isin(kinds, _MAY_LACK_OBJECT))
        & (rows["began_ns"] > 0)
    )
    return sound


def _next(mask: Mask, thread: Ints) -> Ints:
    """Return for each row the next row of its thread that the mask selects, or `NONE`."""
    places = np.append(np.flatnonzero(mask), NONE)
    found = places[np.cumsum(mask)]
    return np.where((found != NONE) & (thread[found] == thread), found, NONE)


def _previous(mask: Mask, thread: Ints) -> Ints:
    """Return for each row the previous row of its thread that the mask selects, or `NONE`."""
    places = np.append(np.flatnonzero(mask), NONE)
    found = places[np.cumsum(mask) - mask - 1]
    return np.where((found != NONE) & (thread[found] == thread), found, NONE)


def _callbacks(
    kind: Ints, thread: Ints, of: Ints, began: Ints, ended: Ints, said_end: Ints, is_start: Mask
) -> tuple[Ints, Ints, Ints]:
    """Begin and end of the callback of each start, and up to when it may publish."""
    size = kind.size
    is_callback = kind == AnatomyKind.CALLBACK
    is_trigger = kind == AnatomyKind.TRIGGER
    breaks = is_start | (kind == AnatomyKind.WAIT) | np.isin(kind, _TAKES)
    starts = np.flatnonzero(is_start)
    rows_of = np.bincount(thread, minlength=1).cumsum()
    after = _next(breaks, thread)[starts]
    stop = np.where(after == NONE, rows_of[thread[starts]], after)
    of_rclcpp = np.bincount(thread[is_callback], minlength=rows_of.size) > 0
    # Of the guard conditions between a start and what ends it.
    triggered = np.concatenate(([0], np.cumsum(is_trigger)))
    first, last = triggered[starts + 1], triggered[stop]
    paired = last - first >= 2
    share = np.bincount(thread[starts], paired, minlength=rows_of.size)
    of_rclpy = share * 2 >= np.maximum(np.bincount(thread[starts], minlength=rows_of.size), 1)
    triggers = np.append(np.flatnonzero(is_trigger), 0)

    callback_began, callback_ended = np.full((2, size), UNKNOWN_NS, np.int64)
    until = np.where(after == NONE, np.iinfo(np.int64).max, began[after])
    cpp = of_rclcpp[thread[starts]]
    python = ~cpp & of_rclpy[thread[starts]]

    callback = _next(is_callback, thread)[starts]
    seen = cpp & (callback != NONE) & (callback < stop)
    silent = ~np.isin(of[starts], of[starts[seen]]) & np.isin(kind[starts], _MAY_BE_SILENT)
    plain = ~python & (~cpp | silent)
    callback_began[starts[seen]] = began[callback[seen]]
    whole = seen & (said_end[callback] >= began[callback])
    callback_ended[starts[whole]] = ended[callback[whole]]
    until[whole] = ended[callback[whole]]

    seen = python & paired
    callback_began[starts[seen]] = ended[triggers[first[seen]]]
    callback_ended[starts[seen]] = began[triggers[last[seen] - 1]]
    until[seen] = callback_ended[starts[seen]]

    callback_began[starts[plain]] = ended[starts[plain]]
    whole = plain & (after != NONE)
    callback_ended[starts[whole]] = began[after[whole]]
    limit = np.full(size, UNKNOWN_NS, np.int64)
    limit[starts] = until
    return callback_began, callback_ended, limit


def _hanging(
    kind: Ints, thread: Ints, of: Ints, is_start: Mask, began_ns: Ints, ended_ns: Ints
) -> Ints:
    """Return the starts in whose callbacks a thread was when the last event was written.

    They are the last ones of threads that say when callbacks end, which those of C on rcl do not,
    and every earlier message of the same subscription, or call of the timer, had a whole callback.
    """
    says = np.isin(kind, (AnatomyKind.CALLBACK, AnatomyKind.TRIGGER))
    breaks = is_start | (kind == AnatomyKind.WAIT) | np.isin(kind, _TAKES)
    starts = np.flatnonzero(is_start)
    whole = (began_ns[starts] != UNKNOWN_NS) & (ended_ns[starts] != UNKNOWN_NS)
    last = (_next(breaks, thread)[starts] == NONE) & ~whole
    last &= np.bincount(thread[says], minlength=int(thread.max(initial=0)) + 1)[thread[starts]] > 0
    earlier, others = starts[whole], starts[~whole & ~last]
    last &= np.isin(of[starts], of[earlier]) & ~np.isin(of[starts], of[others])
    hanging: Ints = starts[last]
    return hanging


def _messages(
    names: Names, column: dict[str, Ints], thread: Ints, ended: Ints, is_take: Mask, intra: Mask
) -> tuple[Ints, Ints, Ints]:
    """Of each take: its send, and when the middleware had sent and received its message."""
    kind, began, source = column["kind"], column["began_ns"], column["source_ns"]
    topic = names.topic_of[column["object"]]
    way = np.zeros(int(max(AnatomyKind)) + 1, np.int64)
    way[[AnatomyKind.SEND_REQUEST, AnatomyKind.TAKE_REQUEST]] = 1
    way[[AnatomyKind.SEND_RESPONSE, AnatomyKind.TAKE_RESPONSE]] = 2
    channel = topic * 4 + way[kind]
    in_buffer = (kind == AnatomyKind.ENQUEUE) | (kind == AnatomyKind.DEQUEUE)
    channel[in_buffer] = column["object"][in_buffer] * 4 + 3
    by_stamp = (kind == AnatomyKind.PUBLISH) | (kind == AnatomyKind.TAKE)
    can_match = ~by_stamp | (source != 0)
    sends = np.flatnonzero(np.isin(kind, _SENDS) & can_match)
    takes = np.flatnonzero(is_take & can_match)
    send = np.full(kind.size, NONE, np.int64)
    send[takes] = newest_before(
        (channel[sends], source[sends]), began[sends], (channel[takes], source[takes]), ended[takes]
    )
    send[takes] = np.where(send[takes] == NONE, NONE, np.append(sends, NONE)[send[takes]])
    # Several publishers of a topic may have had the same stamp: the header tells them apart.
    header = column["header_ns"]
    doubtful = takes[
        (send[takes] != NONE)
        & (header[takes] != 0)
        & (header[send[takes]] != 0)
        & (header[send[takes]] != header[takes])
    ]
    if doubtful.size:
        keys = [(channel[of], source[of], header[of]) for of in (sends, doubtful)]
        found = newest_before(keys[0], began[sends], keys[1], ended[doubtful])
        send[doubtful] = np.where(found == NONE, NONE, np.append(sends, NONE)[found])

    sent = np.full(kind.size, UNKNOWN_NS, np.int64)
    received = np.full(kind.size, UNKNOWN_NS, np.int64)
    matched = takes[send[takes] != NONE]
    to = send[matched]
    sent[matched] = np.where(
        by_stamp[matched],
        _believed(source[to] - column["clock_ns"][to], began[to], ended[to]),
        np.where(in_buffer[matched], began[to], ended[to]),
    )
    stamped = is_take & (column["received_ns"] != 0)
    received[stamped] = column["received_ns"][stamped] - column["clock_ns"][stamped]
    # A request, or a response, may arrive before the call that sends it returns.
    early = matched[~by_stamp[matched] & ~in_buffer[matched] & stamped[matched]]
    arrived = _believed(received[early], began[send[early]], sent[early])
    sent[early] = np.where(arrived == UNKNOWN_NS, sent[early], arrived)
    # On one clock with what came before: a message is received after it was sent, and before it
    # is taken, but for the inaccuracy of the clocks.
    floor = np.maximum(sent, np.where(send == NONE, UNKNOWN_NS, began[send]))
    low = np.where(floor == UNKNOWN_NS, received, floor)
    received = _believed(received, low, np.maximum(began, low))
    buffered = matched[in_buffer[matched]]
    received[buffered] = ended[send[buffered]]
    # What a buffer stores was published just before, in the same thread.
    published = _previous(intra, thread)
    before = published[send[buffered]]
    same = (before != NONE) & (topic[before] == topic[send[buffered]])
    send[buffered] = np.where(same, before, NONE)
    return send, sent, received


def _believed(times: Ints, low: Ints, high: Ints) -> Ints:
    """Times within bounds, or near them and then moved to them; others are unknown."""
    near = (times >= low - _CLOCK_TOLERANCE_NS) & (times <= high + _CLOCK_TOLERANCE_NS)
    return np.where(near, np.clip(times, low, high), UNKNOWN_NS)


def clipped_sum(times: Seconds, limits: Seconds) -> Seconds:
    """Return for each limit the sum of min(time, limit), of ascending times."""
    count = np.searchsorted(times, limits)
    sums: Seconds = np.concatenate(([0.0], np.cumsum(times)))[count]
    return sums + (times.size - count) * limits


def grouped(values: Ints, rows: Ints) -> dict[int, Ints]:
    """Return the rows of each value, in their order; `values` has an entry for each row."""
    order = np.argsort(values, kind="stable")
    values, rows = values[order], rows[order]
    begins = np.flatnonzero(np.append(True, values[1:] != values[:-1])[: values.size])
    return dict(zip(values[begins].tolist(), np.split(rows, begins[1:]), strict=False))


def newest_before(
    keys: tuple[Ints, ...], times: Ints, asked_keys: tuple[Ints, ...], asked_times: Ints
) -> Ints:
    """Return for each question the place of the newest entry, not later, with the same keys.

    Args:
        keys: the keys of the entries, in one or several arrays.
        times: the times of the entries.
        asked_keys: the keys of the questions.
        asked_times: the times of the questions.

    Returns:
        places in the arrays of the entries, or `NONE`.
    """
    count = times.size
    mixed = np.zeros(count + asked_times.size, np.uint64)
    together = [np.concatenate(pair) for pair in zip(keys, asked_keys, strict=True)]
    for key in together:
        mixed = (mixed ^ key.view(np.uint64)) * _ODD
        mixed ^= mixed >> np.uint64(29)
    # The sort is stable, so that an entry comes before a question at the same time.
    order = np.lexsort((np.concatenate((times, asked_times)), mixed))
    newest = np.maximum.accumulate(np.where(order < count, np.arange(order.size), NONE))
    place = np.full(order.size, NONE, np.int64)
    known = newest != NONE
    place[order[known]] = order[newest[known]]
    asked = place[count:]
    same = asked != NONE
    for key in together:
        same &= key[asked] == key[count:]
    return np.where(same, asked, NONE)


_ODD: Final = np.uint64(0x9E3779B97F4A7C15)
"""2^64 divided by the golden ratio: Knuth's multiplicative hash. What collides is compared."""
