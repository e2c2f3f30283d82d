"""A batch: fresh processes of a plan, brought up in order, and warm when they are handed over.

A run is one batch. If it fails, its processes are ended, and a second batch of new ones has to
fail, too (`r2bspec.judge.confirmation`).
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from r2bspec.execute.bringup.discovery import wait_until_met
from r2bspec.execute.bringup.external_nodes import wait_for_external
from r2bspec.execute.bringup.harness_processes import Parts
from r2bspec.execute.bringup.launcher import (
    NODE_ROLES,
    Launcher,
    explain,
    listeners,
    readers_wanted,
    wait_until_matched,
)
from r2bspec.execute.bringup.readiness import wait_for_probe
from r2bspec.execute.bringup.spec_mismatches import suspicions
from r2bspec.execute.bringup.start_deadline import StartDeadline
from r2bspec.execute.diagnosis.find_break import described, whole_way
from r2bspec.execute.diagnosis.graph_facts import Facts
from r2bspec.execute.diagnosis.observe_graph import PLAY_HZ, PLAY_STEPS, Observer, breaks_of, told
from r2bspec.execute.errors import NoOutputError
from r2bspec.execute.inputs.build_schedule import arrange
from r2bspec.execute.measurement.harness_overhead import measure_floor, usual_rate_hz
from r2bspec.execute.measurement.live_mode import LiveStage
from r2bspec.execute.measurement.reporting import Reporting
from r2bspec.execute.measurement.segments import PLAYBACK_ROWS, Stage
from r2bspec.execute.processes.supervisor import Child, Children
from r2bspec.ipc import protocol
from r2bspec.ipc.buffers import buffered_transforms
from r2bspec.ipc.schedule import Cyclic, Schedule
from r2bspec.measure.samples import SegmentSamples
from r2bspec.plan.plan import MonitorPlan, Plan
from r2bspec.plan.taps import all_taps, tap_watches
from r2bspec.record.run_folder import RunFolder
from r2bspec.record.run_record import FloorRecord, Segment, SilenceRecord

PHASE = "measure"
"""The phase of the processes that are up while something is measured."""

_WARM_UP_HZ = 10.0
_WARM_UP_STEPS = 10
_WARM_UP_NS = 1_000_000_000
"""How long an attempt lasts after one in which nothing came."""


class Batch:
    """One batch.

    Attributes:
        floor: what the harness alone takes, once the batch has been brought up.
        silences: outputs that have stopped since then.
    """

    def __init__(
        self,
        plan: Plan,
        children: Children,
        launcher: Launcher,
        folder: RunFolder,
        base_dir: Path,
        scratch: Path,
        reporting: Reporting,
        *,
        confirms: bool = False,
    ) -> None:
        self._plan = plan
        self._children = children
        self._launcher = launcher
        self._folder = folder
        self._base_dir = base_dir
        self._buffer_dir = scratch / "buffers"
        self._rows_dir = scratch / ("rows-confirm" if confirms else "rows")
        self._tell = reporting
        self._confirms = confirms
        self._schedule: Schedule = Cyclic(steps=())
        processes = [each for each in plan.processes if each.phase == PHASE]
        self._parts = Parts(launcher, processes)
        self._stage: Stage | None = None
        self.floor: tuple[FloorRecord, ...] = ()
        self.silences: tuple[SilenceRecord, ...] = ()

    @property
    def segments(self) -> tuple[Segment, ...]:
        """What has been played so far."""
        return tuple(self._stage.segments) if self._stage else ()

    @property
    def samples(self) -> Mapping[str, SegmentSamples]:
        """The samples of what counts for a verdict, by segment; see `Stage.samples`."""
        return self._stage.samples if self._stage else {}

    def bring_up(self) -> Stage:
        """Start everything and warm it up.

        Raises:
            RunError: it did not come up, or nothing comes out of it.
        """
        self._rows_dir.mkdir()
        self._tell.phase("start", "starting player and monitor")
        self._launcher.see_to_room(self._plan, PHASE)
        player, monitor = self._start_harness()
        self._tell.phase("graph", "starting the graph")
        deadline = StartDeadline(self._plan.start_timeout_ns)
        self._start_graph(player, monitor, deadline)
        self._stage = (Stage if player else LiveStage)(
            self._plan,
            self._children,
            player,
            self._rows_dir,
            self._folder,
            self._tell.progress,
            on_segment=self._tell.segment,
            schedule=self._schedule,
            resources=self._tell.resources,
            confirms=self._confirms,
        )
        with deadline.paused():
            self._get_ready(monitor)
        self._warm_up(self._stage, monitor, deadline)
        stage = self._stage
        stage.on_silence = lambda segment, plan: self._explain_silence(
            stage, monitor, segment, plan
        )
        return stage

    def _start_harness(self) -> tuple[Child | None, Child]:
        """The player and the monitor, and what they take with no graph between them.

        A live run has no player.
        """
        plan, launcher = self._plan, self._launcher
        player = self._start_player() if plan.inputs else None
        monitor = self._parts.start("monitor")
        launcher.configure(
            monitor,
            protocol.ConfigureMonitor(
                monitors=(*plan.monitors, *tap_watches(plan.monitors)),
                rows_dir=str(self._rows_dir),
            ),
        )
        if player is not None:
            self._tell.phase("floor", "measuring what player, monitor and transport take alone")
            self.floor = measure_floor(
                self._children,
                player,
                monitor,
                plan.inputs,
                self._rows_dir,
                PLAYBACK_ROWS,
                usual_rate_hz(plan),
                self._schedule,
            )
        return player, monitor

    def _start_player(self) -> Child:
        """The player, with everything that it will play in its memory."""
        plan, launcher = self._plan, self._launcher
        player = self._parts.start("player")
        ready = launcher.configure(
            player,
            protocol.ConfigurePlayer(
                inputs=plan.inputs,
                buffer_dir=str(self._buffer_dir),
                rows=str(self._rows_dir / PLAYBACK_ROWS),
                transforms=buffered_transforms(self._buffer_dir),
            ),
        )
        self._schedule = arrange(plan, self._buffer_dir, ready.headers, self._tell.note)
        launcher.configure(player, protocol.Follow(schedule=self._schedule))
        return player

    def _start_graph(self, player: Child | None, monitor: Child, deadline: StartDeadline) -> None:
        """The nodes after the writers and before the readers; then wait until all are matched."""
        plan, children = self._plan, self._children
        self._launcher.start_nodes(
            (each for each in plan.processes if each.phase == PHASE and each.role in NODE_ROLES),
            deadline,
            beside=self._parts.beside(),
        )
        children.ask(monitor, protocol.Subscribe(), protocol.Matched, 10.0)
        if plan.external:
            self._launcher.expect_others()
            wait_for_external(plan, children, monitor, deadline)
        watched = [each.topic for each in plan.monitors]
        watched += [each.topic for each in all_taps(plan.monitors)]
        wanted = {monitor: dict.fromkeys(watched, 1)}
        if player is not None:
            wanted[player] = {
                each.topic: readers_wanted(plan, each.topic, PHASE) for each in plan.inputs
            } | listeners(self._launcher, buffered_transforms(self._buffer_dir))
        wait_until_matched(children, self._launcher, wanted, plan, PHASE, deadline)
        ends = [(each.topic, each.type, "publishes") for each in plan.inputs]
        ends += [
            (each.topic, each.type, "subscribes")
            for each in (*plan.monitors, *tap_watches(plan.monitors))
        ]
        wait_until_met(children, self._launcher, ends)

    def _get_ready(self, monitor: Child) -> None:
        """What the spec says must be so, and be done, before anything is played."""
        plan = self._plan
        if plan.ready:
            self._tell.phase("ready", "waiting for what the spec says must be ready")
            for probe in plan.ready:
                wait_for_probe(probe, self._children, monitor, self._folder, self._base_dir)
        if plan.after_ready:
            self._tell.phase("after_ready", "doing what the spec says once the graph stands")
            for step in plan.after_ready:
                self._launcher.do(step)

    def _warm_up(self, stage: Stage, monitor: Child, deadline: StartDeadline) -> None:
        """Play until every monitor has seen something, at least for the planned time.

        The first messages cost ten times the median: pages are touched for the first time, and
        nodes set themselves up. Nothing measured may contain that.
        """
        plan = self._plan
        self._tell.phase("warm_up", "warming up")
        rates = [each.rate_hz for each in plan.play]
        rates += [plan.search.min_hz] if plan.search else []
        rate_hz = min([_WARM_UP_HZ, *rates])
        title = f"warm-up at {rate_hz:g} Hz" if rate_hz else "warm-up"
        for attempt in range(1, 1000):
            stage.play_for(
                "warm_up",
                f"warm_up-{attempt:03d}",
                rate_hz,
                max(plan.warm_up_ns, 0 if attempt == 1 else _WARM_UP_NS),
                title=title,
                index=attempt,
                least_steps=_WARM_UP_STEPS,
            )
            silent = [name for name, count in stage.received().items() if not count]
            if not silent:
                return
            if deadline.over:
                topics = [each.topic for each in plan.monitors if each.name in silent]
                facts = self._watch_all(stage, monitor)
                breaks = breaks_of(facts, topics)
                also = suspicions(breaks, self._launcher.differences)
                raise explain(
                    self._launcher,
                    breaks,
                    f"nothing arrived on {', '.join(topics)}: {told(facts, topics, breaks, also)}",
                    otherwise=NoOutputError,
                    hint="The inputs were played, but the graph published nothing there."
                    if plan.inputs
                    else "The graph stands, but its source, or what comes after it, is silent.",
                )

    def _watch_all(self, stage: Stage, monitor: Child) -> Facts:
        """Play some steps and see what passes on each topic."""
        known = self._launcher.endpoints_in(self._plan, PHASE)
        observer = Observer(self._children, monitor, self._plan, PHASE, known)

        def play() -> None:
            if self._plan.inputs:
                stage.play_aside(PLAY_HZ, PLAY_STEPS)
            else:
                # The graph has a source of its own: it need only be given time.
                self._children.pump_for(PLAY_STEPS / PLAY_HZ)

        facts = observer.watch(self._rows_dir, play)
        stage.skip()
        return facts

    def _explain_silence(
        self, stage: Stage, monitor: Child, segment: Segment, plan: MonitorPlan
    ) -> None:
        """Find out, once, why an output has stopped in the middle of a run."""
        self._tell.note(f"{plan.topic} has fallen silent; looking where its messages stop")
        facts = self._watch_all(stage, monitor)
        breaks = breaks_of(facts, [plan.topic])
        reason = "; ".join(each.sentence for each in breaks)
        if not reason:
            passed = facts.topics[plan.topic].passed
            reason = (
                f"{plan.topic}: {passed} messages came for {PLAY_STEPS} steps played afterwards"
            )
        self._tell.note(reason)
        self.silences += (
            SilenceRecord(
                segment=segment.id,
                topic=plan.topic,
                reason=reason,
                way=tuple(each.strip() for each in described(facts, whole_way(facts, plan.topic))),
            ),
        )
