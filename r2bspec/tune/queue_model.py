"""A discrete-event model of a deployed graph: executors that share processors, queues, transports.

Messages of the steps that are played arrive at subscriptions after the transport of their topic. A
subscription keeps the last ``depth`` of them; what is overwritten is lost. An executor with one
thread works like those of rclcpp and rclpy: it looks once which subscriptions and timers are ready,
calls each of them once, in its order, and looks again. One with several threads gives each idle
thread what is ready next; callbacks of a node exclude each other.

Work needs a processor. With k the threads that want to run, e what others want, and N processors,
each of them proceeds at the speed

    min(1, N / (k + e))

and threads of one Python process share one interpreter lock: at most one of them runs at a time, or
each at 1/k of the speed. What a callback waits for without a processor (a sleep, a device) is not
slowed down.
"""

from __future__ import annotations

import heapq
import itertools
import math
from collections import deque
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from operator import attrgetter
from typing import Final

import numpy as np
from numpy.typing import NDArray

Seconds = NDArray[np.float64]
Places = Sequence[tuple[int, float]]
"""For each step which observation stands for it: a segment, and the place in it, from 0 to 1."""

Work = Generator[float, None, None]
"""What a thread does: it yields the seconds of work that come next."""


@dataclass(frozen=True)
class Callback:
    """One observed callback, with its take.

    Attributes:
        work_s: how long it takes alone on a processor.
        outputs: the topics that it publishes, each with the work before; more than `work_s` if the
            node holds the message until later.
    """

    work_s: float
    outputs: tuple[tuple[str, float], ...] = ()


Observed = tuple[tuple[Callback, ...], ...]
"""Callbacks in the order in which they were observed, of each segment."""


@dataclass(frozen=True)
class Reaction:
    """What a node does with the messages of a topic, or each time that a timer is due.

    Attributes:
        topic: empty for a timer.
        callbacks: that were observed.
        depth: of the queue.
        period_s: of the timer.
        joins: the topics of which it needs messages of the same step, if there are several; only
            the callback of the last of them is one of `callbacks`.
        alone: callbacks of messages that are not the last of their step.
    """

    node: str
    topic: str
    callbacks: Observed
    depth: int = 10
    period_s: float = 0.0
    joins: frozenset[str] = frozenset()
    alone: Observed = ()


@dataclass(frozen=True)
class ExecutorModel:
    """An executor of a process.

    Attributes:
        process: two executors of one process share its interpreter, if it has one.
        reactions: in the order in which they are looked at.
        threads: that call callbacks.
        wake_s: observed times from the arrival of a message to the return of the wait for it.
        lead_s: work from there to the take of a message.
        tail_s: work from the end of the last callback to the next look at what is ready.
        idle_s: further work before it waits, if nothing is ready.
        processor_share: of the work that needs a processor.
        is_python: whether its threads share an interpreter lock.
        cpus: on which it may run; empty for all.
    """

    process: str
    reactions: tuple[Reaction, ...]
    threads: int = 1
    wake_s: Seconds = field(default_factory=lambda: np.zeros(1))
    lead_s: float = 0.0
    tail_s: float = 0.0
    idle_s: float = 0.0
    processor_share: float = 1.0
    is_python: bool = False
    cpus: frozenset[int] = frozenset()


Transports = Mapping[tuple[str, str], tuple[Seconds, ...]]
"""By topic and reader (a node or a monitor) the times that messages took, of each segment."""


@dataclass(frozen=True)
class GraphModel:
    """A deployed graph.

    Attributes:
        inputs: the topics that are played in each step.
        monitors: the topic of each monitor, by its name.
        cores: processors.
        others: processors that others want: other programs, and the harness.
        slowness: a factor of all work: the processors may be slower than observed.
    """

    executors: tuple[ExecutorModel, ...]
    inputs: tuple[str, ...]
    monitors: Mapping[str, str]
    transports: Transports
    cores: float
    others: float = 0.0
    slowness: float = 1.0


@dataclass(frozen=True)
class Simulated:
    """What came of the steps.

    Attributes:
        latency_s: of each step, by monitor; NaN for one that never led to a message.
        busy: the share of the time in which each executor worked, by its place in the model.
        overwritten: messages that were lost in queues.
    """

    latency_s: Mapping[str, Seconds]
    busy: tuple[float, ...]
    overwritten: int


def simulate(
    model: GraphModel,
    due_s: Seconds,
    places: Places,
    random: np.random.Generator,
    *,
    most_lost: float = math.inf,
) -> Simulated:
    """Play steps to a model.

    Args:
        model: the graph.
        due_s: when each step is played, ascending.
        places: the observations for each step.
        random: of what belongs to no step.
        most_lost: ends the simulation as soon as more messages were overwritten.
    """
    return _Simulation(model, due_s, places, random).run(most_lost)


def block_places(
    steps: int, counts: Sequence[int], random: np.random.Generator, block: int = 25
) -> list[tuple[int, float]]:
    """Observations for steps, drawn in blocks, so that what is slow together stays together.

    Args:
        steps: how many are wanted.
        counts: how many steps each segment has; a segment without any is never drawn.
        random: the source of the draw.
        block: steps of one draw.
    """
    usable = [segment for segment, count in enumerate(counts) if count]
    found: list[tuple[int, float]] = []
    while len(found) < steps:
        segment = usable[int(random.integers(len(usable)))]
        count = counts[segment]
        length = min(block, count)
        first = int(random.integers(count - length + 1))
        found += [(segment, (first + k + 0.5) / count) for k in range(length)]
    return found[:steps]


_MOST_CALLS: Final = 1_000
"""Of callbacks, for each step: nodes that lead to each other may call each other without end."""

_HORIZON_S: Final = 5.0
"""What has not come this long after the last step is lost."""

_DRAWN: Final = 256
"""Random numbers that are drawn at once."""


class _Thread:
    """A thread that works; `began_s` is when its piece of work began, `finish_s` when it ends."""

    __slots__ = ("began_s", "executor", "finish_s", "speed", "work")

    def __init__(self, executor: _Executor, work: Work, now_s: float) -> None:
        self.executor = executor
        self.work = work
        self.speed = 1.0
        self.began_s = now_s
        self.finish_s = now_s


class _Executor:
    """The state of an executor: what is queued for it, and which of its threads work."""

    def __init__(self, place: int, model: ExecutorModel) -> None:
        self.place = place
        self.model = model
        self.wake_s = model.wake_s.tolist()
        self.queues: list[deque[int]] = [deque() for _ in model.reactions]
        self.working = 0
        self.waking = 0
        self.next = 0
        self.busy_nodes: set[str] = set()
        self.work_s = 0.0

    def ready(self) -> list[int]:
        """What can be called next: of one thread all of it, of several the first in turn."""
        if self.model.threads == 1:
            return [place for place, queue in enumerate(self.queues) if queue]
        count = len(self.queues)
        for offset in range(count):
            place = (self.next + offset) % count
            if self.queues[place] and self.model.reactions[place].node not in self.busy_nodes:
                self.next = place + 1
                return [place]
        return []


class _Simulation:
    def __init__(
        self, model: GraphModel, due_s: Seconds, places: Places, random: np.random.Generator
    ) -> None:
        self._model = model
        self._due_s = due_s.tolist()
        self._places = places
        self._agenda: list[tuple[float, int, Callable[[], None]]] = []
        self._order = itertools.count()
        self._now = 0.0
        self._executors = [_Executor(place, each) for place, each in enumerate(model.executors)]
        self._running: list[_Thread] = []
        self._speeds: dict[tuple[int, ...], list[float]] = {}
        self._uniform = _uniform(random)
        self._transports = {
            ends: [of_segment.tolist() for of_segment in observed]
            for ends, observed in model.transports.items()
        }
        self._readers: dict[str, list[tuple[_Executor, int]]] = {}
        for executor in self._executors:
            for place, reaction in enumerate(executor.model.reactions):
                self._readers.setdefault(reaction.topic, []).append((executor, place))
        self._monitors: dict[str, list[str]] = {}
        for name, topic in model.monitors.items():
            self._monitors.setdefault(topic, []).append(name)
        self._latency = {name: [float("nan")] * len(self._due_s) for name in model.monitors}
        self._arrived: dict[tuple[str, int], set[str]] = {}
        self._newest: dict[str, int] = {}
        self._overwritten = 0
        self._calls_left = _MOST_CALLS * max(len(self._due_s), 1)

    def run(self, most_lost: float) -> Simulated:
        for step, due_s in enumerate(self._due_s):
            self._later(due_s, partial(self._play, step))
        last_s = self._due_s[-1] if self._due_s else 0.0
        for executor in self._executors:
            for place, reaction in enumerate(executor.model.reactions):
                if reaction.period_s:
                    first_s = next(self._uniform) * reaction.period_s
                    self._later(first_s, partial(self._tick, executor, place))
        end_s = last_s + _HORIZON_S
        by_finish = attrgetter("finish_s")
        while self._now <= end_s and self._overwritten <= most_lost:
            thread = min(self._running, key=by_finish, default=None)
            if thread is not None and (not self._agenda or thread.finish_s < self._agenda[0][0]):
                self._now = thread.finish_s
                self._proceed(thread)
            elif self._agenda:
                self._now, _, happens = heapq.heappop(self._agenda)
                happens()
            else:
                break
        span_s = max(min(self._now, last_s), 1e-9)
        return Simulated(
            {name: np.array(values) for name, values in self._latency.items()},
            tuple(each.work_s / span_s / each.model.threads for each in self._executors),
            self._overwritten,
        )

    def _later(self, at_s: float, happens: Callable[[], None]) -> None:
        heapq.heappush(self._agenda, (at_s, next(self._order), happens))

    def _play(self, step: int) -> None:
        for topic in self._model.inputs:
            self._publish(topic, step)

    def _publish(self, topic: str, step: int) -> None:
        segment, place = self._places[step]
        for executor, number in self._readers.get(topic, ()):
            reaction = executor.model.reactions[number]
            took_s = self._transport(topic, reaction.node, segment, place)
            if took_s > 0:
                self._later(self._now + took_s, partial(self._arrive, executor, number, step))
            else:
                self._arrive(executor, number, step)
        for monitor in self._monitors.get(topic, ()):
            latency = self._latency[monitor]
            if latency[step] != latency[step]:  # the first message of a step counts
                took_s = self._transport(topic, monitor, segment, place)
                latency[step] = self._now + took_s - self._due_s[step]

    def _transport(self, topic: str, reader: str, segment: int, place: float) -> float:
        observed = self._transports[topic, reader][segment]
        return observed[int(place * len(observed))] if observed else 0.0

    def _arrive(self, executor: _Executor, number: int, step: int) -> None:
        queue = executor.queues[number]
        queue.append(step)
        if len(queue) > executor.model.reactions[number].depth:
            queue.popleft()
            self._overwritten += 1
        self._wake(executor)

    def _tick(self, executor: _Executor, number: int) -> None:
        reaction = executor.model.reactions[number]
        if not executor.queues[number]:  # a timer that is due twice is called once
            executor.queues[number].append(-1)
        if self._now < self._due_s[-1] + _HORIZON_S / 2:
            self._later(self._now + reaction.period_s, partial(self._tick, executor, number))
        self._wake(executor)

    def _wake(self, executor: _Executor) -> None:
        """Let a waiting thread see what has come, after the time that it takes to wake up."""
        if executor.working + executor.waking < executor.model.threads:
            executor.waking += 1
            took_s = executor.wake_s[int(next(self._uniform) * len(executor.wake_s))]
            self._later(self._now + took_s, partial(self._start, executor))

    def _start(self, executor: _Executor) -> None:
        executor.waking -= 1
        executor.working += 1
        thread = _Thread(executor, self._spin(executor), self._now)
        self._running.append(thread)
        self._share()
        self._proceed(thread)

    def _spin(self, executor: _Executor) -> Work:
        """What a thread does from when it wakes up until it waits again."""
        model = executor.model
        while True:
            ready = executor.ready()
            if not ready and model.idle_s:
                yield model.idle_s
                ready = executor.ready()
            if not ready:
                return
            for number in ready:
                reaction = model.reactions[number]
                executor.busy_nodes.add(reaction.node)
                step = executor.queues[number].popleft()
                yield model.lead_s
                yield from self._call(reaction, step)
                executor.busy_nodes.discard(reaction.node)
            yield model.tail_s

    def _call(self, reaction: Reaction, step: int) -> Work:
        self._calls_left -= 1
        if self._calls_left < 0:
            return
        if reaction.topic:
            self._newest[reaction.node] = max(step, self._newest.get(reaction.node, -1))
        elif (step := self._newest.get(reaction.node, -1)) < 0:
            return
        segment, place = self._places[step]
        observed = reaction.callbacks
        if reaction.joins:
            arrived = self._arrived.setdefault((reaction.node, step), set())
            arrived.add(reaction.topic)
            observed = reaction.callbacks if arrived >= reaction.joins else reaction.alone
        of_segment = observed[segment] if observed else ()
        if not of_segment:
            return
        callback = of_segment[int(place * len(of_segment))]
        done_s = 0.0
        for topic, after_s in callback.outputs:
            if after_s > callback.work_s:
                held_s = after_s - done_s
                self._later(self._now + held_s, partial(self._publish, topic, step))
                continue
            yield after_s - done_s
            done_s = after_s
            self._publish(topic, step)
        yield callback.work_s - done_s

    def _proceed(self, thread: _Thread) -> None:
        """Let a thread begin its next piece of work; without one, it waits."""
        thread.executor.work_s += self._now - thread.began_s
        thread.began_s = self._now
        for work_s in thread.work:
            if work_s > 0:
                thread.finish_s = self._now + work_s * self._model.slowness / thread.speed
                return
        self._running.remove(thread)
        thread.executor.working -= 1
        self._share()

    def _share(self) -> None:
        """Divide the processors, and the interpreters, among the threads that run."""
        running = tuple([thread.executor.place for thread in self._running])
        if (speeds := self._speeds.get(running)) is None:
            # The same few executors run at once again and again.
            speeds = self._speeds[running] = self._shares(running)
        for thread, speed in zip(self._running, speeds, strict=True):
            if speed != thread.speed:
                remaining_s = (thread.finish_s - self._now) * thread.speed
                thread.finish_s = self._now + remaining_s / speed
                thread.speed = speed

    def _shares(self, running: tuple[int, ...]) -> list[float]:
        """The speed of each thread, by the places of their executors."""
        model = self._model
        executors = [model.executors[place] for place in running]
        wanted: dict[str, float] = {}
        for own in executors:
            wanted[own.process] = wanted.get(own.process, 0.0) + own.processor_share
        locked = {own.process: max(1.0, wanted[own.process]) for own in executors if own.is_python}
        total = sum(each / locked.get(process, 1.0) for process, each in wanted.items())
        crowd = max(1.0, (total + model.others) / model.cores)
        pinned: dict[frozenset[int], float] = {}
        for own in executors:
            if own.cpus:
                share = own.processor_share / locked.get(own.process, 1.0)
                pinned[own.cpus] = pinned.get(own.cpus, 0.0) + share
        speeds = []
        for own in executors:
            slowed = crowd
            if own.cpus:
                others = model.others * len(own.cpus) / model.cores
                slowed = max(1.0, (pinned[own.cpus] + others) / len(own.cpus))
            slowed *= locked.get(own.process, 1.0)
            speeds.append(1.0 / (own.processor_share * slowed + 1.0 - own.processor_share))
        return speeds


def _uniform(random: np.random.Generator) -> Iterator[float]:
    """Numbers below 1, drawn many at a time: one by one they take longer than what they decide."""
    while True:
        yield from random.random(_DRAWN).tolist()
