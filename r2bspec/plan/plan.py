"""The plan: everything that a run will do, as frozen values that serialise to canonical JSON.

Topic and node names are fully resolved here (``/r2b/image``). Times are nanoseconds, rates hertz.
Paths are as the spec wrote them, relative to the spec's folder, so that a plan has the same bytes
on every machine.
"""

from __future__ import annotations

from typing import Any, Literal

import msgspec

from r2bspec.language.confidence import CONFIDENCE
from r2bspec.language.requirement_grammar import Requirement
from r2bspec.language.spec import Objective, QoS, Scalar


class _Value(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Base of all plan values: immutable and closed."""


class BagTopicPlan(_Value, frozen=True, kw_only=True):
    """One topic of the bag: its name there, its name in the graph, and what the bag says of it."""

    bag_topic: str
    topic: str
    type: str
    count: int
    rate_hz: float


class DatasetPlan(_Value, frozen=True, kw_only=True):
    """A recording. `source` is the bag as the spec names it; empty in a live benchmark.

    Attributes:
        start_ns: where the window begins, after the first message of any recording of the plan.
        publish_tf: whether its /tf is given to the preprocessors and played along with the inputs.
        publish_tf_static: whether all of its /tf_static is published, latched, before anything
            else of a phase.
        real_time: whether the preprocessors get the messages as they were recorded in time,
            instead of as fast as they can take them.
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
    """A node: its resolved name, what it is, its parameters, and its remappings as written.

    `target` is ``module.Class`` or ``./file.py:Class`` for Python nodes and empty otherwise.
    `parameters` are those that it ends up with, from all files and values of the spec; but those
    of a `command` that come from files are left to ``--params-file`` on its command line.

    Attributes:
        package: the ROS package of a `plugin`, which is the class of a C++ component; both are
            empty for other nodes. A plugin is loaded into its container with this name,
            namespace, and these parameters and remappings.
    """

    name: str
    node: str
    namespace: str
    target: str
    parameters: dict[str, Any]
    remappings: dict[str, str]
    package: str = ""
    plugin: str = ""


class ProcessPlan(_Value, frozen=True, kw_only=True):
    """One process. `env` holds only the changes to the environment that the run gives to all.

    ``$(python)`` in `argv` stands for the interpreter that runs r2bspec; ``$(executable P E)``
    for the path of executable E of package P in the ament index; ``$(included_launch)`` for the
    launch file of r2bspec that includes another one (`r2bspec.harness.included_launch`). What the
    spec calls `prefix` stands at the beginning of `argv`. `nodes` of a command are what the spec
    calls it; a bare command need not be a ROS node.

    Roles:
        loader, player, monitor: the harness's own, configured over the control channel.
        harness: player and monitor in one process, with the Python nodes in `nodes` beside them.
        host: a process of Python nodes; `executor` and `threads` say how it spins them.
        container: a C++ component container, into which the `nodes` are loaded in order through
            its ``_container/load_node`` service once it is up. With a harness of
            ``ros2_benchmark`` the parts of the harness are among them.
        command: anything else, also an executable of a package or a launch file.

    Attributes:
        container: the name that the spec gives the container; empty for a process of the plan's
            own making.
        executor: how many threads a host spins its nodes with: one, or `threads` of them.
        threads: 0 leaves the number to the executor.
        nice: by how much the process yields to others; 0 changes nothing.
        cpus: the processors that it may run on; all if empty.
        memory_limit_bytes: resident memory at which the run ends; 0 for none.
    """

    name: str
    role: Literal["loader", "player", "monitor", "harness", "host", "container", "command"]
    phase: Literal["preprocess", "measure"]
    argv: tuple[str, ...]
    env: dict[str, str]
    nodes: tuple[NodePlan, ...] = ()
    container: str = ""
    executor: Literal["single_threaded", "multi_threaded"] = "single_threaded"
    threads: int = 0
    nice: int = 0
    cpus: tuple[int, ...] = ()
    memory_limit_bytes: int = 0


class ExternalPlan(_Value, frozen=True, kw_only=True):
    """A node that must already run when the graph starts, and that the run leaves alone."""

    name: str
    phase: Literal["preprocess", "measure"]


class SetupPlan(_Value, frozen=True, kw_only=True):
    """A command that runs before anything starts, one after the other, without a shell.

    It is skipped where the file `creates` (relative to the spec's folder) is there, and locked
    while it is made. `directory` is where it runs, relative to the spec's folder.
    """

    name: str
    argv: tuple[str, ...]
    creates: str
    directory: str
    env: dict[str, str]
    timeout_ns: int


class ProbePlan(_Value, frozen=True, kw_only=True):
    """What must be so before the graph counts as ready, as far as `kind` says.

    Attributes:
        target: the path of a `file`, relative to the spec's folder; the full name of a `service`
            or of a `topic` that must have a writer and a reader; the process of a `log`.
        pattern: the regular expression that a line of a `log` must contain.
    """

    name: str
    kind: Literal["file", "service", "log", "topic"]
    target: str
    pattern: str = ""
    timeout_ns: int


class AfterReadyPlan(_Value, frozen=True, kw_only=True):
    """What is done once the graph stands: a command without a shell, or a service call."""

    name: str
    argv: tuple[str, ...] = ()
    service: str = ""
    service_type: str = ""
    request: dict[str, Any] = {}
    timeout_ns: int


class TopicPlan(_Value, frozen=True, kw_only=True):
    """A topic: who writes and who reads it, by process-independent names.

    Writers and readers are full node names (``/r2b/apriltag``), ``loader``, ``player`` or
    ``monitor``; the loader reads what it records for playback. Where a node's interface is unknown,
    it is listed in neither. An empty type is unknown. `qos` is what each of them is known to offer
    or to ask for.
    """

    name: str
    type: str
    phase: Literal["preprocess", "measure"]
    writers: tuple[str, ...]
    readers: tuple[str, ...]
    qos: dict[str, QoS] = {}


class InputPlan(_Value, frozen=True, kw_only=True):
    """An input of the graph: the topic played, and where its messages come from.

    `bag_topic`, as the spec writes it, is set where they come straight from the bag; otherwise
    they are what the preprocessors publish on `source`. With `timestamp` ``none`` the header
    stamp stays as it was recorded. In a timeline, `later_ns` is by how much the input is played
    and stamped later than it was recorded.
    """

    topic: str
    type: str
    source: str
    bag_topic: str
    qos: QoS
    timestamp: Literal["header", "none"] = "header"
    later_ns: int = 0


class TapPlan(_Value, frozen=True, kw_only=True):
    """A topic on the way from the inputs to a monitored one, to be watched, too."""

    topic: str
    type: str


class MonitorPlan(_Value, frozen=True, kw_only=True):
    """A watched topic. `qos` None means: whatever its writer offers.

    Attributes:
        ratio_inputs: with `match` order, every so many inputs lead to `ratio_outputs` messages.
        label: how reports call it; its name if empty.
        answers: in a timeline, the topics of the inputs that it answers: a step counts for it if
            it has messages of all of them. Empty elsewhere, where each step has all inputs.
        taps: topics whose messages are matched by stamp, too; in the order of the plan's topics.
        parameters: for the component that watches, with a harness of ``ros2_benchmark``.
    """

    name: str
    topic: str
    type: str
    match: Literal["stamp", "order"]
    qos: QoS | None
    ratio_inputs: int = 1
    ratio_outputs: int = 1
    label: str = ""
    answers: tuple[str, ...] = ()
    taps: tuple[TapPlan, ...] = ()
    parameters: dict[str, Any] = {}


class SearchPlan(_Value, frozen=True, kw_only=True):
    """The search for the peak rate; `precision` is a relative width, as a fraction."""

    min_hz: float
    max_hz: float
    precision: float
    probe_ns: int
    holds: tuple[Requirement, ...]
    confidence: float = CONFIDENCE


class PlayPlan(_Value, frozen=True, kw_only=True):
    """`iterations` times `duration_ns` at one rate.

    A rate of 0 is that of the recording (timeline), or of the graph's own source (live).
    `max_iterations` is how many there may be where fewer decide nothing; 0 means `iterations`.
    """

    rate_hz: float
    duration_ns: int
    iterations: int
    max_iterations: int = 0


class TimelinePlan(_Value, frozen=True, kw_only=True):
    """How recorded time becomes time of play.

    Attributes:
        speed: of play relative to the recording; 1.0 is as recorded.
        recorded: whether the times are those at which messages came out of the preprocessors,
            instead of those of the recording.
        shift_tf: whether stamps inside /tf are shifted like all others.
    """

    speed: float
    recorded: bool
    shift_tf: bool


class PluginPlan(_Value, frozen=True, kw_only=True):
    """A C++ component that stands in for a part of the harness."""

    package: str
    plugin: str
    parameters: dict[str, Any] = {}


class HarnessPlan(_Value, frozen=True, kw_only=True):
    """Who plays and watches; the plugins are those of ``ros2_benchmark``, else None."""

    kind: Literal["r2bspec", "ros2_benchmark"] = "r2bspec"
    placement: Literal["separate", "shared"] = "separate"
    data_loader: PluginPlan | None = None
    playback: PluginPlan | None = None
    monitor: PluginPlan | None = None


class GatePlan(_Value, frozen=True, kw_only=True):
    """How verdicts are reached, and what they lead to; a budget of 0 is none."""

    confidence: float = CONFIDENCE
    inconclusive: Literal["report", "pass", "fail"] = "report"
    confirm: bool = True
    time_budget_ns: int = 0


class Plan(_Value, frozen=True, kw_only=True):
    """The whole run.

    `phases` are those of setup, load, preprocess, start, floor, graph, ready, after_ready, warm_up,
    search, sustained, play and collect that happen, in this order. `sustained_hz` are the rates
    that an objective requires to be sustained and that get one sequential probe each.
    `play_at_peak` is what is played at the rate that the search finds, where an objective speaks
    of it; its own rate is 0.
    `largest_message_bytes` is over the bag topics that are used, and 0 if unknown.

    Attributes:
        objectives: those that count: a level of `off`, or a variable that has not the value that
            `when` asks for, leaves one out.
        datasets: every recording where there are several, `dataset` being the first of them;
            empty where there is one.
        timeline: only in that mode.
        external: nodes that must already run.
        segment_bytes: the size of the shared memory that the spec asks for; 0 leaves it to the
            largest message.
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
    warm_up_ns: int
    start_timeout_ns: int
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
    drain_timeout_ns: int = 5 * 10**9
    segment_bytes: int = 0
    play_at_peak: PlayPlan | None = None
