"""The life of a start: the processes of a plan come up once, play, and end.

    start              player and monitors, while the processes of Python nodes import ROS
    graph              the nodes are created, brought into their lifecycle states, and matched
    ready, after_ready what the spec waits for, and what it then does
    warm_up            inputs are played until every monitor has received something
    play               each segment is played, drained and stored (`SegmentPlayer`)
    end                all processes exit; the next start, or the end of the run, asks for it

`Start.bring_up` takes a start through the states before its first segment. `StartSequence` has all
starts of a run, of which at most one lives. Loading and preprocessing come before the first one.

Player and monitor are started afresh, too, and not the graph alone: where they lie in memory, when
they discover the nodes, and on which cores their threads run is decided at their start, and is part
of every latency. If they remained, what they got would be common to all starts. Starts would then
differ by less than two runs do, and a verdict would be more certain than it may be.

What does not depend on the processes is made once, before the first start: the bag is read, the
preprocessors run, buffers and schedule are built. What is left is made short: all processes import
ROS at the same time.

Nothing of the next start is prepared while iterations play. A process that imports ROS takes a core
for half a second, and discovery by new participants wakes every process of the graph; both would
be in the measured latencies. Ending the old processes takes 30 to 60 ms, and is finished before the
new ones are started, so that these meet none of the old ones in their domain.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field

import msgspec

from r2bspec.execute import errors
from r2bspec.execute.anatomy import AnatomyObservation
from r2bspec.execute.bringup import harness_processes, readiness
from r2bspec.execute.bringup.launcher import Launcher, message_packages
from r2bspec.execute.bringup.node_faults import not_created, not_made
from r2bspec.execute.build_schedule import build_call_timeline, build_schedule
from r2bspec.execute.diagnose.diagnosis import PhaseGraph
from r2bspec.execute.diagnose.facts import foreign_publishers, guarded_topics
from r2bspec.execute.graph_matching import (
    MonitorSubscriptions,
    expected_subscriptions,
    subscription_counts,
    wait_for_mutual_discovery,
    wait_until_matched,
)
from r2bspec.execute.processes.prerequisites import built
from r2bspec.execute.processes.resources import family
from r2bspec.execute.processes.scheduling import read_scheduling
from r2bspec.execute.processes.supervisor import ManagedProcess
from r2bspec.execute.run_context import MEASURE_PHASE, RunContext
from r2bspec.execute.start.segments import (
    PLAYBACK_ROWS,
    LiveSegmentWatcher,
    SegmentHeading,
    SegmentPlayer,
)
from r2bspec.execute.start.silent_outputs import SilentOutputs
from r2bspec.execute.states import RunState
from r2bspec.ipc import protocol
from r2bspec.ipc.buffers import TF_STATIC, buffered_transforms
from r2bspec.ipc.protocol import STATIC
from r2bspec.ipc.schedule import CyclicSchedule, Schedule
from r2bspec.judge.measure.samples import SegmentSamples
from r2bspec.judge.rate_decision import load_scipy
from r2bspec.native.build import harness_library, join_object
from r2bspec.plan.plan import GRAPH_ROLES, InputPlan, Plan, ProcessPlan
from r2bspec.record import run_record

_WARM_UP_HZ = 30.0
_WARM_UP_STEPS = 10
_WARM_UP_RETRY_NS = 1_000_000_000
"""The length of each further attempt after one without output."""

_IDLE_WINDOW_S = 1.0
"""For how long the nodes are observed while nothing is played."""

_DIAGNOSED_ATTEMPT = 3
"""After this attempt without output the path is traced, so that the reason is said early."""


class Start:
    """A start of all processes.

    Attributes:
        number: among the starts of the run, from 1.
        confirms: whether it is part of the confirmation run.
        schedule: of the player; empty before `bring_up`.
        rows_dir: receives the rows of player and monitors.
        player: plays the segments; None before the graph is matched.
        anatomy: its processes, where they are observed from inside.
        unplayed: messages of inputs that are not played.
    """

    def __init__(
        self,
        plan: Plan,
        context: RunContext,
        launcher: Launcher,
        *,
        number: int = 1,
        confirms: bool = False,
        schedule: Schedule | None = None,
    ) -> None:
        """Create a start; no process runs yet.

        Args:
            plan: of the run.
            context: of the run.
            launcher: starts its processes.
            number: its number among the starts of the run, from 1.
            confirms: whether it is part of the confirmation run.
            schedule: of the player, where an earlier start has built it.
        """
        self._plan = plan
        self._context = context
        self._supervisor = context.supervisor
        self._launcher = launcher
        self.anatomy = launcher.anatomy = (
            AnatomyObservation(plan, number, context.events) if plan.anatomy else None
        )
        self._graph = PhaseGraph(plan, MEASURE_PHASE, context.supervisor, launcher, context.note)
        self._buffer_dir = context.buffer_dir
        self.rows_dir = context.scratch / f"rows-{number}"
        self.number = number
        self.confirms = confirms
        self.schedule: Schedule = schedule or CyclicSchedule(steps=())
        measured = plan.processes_in(MEASURE_PHASE)
        self._parts = harness_processes.HarnessProcesses(launcher, measured)
        self._observer: ManagedProcess | None = None
        self._silent_outputs: SilentOutputs | None = None
        self.player: SegmentPlayer | None = None
        self.unplayed: tuple[run_record.UnplayedMessages, ...] = ()

    @property
    def segments(self) -> tuple[run_record.Segment, ...]:
        """The segments that have been played."""
        return tuple(self.player.segments) if self.player else ()

    @property
    def samples(self) -> Mapping[str, SegmentSamples]:
        """The samples of the segments that are judged, by id; see `SegmentPlayer.samples`."""
        return self.player.samples if self.player else {}

    @property
    def output_gaps(self) -> tuple[run_record.OutputGapRecord, ...]:
        """Outputs that have stopped since the start."""
        return tuple(self._silent_outputs.records) if self._silent_outputs else ()

    def foreign_publishers(self) -> tuple[str, ...]:
        """Return in words the publishers on played and recorded topics that are not of this run.

        Raises:
            RunError: the observer does not answer.
        """
        # An iteration with a profiler ends all processes.
        if self._observer is None or not self._observer.is_running:
            return ()
        return foreign_publishers(self._supervisor)

    def look_at_loaded_files(self) -> None:
        """Record the files that the processes of the graph have loaded so far.

        Raises:
            RunError: a process has exited.
        """
        hosts = [process for process in self._supervisor if process in self._launcher.hosts]
        others = [
            process
            for process in self._supervisor
            if process.role in GRAPH_ROLES and process not in self._launcher.hosts
        ]
        self._context.loaded_files.look(hosts, others)

    def bring_up(self) -> SegmentPlayer:
        """Start all processes and warm them up.

        Raises:
            RunError: the graph is not ready in time, or has no output.
        """
        player, monitor = self._start_harness()
        self._enter(RunState.GRAPH, "starting the graph")
        # While nodes start, and before anything is played; a later start finds it imported.
        is_judged = self._plan.objectives or self._plan.search or self._plan.sustained_hz
        scipy = load_scipy() if is_judged else None
        deadline = readiness.StartDeadline(self._plan.start_timeout.ns)
        settings = protocol.ConfigureObserver(
            guarded=guarded_topics(self._plan),
            buffer_dir=str(self._buffer_dir),
            latched=self._latched,
            # In a live run, a node of the graph publishes it.
            clock=self._plan.clock and bool(self._plan.inputs),
        )
        observer = self._observer = self._launcher.start_observer(settings)
        with self._creating_nodes():
            if monitor is None:
                player, monitor = self._start_joined_nodes(deadline)
            else:
                running = self._parts.node_hosts()
                self._launcher.start_nodes(self._node_processes(), deadline, running)
            self._bring_up_lifecycle_nodes(observer, deadline)
            self._connect_graph(player, monitor, observer, deadline)
        segment_player = self.player = (SegmentPlayer if player else LiveSegmentWatcher)(
            self._plan,
            self._context,
            player,
            self.rows_dir,
            schedule=self.schedule,
            latching=observer if self._latched else None,
            confirms=self.confirms,
            start=self.number,
            anatomy=self.anatomy,
        )
        silent_outputs = self._silent_outputs = SilentOutputs(
            self._graph, self.rows_dir, monitor, segment_player
        )
        with deadline.paused():
            self._wait_until_ready()
        if scipy is not None:
            scipy.join()
        self.look_at_loaded_files()
        self._warm_up(segment_player, silent_outputs, deadline)
        self._read_scheduling()
        segment_player.watch_work(self._graph_processes())
        segment_player.on_output_stopped = silent_outputs.explain_stop
        return segment_player

    @contextlib.contextmanager
    def _creating_nodes(self) -> Iterator[None]:
        """Of a process that ends in the block by an exception, its node could not be created.

        Raises:
            GraphDifferencesError: this is so.
        """
        try:
            yield
        except errors.ProcessDiedError as died:
            nodes = (
                process.nodes for process in self._plan.processes if process.name == died.process
            )
            if error := not_created(died, next(nodes, ())):
                raise error from died
            raise
        except errors.ProcessFailedError as failed:
            made = [node for process in self._plan.processes for node in process.nodes]
            if error := not_made(failed, made):
                raise error from failed
            raise

    def _enter(self, state: RunState, text: str) -> None:
        self._context.states.enter(state, text)

    def _start_harness(self) -> tuple[ManagedProcess | None, ManagedProcess | None]:
        """Start player and monitors; both are None in the graph, and a live run has no player.

        The processes of Python nodes are started with these, and all import ROS at the same time;
        their nodes are created later.
        """
        plan, launcher = self._plan, self._launcher
        self.rows_dir.mkdir()
        again = f" again: start {self.number}" if self.number > 1 else ""
        self._enter(RunState.START, f"starting player and monitor{again}")
        launcher.check_shared_memory(plan, MEASURE_PHASE)
        if plan.harness.placement == "graph":
            return None, None
        launcher.start_early(self._node_processes(), message_packages(plan))
        player = self._parts.start("player") if plan.inputs or plan.called else None
        monitor = self._parts.start("monitor")
        monitors = plan.topic_monitors
        settings = protocol.ConfigureMonitor(monitors=monitors, rows_dir=str(self.rows_dir))
        if player is not None and plan.called and not plan.inputs:
            launcher.configure_all([(player, self._call_settings()), (monitor, settings)])
            return player, monitor
        if player is None:
            launcher.configure(monitor, settings)
            return player, monitor
        ready, _ = launcher.configure_all([(player, self._player_settings()), (monitor, settings)])
        self._load_schedule(player, ready)
        return player, monitor

    def _player_settings(self) -> protocol.ConfigurePlayer:
        return protocol.ConfigurePlayer(
            inputs=self._plan.inputs,
            buffer_dir=str(self._buffer_dir),
            rows=str(self.rows_dir / PLAYBACK_ROWS),
            transforms=buffered_transforms(self._buffer_dir),
        )

    @property
    def _latched(self) -> tuple[InputPlan, ...]:
        """What the observer publishes: /tf_static, and the inputs of one message."""
        static = (STATIC,) if TF_STATIC in buffered_transforms(self._buffer_dir) else ()
        return *static, *self._plan.latched_inputs

    def _load_schedule(self, player: ManagedProcess, ready: protocol.Ready) -> None:
        """Let the player load all messages that it will play into its memory.

        Raises:
            ProcessFailedError: a recorded message on /tf is damaged.
        """
        if not self.schedule.steps:
            self.schedule, self.unplayed = build_schedule(
                self._plan, self._buffer_dir, ready.headers, self._context.note
            )
        try:
            self._launcher.configure(player, protocol.LoadSchedule(schedule=self.schedule))
        except ValueError as error:
            # The stamps of transforms are looked up in the recorded messages.
            raise errors.ProcessFailedError(f"player: {error}") from error

    def _node_processes(self) -> list[ProcessPlan]:
        return [
            process
            for process in self._plan.processes_in(MEASURE_PHASE)
            if process.role in GRAPH_ROLES
        ]

    def _start_joined_nodes(
        self, deadline: readiness.StartDeadline
    ) -> tuple[ManagedProcess | None, ManagedProcess]:
        """Start the nodes, and the player and the monitors in their processes."""

        def configure_player(player: ManagedProcess) -> None:
            ready = self._launcher.configure(player, self._player_settings())
            self._load_schedule(player, ready)

        harness = harness_processes.GraphHarness(
            self._launcher, self._plan, configure_player, self.rows_dir
        )
        files = built(join_object), built(harness_library)
        joins = harness_processes.GraphJoins(self._supervisor, self.rows_dir, *files)
        self._launcher.joins = joins
        try:
            packages = message_packages(self._plan)
            self._launcher.start_early(self._node_processes(), packages, observer=False)
            self._launcher.start_nodes(
                self._node_processes(), deadline, on_joined=harness.configure
            )
        finally:
            joins.close()
        return harness.player, harness.monitor

    def _bring_up_lifecycle_nodes(
        self, observer: ManagedProcess, deadline: readiness.StartDeadline
    ) -> None:
        """Configure and activate them, before their endpoints are waited for."""
        if not self._plan.states_in(MEASURE_PHASE):
            return
        self._launcher.wait_for_observer(observer)
        self._graph.lifecycle.bring_up(
            deadline,
            lambda transition: self._enter(RunState(transition), f"lifecycle nodes: {transition}"),
        )
        if self._context.states.state is not RunState.GRAPH:
            self._enter(RunState.GRAPH, "connecting the graph")
        self._launcher.describe_lifecycle_nodes()

    def _connect_graph(
        self,
        player: ManagedProcess | None,
        monitor: ManagedProcess,
        observer: ManagedProcess,
        deadline: readiness.StartDeadline,
    ) -> None:
        """Create the subscriptions of the monitor, after the nodes; wait until all are matched."""
        plan, supervisor = self._plan, self._supervisor
        monitors = plan.topic_monitors
        subscriptions = MonitorSubscriptions(supervisor, monitor, monitors)
        self._launcher.wait_for_observer(observer)
        subscriptions.update()
        if plan.external:
            readiness.wait_for_external(plan, supervisor, deadline)
        watched = [watch.topic for watch in plan.topic_monitors]
        expected = {monitor: dict.fromkeys(watched, 1)}
        caller = self._start_caller(player) if player is not None and plan.called else None
        if caller is not None:
            readiness.wait_for_services(supervisor, caller, deadline)
        if player is not None and plan.inputs:
            transforms = subscription_counts(self._graph, buffered_transforms(self._buffer_dir))
            if self._latched:
                expected[observer] = {
                    each.topic: transforms.pop(TF_STATIC)
                    if each is STATIC
                    else expected_subscriptions(self._graph, each.topic)
                    for each in self._latched
                }
            expected[player] = transforms | {
                source.topic: expected_subscriptions(self._graph, source.topic)
                for source in plan.inputs
            }
        wait_until_matched(self._graph, expected, deadline, subscriptions.update)
        ends = [(source.topic, source.type, "publishes") for source in plan.inputs]
        ends += [(watch.topic, watch.type, "subscribes") for watch in monitors]
        wait_for_mutual_discovery(self._graph, ends)

    def _start_caller(self, player: ManagedProcess) -> ManagedProcess:
        """Return the process that calls services: the player, or one that follows its steps.

        It is started when all that is played belongs to the graph.
        """
        if not self._plan.inputs:
            return player
        caller = self._parts.start("caller")
        settings = self._call_settings(follows=str(self.rows_dir / PLAYBACK_ROWS))
        self._launcher.configure(caller, settings)
        return caller

    def _call_settings(self, follows: str = "") -> protocol.ConfigureCalls:
        plan, timeline = self._plan, None
        if plan.timeline is not None and not plan.inputs:
            timeline = build_call_timeline(plan.calls or (), plan.timeline, self._buffer_dir)
            self.schedule = timeline
        calls = tuple(
            msgspec.structs.replace(call, request={}, each=tuple(call.requests))
            for name, call in plan.called.items()
            if name == call.name
        )
        return protocol.ConfigureCalls(
            calls=calls,
            rows_dir=str(self.rows_dir),
            buffer_dir=str(self._buffer_dir),
            follows=follows,
            timeline=timeline,
        )

    def _read_scheduling(self) -> None:
        """Note how the threads of processes are scheduled whose scheduling is in the plan."""
        plans = {process.name: process for process in self._plan.processes}
        for child in self._supervisor:
            plan = plans.get(child.name)
            if plan is not None and (plan.scheduling or plan.cpus or plan.nice):
                child.scheduling = read_scheduling(child.pid)

    def _wait_until_ready(self) -> None:
        """Wait for the readiness probes, run the `after_ready` steps, and check parameters."""
        plan, context = self._plan, self._context
        if plan.ready:
            self._enter(RunState.READY, "waiting for the readiness probes")
            for probe in plan.ready:
                readiness.wait_for_probe(probe, self._supervisor, context.folder, context.base_dir)
        if plan.after_ready:
            self._enter(RunState.AFTER_READY, "running the after_ready steps")
            for step in plan.after_ready:
                self._launcher.run_step(step)
        self._graph.check_parameters()

    def _warm_up(
        self,
        segment_player: SegmentPlayer,
        silent_outputs: SilentOutputs,
        deadline: readiness.StartDeadline,
    ) -> None:
        """Play until every monitor has received a message, and at least for the planned time.

        The first messages take ten times the median: pages are touched for the first time, and
        nodes initialise themselves. The measurements must not contain them. The rate is not more
        than `_WARM_UP_HZ`, so that queues of nodes that are not ready yet do not overflow.
        """
        plan = self._plan
        self._enter(RunState.WARM_UP, "warming up")
        rates = [play.rate_hz for play in plan.play]
        rates += [plan.search.min_hz] if plan.search else []
        rate_hz = min([_WARM_UP_HZ, *rates])
        title = f"warm-up at {rate_hz:g} Hz" if rate_hz else "warm-up"
        later = f"start-{self.number}-" if self.number > 1 else ""
        began_s = time.monotonic()
        for attempt in range(1, 1000):
            segment_player.play_for(
                SegmentHeading("warm_up", f"{later}warm_up-{attempt:03d}", title, attempt),
                rate_hz,
                max(plan.warm_up.ns, 0 if attempt == 1 else _WARM_UP_RETRY_NS),
                min_steps=_WARM_UP_STEPS,
            )
            silent = [name for name, count in segment_player.received().items() if not count]
            if not silent:
                return
            waited_s = time.monotonic() - began_s
            final = deadline.over or (
                attempt > _DIAGNOSED_ATTEMPT
                and waited_s > readiness.patience_s(plan.start_timeout.seconds)
                and self._is_idle()
            )
            if final or attempt == _DIAGNOSED_ATTEMPT:
                silent_outputs.explain_start(silent, final=final)

    def _graph_processes(self) -> dict[int, list[int]]:
        """Return the pids of each process tree of the graph, by its index in the record."""
        started = {record.pid: index for index, record in enumerate(self._supervisor.records())}
        names = {process.name for process in self._node_processes()}
        names |= {process.name for process in self._plan.processes if process.nodes}
        return {
            started[child.pid]: family(child.pid)
            for child in self._supervisor
            if child.name in names
        }

    def _is_idle(self) -> bool:
        """Return whether all nodes have processed what was played, and wait for more.

        Never in a live run, whose source publishes all the time.
        """
        if not self._plan.inputs:
            return False
        idle = readiness.IdleNodes(self._plan, MEASURE_PHASE, self._supervisor)
        self._supervisor.pump_for(_IDLE_WINDOW_S)
        if idle.update() == 0 or not idle.answer():
            return False
        self._context.note("all nodes are idle and answer: the start is no longer waited for")
        return True


@dataclass
class StartSequence:
    """The starts of a run and of its confirmation; at most one of them runs at a time.

    Attributes:
        make_launcher: a new launcher, once the buffers are complete.
        starts: all so far, the running one last.
        records: of the starts whose graph was warmed up.
        foreign: publishers that are no process's of the run, in words.
    """

    plan: Plan
    context: RunContext
    make_launcher: Callable[[], Launcher]
    starts: list[Start] = field(default_factory=list)
    records: list[run_record.StartRecord] = field(default_factory=list)
    foreign: tuple[str, ...] = ()

    def begin(self, *, confirms: bool = False) -> SegmentPlayer:
        """End the current start, if there is one, and start all processes afresh.

        Args:
            confirms: whether it is part of the confirmation run.

        Raises:
            RunError: a process of the old start has exited, or the new one fails.
        """
        began_ns = time.monotonic_ns()
        start = self._next(self.plan, confirms=confirms)
        segment_player = start.bring_up()
        self.records.append(
            run_record.StartRecord(
                number=start.number,
                began_ns=began_ns,
                ready_ns=time.monotonic_ns(),
                confirms=confirms,
            )
        )
        return segment_player

    def begin_uncounted(self, plan: Plan) -> SegmentPlayer:
        """End the current start, and start the processes of a changed plan; it is not recorded.

        Raises:
            RunError: a process of the old start has exited, or the new one fails; likewise where
                the plan is observed from inside, and what observes it cannot be built (R2B668).
        """
        return self._next(plan, confirms=False).bring_up()

    def _next(self, plan: Plan, *, confirms: bool) -> Start:
        """End the current start, if any, and return the next start, of which nothing runs yet."""
        before = self.starts[-1] if self.starts else None
        if before is not None:
            # Detect a process that exited after the last message, which also fails the run.
            self.context.supervisor.pump(0.0)
            self.find_foreign_publishers()
            before.look_at_loaded_files()
            self.context.supervisor.end(list(self.context.supervisor))
        start = Start(
            plan,
            self.context,
            self.make_launcher(),
            number=len(self.starts) + 1,
            confirms=confirms,
            schedule=before.schedule if before is not None else None,
        )
        self.starts.append(start)
        return start

    def find_foreign_publishers(self) -> bool:
        """Look for foreign publishers, and return True if there have ever been any."""
        before = self.foreign
        publishers = self.starts[-1].foreign_publishers() if self.starts else ()
        self.foreign = tuple(dict.fromkeys((*before, *publishers)))
        for publisher in self.foreign[len(before) :]:
            self.context.note(f"a program outside of this run has published on {publisher}")
        return bool(self.foreign)

    def name_start(self, error: errors.RunError) -> None:
        """Add to an error the start in which it occurred, unless it is the first."""
        if len(self.starts) < 2 or isinstance(error, errors.InterruptedRunError):
            return
        confirms = ", which confirms a failure" if self.starts[-1].confirms else ""
        which = f" (in start {len(self.starts)}{confirms})"
        error.args = (f"{error}{which}", *error.args[1:])
        if isinstance(error, errors.GraphDifferencesError):
            error.details = f"{error.details}{which}".strip()
