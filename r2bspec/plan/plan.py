"""The plan of a run, as frozen values that serialise to canonical JSON.

Topic and node names are fully resolved (``/r2b/image``). Times are in nanoseconds, rates in hertz.
Paths are as in the spec, relative to its folder, so that a plan has the same bytes on every
machine.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any, Final, Literal

import msgspec

from r2bspec.language.benchmark_defaults import CONFIDENCE, MAX_STARTS, MIN_CONFIDENCE
from r2bspec.language.comparison_grammar import Requirement
from r2bspec.language.spec import (
    Arrivals,
    LifecycleState,
    MonitorSettings,
    Network,
    Objective,
    Pacing,
    ProcessSettings,
    QoS,
    Requires,
    Scalar,
)

_Confidence = Annotated[float, msgspec.Meta(ge=MIN_CONFIDENCE, lt=1)]
_Count = Annotated[int, msgspec.Meta(ge=0)]


class _Value(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Base of all plan values: immutable and closed."""


class BagTopicPlan(_Value, frozen=True, kw_only=True):
    """One topic of the bag: its names in the bag and in the graph, and its metadata."""

    bag_topic: str
    topic: str
    type: str
    count: int
    rate_hz: float


class DatasetPlan(_Value, frozen=True, kw_only=True):
    """A recording. `source` is the bag as in the spec; empty in a live benchmark.

    Attributes:
        start_ns: the start of the window, relative to the first message of all recordings.
        publish_tf: whether its /tf is published to the preprocessors and played with the inputs.
        publish_tf_static: whether its /tf_static is published, latched, before all other messages
            of a phase.
        real_time: whether the preprocessors receive the messages at their recorded times, instead
            of as fast as they process them.
    """

    source: str
    kind: Literal["recorded", "synthetic"]
    sha256: str
    start_ns: int
    end_ns: int | None
    topics: tuple[BagTopicPlan, ...]
    publish_tf: bool = False
    publish_tf_static: bool = False
    real_time: bool = False


class NodePlan(_Value, frozen=True, kw_only=True):
    """A node: its resolved name, its program, its parameters, and its remappings as written.

    `target` is ``module.Class`` or ``./file.py:Class`` for Python nodes and empty otherwise.
    `parameters` are the effective ones, from all files and values of the spec; only for a
    `command`, parameters from files are passed by ``--params-file`` on its command line.

    Attributes:
        package: the ROS package of a `plugin`, which is the class of a C++ component; both are
            empty for other nodes. A plugin is loaded into its container with this name,
            namespace, and these parameters and remappings.
        parameter_files: the files that `parameters` are from, as in the spec, in the order in which
            they apply; a node without any has no such key.
        intra_process: whether a plugin is loaded with ``use_intra_process_comms``; a node that is
            not has no such key.
        extra_arguments: further arguments that a plugin is loaded with; likewise.
    """

    name: str
    node: str
    namespace: str
    target: str
    parameters: dict[str, Any]
    remappings: dict[str, str]
    package: str = ""
    plugin: str = ""
    parameter_files: tuple[str, ...] | msgspec.UnsetType = msgspec.UNSET
    intra_process: bool | msgspec.UnsetType = msgspec.UNSET
    extra_arguments: dict[str, Any] | msgspec.UnsetType = msgspec.UNSET


class JoinPlan(_Value, frozen=True, kw_only=True):
    """The parts of the harness in a process of the graph.

    Attributes:
        player: whether the player is one.
        monitors: the monitors, by name.
        program: which program or node of a launch file gets them; empty for the first one of the
            process that is a ROS node.
    """

    player: bool = False
    monitors: tuple[str, ...] = ()
    program: str = ""


class ProcessPlan(ProcessSettings, frozen=True, kw_only=True):
    """A process. `env` has only the changes to the environment common to all processes.

    In `argv`, ``$(python)`` is the interpreter that runs r2bspec, ``$(harness)`` the program of
    player and monitor, which is built on first use (`r2bspec.native`), ``$(executable P E)`` the
    path of executable E of package P in the ament index, and ``$(included_launch)`` the launch file
    of r2bspec that includes another (`r2bspec.harness.included_launch`). The `prefix` of the spec
    is at the beginning of `argv`. `nodes` of a command has its name in the spec; a command need not
    be a ROS node. The fields of `ProcessSettings` are keys of the spec.

    Roles:
        loader, player, monitor: processes of the harness, configured over the control channel.
        caller: the same; it calls services and actions while the player plays topics.
        harness: player and monitor in one process, with the Python nodes in `nodes`.
        host: a process of Python nodes, which it spins with `executor` and `threads`.
        container: a C++ component container, into which the `nodes` are loaded in order with its
            ``_container/load_node`` service.
        command: any other process, including an executable of a package or a launch file.

    Attributes:
        container: the name of the container in the spec; empty for other processes.
        memory_limit_bytes: the resident memory at which the run fails; 0 for none.
        join: the parts of the harness that run in it.
    """

    name: str
    role: Literal[
        "loader", "player", "caller", "monitor", "harness", "host", "container", "command"
    ]
    phase: Literal["preprocess", "measure"]
    argv: tuple[str, ...]
    env: dict[str, str]
    nodes: tuple[NodePlan, ...] = ()
    container: str = ""
    memory_limit_bytes: int = 0
    join: JoinPlan | None = None


HARNESS_ROLES: Final = frozenset({"loader", "player", "caller", "monitor", "harness"})
"""Roles of the processes of r2bspec."""

GRAPH_ROLES: Final = frozenset({"host", "container", "command"})
"""Roles of the processes of the graph; with ``placement: harness`` its nodes are in that one."""

HARNESS_PARTS: Final = ("loader", "player", "monitor")
"""Who reads and writes topics beside nodes, whose full names begin with a slash."""


class ExternalPlan(_Value, frozen=True, kw_only=True):
    """A node that must already run when the graph starts; the run does not start or end it."""

    name: str
    phase: Literal["preprocess", "measure"]


class LifecyclePlan(_Value, frozen=True, kw_only=True):
    """A lifecycle node, and the state into which the run brings it before its topics are used."""

    name: str
    phase: Literal["preprocess", "measure"]
    state: LifecycleState


class SetupPlan(_Value, frozen=True, kw_only=True):
    """A command that runs before all processes, in order and without a shell.

    It is skipped if the file `creates` (relative to the folder of the spec) exists; the file is
    locked while it is created. `directory` is the working directory, relative to the folder of the
    spec.
    """

    name: str
    argv: tuple[str, ...]
    creates: str
    directory: str
    env: dict[str, str]
    timeout_ns: int


ProbeKind = Literal["file", "service", "log", "topic"]


class ProbePlan(_Value, frozen=True, kw_only=True):
    """A condition that must be met before the graph counts as ready.

    Attributes:
        target: the path of a `file`, relative to the folder of the spec; the full name of a
            `service`, or of a `topic` that must have a publisher and a subscription; the process
            of a `log`.
        pattern: the regular expression that must match in a line of a `log`.
    """

    name: str
    kind: ProbeKind
    target: str
    pattern: str = ""
    timeout_ns: int


class AfterReadyPlan(_Value, frozen=True, kw_only=True):
    """A step after the graph is ready: a command without a shell, or a service call."""

    name: str
    argv: tuple[str, ...] = ()
    service: str = ""
    service_type: str = ""
    request: dict[str, Any] = {}
    timeout_ns: int


class TopicPlan(_Value, frozen=True, kw_only=True):
    """A topic with its publishers (`writers`) and subscribers (`readers`).

    These are full node names (``/r2b/apriltag``), ``loader``, ``player`` or ``monitor``; the
    loader subscribes to topics that it records for playback. A node with an unknown interface is
    in neither. An empty type is unknown. `qos` has the known profiles that they offer or request.
    """

    name: str
    type: str
    phase: Literal["preprocess", "measure"]
    writers: tuple[str, ...]
    readers: tuple[str, ...]
    qos: dict[str, QoS] = {}


class InputPlan(_Value, frozen=True, kw_only=True):
    """An input of the graph: the topic that is played, and the source of its messages.

    `bag_topic`, as in the spec, is set if they are from the bag; otherwise the preprocessors
    publish them on `source`. With `timestamp` ``none`` the header stamp remains as recorded. In a
    timeline, `later_ns` is the delay of the input, and of its stamps, relative to the recording.

    Attributes:
        slop_ns: by how much its stamp may differ from that of the input with the fewest messages
            in the same step.
        recorded_rate: whether its messages are played between the steps, and belong to none.
        ahead_ns: is taken from its recorded stamps.
    """

    topic: str
    type: str
    source: str
    bag_topic: str
    qos: QoS
    timestamp: Literal["header", "none"] = "header"
    later_ns: int = 0
    slop_ns: int = 0
    recorded_rate: bool = False
    ahead_ns: int = 0


_Ratio = Annotated[int, msgspec.Meta(ge=1, le=1_000_000)]
"""One side of the ratio of inputs to outputs."""


class MonitorPlan(MonitorSettings, frozen=True, kw_only=True):
    """A monitored topic. The fields of `MonitorSettings` are keys of the spec.

    Attributes:
        ratio_inputs: this number of inputs leads to `ratio_outputs` messages.
        answers: in a timeline, the topics of the inputs, or the recorded call, that it answers: a
            step counts for it if
            it has messages of all of them. Otherwise empty, because each step has all inputs.
    """

    name: str
    topic: str
    type: str
    ratio_inputs: _Ratio = 1
    ratio_outputs: _Ratio = 1
    answers: tuple[str, ...] = ()


class CallPlan(_Value, frozen=True, kw_only=True):
    """A service or an action that is called in each step.

    Attributes:
        name: the name of the monitor that has the responses, or the results.
        target: the full name of the service or the action.
        request: the fields of the request, or of the goal.
        each: fields that replace some of them, in turn; a plan without them has no such key.
        every: it is called in the last of so many steps; not there if it is in each.
        source: the loaded topic with recorded requests, of which those fields replace some, in
            turn or, in a timeline, at their times; not there without one.
        success: the field of a response that is false if the call has failed; empty for none.
        accepted: of an action, the monitor that has the acceptances of goals; else empty.
        feedback: of an action, the monitor that has the feedback; empty for none.
    """

    name: str
    target: str
    type: str
    request: dict[str, Any]
    each: tuple[dict[str, Any], ...] | msgspec.UnsetType = msgspec.UNSET
    every: int | msgspec.UnsetType = msgspec.UNSET
    source: str | msgspec.UnsetType = msgspec.UNSET
    success: str = ""
    accepted: str = ""
    feedback: str = ""

    @property
    def topic(self) -> str:
        """The name under which `MonitorPlan.answers` refers to the call."""
        return self.name

    @property
    def requests(self) -> tuple[dict[str, Any], ...]:
        """The stated fields of every request, in turn."""
        each = ({},) if self.each is msgspec.UNSET else self.each
        return tuple({**self.request, **fields} for fields in each)


StepSources = Sequence[InputPlan | CallPlan]
"""What a step is made of: inputs, or recorded calls."""


class SearchPlan(_Value, frozen=True, kw_only=True):
    """The peak search; `precision` is a relative width, as a fraction.

    The lower end of its result is played for `confirm_ns`; 0 in plans of versions that did not.
    """

    min_hz: float
    max_hz: float
    precision: float
    probe_ns: int
    holds: tuple[Requirement, ...]
    confidence: _Confidence = CONFIDENCE
    confirm_ns: int = 0


class PlayPlan(_Value, frozen=True, kw_only=True):
    """`iterations` times `duration_ns` at one rate.

    A rate of 0 is that of the recording (timeline), or of the graph's own source (live).
    `max_iterations` is the limit if `iterations` do not decide; 0 means `iterations`.
    """

    rate_hz: Annotated[float, msgspec.Meta(ge=0)]
    duration_ns: _Count
    iterations: _Count
    max_iterations: _Count = 0


class TimelinePlan(_Value, frozen=True, kw_only=True):
    """How recorded times are converted to playback times.

    Attributes:
        speed: the speed of the playback relative to the recording; 1.0 is as recorded.
        recorded: whether the times are those at which the preprocessors published the messages,
            instead of those of the recording.
        shift_tf: whether stamps in /tf are also shifted.
    """

    speed: float
    recorded: bool
    shift_tf: bool


class HarnessPlan(_Value, frozen=True, kw_only=True):
    """The processes of the player and the monitors: separate, one, or those of the graph."""

    placement: Literal["separate", "shared", "graph"] = "separate"


class GatePlan(_Value, frozen=True, kw_only=True):
    """How verdicts are decided, and their consequences; a budget of 0 means no limit."""

    confidence: _Confidence = CONFIDENCE
    inconclusive: Literal["report", "pass", "fail"] = "report"
    confirm: bool = True
    time_budget_ns: int = 0
    interference: Literal["tolerate", "note"] = "note"


_OF_NODES = frozenset({"host", "container", "command"})
"""Roles of processes without a part of the harness, as a rule."""


class Plan(Pacing, frozen=True, kw_only=True):
    """The plan of a run.

    `phases` are those of setup, load, preprocess, start, graph, configure, activate, ready,
    after_ready, warm_up, search, sustained, play and collect that the run has, in this order.
    `sustained_hz` are the rates that an objective requires to be sustained, with one sequential
    probe each.
    `play_at_peak` is played at the peak rate of the search, if an objective needs it; its own rate
    is 0. `largest_message_bytes` is over the bag topics that are used, and 0 if unknown. The fields
    of `Pacing` are keys of the spec.

    Attributes:
        objectives: the active ones: their level is not `off`, and all variables have the values in
            their `when`.
        datasets: all recordings, if there are several; `dataset` is the first of them. Empty if
            there is one.
        timeline: only in this mode.
        external: nodes that must already run.
        segment_bytes: the size of the shared memory segment in the spec; 0 derives it from the
            largest message.
        starts: how often all processes are started, each time for a part of the iterations;
            see `r2bspec.plan.interim_looks`.
        clock: whether loader and player publish the system time on /clock.
        requires: what the machine must be; a plan without it has no such key.
        lifecycle: the nodes whose states the run changes, in this order; likewise.
        calls: the services and actions that are called; a plan without them has no such key.
        anatomy: whether the processes of the graph are observed from inside, or of which nodes;
            likewise.
        latched: the inputs of which one message is published before the first step; likewise.
        arrivals: when the steps come, if not at equal intervals; likewise.
        network: what is emulated between the processes; likewise.
    """

    r2bspec_plan: Literal[1] = 1
    generator: str
    name: str
    title: str
    description: str
    labels: dict[str, Scalar]
    namespace: str
    environment: tuple[str, ...]
    transport: Literal["inherit", "shared_memory", "udp"]
    largest_message_bytes: int
    dataset: DatasetPlan
    processes: tuple[ProcessPlan, ...]
    topics: tuple[TopicPlan, ...]
    playback_mode: Literal["timeline", "looping", "sweeping", "live"]
    buffer: int
    inputs: tuple[InputPlan, ...]
    monitors: tuple[MonitorPlan, ...]
    phases: tuple[str, ...]
    search: SearchPlan | None
    sustained_hz: tuple[float, ...]
    play: tuple[PlayPlan, ...]
    objectives: dict[str, Objective]
    datasets: tuple[DatasetPlan, ...] = ()
    timeline: TimelinePlan | None = None
    harness: HarnessPlan = HarnessPlan()
    external: tuple[ExternalPlan, ...] = ()
    setup: tuple[SetupPlan, ...] = ()
    ready: tuple[ProbePlan, ...] = ()
    after_ready: tuple[AfterReadyPlan, ...] = ()
    gate: GatePlan = GatePlan()
    segment_bytes: int = 0
    play_at_peak: PlayPlan | None = None
    starts: Annotated[int, msgspec.Meta(ge=1, le=MAX_STARTS)] = 1
    unpaired: Literal["refuse", "drop"] = "refuse"
    clock: bool = False
    requires: Requires | msgspec.UnsetType = msgspec.UNSET
    lifecycle: tuple[LifecyclePlan, ...] | msgspec.UnsetType = msgspec.UNSET
    calls: tuple[CallPlan, ...] | msgspec.UnsetType = msgspec.UNSET
    anatomy: Literal[True] | tuple[str, ...] | msgspec.UnsetType = msgspec.UNSET
    latched: tuple[InputPlan, ...] | msgspec.UnsetType = msgspec.UNSET
    arrivals: Arrivals | msgspec.UnsetType = msgspec.UNSET
    network: Network | msgspec.UnsetType = msgspec.UNSET

    def observes(self, process: ProcessPlan) -> bool:
        """Return True if a process is observed from inside: those of the harness always are."""
        if not isinstance(self.anatomy, tuple) or process.join or process.role not in _OF_NODES:
            return bool(self.anatomy)
        owned = {process.name, process.container, *(node.node for node in process.nodes)}
        return not owned.isdisjoint(self.anatomy)

    def processes_in(self, phase: str) -> tuple[ProcessPlan, ...]:
        """Return the processes that run in a phase."""
        return tuple(process for process in self.processes if process.phase == phase)

    def states_in(self, phase: str) -> dict[str, LifecycleState]:
        """Return the nodes of a phase whose states the run changes, in order, with these states."""
        return {each.name: each.state for each in self.lifecycle or () if each.phase == phase}

    @property
    def latched_inputs(self) -> tuple[InputPlan, ...]:
        """The inputs of which a single message is published before the first step."""
        return () if self.latched is msgspec.UNSET else self.latched

    @property
    def called(self) -> dict[str, CallPlan]:
        """The services and actions that are called, by the monitors of their answers."""
        calls = () if self.calls is msgspec.UNSET else self.calls
        return {
            name: call
            for call in calls
            for name in (call.name, call.accepted, call.feedback)
            if name
        }

    @property
    def step_sources(self) -> StepSources:
        """The meaning of the input bits of a step: inputs, or recorded calls."""
        return self.inputs or tuple(call for call in self.calls or () if call.source)

    @property
    def topic_monitors(self) -> tuple[MonitorPlan, ...]:
        """The monitors of topics, without those of answers to calls."""
        return tuple(monitor for monitor in self.monitors if monitor.name not in self.called)

    @property
    def load(self) -> tuple[str, ...]:
        """How the load differs from messages at equal intervals within one machine, in words."""
        arrivals, network = self.arrivals or None, self.network or None
        texts = (str(arrivals) if arrivals else "", f"network: {network}" if network else "")
        return tuple(filter(None, texts))

    @property
    def plays(self) -> tuple[PlayPlan, ...]:
        """The plays at each rate, the peak included."""
        return (*self.play, *([self.play_at_peak] if self.play_at_peak is not None else []))
