"""Which part of which node or topic grew from one anatomy to another, and what follows from it.

The values of a part are averaged in `WINDOWS` parts of each iteration, because messages that follow
each other are alike. With the means m and the variances v of k such averages of base and change,

    growth = m' - m,    bound = growth - 3.6 sqrt(v / k + v' / k')

and a part has grown if its bound is above zero and the growth is at least 3 % of the part. 3.6 is
the quantile of Student's t for 38 degrees of freedom at 99.95 %: of a hundred parts that did not
grow, one is named in every twenty comparisons.

A callback in which a node publishes is compared with others in which it does, and one after which
the node holds the message with others of these: which input of a node comes last may change.

Some parts depend on what else happens, and are named after a part that they follow from, which
their growth is then credited to:

* a wait, or a queue that overflows, from the callback that grew most on the threads of the node;
* otherwise a wait from a part before it that grew, because messages come at other times: by as
  much, at most;
* what a node holds from what grew most before it, because it lacks another input.

A thread that calls more nodes now than in the base explains a wait by itself.

A message that is overwritten in a queue has no latency; it makes what is known older by a period.
So the growth of a queue is that of the share n / N of such messages, times the time between two.
Counts are compared by their roots, whose variance is a quarter whatever n is (Anscombe):
sqrt(n' + 3/8) - sqrt(n + 3/8) has to be above 3.6 sqrt(1/2).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from operator import attrgetter
from typing import Final, Literal

import numpy as np

from r2bspec.judge.measure.anatomy import WINDOWS, Anatomy, NodeAnatomy
from r2bspec.judge.measure.anatomy_events import Ints
from r2bspec.judge.measure.anatomy_paths import NOT_SEEN
from r2bspec.judge.measure.observed_runs import join_segment, observed_segments
from r2bspec.judge.measure.times import Seconds
from r2bspec.judge.measure.units import at_rate, show
from r2bspec.record.comparison_folder import MergedRun
from r2bspec.record.run_folder import Run

_QUANTILE: Final = 3.6

_LEAST_SHARE: Final = 0.03
"""Two starts of the same program differ by as much."""

LEAST_BESIDE: Final = 0.05
"""A part that grew by a smaller share of the one that grew most is not said."""

_MOST_PAIRS: Final = 5
"""Of a comparison, the last ones; each is read and joined in up to seconds."""

_QUEUE: Final = "queue"

_FOLLOWING: Final = frozenset({"wait", "held", _QUEUE})
"""Parts that depend on what else happens, and not on the work for a message alone."""

_SHIFTED: Final = 1.5
"""A wait grows by what a message before it is late, and a little more where that varies."""

_seconds = attrgetter("seconds")
_Key = tuple[str, str, str]
"""The owner of a part, its name, and the topic that tells it from others of this name."""


@dataclass(frozen=True)
class GrownPart:
    """A part that grew.

    Attributes:
        owner: the node or topic.
        of: which of the two.
        name: of the part, or ``queue`` for messages that were never taken.
        seconds: by how much its mean grew; of a queue, see above.
        share: of a queue, how many more of the messages were never taken; else 0.
        latency: by how much the mean latency grew to the monitor where that grew most.
        follows: the owner and the name of the part that it follows from; empty for a cause.
        beside: nodes that share its threads now, and did not in the base.
    """

    owner: str
    of: Literal["node", "topic"]
    name: str
    seconds: float
    share: float
    latency: float
    follows: str = ""
    beside: tuple[str, ...] = ()

    @property
    def text(self) -> str:
        """Such as ``blur: callback +4.1 ms (of +4.3 ms)``."""
        if self.name == _QUEUE:
            text = f"{self.owner}: {self.share:+.1%} of its messages are never taken"
        else:
            # The latency of all messages grew by less if other parts became shorter.
            of = f" (of {_signed(self.latency)})" if self.latency >= self.seconds else ""
            text = f"{self.owner}: {self.name} {_signed(self.seconds)}{of}"
        if self.beside:
            text += f"; it shares a thread with {', '.join(self.beside)} now"
        return text


def _signed(seconds: float) -> str:
    return f"{'+' if seconds >= 0 else '-'}{show(abs(seconds), 's', digits=2)}"


def grown_parts(base: Anatomy, change: Anatomy) -> tuple[GrownPart, ...]:
    """The parts that grew, first the one that grew most with what follows from it.

    Args:
        base: an observed iteration before a change.
        change: one after it, at the same rate.
    """
    before, after = _parts(base), _parts(change)
    latency = _latency_growth(base, change)
    found = [
        part
        for key in after
        if key in before and (part := _grown(key, before[key], after[key], latency)) is not None
    ]
    found += _overflowing(base, change, latency)
    found = [_beside(part, base, change) for part in found]
    order = _order(change)
    causes = [part for part in found if part.name not in _FOLLOWING or part.beside]
    found = [_following(part, causes, order, change) for part in found]
    causes = [part for part in found if not part.follows and part.name != "held"]
    found = [
        _following(part, causes, order, change) if part.name == "held" else part for part in found
    ]
    credit: dict[str, float] = {}
    for part in found:
        cause = part.follows or _title(part)
        credit[cause] = credit.get(cause, 0.0) + part.seconds
    return tuple(
        sorted(
            found,
            key=lambda part: (part.follows != "", -credit.get(_title(part), 0.0), -part.seconds),
        )
    )


def grown_texts(base: Run, head: Run) -> tuple[str, ...]:
    """What grew from one run to another of the same plan, a clause each; empty if nothing did.

    Only causes, at the rates at which an iteration of both was observed from inside. Of several
    runs as one the last pairs are compared, and what grew in most of them is named: two starts of
    the same program differ by more than their messages tell.

    Raises:
        RecordError: a file of one of the runs is missing or damaged.
    """
    runs = [each.runs if isinstance(each, MergedRun) else (each,) for each in (base, head)]
    pairs = [*zip(*runs, strict=False)][-_MOST_PAIRS:]
    by_rate: dict[float, list[tuple[GrownPart, ...]]] = {}
    for before, after in pairs:
        was = {segment.rate_hz: (segment, record) for segment, record in observed_segments(before)}
        now = {segment.rate_hz: (segment, record) for segment, record in observed_segments(after)}
        for rate in sorted(was.keys() & now.keys()):
            grown = grown_parts(join_segment(before, *was[rate]), join_segment(after, *now[rate]))
            by_rate.setdefault(rate, []).append(grown)
    return tuple(
        f"{part.text} {at_rate(rate)}" if len(by_rate) > 1 else part.text
        for rate, grown in by_rate.items()
        for part in _in_most(grown)
    )


def _in_most(grown: Sequence[Sequence[GrownPart]]) -> Iterator[GrownPart]:
    """Causes that most of some comparisons name, without those that do not matter beside them."""
    found: dict[str, list[tuple[int, GrownPart]]] = {}
    for parts in grown:
        for place, part in enumerate(part for part in parts if not part.follows):
            found.setdefault(_title(part), []).append((place, part))
    often = [named for named in found.values() if 2 * len(named) > len(grown)]
    often.sort(key=lambda named: sum(place for place, _ in named) / len(named))
    middle = [sorted((part for _, part in named), key=_seconds)[len(named) // 2] for named in often]
    largest = max(map(_seconds, middle), default=0.0)
    return (part for part in middle if part.seconds >= LEAST_BESIDE * largest)


def _title(part: GrownPart) -> str:
    return f"{part.owner}: {part.name}"


@dataclass(frozen=True)
class _Values:
    of: Literal["node", "topic"]
    at_ns: Ints
    seconds: Seconds
    window: tuple[int, int]

    def means(self) -> Seconds:
        """The mean of each window that has values."""
        known = ~np.isnan(self.seconds)
        width = max((self.window[1] - self.window[0]) / WINDOWS, 1)
        place = ((self.at_ns[known] - self.window[0]) / width).astype(np.int64)
        place = np.clip(place, 0, WINDOWS - 1)
        count = np.bincount(place, minlength=WINDOWS)
        sums = np.bincount(place, self.seconds[known], minlength=WINDOWS)
        means: Seconds = sums[count > 0] / count[count > 0]
        return means


def _parts(one: Anatomy) -> dict[_Key, _Values]:
    """The values of each part, of the path that most messages took."""
    found: dict[_Key, _Values] = {}
    for path in (path for paths in one.paths.values() for path in paths):
        for number, part in enumerate(path.parts):
            if part.name == NOT_SEEN:
                continue
            hop = sum(each.name == "publish" for each in path.parts[: number + 1]) - 1
            topic = path.hops[2 * hop + 1]
            versions = {topic: part.seconds}
            if part.name == "callback":
                held = path.held[hop]
                versions = {
                    topic: np.where(held, np.nan, part.seconds),
                    f"{topic} held": np.where(held, part.seconds, np.nan),
                }
            for place, seconds in versions.items():
                key = (part.owner, part.name, place)
                if key not in found or found[key].at_ns.size < path.began_ns.size:
                    found[key] = _Values(part.of, path.began_ns, seconds, one.window_ns)
    return found


def _grown(
    key: _Key, before: _Values, after: _Values, latency: dict[str, float]
) -> GrownPart | None:
    growth, bound, mean = _growth(before.means(), after.means())
    if not (bound > 0 and growth >= _LEAST_SHARE * mean):
        return None
    return GrownPart(
        owner=key[0],
        of=after.of,
        name=key[1],
        seconds=growth,
        share=0.0,
        latency=latency.get(key[0], 0.0),
    )


def _growth(before: Seconds, after: Seconds) -> tuple[float, float, float]:
    """The growth of a mean, its lower bound, and the mean that it grew from."""
    if min(before.size, after.size) < 2:
        return 0.0, 0.0, 0.0
    growth = float(after.mean() - before.mean())
    error = math.sqrt(before.var(ddof=1) / before.size + after.var(ddof=1) / after.size)
    return growth, growth - _QUANTILE * error, float(before.mean())


def _latency_growth(base: Anatomy, change: Anatomy) -> dict[str, float]:
    """Of each node and topic, the largest growth of the latency to a monitor behind it."""
    found: dict[str, float] = {}
    for monitor, paths in change.paths.items():
        before = [path.seconds[path.last] for path in base.paths.get(monitor, ())]
        after = [path.seconds[path.last] for path in paths]
        if not sum(map(len, before)) or not sum(map(len, after)):
            continue
        growth = float(np.concatenate(after).mean() - np.concatenate(before).mean())
        for owner in dict.fromkeys(owner for path in paths for owner in path.hops):
            found[owner] = max(found.get(owner, growth), growth)
    return found


def _overflowing(base: Anatomy, change: Anatomy, latency: dict[str, float]) -> Iterator[GrownPart]:
    """The queues that lost more messages than before."""
    for name in change.nodes.keys() & base.nodes.keys():
        node, was = change.nodes[name], base.nodes[name]
        for topic in node.overtaken.keys() & was.overtaken.keys():
            missed, sent = _losses(node, topic)
            missed_before, sent_before = _losses(was, topic)
            growth = missed / sent - missed_before / sent_before
            period = (change.window_ns[1] - change.window_ns[0]) / 1e9 / sent
            # The base may have had more messages, or fewer.
            roots = [math.sqrt(n + 0.375) for n in (missed, missed_before * sent / sent_before)]
            if roots[0] - roots[1] > _QUANTILE * math.sqrt(0.5):
                yield GrownPart(
                    owner=name,
                    of="node",
                    name=_QUEUE,
                    seconds=growth * period,
                    share=growth,
                    latency=latency.get(name, 0.0),
                )


def _losses(node: NodeAnatomy, topic: str) -> tuple[int, int]:
    """How many messages of a topic were never taken, and how many were sent."""
    missed = node.overtaken[topic]
    return missed, max(missed + node.taken.get(topic, 0), 1)


def _beside(part: GrownPart, base: Anatomy, change: Anatomy) -> GrownPart:
    if part.of != "node" or part.name not in _FOLLOWING:
        return part
    now, then = _neighbours(part.owner, change), _neighbours(part.owner, base)
    return replace(part, beside=tuple(sorted(now - then)))


def _neighbours(name: str, one: Anatomy) -> set[str]:
    """The nodes that all threads of a node call, too."""
    if name not in one.nodes:
        return set()
    own = set(one.nodes[name].threads)
    return {
        other.name
        for other in one.nodes.values()
        if other.name != name and own and set(other.threads) >= own
    }


def _order(one: Anatomy) -> dict[str, set[str]]:
    """Of each node and topic, what lies before it on a path, and itself."""
    found: dict[str, set[str]] = {}
    for path in (path for paths in one.paths.values() for path in paths):
        for number, owner in enumerate(path.hops):
            found.setdefault(owner, set()).update(path.hops[: number + 1])
    return found


def _following(
    part: GrownPart, causes: list[GrownPart], order: dict[str, set[str]], change: Anatomy
) -> GrownPart:
    """The part with what it follows from, if it does."""
    if part.name not in _FOLLOWING or part.beside:
        return part
    before = [
        cause for cause in causes if cause.owner in order.get(part.owner, ()) and cause is not part
    ]
    if part.name == "held":
        possible = before
    else:
        sharing = _neighbours(part.owner, change) | {part.owner}
        possible = [each for each in causes if each.name == "callback" and each.owner in sharing]
    if part.name == "wait" and not possible:
        possible = [cause for cause in before if cause.seconds * _SHIFTED >= part.seconds]
    if not possible:
        return part
    return replace(part, follows=_title(max(possible, key=_seconds)))
