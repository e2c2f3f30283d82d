"""The paths of messages from inputs to monitors, and how long each part of a path took.

A path leads from a publication of the player to a message of a monitor, hop by hop: a send, its
take, the send that it caused. A node with several inputs has a path for each of them. The times of
a message on its path divide its end-to-end latency; with s the send of a hop and s' the next one,

    publish    of the node that sends: s begins .. the middleware has the message
    transport  of the topic: .. the middleware of the reader has received it
    wait       of the node that takes: .. its take begins
    take       .. the take ends
    dispatch   .. its callback begins
    callback   .. s' begins, or the callback ends
    held       where s' lies in another callback, or in none: .. that callback begins, or s' does.
               The message waits in the node for another input, a timer, or a thread

The path ends when the middleware of the monitor has received the message. A time that is not known,
or not between those that are, leaves what lies between its neighbours ``not seen``: of the topic up
to the end of the take, of the node after it. So the parts always add up to the end-to-end latency,
to the nanosecond.

In a live graph a path begins ``earlier`` than with a publication: with the header stamp of its
source, as the latency does.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from typing import TYPE_CHECKING, Final, Literal

import numpy as np

from r2bspec.judge.measure.anatomy_events import NONE, UNKNOWN_NS, Events, Ints, Mask
from r2bspec.judge.measure.times import Seconds

if TYPE_CHECKING:
    from r2bspec.judge.measure.anatomy_causes import Causes


PartName = Literal[
    "earlier",
    "publish",
    "transport",
    "wait",
    "take",
    "dispatch",
    "callback",
    "held",
    "not seen",
]

NOT_SEEN: Final = "not seen"

MAX_PATHS: Final = 32
"""Of one monitor; those that most messages took are kept."""

_OLDEST_STAMP_NS = 60 * 10**9
"""Older header stamps are of another clock, or of what was recorded."""

_MAX_STEPS = 1024
_MAX_FOUND = 4 * MAX_PATHS
"""Of the search for paths, which a graph whose nodes are all connected would make endless."""


@dataclass(frozen=True)
class Part:
    """A part of the time of each message on a path.

    Attributes:
        owner: the node or topic that the time belongs to.
        of: which of the two.
        name: what the time passed with.
        seconds: for each message; NaN where it was not seen.
    """

    owner: str
    of: Literal["node", "topic"]
    name: PartName
    seconds: Seconds


@dataclass(frozen=True)
class Path:
    """A path to a monitor, with the times of each message on it.

    Attributes:
        monitor: its name.
        hops: nodes and topics by turns, from the node of the first publication to the last topic.
        parts: in the order of time.
        began_ns: when the first publication of each message began (CLOCK_MONOTONIC).
        ended_ns: when the monitor had received it.
        last: whether the message followed the input on this path: those on the other paths to the
            same message of the monitor had been there before, and waited.
        by_timer: whether a node on the path published it without being caused by a message.
    """

    monitor: str
    hops: tuple[str, ...]
    parts: tuple[Part, ...]
    began_ns: Ints
    ended_ns: Ints
    last: Mask
    by_timer: Mask

    @property
    def seconds(self) -> Seconds:
        """The end-to-end latency of each message."""
        return (self.ended_ns - self.began_ns).astype(np.float64) / 1e9

    @property
    def name(self) -> str:
        """Its nodes and topics in a line."""
        return " → ".join((*self.hops, self.monitor))


@dataclass(frozen=True)
class _Chain:
    """Messages that took the same way so far, from the monitor back; a row each.

    `hops` are (send, take), the last hop first; `held`, for each hop but the last, says whether the
    next send lies outside the callback of its take.
    """

    member: Ints
    hops: tuple[tuple[Ints, Ints], ...]
    held: tuple[Mask, ...]
    last: Mask
    by_timer: Mask

    def only(self, which: Mask | Ints) -> _Chain:
        """Some of the messages; those of a place that is given twice, twice."""
        return _Chain(
            member=self.member[which],
            hops=tuple((send[which], take[which]) for send, take in self.hops),
            held=tuple(held[which] for held in self.held),
            last=self.last[which],
            by_timer=self.by_timer[which],
        )


class PathSearch:
    """Finds the paths to monitors in events.

    Args:
        events: joined.
        causes: the causes of their sends.
        live: whether the graph has its own source: then a path also begins with what no message
            has caused, at its header stamp.
        window: from when to when a path may begin.
    """

    def __init__(
        self, events: Events, causes: Causes, *, live: bool, window: tuple[int, int]
    ) -> None:
        self._events = events
        self._causes = causes
        self._live = live
        self._window = window
        self._end = events.end
        self._harness = events.names.is_harness[events.object]

    def paths_to(self, monitor: str, takes: Ints) -> tuple[Path, ...]:
        """Return the paths to a monitor, the most frequent first.

        Args:
            monitor: its name.
            takes: the rows of its takes.
        """
        known = takes[self._events.send[takes] != NONE]
        chain = _Chain(
            member=np.arange(known.size),
            hops=((self._events.send[known], known),),
            held=(),
            last=np.ones(known.size, np.bool_),
            by_timer=np.zeros(known.size, np.bool_),
        )
        self._steps = 0
        paths = [self._path(monitor, found) for found in islice(self._back(chain, ()), _MAX_FOUND)]
        return _most_used(paths)[:MAX_PATHS]

    def _back(self, chain: _Chain, seen: tuple[int, ...]) -> Iterator[_Chain]:
        """Yield the chains that a publication of the player begins, or a source of a live graph."""
        self._steps += 1
        if self._steps > _MAX_STEPS:
            return
        send = chain.hops[-1][0]
        for end in _by_count(self._end[send]):
            if end in seen:
                continue
            some = chain.only(self._end[send] == end)
            sends = some.hops[-1][0]
            begins = self._begins(sends)
            if begins.any():
                yield some.only(begins)
            if not begins.all():
                yield from self._before(some.only(~begins), (*seen, end))

    def _begins(self, sends: Ints) -> Mask:
        """Return which sends a path begins with."""
        begins = self._harness[sends]
        if self._live:
            first = np.searchsorted(self._causes.send, sends)
            at = np.minimum(first, max(self._causes.send.size - 1, 0))
            caused = np.zeros(sends.size, np.bool_)
            if self._causes.send.size:
                caused = (self._causes.send[at] == sends) & ~self._causes.by_timer[at]
            begins = begins | ~caused
        return begins

    def _before(self, chain: _Chain, seen: tuple[int, ...]) -> Iterator[_Chain]:
        """Yield the chains that are longer by the hop that caused their first send."""
        events, causes = self._events, self._causes
        send = chain.hops[-1][0]
        first = np.searchsorted(causes.send, send, side="left")
        count = np.searchsorted(causes.send, send, side="right") - first
        # One row for each cause of a message.
        row = np.repeat(np.arange(send.size), count)
        offset = np.arange(row.size) - np.repeat(np.cumsum(count) - count, count)
        cause = np.repeat(first, count) + offset
        take = causes.take[cause]
        known = events.send[take] != NONE
        row, cause, take = row[known], cause[known], take[known]
        for end in _by_count(self._end[take]):
            chosen = self._end[take] == end
            taken = take[chosen]
            of = chain.only(row[chosen])
            which = cause[chosen]
            longer = _Chain(
                member=of.member,
                hops=(*of.hops, (events.send[taken], taken)),
                held=(*of.held, causes.held[which]),
                last=of.last & causes.last[which],
                by_timer=of.by_timer | causes.by_timer[which],
            )
            yield from self._back(longer, seen)

    def _path(self, monitor: str, chain: _Chain) -> Path:
        events = self._events
        began = events.began_ns[chain.hops[-1][0]]
        chain = chain.only((began >= self._window[0]) & (began <= self._window[1]))
        hops, held = chain.hops[::-1], chain.held[::-1]
        times = _Times(events, hops, held)
        chain = chain.only(times.sound)
        hops = chain.hops[::-1]
        order = np.argsort(times.began_ns, kind="stable")
        names = events.names
        named: list[str] = []
        for send, _ in hops:
            if send.size:
                of = events.object[send[0]]
                named += (names.nodes[names.node_of[of]], names.topics[names.topic_of[of]])
        path = Path(
            monitor=monitor,
            hops=tuple(named),
            parts=times.parts(named, order) if order.size else (),
            began_ns=times.began_ns[order],
            ended_ns=times.ended_ns[order],
            last=chain.last[order],
            by_timer=chain.by_timer[order],
        )
        return self._from_stamp(path, hops[0][0][order]) if self._live and order.size else path

    def _from_stamp(self, path: Path, sends: Ints) -> Path:
        """Return the path from the header stamp of its first message on, if it can begin there."""
        stamped = self._events.stamped_ns[sends]
        possible = (stamped <= path.began_ns) & (stamped > path.began_ns - _OLDEST_STAMP_NS)
        began_ns = np.where(possible, stamped, path.began_ns)
        seconds = (path.began_ns - began_ns) / 1e9
        earlier = Part(owner=path.hops[0], of="node", name="earlier", seconds=seconds)
        return replace(path, parts=(earlier, *path.parts), began_ns=began_ns)


def _most_used(paths: list[Path]) -> tuple[Path, ...]:
    """Return those with messages, the one first that most of them took last."""
    full = [path for path in paths if path.began_ns.size]
    full.sort(key=lambda path: (-int(np.count_nonzero(path.last)), -path.began_ns.size))
    return tuple(full)


def _by_count(values: Ints) -> list[int]:
    """Return the different values, the most frequent first."""
    found, count = np.unique(values, return_counts=True)
    return [int(value) for value in found[np.argsort(-count, kind="stable")]]


class _Times:
    """The times of messages on a path, in a table with a row for each time and a column each.

    A row belongs to a hop, and the part that begins with it has a name. Those of `anchors` are
    always known.
    """

    def __init__(
        self, events: Events, hops: Sequence[tuple[Ints, Ints]], held: Sequence[Mask]
    ) -> None:
        self._rows: list[Ints] = []
        self._parts: list[tuple[int, PartName]] = []
        self._anchors: list[int] = []
        for number, (send, take) in enumerate(hops):
            self._add(number, "publish", events.began_ns[send], anchor=True)
            self._add(number, "transport", events.sent_ns[take])
            if number + 1 < len(hops):
                self._add(number, "wait", events.received_ns[take])
                self._add(number, "take", events.began_ns[take])
                self._inside(events, number, take, hops[number + 1][0], held[number])
            else:
                self._add(number, NOT_SEEN, events.received_ns[take])
                self._add(number, NOT_SEEN, _arrival(events, send, take), anchor=True)
        table = np.array(self._rows)
        anchored = table[self._anchors]
        self.sound: Mask = np.all(np.diff(anchored, axis=0) >= 0, axis=0)
        self._table = table[:, self.sound]
        self._known = self._between()

    def _add(self, hop: int, part: PartName, times: Ints, *, anchor: bool = False) -> None:
        if anchor:
            self._anchors.append(len(self._rows))
        self._rows.append(times)
        self._parts.append((hop, part))

    def _inside(self, events: Events, number: int, take: Ints, send: Ints, held: Mask) -> None:
        """The times from the end of a take to the send that it caused."""
        published = events.began_ns[send]
        ended = events.callback_ended_ns[take]
        within = events.within[send]
        other = np.where(within == NONE, published, events.callback_began_ns[within])
        # A callback in another thread may go on while the message is already published.
        ended = np.where(ended == UNKNOWN_NS, ended, np.minimum(ended, published))
        other = np.where(
            (other == UNKNOWN_NS) | (ended == UNKNOWN_NS), other, np.maximum(other, ended)
        )
        self._add(number, "dispatch", np.minimum(events.ended_ns[take], published), anchor=True)
        self._add(number, "callback", events.callback_began_ns[take])
        self._add(number, "held", np.where(held, ended, published))
        self._add(number, "callback", np.where(held, other, published))

    def _between(self) -> Mask:
        """Return which times are known, and in order."""
        table = self._table
        number = np.arange(len(table))
        anchors = np.array(self._anchors)
        before = anchors[np.searchsorted(anchors, number, side="right") - 1]
        after = anchors[np.searchsorted(anchors, number, side="left")]
        known: Mask = (table >= table[before]) & (table <= table[after])
        latest = np.maximum.accumulate(np.where(known, table, UNKNOWN_NS), axis=0)
        known &= table == latest
        return known

    @property
    def began_ns(self) -> Ints:
        """The first time of each message."""
        began: Ints = self._table[0]
        return began

    @property
    def ended_ns(self) -> Ints:
        """The last time of each message."""
        ended: Ints = self._table[-1]
        return ended

    def parts(self, named: Sequence[str], order: Ints) -> tuple[Part, ...]:
        """Return the parts, in the order of time.

        Args:
            named: nodes and topics by turns.
            order: the order of the messages.
        """
        took = np.diff(self._table, axis=0)
        seen = self._known[1:] & self._known[:-1]
        # A callback that the message left and another in which it was sent are one part.
        sums: dict[tuple[int, PartName], tuple[Ints, Mask]] = {}
        for (hop, name), ns, known in zip(self._parts[:-1], took, seen, strict=True):
            ns = np.where(known, ns, 0)
            total, some = sums.get((hop, name), (0, known))
            sums[hop, name] = (total + ns, some | (ns > 0))
        found: list[Part] = []
        for place, (start, stop) in enumerate(zip(self._anchors, self._anchors[1:], strict=False)):
            hop = self._parts[start][0]
            names = dict.fromkeys(part for part in self._parts[start:stop] if part[1] != NOT_SEEN)
            for each in names:
                ns, known = sums[each]
                if each[1] == "held" and not ns.any():
                    continue
                owner, of = _owner(named, *each)
                seconds = np.where(known, ns / 1e9, np.nan)[order]
                found.append(Part(owner=owner, of=of, name=each[1], seconds=seconds))
            whole = self._table[stop] - self._table[start]
            rest = whole - sum(sums[each][0] for each in names)
            if rest.any():
                of_topic = place % 2 == 0
                owner = named[2 * hop + 1] if of_topic else named[2 * hop + 2]
                found.append(
                    Part(
                        owner=owner,
                        of="topic" if of_topic else "node",
                        name=NOT_SEEN,
                        seconds=rest[order] / 1e9,
                    )
                )
        return tuple(found)


def _owner(named: Sequence[str], hop: int, part: PartName) -> tuple[str, Literal["node", "topic"]]:
    if part == "publish":
        return named[2 * hop], "node"
    if part == "transport":
        return named[2 * hop + 1], "topic"
    return named[2 * hop + 2], "node"


def _arrival(events: Events, send: Ints, take: Ints) -> Ints:
    """Return the time of reception, else the begin or the end of the take."""
    received, began = events.received_ns[take], events.began_ns[take]
    sent = events.began_ns[send]
    arrived = np.where(began >= sent, began, events.ended_ns[take])
    return np.where((received != UNKNOWN_NS) & (received >= sent), received, arrived)
