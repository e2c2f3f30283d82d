"""What caused each message that a graph sent, determined from events.

The causes of a send, whether publication, request or response, are

* of a response, the request that it answers; of the result of an action, the request that brought
  its goal, because the goal is executed whether or not the result has been asked for;
* for each subscription of the node, the newest take with its header stamp, if there is one; and
  the take in whose callback it lies;
* where it lies in no callback, but a take with its header stamp has sent a request: the newest
  response before it to such a request. What awaits a response in rclpy is called outside of
  callbacks;
* without any of these, because a timer or a thread of the node's own sends it: for each
  subscription of the node, the newest take.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from r2bspec.judge.measure.anatomy_events import NONE, Events, Ints, Mask, grouped, newest_before
from r2bspec.record.run_record import AnatomyKind


@dataclass(frozen=True)
class Causes:
    """The causes of sends as pairs of rows, by ascending send.

    Attributes:
        send: the rows of the sends.
        take: the rows of the takes that caused them.
        last: whether the send followed this take: it lies in the callback of the take, or in no
            callback, and the take is the newest. Each send with causes has one such take.
        held: whether the send does not lie in the callback of the take.
        by_timer: whether nothing is known of the cause but that the take came before.
    """

    send: Ints
    take: Ints
    last: Mask
    held: Mask
    by_timer: Mask


def find_causes(events: Events) -> Causes:
    """Return the causes of all sends except those of the harness."""
    harness = events.names.is_harness[events.object]
    sends = np.flatnonzero(events.is_send & ~harness)
    takes = np.flatnonzero(events.is_take & ~harness)
    asked = _asked(events, sends, takes)
    # A client library answers requests for the result of an action itself: no callback is theirs.
    takes = takes[~_asks_for_result(events, takes)]
    known = _joined([asked, _by_header(events, sends, takes)])
    pairs = [known, _within(events, sends, asked[0]), _answered(events, known, takes)]
    send, take = _unique_ends(events, pairs)
    alone = sends[~np.isin(sends, send)]
    newest = _joined([*_newest(events, alone, takes)])
    by_timer = np.arange(send.size + newest[0].size) >= send.size
    send, take = _joined([(send, take), newest])
    held = events.within[send] != take
    order = np.lexsort((events.ended_ns[take], ~held, send))
    send, take, held, by_timer = send[order], take[order], held[order], by_timer[order]
    last = np.append(send[1:] != send[:-1], np.ones(min(send.size, 1), np.bool_))
    return Causes(send=send, take=take, last=last, held=held, by_timer=by_timer)


Pairs = tuple[Ints, Ints]
"""Rows of sends, and of the takes that caused them."""


def _asked(events: Events, sends: Ints, takes: Ints) -> Pairs:
    """Return for each response the newest take of the request with its number, or of its goal."""
    responses = sends[events.kind[sends] == AnatomyKind.SEND_RESPONSE]
    requests = takes[events.kind[takes] == AnatomyKind.TAKE_REQUEST]
    place = newest_before(
        (events.object[requests], events.source[requests]),
        events.ended_ns[requests],
        (events.object[responses], events.source[responses]),
        events.began_ns[responses],
    )
    responses, asked = responses[place != NONE], requests[place[place != NONE]]
    # A goal and the request for its result begin with its id, whose number is in their rows.
    place = newest_before(
        (events.header_ns[requests], _asks_for_result(events, requests).astype(np.int64)),
        events.ended_ns[requests],
        (events.header_ns[asked], np.zeros(asked.size, np.int64)),
        events.began_ns[responses],
    )
    has_goal = _asks_for_result(events, asked) & (events.header_ns[asked] != 0) & (place != NONE)
    return responses, np.where(has_goal, np.append(requests, NONE)[place], asked)


def _asks_for_result(events: Events, takes: Ints) -> Mask:
    numbers = [
        number
        for number, name in enumerate(events.names.topics)
        if name.endswith("/_action/get_result")
    ]
    is_request = events.kind[takes] == AnatomyKind.TAKE_REQUEST
    asks: Mask = np.isin(events.topic[takes], numbers) & is_request
    return asks


def _by_header(events: Events, sends: Ints, takes: Ints) -> Pairs:
    """Return for each subscription of a send's node the newest take with the same header stamp."""
    found = [
        _matching(events, of_node, of_end)
        for of_node, of_end in _ends_of_nodes(events, sends, takes)
    ]
    return _joined(found)


def _matching(events: Events, sends: Ints, takes: Ints) -> Pairs:
    sends = sends[events.header_ns[sends] != 0]
    place = newest_before(
        (events.header_ns[takes],),
        events.ended_ns[takes],
        (events.header_ns[sends],),
        events.began_ns[sends],
    )
    return sends[place != NONE], takes[place[place != NONE]]


def _newest(events: Events, sends: Ints, takes: Ints) -> Iterator[Pairs]:
    """Return for each subscription of a send's node the newest take."""
    for of_node, of_end in _ends_of_nodes(events, sends, takes):
        in_time = of_end[np.argsort(events.ended_ns[of_end], kind="stable")]
        count = np.searchsorted(events.ended_ns[in_time], events.began_ns[of_node], side="right")
        some = count > 0
        yield of_node[some], in_time[count[some] - 1]


def _ends_of_nodes(events: Events, sends: Ints, takes: Ints) -> Iterator[Pairs]:
    """Yield the sends of a node, with the takes of each of its subscriptions in turn.

    A node that takes nothing belongs to the other nodes of its process, as a node does that a
    program has for its publishers alone.
    """
    node, process = events.node, events.process
    lonely = ~np.isin(node[sends], np.unique(node[takes]))
    by_node = grouped(node[sends], sends)
    by_process = grouped(process[sends[lonely]], sends[lonely])
    none = np.empty(0, np.int64)
    for of_end in grouped(events.end[takes], takes).values():
        row = of_end[0]
        own = by_node.get(int(node[row]), none), by_process.get(int(process[row]), none)
        of_node = np.concatenate(own)
        if of_node.size:
            yield of_node, of_end


def _within(events: Events, sends: Ints, asked: Ints) -> Pairs:
    """Return the take in whose callback each send lies.

    An action server of rclpy takes several requests before it answers the first: the last of these
    is no cause of responses whose request is known.

    Args:
        events: joined.
        sends: the rows of the sends.
        asked: those of them that answer a known request.
    """
    start = events.within[sends]
    known = (start != NONE) & events.is_take[start]
    other = np.isin(sends, asked) & (events.kind[start] == AnatomyKind.TAKE_REQUEST)
    known &= ~other & ~_asks_for_result(events, start)
    return sends[known], start[known]


def _answered(events: Events, pairs: Pairs, takes: Ints) -> Pairs:
    """Return for each send outside of callbacks the newest response to a request of its causes."""
    responses = takes[events.kind[takes] == AnatomyKind.TAKE_RESPONSE]
    asking = responses
    # From a response back to the take in whose callback its request was sent.
    for way in (events.send, events.within, events.send, events.within):
        asking = np.where(asking == NONE, NONE, way[asking])
    responses, asking = responses[asking != NONE], asking[asking != NONE]
    send, take = pairs
    outside = events.within[send] == NONE
    send, take = send[outside], take[outside]
    place = newest_before((asking,), events.ended_ns[responses], (take,), events.began_ns[send])
    return send[place != NONE], responses[place[place != NONE]]


def _unique_ends(events: Events, pairs: list[Pairs]) -> Pairs:
    """Return one cause of a send for each subscription: that of the first of these pairs."""
    send, take = _joined(pairs)
    order = np.lexsort((events.end[take], send))
    send, take = send[order], take[order]
    end = events.end[take]
    first = np.ones(send.size, np.bool_)
    first[1:] = (send[1:] != send[:-1]) | (end[1:] != end[:-1])
    return send[first], take[first]


def _joined(pairs: list[Pairs]) -> Pairs:
    empty = np.empty(0, np.int64)
    return (
        np.concatenate([empty, *(send for send, _ in pairs)]),
        np.concatenate([empty, *(take for _, take in pairs)]),
    )
