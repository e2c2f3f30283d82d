"""Graphs that never ran: the events that their processes would have written, and the truth."""

from __future__ import annotations

import heapq
import itertools
import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from operator import attrgetter
from pathlib import Path
from typing import Any, Literal

import msgspec
import numpy as np

from plans import node_plan
from r2bspec.language.spec import QoS
from r2bspec.plan.plan import InputPlan, MonitorPlan, Plan, ProcessPlan, TopicPlan
from r2bspec.record.run_folder import Run, RunFolder, open_run
from r2bspec.record.run_record import AnatomyKind, AnatomyObject, AnatomyProcess, AnatomyRecord
from r2bspec.record.sample_arrays import ANATOMY_DTYPE, Rows
from run_simulation import Played, Simulation

START_NS = 5_000_000_000_000
CLOCK_NS = 1_800_000_000_000_000_000

Style = Literal["rclcpp", "rclpy", "rcl"]


@dataclass(frozen=True)
class Stage:
    """A node: what it takes, what it publishes, and what that costs.

    Attributes:
        name: its key in the spec.
        inputs: the topics that it takes.
        output: the topic that it publishes; empty for none.
        service_s: how long a callback takes at its median.
        process: of its own without.
        executor: the threads that call it; those of its process without.
        style: of the client library.
        depth: of the queue of each subscription.
        fuses: whether it publishes when it has a message of each input with the same stamp.
        period_s: whether a timer publishes, this often.
        own_thread: whether a thread that is no executor publishes, after the callback.
        keeps_stamp: whether its messages have the header stamp of what it took.
        spread: of the time of callbacks, as the sigma of their logarithm.
        stretched: the chance of a callback to take half as long again.
        publishes: how many messages for each one that it took.
    """

    name: str
    inputs: tuple[str, ...]
    output: str = ""
    service_s: float = 0.002
    process: str = ""
    executor: str = ""
    style: Style = "rclcpp"
    depth: int = 10
    fuses: bool = False
    period_s: float = 0.0
    own_thread: bool = False
    keeps_stamp: bool = True
    spread: float = 0.1
    stretched: float = 0.0
    publishes: int = 1

    @property
    def home(self) -> str:
        """The process that it is in."""
        return self.process or self.name

    @property
    def calls(self) -> str:
        """The executor that calls it."""
        return self.executor or self.home


@dataclass(frozen=True)
class Graph:
    """A graph with its inputs and its monitor.

    Attributes:
        stages: the nodes.
        inputs: the topics that are played.
        output: the topic that is monitored.
        rate_hz: of the playback.
        steps: how many are played.
        transport_s: of each message, by topic; else 100 µs.
        threads: of executors with several, by name.
        burst: how far from its due time a step may be played, in periods.
        seed: of everything that is random.
    """

    stages: tuple[Stage, ...]
    inputs: tuple[str, ...] = ("/in",)
    output: str = "/out"
    rate_hz: float = 100.0
    steps: int = 200
    transport_s: tuple[tuple[str, float], ...] = ()
    threads: tuple[tuple[str, int], ...] = ()
    burst: float = 0.0
    seed: int = 0

    def with_stage(self, name: str, **changes: Any) -> Graph:
        """The graph with one node changed."""
        stages = (
            replace(stage, **changes) if stage.name == name else stage for stage in self.stages
        )
        return replace(self, stages=tuple(stages))


@dataclass
class _Message:
    topic: str
    header_ns: int
    source_ns: int
    received_ns: int
    step: int


@dataclass
class _Executor:
    idle: list[int]
    stages: list[Stage] = field(default_factory=list)
    since: dict[int, int] = field(default_factory=dict)
    ready: deque[tuple[Stage, str | None]] = field(default_factory=deque)


@dataclass(frozen=True)
class Observed:
    """What was written of a graph, and what is true of it.

    Attributes:
        latency_ns: of each message of the monitor that a step led to, by its step.
        overtaken: how many messages each node lost in its queues.
    """

    record: AnatomyRecord
    rows: Rows
    plan: Plan
    window_ns: tuple[int, int]
    latency_ns: dict[int, int]
    overtaken: dict[str, int]


class _World:
    """Simulates a graph, event by event."""

    def __init__(self, graph: Graph) -> None:
        self.graph = graph
        self.random = np.random.default_rng(graph.seed)
        self.agenda: list[tuple[int, int, Callable[[], None]]] = []
        self.order = itertools.count()
        self.now = START_NS
        self.rows: list[tuple[int, ...]] = []
        self.processes: dict[str, int] = {}
        self.objects: dict[tuple[str, str, str, str], int] = {}
        self.queues: dict[tuple[str, str], deque[_Message]] = {}
        self.busy: set[str] = set()
        self.partners: dict[str, dict[int, set[str]]] = {}
        self.newest: dict[str, _Message] = {}
        self.latency_ns: dict[int, int] = {}
        self.overtaken: dict[str, int] = {stage.name: 0 for stage in graph.stages}
        self.played_ns: dict[int, int] = {}
        self.stamps = itertools.count(1)
        threads, numbers = dict(graph.threads), itertools.count(100)
        self.executors: dict[str, _Executor] = {}
        for stage in graph.stages:
            if stage.calls not in self.executors:
                own = [next(numbers) for _ in range(threads.get(stage.calls, 1))]
                since = dict.fromkeys(own, START_NS - 1_000_000)
                self.executors[stage.calls] = _Executor(idle=own, since=since)
            self.executors[stage.calls].stages.append(stage)

    def later(self, at_ns: int, what: Callable[[], None]) -> None:
        heapq.heappush(self.agenda, (at_ns, next(self.order), what))

    def around(self, median_s: float, spread: float = 0.1) -> int:
        return max(1, int(median_s * 1e9 * np.exp(spread * self.random.standard_normal())))

    def object(self, process: str, kind: str, name: str, node: str) -> int:
        self.processes.setdefault(process, len(self.processes))
        return self.objects.setdefault((process, kind, name, node), len(self.objects) + 1)

    def row(
        self,
        kind: AnatomyKind,
        process: str,
        thread: int,
        began: int,
        ended: int,
        *,
        of: int = 0,
        source: int = 0,
        received: int = 0,
        header: int = 0,
    ) -> None:
        number = self.processes.setdefault(process, len(self.processes))
        self.rows.append(
            (of, number, thread, kind, 0, began, ended, source, received, header, CLOCK_NS)
        )

    def run(self) -> None:
        graph = self.graph
        period = 1e9 / graph.rate_hz
        for step in range(graph.steps):
            shift = graph.burst * period * self.random.uniform(-0.5, 0.5)
            self.later(START_NS + int(step * period + max(shift, 0)), partial(self.play, step))
        for stage in graph.stages:
            if stage.period_s:
                ticks = int(graph.steps * period / (stage.period_s * 1e9))
                for tick in range(ticks):
                    due = START_NS + int((tick + 0.37) * stage.period_s * 1e9)
                    self.later(due, partial(self.tick, stage))
        while self.agenda:
            self.now, _, what = heapq.heappop(self.agenda)
            what()

    def play(self, step: int) -> None:
        at = self.now
        for topic in self.graph.inputs:
            self.played_ns.setdefault(step, at)
            stamp = CLOCK_NS + START_NS + step * 1000 + 1
            at = self.publish("player", 1, "/r2bspec/player", topic, at, stamp, step)

    def publish(
        self, process: str, thread: int, node: str, topic: str, at: int, header: int, step: int
    ) -> int:
        """Publish a message; returns when the call ends."""
        of = self.object(process, "publisher", topic, node)
        took = self.around(20e-6)
        sent = at + took // 2
        source = CLOCK_NS + sent
        self.row(
            AnatomyKind.PUBLISH, process, thread, at, at + took, of=of,
            source=source, header=header,
        )  # fmt: skip
        transport_s = dict(self.graph.transport_s).get(topic, 100e-6)
        received = sent + self.around(transport_s, 0.05)
        message = _Message(topic, header, source, received, step)
        self.later(received, lambda: self.deliver(message))
        return at + took

    def deliver(self, message: _Message) -> None:
        if message.topic == self.graph.output:
            self.monitor(message)
        for stage in self.graph.stages:
            if message.topic in stage.inputs:
                queue = self.queues.setdefault((stage.name, message.topic), deque())
                queue.append(message)
                if len(queue) > stage.depth:
                    queue.popleft()
                    self.overtaken[stage.name] += 1
                else:
                    self.executors[stage.calls].ready.append((stage, message.topic))
                self.dispatch(stage.calls)

    def monitor(self, message: _Message) -> None:
        of = self.object("monitor", "subscription", message.topic, "/r2bspec/monitor")
        began = message.received_ns + self.around(15e-6)
        self.row(
            AnatomyKind.TAKE, "monitor", 2, began, began + 4000, of=of,
            source=message.source_ns, received=CLOCK_NS + message.received_ns,
            header=message.header_ns,
        )  # fmt: skip
        if message.step >= 0:
            took = message.received_ns - self.played_ns[message.step]
            self.latency_ns.setdefault(message.step, took)

    def tick(self, stage: Stage) -> None:
        self.executors[stage.calls].ready.append((stage, None))
        self.dispatch(stage.calls)

    def dispatch(self, executor: str) -> None:
        """Let idle threads begin what is ready; callbacks of a node exclude each other."""
        threads = self.executors[executor]
        waiting = [*threads.ready]
        threads.ready.clear()
        for stage, topic in waiting:
            if threads.idle and stage.name not in self.busy:
                self.begin(executor, threads.idle.pop(0), stage, topic)
            else:
                threads.ready.append((stage, topic))

    def begin(self, executor: str, thread: int, stage: Stage, topic: str | None) -> None:
        self.busy.add(stage.name)
        threads, home, node = self.executors[executor], stage.home, f"/r2b/{stage.name}"
        at = self.now + self.around(8e-6)
        self.row(AnatomyKind.WAIT, home, thread, threads.since[thread], at)
        message = None
        if topic is None:
            timer = self.object(home, "timer", "", node)
            ended = at + 1000
            self.row(AnatomyKind.TIMER, home, thread, at, ended, of=timer)
        else:
            message = self.queues[stage.name, topic].popleft()
            subscription = self.object(home, "subscription", topic, node)
            ended = at + self.around(12e-6)
            self.row(
                AnatomyKind.TAKE, home, thread, at, ended, of=subscription,
                source=message.source_ns, received=CLOCK_NS + message.received_ns,
                header=message.header_ns,
            )  # fmt: skip
        began = ended + (0 if stage.style == "rcl" else self.around(5e-6))
        took = self.around(stage.service_s, stage.spread)
        if stage.stretched and self.random.random() < stage.stretched:
            took += took // 2
        finish = began + took
        if stage.style == "rclpy":
            self.row(AnatomyKind.TRIGGER, home, thread, began - 500, began)
        inside = self.answer(stage, thread, message, began, took)
        finish = max(finish, inside)
        if stage.style == "rclpy":
            self.row(AnatomyKind.TRIGGER, home, thread, finish, finish + 500)
        if stage.style == "rclcpp":
            of = timer if topic is None else subscription
            self.row(AnatomyKind.CALLBACK, home, thread, began, finish, of=of)
        threads.since[thread] = finish + 1000
        self.later(finish + 1000, lambda: self.free(executor, thread, stage))

    def answer(
        self, stage: Stage, thread: int, message: _Message | None, began: int, took: int
    ) -> int:
        """Publish what a callback publishes; returns when that ends."""
        at = began + int(took * 0.9)
        if message is not None and stage.period_s:
            self.newest[stage.name] = message
            return began
        source = self.newest.get(stage.name) if message is None else message
        if source is None or not stage.output:
            return began
        if stage.fuses and message is not None:
            seen = self.partners.setdefault(stage.name, {}).setdefault(message.header_ns, set())
            seen.add(message.topic)
            if len(seen) < len(stage.inputs):
                return began
        if stage.own_thread:
            at, thread = began + took + 500_000, 9000
        for _ in range(stage.publishes):
            header = source.header_ns if stage.keeps_stamp else next(self.stamps)
            node = f"/r2b/{stage.name}"
            at = self.publish(stage.home, thread, node, stage.output, at, header, source.step)
        return began if stage.own_thread else at

    def free(self, executor: str, thread: int, stage: Stage) -> None:
        self.executors[executor].idle.append(thread)
        self.busy.discard(stage.name)
        self.dispatch(executor)


def observed(graph: Graph) -> Observed:
    """Simulate a graph."""
    world = _World(graph)
    world.run()
    rows = np.array(sorted(world.rows, key=lambda row: row[5]), ANATOMY_DTYPE)
    record = AnatomyRecord(
        start=1,
        processes=tuple(
            AnatomyProcess(name=name, pid=1000 + number) for name, number in world.processes.items()
        ),
        objects=tuple(
            AnatomyObject(process=world.processes[process], kind=kind, name=name, node=node)  # type: ignore[arg-type]
            for process, kind, name, node in world.objects
        ),
    )
    window_ns = (START_NS, START_NS + int(graph.steps / graph.rate_hz * 1e9))
    return Observed(record, rows, plan_of(graph), window_ns, world.latency_ns, world.overtaken)


def plan_of(graph: Graph) -> Plan:
    """The plan of a graph, as far as its anatomy reads it."""
    homes = dict.fromkeys(stage.home for stage in graph.stages)
    processes = [
        ProcessPlan(
            name=home, role="host", phase="measure", argv=("x",), env={},
            nodes=tuple(node_plan(stage.name) for stage in graph.stages if stage.home == home),
        )
        for home in homes
    ]  # fmt: skip
    ends = [
        ProcessPlan(name=role, role=role, phase="measure", argv=("x",), env={})
        for role in ("player", "monitor")
    ]
    return msgspec.structs.replace(
        Simulation().plan(),
        processes=(*ends, *processes),
        topics=tuple(
            TopicPlan(
                name=topic,
                type="x/msg/X",
                phase="measure",
                writers=tuple(
                    [f"/r2b/{stage.name}" for stage in graph.stages if stage.output == topic]
                    or ["player"]
                ),
                readers=tuple(
                    [f"/r2b/{stage.name}" for stage in graph.stages if topic in stage.inputs]
                    or ["monitor"]
                ),
            )
            for topic in dict.fromkeys(
                [*graph.inputs, *(stage.output for stage in graph.stages if stage.output)]
            )
        ),
        inputs=tuple(
            InputPlan(topic=topic, type="x/msg/X", source="", bag_topic="", qos=QoS())
            for topic in graph.inputs
        ),
        monitors=(MonitorPlan(name="out", topic=graph.output, type="", match="stamp", qos=None),),
    )


@dataclass(frozen=True)
class ObservedSimulation(Simulation):
    """A run of a graph of one iteration, which was observed from inside.

    Attributes:
        lost: events of each process for which there was no room.
        left: the events that were written, of those that happened.
    """

    graph: Graph = Graph(stages=())
    lost: int = 0
    left: Callable[[Observed], Rows] = attrgetter("rows")

    @classmethod
    def of(cls, graph: Graph, **fields: Any) -> ObservedSimulation:
        """A run with the latencies that the simulated graph had."""
        latency_ns = observed(graph).latency_ns
        latency = [latency_ns.get(step, math.nan) / 1e9 for step in range(graph.steps)]
        played = Played(graph.rate_hz, latency)
        return cls(segments=[played], monitors=("out",), start_ns=START_NS, graph=graph, **fields)

    def plan(self) -> Plan:
        """See `Simulation.plan`."""
        plan = plan_of(self.graph)
        return msgspec.structs.replace(plan, objectives=dict(self.objectives), anatomy=True)

    def write(self, path: Path) -> Run:
        """See `Simulation.write`."""
        run = super().write(path)
        found = observed(self.graph)
        folder = RunFolder(path)
        folder.write_rows("anatomy", self.left(found), run.record.segments[0].id)
        processes = tuple(
            msgspec.structs.replace(each, lost=self.lost) for each in found.record.processes
        )
        record = msgspec.structs.replace(found.record, processes=processes)
        folder.write_record(msgspec.structs.replace(run.record, anatomies=(record,)))
        return open_run(path)


CHAIN = Graph(
    stages=(
        Stage("decode", ("/in",), "/image", 0.002, style="rclcpp"),
        Stage("blur", ("/image",), "/blurred", 0.004, style="rclpy"),
        Stage("detect", ("/blurred",), "/out", 0.003, style="rcl"),
    )
)

FORK = replace(
    CHAIN,
    stages=(
        Stage("split", ("/in",), "/image", 0.001),
        Stage("left", ("/image",), "/a", 0.003),
        Stage("right", ("/image",), "/b", 0.002, style="rclpy"),
        Stage("fuse", ("/a", "/b"), "/out", 0.001, fuses=True),
    ),
)

TIMER = replace(
    CHAIN,
    stages=(
        Stage("decode", ("/in",), "/image", 0.002),
        Stage("track", ("/image",), "/out", 0.001, period_s=0.02, keeps_stamp=False),
    ),
)
