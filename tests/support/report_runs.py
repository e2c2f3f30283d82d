"""Runs whose reports are tested, with a graph to draw and with names chosen to break things."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import msgspec
import numpy as np
from numpy.typing import NDArray

from r2bspec.judge.measure.metrics import MonitorMetrics, SegmentMetrics
from r2bspec.judge.result import Result
from r2bspec.plan.plan import NodePlan, Plan, ProcessPlan, TopicPlan
from r2bspec.record.run_folder import Run
from r2bspec.record.run_record import SearchRecord, StartRecord
from run_simulation import Played, Simulation, objective, probe

HOSTILE = (
    "<script>alert(1)</script><img src=x onerror=alert(2)>\"'&|`*_[a](http://b)\n"
    "::error::$x^2$ @all %0A"
)


@dataclass(frozen=True)
class GraphSimulation(Simulation):
    """A simulation whose plan has a graph, and words of the test's choice."""

    title: str = "A simulated run"
    labels: tuple[tuple[str, str], ...] = ()

    def plan(self) -> Plan:
        monitor = self.monitors[0]
        return msgspec.structs.replace(
            super().plan(),
            title=self.title,
            labels=dict(self.labels),
            processes=(
                ProcessPlan(name="player", role="player", phase="measure", argv=("p",), env={}),
                ProcessPlan(
                    name="apriltag",
                    role="host",
                    phase="measure",
                    argv=("h",),
                    env={},
                    nodes=(
                        NodePlan(
                            name="/r2b/apriltag",
                            node="apriltag",
                            namespace="/r2b",
                            target="r2bspec.nodes.AprilTagNode",
                            parameters={},
                            remappings={},
                        ),
                    ),
                ),
            ),
            topics=(
                _topic("/r2b/image", ("player",), ("/r2b/apriltag",)),
                _topic(f"/r2b/{monitor}", ("/r2b/apriltag",), ("monitor",)),
            ),
        )


def with_starts(run: Run, *starts: StartRecord) -> Run:
    """The run, its iterations taken in turn from these starts."""
    segments = tuple(
        msgspec.structs.replace(segment, start=1 + number % len(starts))
        for number, segment in enumerate(run.record.segments)
    )
    record = msgspec.structs.replace(run.record, segments=segments, starts=starts)
    return replace(run, record=record)


def _topic(name: str, writers: tuple[str, ...], readers: tuple[str, ...]) -> TopicPlan:
    kind = "sensor_msgs/msg/Image"
    return TopicPlan(name=name, type=kind, phase="measure", writers=writers, readers=readers)


def skewed(n: int, base_s: float, start: int = 0) -> NDArray[np.float64]:
    """Latencies above `base_s`, from a sequence that is the same everywhere."""
    uniform = (np.arange(start, start + n) * 7919 % 9973 + 0.5) / 9973
    return base_s * (1 - 0.05 * np.log(uniform))


def with_losses(n: int, base_s: float, start: int, every: int) -> NDArray[np.float64]:
    """The same, with every so many of them lost."""
    found = skewed(n, base_s, start)
    found[::every] = np.nan
    return found


USUAL = GraphSimulation(
    segments=[
        *(Played(10, skewed(100, 0.02, number * 100)) for number in range(3)),
        *(Played(30, with_losses(300, 0.03, number * 300, 40)) for number in range(3)),
    ],
    objectives={
        "camera": objective("latency.p99 < 60 ms", "drop_rate <= 1 %", "throughput.mean > 25 Hz"),
        "gentle": objective("latency.p90 < 60 ms", "missed == 0", at="10 Hz"),
        "peak": objective("peak.rate >= 10 Hz", at=""),
    },
    search=SearchRecord(
        probes=(probe(5, holds=True), probe(200, holds=False, reason="the backlog grows")),
        holds_hz=5,
        fails_hz=200,
        limited_by="graph",
    ),
    interference={"busy_s": 1.0, "stolen_s": 0.001, "waited_s": 0.04, "throttled_s": 0.0},
)

TWO = GraphSimulation(
    segments=[Played(30, skewed(90, 0.02, 90 * number)) for number in range(2)],
    objectives={"all": objective("latency.p50 < 60 ms", "extra.latency.p99 < 1 ms")},
    monitors=("detections", "extra"),
)

SILENT = Simulation(
    segments=[Played(30, [np.nan] * 30)], objectives={"fast": objective("latency.p99 < 60 ms")}
)

EMPTY = Simulation(status="incomplete", reason="interrupted")

HOSTILE_RUN = GraphSimulation(
    segments=[Played(30, skewed(60, 0.02, 60 * number)) for number in range(2)],
    objectives={HOSTILE: objective("latency.p50 < 1 ms")},
    title=HOSTILE,
    labels=((HOSTILE, HOSTILE),),
    status="incomplete",
    reason=HOSTILE,
    cpu={HOSTILE: 0.1, "\x00\x1b[31m\ud7ff": 0.2},
)

SIMULATIONS = {
    "usual": USUAL,
    "two monitors": TWO,
    "silent": SILENT,
    "empty": EMPTY,
    "hostile": HOSTILE_RUN,
}


def with_monitors(
    result: Result, change: Callable[[Mapping[str, MonitorMetrics]], dict[str, MonitorMetrics]]
) -> Result:
    """The result with other metrics of the monitors at every rate, and in each iteration."""
    put = msgspec.structs.replace

    def changed(segment: SegmentMetrics) -> SegmentMetrics:
        return put(segment, monitors=change(segment.monitors))

    rates = tuple(
        put(rate, pooled=changed(rate.pooled), iterations=tuple(map(changed, rate.iterations)))
        for rate in result.metrics.rates
    )
    return put(result, metrics=put(result.metrics, rates=rates))
