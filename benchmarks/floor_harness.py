"""Player and monitor of r2bspec with nothing between them, in one process or in two."""

from __future__ import annotations

import contextlib
import os
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType, SimpleNamespace
from typing import Any, cast

from floor_workloads import COPIES, TOPIC, TYPE, Figures, Workload, cpu_ns, figures, write_buffer

from r2bspec.execute.measurement.peak_search import PeakSearch, ProbeOutcome
from r2bspec.execute.processes.environment import RunEnvironment
from r2bspec.execute.processes.prerequisites import reserved_domain
from r2bspec.execute.processes.process import shorten_slice
from r2bspec.execute.processes.resources import ResourceSampler
from r2bspec.execute.processes.supervisor import ManagedProcess, ProcessSupervisor
from r2bspec.execute.start.segment_observation import SegmentObservation
from r2bspec.execute.start.segments import PLAYBACK_ROWS, SegmentHeading, SegmentPlayer
from r2bspec.ipc import protocol
from r2bspec.ipc.buffers import largest_message_bytes
from r2bspec.ipc.schedule import CyclicSchedule
from r2bspec.judge.rate_decision import Criterion, estimate_probe, judge_final, plan_interim_looks
from r2bspec.language.quantities import Duration
from r2bspec.language.spec import QoS
from r2bspec.native.build import harness_program
from r2bspec.plan.plan import InputPlan, MonitorPlan, Plan
from r2bspec.record.run_folder import RunFolder
from r2bspec.record.run_record import Probe

MONITOR = "floor"
SUBSCRIPTION_DEPTH = 1000
_WARM_UP_STEPS = 60
_MATCH_S = 30.0


class _TransportPlan:
    """The part of a plan that the environment looks at; whatever else it asks for is not set."""

    environment = ()

    def __init__(self, transport: str) -> None:
        self.transport = transport

    def __getattr__(self, _name: str) -> None:
        return None


class _Silent:
    """A progress that tells nobody."""

    def __getattr__(self, _name: str) -> Any:
        return lambda *_arguments, **_named: None


class Floor:
    """A player and a monitor that are ready for one workload."""

    def __init__(self, segment_player: SegmentPlayer, pids: list[int]) -> None:
        self._stage = segment_player
        self._pids = pids
        self._count = 0

    def measure(self, rate_hz: float, seconds: float) -> Figures:
        """Play for a time and say how it went."""
        before = cpu_ns(self._pids)
        observed = self._play(rate_hz, seconds)
        spent = cpu_ns(self._pids) - before
        return figures(observed.playback, observed.monitors[MONITOR], spent)

    def highest_rate(self, most_hz: float, seconds: float, precision: float) -> float | None:
        """The highest rate that is delivered as offered."""
        criterion = Criterion(precision=precision)

        def probe(rate_hz: float) -> ProbeOutcome:
            observed = self._play(rate_hz, seconds)
            seen = estimate_probe(
                rate_hz,
                observed.playback,
                observed.monitors[MONITOR],
                observed.matched(MONITOR).matching,
                observed.now_ns,
            )
            judged = judge_final(seen, criterion, plan_interim_looks(seconds)[-1], None)
            found = Probe(
                segment="",
                rate_hz=rate_hz,
                delivered_hz=seen.overall.delivered_hz,
                holds=judged.holds,
                reason=judged.reason,
                keeps_up=judged.keeps_up,
            )
            return ProbeOutcome(found, judged.limited_by_player)

        return PeakSearch(10.0, most_hz, precision, probe).run().holds_hz

    def _play(self, rate_hz: float, seconds: float) -> SegmentObservation:
        self._count += 1
        steps = max(20, round(rate_hz * seconds))
        heading = SegmentHeading("iteration", f"{self._count:03d}", title="")
        return self._stage.play(heading, rate_hz, steps)


@contextlib.contextmanager
def floor(
    workload: Workload,
    transport: str,
    placement: str,
    variables: Mapping[str, str] = MappingProxyType({}),
) -> Iterator[Floor]:
    """Bring player and monitor up, warm them up, and end them.

    Args:
        workload: what the buffers hold.
        transport: as a spec names it.
        placement: ``two processes`` or ``one process``.
        variables: further ones of the environment of the processes.
    """
    with (
        tempfile.TemporaryDirectory() as scratch,
        reserved_domain() as domain,
        contextlib.ExitStack() as stack,
    ):
        folder = Path(scratch)
        buffers, rows = folder / "buffers", folder / "rows"
        buffers.mkdir()
        rows.mkdir()
        # Of their own: what grows too large beside logs is cut.
        (folder / "logs").mkdir()
        write_buffer(buffers, workload)
        run_id = f"bench-{os.getpid()}-{time.monotonic_ns()}"
        environment = RunEnvironment(
            cast("Plan", _TransportPlan(transport)),
            run_id=run_id,
            domain=domain,
            scratch=folder,
            largest_message_bytes=largest_message_bytes(buffers),
        ).for_harness(variables)
        children = ProcessSupervisor(run_id, folder, lambda: None)
        stack.callback(children.close)
        # As of a monitor that copies the quality of service of the player.
        qos = QoS(depth=SUBSCRIPTION_DEPTH)
        plans = (MonitorPlan(name=MONITOR, topic=TOPIC, type=TYPE, match="stamp", qos=qos),)
        watch = protocol.ConfigureMonitor(monitors=plans, rows_dir=str(rows))
        player, monitor, pids = _start_parts(children, environment, folder, placement)
        children.request(
            player,
            protocol.ConfigurePlayer(
                inputs=(InputPlan(topic=TOPIC, type=TYPE, source=TOPIC, bag_topic="", qos=QoS()),),
                buffer_dir=str(buffers),
                rows=str(rows / PLAYBACK_ROWS),
            ),
            protocol.Ready,
            60.0,
        )
        schedule = CyclicSchedule(steps=tuple((number,) for number in range(COPIES)))
        children.request(player, protocol.LoadSchedule(schedule=schedule), protocol.Ready, 60.0)
        children.request(monitor, watch, protocol.Ready, 60.0)
        children.request(monitor, protocol.Subscribe(monitors=plans), protocol.Matched, 10.0)
        _wait_for_match(children, player)
        # All of a plan that playing looks at.
        plan = SimpleNamespace(
            monitors=plans, inputs=(), step_sources=(), called=(), drain_timeout=Duration(5 * 10**9)
        )
        context = SimpleNamespace(
            supervisor=children,
            folder=RunFolder.create(folder / "run"),
            progress=_Silent(),
            on_segment=lambda: None,
            # Not started: what it is asked for is never sampled.
            resources=ResourceSampler(),
        )
        segment_player = SegmentPlayer(cast("Any", plan), cast("Any", context), player, rows)
        made = Floor(segment_player, pids)
        made.measure(workload.rate_hz, _WARM_UP_STEPS / workload.rate_hz)
        yield made


def _start_parts(
    children: ProcessSupervisor, environment: dict[str, str], folder: Path, placement: str
) -> tuple[ManagedProcess, ManagedProcess, list[int]]:
    """Player and monitor, not configured yet, and the processes that they are in."""

    def start(name: str, parts: Sequence[str] = ()) -> ManagedProcess:
        log = folder / "logs" / f"{name}.log"
        child = children.start(
            *(name, name, [str(harness_program())], environment),
            cwd=folder,
            log=log,
            parts=parts,
            native=("", *parts),
        )
        shorten_slice(child.pid)
        return child

    if placement == "one process":
        parts = ("player", "monitor")
        whole = start("harness", parts)
        children.request(whole, protocol.ConfigureHarness(parts=parts), protocol.Ready, 60.0)
        return whole.parts["player"], whole.parts["monitor"], [whole.pid]
    player, monitor = start("player"), start("monitor")
    return player, monitor, [player.pid, monitor.pid]


def _wait_for_match(children: ProcessSupervisor, player: ManagedProcess) -> None:
    deadline = time.monotonic() + _MATCH_S
    while time.monotonic() < deadline:
        matched = children.request(player, protocol.CountMatches(), protocol.Matched, 10.0)
        if matched.counts[TOPIC] > 0:
            return
        children.pump(0.02)
    raise RuntimeError("player and monitor do not see each other")
