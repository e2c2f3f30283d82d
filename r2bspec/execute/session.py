"""A session: the processes of a plan, started once in order, and warmed up.

A run has a session for each of its starts (`r2bspec.execute.start_sequence`). If it fails, as many
further sessions, the confirmation run, must also fail (`r2bspec.judge.confirmation`).
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Mapping
from pathlib import Path
from typing import Any

import msgspec

from r2bspec.execute.bringup.graph_joins import GraphJoins, build_join_files
from r2bspec.execute.bringup.graph_matching import (
    MonitorSubscriptions,
    expected_subscriptions,
    graph_error,
    graph_observer,
    remapped_topics,
    subscription_counts,
    wait_for_mutual_discovery,
    wait_until_matched,
)
from r2bspec.execute.bringup.harness_processes import (
    GraphHarness,
    HarnessProcesses,
    overhead_processes,
)
from r2bspec.execute.bringup.idle_nodes import IdleNodes, patience_s
from r2bspec.execute.bringup.launcher import NODE_ROLES, Launcher, message_packages
from r2bspec.execute.bringup.readiness import StartDeadline, wait_for_external, wait_for_probe
from r2bspec.execute.bringup.spec_mismatches import check_parameters, related_differences
from r2bspec.execute.diagnosis.certain_faults import certain_topics, unmatched
from r2bspec.execute.diagnosis.find_fault import fault_report, find_faults, full_path, path_lines
from r2bspec.execute.diagnosis.observe_graph import (
    TRACE_RATE_HZ,
    TRACE_STEPS,
    GraphFacts,
    foreign_publishers,
    guarded_topics,
)
from r2bspec.execute.errors import NoOutputError, ProcessFailedError, RunError
from r2bspec.execute.identity.mapped_files import loaded_by_graph, mapped_files
from r2bspec.execute.inputs.build_schedule import build_schedule
from r2bspec.execute.measurement.harness_overhead import (
    can_be_measured,
    measure_harness_overhead,
    overhead_rate_hz,
)
from r2bspec.execute.measurement.live_mode import LiveSegmentWatcher
from r2bspec.execute.measurement.run_reporter import RunReporter
from r2bspec.execute.measurement.segments import PLAYBACK_ROWS, SegmentHeading, SegmentPlayer
from r2bspec.execute.processes.supervisor import NO_ANSWER, ManagedProcess, ProcessSupervisor
from r2bspec.ipc import protocol
from r2bspec.ipc.buffers import buffered_transforms
from r2bspec.ipc.schedule import CyclicSchedule, Schedule
from r2bspec.ipc.stamps import TF_STATIC
from r2bspec.judge.rate_decision import load_scipy
from r2bspec.measure.samples import SegmentSamples
from r2bspec.plan.plan import MonitorPlan, Plan, ProcessPlan
from r2bspec.plan.taps import all_taps, tap_monitors
from r2bspec.record.run_folder import RunFolder
from r2bspec.record.run_record import (
    AccuracyRecord,
    HarnessOverheadRecord,
    OutputGapRecord,
    Segment,
    UnplayedMessages,
)

MEASURE_PHASE = "measure"
"""The phase of the processes that run during the measurement."""

_WARM_UP_HZ = 10.0
_WARM_UP_STEPS = 10
_WARM_UP_RETRY_NS = 1_000_000_000
"""The length of each further attempt after one without output."""

_MODULES_TIMEOUT_S = 5.0

_IDLE_WINDOW_S = 1.0
"""For how long the nodes are observed while nothing is played."""

_DIAGNOSED_ATTEMPT = 3
"""After this attempt without output the path is traced, so that the reason is said early."""


def _is_judged(plan: Plan) -> bool:
    """Whether statistics are computed while a run lasts, or at its end."""
    return bool(plan.objectives or plan.search or plan.sustained_hz)


class Session:
    """One session.

    Attributes:
        start: its number among the starts of the run, from 1.
        confirms: whether it is part of the confirmation run.
        schedule: of the player; empty before `bring_up`.
        harness_overhead: without the graph; empty before `bring_up`, and in a later start.
        overhead_ns: how long its measurement took.
        output_gaps: outputs that have stopped since then.
        unplayed: messages of inputs that are not played.
        loaded_files: the files that each process of the graph has loaded so far, by its name.
    """

    def __init__(
        self,
        plan: Plan,
        supervisor: ProcessSupervisor,
        launcher: Launcher,
        folder: RunFolder,
        base_dir: Path,
        scratch: Path,
        reporter: RunReporter,
        *,
        start: int = 1,
        confirms: bool = False,
        schedule: Schedule | None = None,
        is_later: bool = False,
    ) -> None:
        """Create a session; nothing is started yet.

        Args:
            plan: of the run.
            supervisor: of its processes.
            launcher: starts them.
            folder: receives samples and logs.
            base_dir: of the spec.
            scratch: of the run.
            reporter: receives phases, notes and segments.
            start: its number among the starts of the run, from 1.
            confirms: whether it is part of the confirmation run.
            schedule: of the player, where an earlier session has built it.
            is_later: whether it follows another session of the same kind, so that the harness
                overhead is known.
        """
        self._plan = plan
        self._supervisor = supervisor
        self._launcher = launcher
        self._folder = folder
        self._base_dir = base_dir
        self._buffer_dir = scratch / "buffers"
        self._rows_dir = scratch / f"rows-{start}"
        self._reporter = reporter
        self.start = start
        self.confirms = confirms
        self._is_later = is_later
        self._has_schedule = schedule is not None
        self.schedule: Schedule = schedule or CyclicSchedule(steps=())
        processes = [each for each in plan.processes if each.phase == MEASURE_PHASE]
        self._parts = HarnessProcesses(launcher, processes)
        self._segment_player: SegmentPlayer | None = None
        self._monitor: ManagedProcess | None = None
        self._observer: ManagedProcess | None = None
        self.harness_overhead: tuple[HarnessOverheadRecord, ...] = ()
        self.overhead_ns = 0
        self.output_gaps: tuple[OutputGapRecord, ...] = ()
        self._late_outputs: dict[str, int] = {}
        self.unplayed: tuple[UnplayedMessages, ...] = ()
        self.loaded_files: dict[str, frozenset[str]] = {}

    @property
    def segments(self) -> tuple[Segment, ...]:
        """The segments that have been played."""
        return tuple(self._segment_player.segments) if self._segment_player else ()

    @property
    def samples(self) -> Mapping[str, SegmentSamples]:
        """The samples of the segments that are judged, by id; see `SegmentPlayer.samples`."""
        return self._segment_player.samples if self._segment_player else {}

    def foreign_publishers(self) -> tuple[str, ...]:
        """Publishers on what is played and watched that are no process's of the run, in words.

        Raises:
            RunError: the observer does not answer.
        """
        if self._observer is None:
            return ()
        return foreign_publishers(self._supervisor, self._observer)

    def record_outputs(self) -> dict[str, int]:
        """Play one more iteration and record its messages; see `output_recording`.

        Raises:
            RunError: a process does not respond, or exited.
        """
        if self._segment_player is None or not self._plan.play:
            return {}
        from r2bspec.execute.measurement.output_recording import OutputRecorder

        return OutputRecorder(
            self._plan,
            self._supervisor,
            self._segment_player,
            self._rows_dir,
            self._folder,
        ).record()

    def play_unrecorded_for(self, title: str, rate_hz: float, duration_ns: int) -> None:
        """Play messages of which nothing is recorded; `title` is for the progress shown.

        Raises:
            RunError: a process does not respond, or exited.
        """
        if self._segment_player is None:
            raise RunError("the graph was not brought up")
        self._segment_player.play_unrecorded_for(title, rate_hz, duration_ns)

    def compare_with_truth(self, datasets: tuple[Path, ...]) -> tuple[AccuracyRecord, ...]:
        """Play one more iteration and compare its outputs; see `truth_comparison`.

        Args:
            datasets: the folders of the recordings.

        Raises:
            RunError: a process does not respond, or exited.
        """
        if self._segment_player is None or not self._plan.inputs:
            return ()
        from r2bspec.execute.measurement.truth_comparison import TruthComparison

        return TruthComparison(
            self._plan,
            self._supervisor,
            self._segment_player,
            self.schedule,
            self._rows_dir,
            self._buffer_dir,
            datasets,
        ).compare()

    def bring_up(self) -> SegmentPlayer:
        """Start all processes and warm them up.

        Raises:
            RunError: the graph is not ready in time, or has no output.
        """
        self._rows_dir.mkdir()
        again = f" again: start {self.start}" if self._is_later else ""
        self._reporter.phase("start", f"starting player and monitor{again}")
        self._launcher.check_shared_memory(self._plan, MEASURE_PHASE)
        player, monitor = None, None
        if self._is_joined:
            self._measure_overhead_alone()
        else:
            player, monitor = self._start_harness()
        self._reporter.phase("graph", "starting the graph")
        # While nodes start, and before anything is played; a later start finds it imported.
        scipy = load_scipy() if _is_judged(self._plan) else None
        deadline = StartDeadline(self._plan.start_timeout_ns)
        # Not before the harness overhead was measured, which its start would disturb.
        observer = self._observer = self._launcher.start_observer(self._observer_settings())
        if monitor is None:
            player, monitor = self._start_joined_nodes(deadline)
        else:
            self._start_nodes(deadline)
        self._monitor = monitor
        self._connect_graph(player, monitor, observer, deadline)
        self._segment_player = (SegmentPlayer if player else LiveSegmentWatcher)(
            self._plan,
            self._supervisor,
            player,
            self._rows_dir,
            self._folder,
            self._reporter.progress,
            on_segment=self._reporter.segment,
            schedule=self.schedule,
            static_publisher=observer if self._has_static else None,
            resources=self._reporter.resources,
            confirms=self.confirms,
            start=self.start,
        )
        with deadline.paused():
            self._wait_until_ready(observer)
            check_parameters(
                self._plan,
                MEASURE_PHASE,
                self._supervisor,
                observer,
                self._launcher.differences,
                self._reporter.note,
            )
        if scipy is not None:
            with self._supervisor.waiting("SciPy: imported"):
                scipy.join()
        self.note_loaded_files()
        self._warm_up(self._segment_player, deadline)
        segment_player = self._segment_player
        segment_player.on_output_stopped = lambda segment, plan: self._diagnose_stopped_output(
            segment_player, segment, plan
        )
        return segment_player

    def note_loaded_files(self) -> None:
        """Take down which files the processes of the graph have loaded until now.

        Raises:
            RunError: a process has exited.
        """
        for child in self._supervisor:
            is_host = child in self._launcher.hosts
            if not is_host and child.role not in NODE_ROLES:
                continue
            files = set(mapped_files(child.pid))
            if is_host:
                files.update(loaded_by_graph(self._module_files(child)))
            known = self.loaded_files.get(child.name, frozenset())
            self.loaded_files[child.name] = known | files

    def _module_files(self, host: ManagedProcess) -> tuple[str, ...]:
        """What a host has imported; nothing if a node keeps it from answering."""
        try:
            return self._supervisor.request(
                host, protocol.ListModules(), protocol.Modules, _MODULES_TIMEOUT_S
            ).files
        except RunError as error:
            if error.code != NO_ANSWER:
                raise
            self._reporter.note(f"{host.name} does not say which modules it has imported")
            return ()

    def _start_harness(self) -> tuple[ManagedProcess | None, ManagedProcess]:
        """Start the player and the monitor, and measure the overhead of the harness.

        A live run has no player. The processes of Python nodes are started with these, and all
        import ROS at the same time. They are idle before the overhead is measured, which they
        would disturb; their nodes are created after it.
        """
        plan, launcher = self._plan, self._launcher
        launcher.start_early(self._node_processes(), message_packages(plan))
        player = self._parts.start("player") if plan.inputs else None
        monitor = self._parts.start("monitor")
        commands: list[tuple[ManagedProcess, Any]] = [
            (
                monitor,
                protocol.ConfigureMonitor(
                    monitors=(*plan.monitors, *tap_monitors(plan.monitors)),
                    rows_dir=str(self._rows_dir),
                ),
            )
        ]
        if player is None:
            launcher.configure_all(commands)
            return player, monitor
        ready, *_ = launcher.configure_all(
            [(player, self._player_settings(self._rows_dir)), *commands]
        )
        self._load_schedule(player, ready)
        if not self._is_later and "harness_overhead" in plan.phases:
            self._measure_overhead(player, monitor, self._rows_dir)
        return player, monitor

    def _player_settings(self, rows_dir: Path) -> protocol.ConfigurePlayer:
        return protocol.ConfigurePlayer(
            inputs=self._plan.inputs,
            buffer_dir=str(self._buffer_dir),
            rows=str(rows_dir / PLAYBACK_ROWS),
            transforms=buffered_transforms(self._buffer_dir),
        )

    def _observer_settings(self) -> protocol.ConfigureObserver:
        return protocol.ConfigureObserver(
            guarded=guarded_topics(self._plan),
            static_dir=str(self._buffer_dir) if self._has_static else "",
            # In a live run, a node of the graph publishes it.
            clock=self._plan.clock and bool(self._plan.inputs),
        )

    @property
    def _has_static(self) -> bool:
        """Whether /tf_static is published."""
        return TF_STATIC in buffered_transforms(self._buffer_dir)

    def _measure_overhead_alone(self) -> None:
        """Measure the overhead of a harness that will run in processes of the graph.

        This is done in processes of its own, which are as far from each other, and end before the
        graph starts: a graph would answer what is played.
        """
        inputs = self._plan.inputs
        if (
            self._is_later
            or "harness_overhead" not in self._plan.phases
            or not can_be_measured(inputs)
        ):
            return
        rows_dir = self._rows_dir / "overhead"
        rows_dir.mkdir()
        parts = HarnessProcesses(self._launcher, overhead_processes(self._plan.processes))
        player, monitor = parts.start("player"), parts.start("monitor")
        ready, _ = self._launcher.configure_all(
            [
                (player, self._player_settings(rows_dir)),
                (monitor, protocol.ConfigureMonitor(monitors=(), rows_dir=str(rows_dir))),
            ]
        )
        self._load_schedule(player, ready)
        self._measure_overhead(player, monitor, rows_dir)
        alone = {player.pid, monitor.pid}
        self._supervisor.end([each for each in self._supervisor if each.pid in alone])

    def _start_joined_nodes(
        self, deadline: StartDeadline
    ) -> tuple[ManagedProcess | None, ManagedProcess]:
        """Start the nodes, and the player and the monitors in their processes."""

        def configure_player(player: ManagedProcess) -> None:
            ready = self._launcher.configure(player, self._player_settings(self._rows_dir))
            self._load_schedule(player, ready)

        harness = GraphHarness(self._launcher, self._plan, configure_player, self._rows_dir)
        joins = GraphJoins(self._supervisor, self._rows_dir, build_join_files())
        self._launcher.joins = joins
        try:
            if self._is_later:
                packages = message_packages(self._plan)
                self._launcher.start_early(self._node_processes(), packages, observer=False)
            self._start_nodes(deadline, harness.configure)
        finally:
            joins.close()
        return harness.player, harness.monitor

    def _load_schedule(self, player: ManagedProcess, ready: protocol.Ready) -> None:
        """Let the player load all messages that it will play into its memory.

        Raises:
            ProcessFailedError: a recorded message on /tf is damaged.
        """
        if not self._has_schedule:
            self.schedule, self.unplayed = build_schedule(
                self._plan, self._buffer_dir, ready.headers, self._reporter.note
            )
            self._has_schedule = True
        try:
            self._launcher.configure(player, protocol.LoadSchedule(schedule=self.schedule))
        except ValueError as error:
            # The stamps of transforms are looked up in the recorded messages.
            raise ProcessFailedError(f"player: {error}") from error

    def _measure_overhead(
        self, player: ManagedProcess, monitor: ManagedProcess, rows_dir: Path
    ) -> None:
        if can_be_measured(self._plan.inputs):
            self._launcher.wait_until_imported()
        began_ns = time.monotonic_ns()
        self._reporter.phase("harness_overhead", "measuring the harness overhead")
        found = measure_harness_overhead(
            self._supervisor,
            player,
            monitor,
            self._plan.inputs,
            rows_dir,
            PLAYBACK_ROWS,
            overhead_rate_hz(self._plan),
            self.schedule,
            self._reporter.host.between,
        )
        self.harness_overhead = tuple(
            msgspec.structs.replace(
                each,
                placement=self._plan.harness.placement,
                processes=1 if player.process is monitor.process else 2,
            )
            for each in found
        )
        self.overhead_ns = time.monotonic_ns() - began_ns

    @property
    def _is_joined(self) -> bool:
        """Whether player and monitors run in the processes of the graph."""
        return self._plan.harness.placement == "graph"

    def _node_processes(self) -> list[ProcessPlan]:
        return [
            each
            for each in self._plan.processes
            if each.phase == MEASURE_PHASE and each.role in NODE_ROLES
        ]

    def _start_nodes(
        self,
        deadline: StartDeadline,
        on_joined: Callable[[ManagedProcess, ProcessPlan], None] = lambda _, __: None,
    ) -> None:
        self._launcher.start_nodes(
            self._node_processes(),
            deadline,
            running_hosts=self._parts.node_hosts(),
            on_joined=on_joined,
        )

    def _connect_graph(
        self,
        player: ManagedProcess | None,
        monitor: ManagedProcess,
        observer: ManagedProcess,
        deadline: StartDeadline,
    ) -> None:
        """Create the subscriptions of the monitor, after the nodes; wait until all are matched."""
        plan, supervisor = self._plan, self._supervisor
        monitors = (*plan.monitors, *tap_monitors(plan.monitors))
        subscriptions = MonitorSubscriptions(supervisor, observer, monitor, monitors)
        self._launcher.wait_for_observer(observer)
        subscriptions.update()
        if plan.external:
            self._launcher.mark_external_nodes()
            wait_for_external(plan, supervisor, observer, deadline)
        watched = [each.topic for each in plan.monitors]
        watched += [each.topic for each in all_taps(plan.monitors)]
        wanted = {monitor: dict.fromkeys(watched, 1)}
        if player is not None:
            transforms = subscription_counts(self._launcher, buffered_transforms(self._buffer_dir))
            if TF_STATIC in transforms:
                wanted[observer] = {TF_STATIC: transforms.pop(TF_STATIC)}
            wanted[player] = transforms | {
                each.topic: expected_subscriptions(plan, each.topic, MEASURE_PHASE)
                for each in plan.inputs
            }
        with supervisor.waiting("endpoints: matched"):
            wait_until_matched(
                supervisor,
                self._launcher,
                wanted,
                plan,
                MEASURE_PHASE,
                deadline,
                self._reporter.note,
                subscriptions.update,
            )
        ends = [(each.topic, each.type, "publishes") for each in plan.inputs]
        ends += [(each.topic, each.type, "subscribes") for each in monitors]
        wait_for_mutual_discovery(supervisor, self._launcher, ends)

    def _wait_until_ready(self, observer: ManagedProcess) -> None:
        """Wait for the readiness probes, then run the `after_ready` steps."""
        plan = self._plan
        if plan.ready:
            self._reporter.phase("ready", "waiting for the readiness probes")
            for probe in plan.ready:
                wait_for_probe(probe, self._supervisor, observer, self._folder, self._base_dir)
        if plan.after_ready:
            self._reporter.phase("after_ready", "running the after_ready steps")
            for step in plan.after_ready:
                self._launcher.run_step(step)

    def _warm_up(self, segment_player: SegmentPlayer, deadline: StartDeadline) -> None:
        """Play until every monitor has received a message, and at least for the planned time.

        The first messages take ten times the median: pages are touched for the first time, and
        nodes initialise themselves. The measurements must not contain them.
        """
        plan = self._plan
        self._reporter.phase("warm_up", "warming up")
        rates = [each.rate_hz for each in plan.play]
        rates += [plan.search.min_hz] if plan.search else []
        rate_hz = min([_WARM_UP_HZ, *rates])
        title = f"warm-up at {rate_hz:g} Hz" if rate_hz else "warm-up"
        later = f"start-{self.start}-" if self._is_later else ""
        began_s = time.monotonic()
        for attempt in range(1, 1000):
            segment_player.play_for(
                SegmentHeading("warm_up", f"{later}warm_up-{attempt:03d}", title, attempt),
                rate_hz,
                max(plan.warm_up_ns, 0 if attempt == 1 else _WARM_UP_RETRY_NS),
                min_steps=_WARM_UP_STEPS,
            )
            silent = [name for name, count in segment_player.received().items() if not count]
            if not silent:
                return
            waited_s = time.monotonic() - began_s
            final = deadline.over or (
                attempt > _DIAGNOSED_ATTEMPT and waited_s > patience_s(plan) and self._is_idle()
            )
            if final or attempt == _DIAGNOSED_ATTEMPT:
                self._diagnose_no_output(segment_player, silent, final=final)

    def _is_idle(self) -> bool:
        """Whether all nodes have processed what was played, and wait for more.

        Never in a live run, whose source publishes all the time.
        """
        if not self._plan.inputs:
            return False
        idle = IdleNodes(self._plan, MEASURE_PHASE, self._supervisor)
        self._supervisor.pump_for(_IDLE_WINDOW_S)
        if idle.update() == 0 or not idle.answer(self._supervisor.observer()):
            return False
        self._reporter.note("all nodes are idle and answer: the start is not waited for any longer")
        return True

    def _diagnose_no_output(
        self,
        segment_player: SegmentPlayer,
        silent: Collection[str],
        *,
        final: bool,
    ) -> None:
        """Find out why monitors have received nothing, and say it.

        Before the end of the start, a node without output may still load a model. Only endpoints
        that never match are certain.

        Args:
            segment_player: plays the steps that are traced.
            silent: the monitors, by name.
            final: whether the start is not waited for any longer.

        Raises:
            GraphMismatchError: the graph differs from the plan, so that there never is an output.
            NoOutputError: there is another reason, and `final`.
        """
        plan = self._plan
        topics = [each.topic for each in plan.monitors if each.name in silent]
        facts = self._trace_messages(segment_player)
        faults = find_faults(facts, topics)
        remapped = [*remapped_topics(plan, MEASURE_PHASE)]
        certain = certain_topics(facts, [each.topic for each in faults], remapped)
        certain |= {each.topic for each in faults if each.kind in {"types", "qos"}}
        if not final and not certain:
            sentences = "; ".join(each.sentence for each in faults) or "no fault was found yet"
            self._reporter.note(f"no messages on {', '.join(topics)} so far: {sentences}")
            return
        lacking = {each.topic for each in faults}
        self._launcher.add_unmatched_remappings(
            unmatched(facts, [each for each in remapped if each.topic in lacking]), facts
        )
        also = related_differences(faults, self._launcher.differences)
        raise graph_error(
            self._launcher,
            faults,
            f"no messages on {', '.join(topics)}",
            fault_report(facts, topics, faults, also),
            otherwise=NoOutputError,
            hint="The inputs were played, but the graph published nothing on these topics."
            if plan.inputs
            else "All nodes run, but the source, or a node after it, publishes nothing.",
            certain=certain,
        )

    def _trace_messages(self, segment_player: SegmentPlayer) -> GraphFacts:
        """Play some steps and count the messages on each topic."""
        observer = graph_observer(
            self._supervisor, self._launcher, self._plan, MEASURE_PHASE, self._monitor
        )

        def play() -> None:
            if self._plan.inputs:
                segment_player.play_unrecorded(TRACE_RATE_HZ, TRACE_STEPS)
            else:
                # The graph has its own source, which publishes during this time.
                self._supervisor.pump_for(TRACE_STEPS / TRACE_RATE_HZ)

        facts = observer.trace(self._rows_dir, play)
        self._late_outputs = segment_player.discard_new_rows()
        return facts

    def _diagnose_stopped_output(
        self,
        segment_player: SegmentPlayer,
        segment: Segment,
        plan: MonitorPlan,
    ) -> None:
        """Find out, once, why an output has stopped during a run."""
        self._reporter.note(f"no more messages on {plan.topic}: tracing the path")
        facts = self._trace_messages(segment_player)
        faults = find_faults(facts, [plan.topic])
        reason = "; ".join(each.sentence for each in faults)
        if not reason:
            passed = facts.topics[plan.topic].passed
            reason = f"{passed} messages on {plan.topic} for {TRACE_STEPS} steps played afterwards"
        late = self._late_outputs.get(plan.name, 0)
        if late:
            reason = (
                f"{late:,} of the missing outputs came while the path was traced: they are late, "
                "not lost, and 'benchmark.drain_timeout' is too short for them"
            )
        self._reporter.note(reason)
        self.output_gaps += (
            OutputGapRecord(
                segment=segment.id,
                topic=plan.topic,
                reason=reason,
                late=late,
                way=tuple(each.strip() for each in path_lines(facts, full_path(facts, plan.topic))),
            ),
        )
