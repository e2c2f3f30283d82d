"""The typed, frozen values of a spec after parsing, substitution and validation.

These classes and the JSON Schema (`r2bspec.language.schema`) describe the same language; a test
compares them. There are two differences, and both are marked: keys that the loader evaluates
(``extends``, ``matrix``, ``repeat``) are in the schema only, and the fields in `DERIVED_FIELDS` are
here only: shorthands are expanded into them (`r2bspec.language.shorthand`).

Names are kept as the user wrote them; the plan resolves `image` to `/r2b/image`. Quantities are
exact (`r2bspec.language.quantities`).
"""

from __future__ import annotations

from typing import Any, Literal

import msgspec

from r2bspec.language.confidence import CONFIDENCE
from r2bspec.language.default_starts import default_starts
from r2bspec.language.node_kinds import NodeKind, kind_of
from r2bspec.language.probe_length import CONFIRM, PROBE
from r2bspec.language.quantities import Duration, Rate, Share, Size
from r2bspec.language.requirement_grammar import Requirement

DERIVED_FIELDS = {
    "Node": ("parameter_sources",),
    "Objective": ("at_peak",),
    "Spec": ("segment",),
}
"""Fields that no document has: shorthands and mixed values are expanded into them."""

Scalar = bool | int | float | str
ParameterValue = Scalar | list[Any]


class _SpecStruct(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Base of all values of the language: immutable, without unknown fields."""


class BagSource(_SpecStruct, frozen=True, kw_only=True):
    """The source of the recorded messages: exactly one of `dataset` and `path`."""

    dataset: str = ""
    path: str = ""
    sha256: str = ""


class Window(_SpecStruct, frozen=True, kw_only=True):
    """The part of the recording to use, relative to its first message."""

    start: Duration = Duration(0)
    end: Duration | None = None


class DataLoader(_SpecStruct, frozen=True, kw_only=True):
    """The recordings, the window, and the names of recorded topics in the graph.

    Attributes:
        bag: the recording, or the first of `bags`; empty in a live benchmark.
        bags: all recordings if the document lists several, else empty; see `sources`.
        publish_tf: whether the recorded /tf is played with the inputs.
        publish_tf_static: whether the recorded /tf_static is published before playing starts.
        real_time: whether the preprocessors get the messages at the recorded times instead of as
            fast as they process them.
    """

    bag: BagSource = BagSource()
    bags: tuple[BagSource, ...] = ()
    window: Window = Window()
    topics: dict[str, str] = {}
    publish_tf: bool = False
    publish_tf_static: bool = False
    real_time: bool = False

    @property
    def sources(self) -> tuple[BagSource, ...]:
        """Every recording, in the order of the document; none in a live benchmark."""
        return self.bags or ((self.bag,) if self.bag != BagSource() else ())


class QoS(_SpecStruct, frozen=True, kw_only=True):
    """A quality-of-service profile; the default is the one that rclpy uses for `depth=10`."""

    reliability: Literal["reliable", "best_effort"] = "reliable"
    durability: Literal["volatile", "transient_local"] = "volatile"
    history: Literal["keep_last", "keep_all"] = "keep_last"
    depth: int = 10


class Harness(_SpecStruct, frozen=True, kw_only=True):
    """Where the player and the monitors run.

    Attributes:
        placement: `separate` processes for player and monitors, one `shared` process, or the
            processes of the `graph`.
        process: the node or process that gets the player; empty to find it.
    """

    placement: Literal["separate", "shared", "graph"] = "separate"
    process: str = msgspec.field(name="in", default="")


class Container(_SpecStruct, frozen=True, kw_only=True):
    """A process for several nodes; `threads` 0 means the default of the executor."""

    executable: Literal[
        "component_container",
        "component_container_mt",
        "component_container_isolated",
        "python",
    ] = "component_container"
    executor: Literal["single_threaded", "multi_threaded"] = "single_threaded"
    threads: int = 0
    env: dict[str, str] = {}
    cpus: tuple[int, ...] = ()
    nice: int = 0
    prefix: tuple[str, ...] = ()
    memory_limit: Size | None = None


class Launch(_SpecStruct, frozen=True, kw_only=True):
    """A launch file: `package` and `file`, or `path` relative to the document."""

    package: str = ""
    file: str = ""
    path: str = ""
    arguments: dict[str, Scalar] = {}


class ParameterSource(_SpecStruct, frozen=True, kw_only=True):
    """One part of a node's parameters: a parameter file, or values."""

    file: str = ""
    values: dict[str, ParameterValue] = {}


class Node(_SpecStruct, frozen=True, kw_only=True):
    """A node of the graph or of the preprocessors.

    The keys of exactly one kind are given (`r2bspec.language.node_kinds`).

    Attributes:
        container: the name of its container; if empty, the placement of the graph applies.
        parameters: the values in the document; of several maps, later ones have precedence.
        parameter_sources: files and values in the order in which they apply; empty if there is
            no file, because `parameters` is then complete.
        qos: the profiles of topics, by their names in the code of the node, that the document
            states.
    """

    description: str = ""
    python: str = ""
    package: str = ""
    plugin: str = ""
    executable: str = ""
    command: tuple[str, ...] = ()
    launch: Launch | None = None
    external: bool = False
    container: str = ""
    arguments: tuple[str, ...] = ()
    namespace: str = ""
    parameters: dict[str, ParameterValue] = {}
    remappings: dict[str, str] = {}
    publishes: dict[str, str] = {}
    subscribes: dict[str, str] = {}
    qos: dict[str, QoS] = {}
    env: dict[str, str] = {}
    cpus: tuple[int, ...] = ()
    nice: int = 0
    prefix: tuple[str, ...] = ()
    memory_limit: Size | None = None
    parameter_sources: tuple[ParameterSource, ...] = ()

    @property
    def kind(self) -> NodeKind:
        """The kind of the node."""
        return kind_of(self)

    @property
    def parameter_files(self) -> tuple[str, ...]:
        """The parameter files, in the order in which they apply."""
        return tuple(each.file for each in self.parameter_sources if each.file)


class Pairing(_SpecStruct, frozen=True, kw_only=True):
    """Which messages of several inputs are one step.

    Attributes:
        slop: the largest difference between stamps of one step; 0 for equal stamps.
    """

    slop: Duration = Duration(0)


class PlaybackInput(_SpecStruct, frozen=True, kw_only=True):
    """A topic that is played to the graph: the source of its messages, and their type.

    Attributes:
        timestamp: `none` for messages whose header stays as recorded.
        pairing: replaces that of all inputs; None for the same.
        rate: `recorded` for an input with a rate of its own: what was recorded between two steps
            is played between them.
    """

    source: str = msgspec.field(name="from")
    format: str
    qos: QoS = QoS()
    timestamp: Literal["header", "none"] = "header"
    pairing: Pairing | None = None
    rate: Literal["step", "recorded"] = "step"


class Timeline(_SpecStruct, frozen=True, kw_only=True):
    """How recorded times are converted to times of playing.

    Attributes:
        speed: of playing, relative to the recording.
        translations: how much later than recorded an input is played and stamped.
    """

    speed: Share = Share(1.0)
    translations: dict[str, Duration] = {}


class Playback(_SpecStruct, frozen=True, kw_only=True):
    """How the buffered messages are played. `buffer` is messages per input; 0 means all.

    A `live` benchmark plays nothing: its `inputs` are empty.

    Attributes:
        unpaired: whether an input may lose most of its messages because no other input has a
            message with their stamp: `refuse` makes it an error.
        record_timeline: whether the timeline follows the times at which the preprocessors
            published the messages, instead of the recorded times.
        tf: whether stamps in /tf are shifted like those of other messages, or kept.
        clock: whether the system time is published on /clock.
    """

    mode: Literal["timeline", "looping", "sweeping", "live"] = "looping"
    buffer: int = 0
    inputs: dict[str, PlaybackInput] = {}
    unpaired: Literal["refuse", "drop"] = "refuse"
    timeline: Timeline = Timeline()
    record_timeline: bool = False
    tf: Literal["shift", "keep"] = "shift"
    pairing: Pairing = Pairing()
    clock: bool = False


class SetupStep(_SpecStruct, frozen=True, kw_only=True):
    """A command that runs before anything starts, unless the file `creates` exists."""

    command: tuple[str, ...]
    creates: str = ""
    timeout: Duration = Duration(600 * 10**9)
    directory: str = ""
    env: dict[str, str] = {}


class LogLine(_SpecStruct, frozen=True, kw_only=True):
    """A line in the output of a process, as a regular expression."""

    process: str
    pattern: str


class ReadyProbe(_SpecStruct, frozen=True, kw_only=True):
    """A condition for the graph to be ready: exactly one of the first four fields."""

    file: str = ""
    service: str = ""
    log: LogLine | None = None
    topic: str = ""
    timeout: Duration = Duration(30 * 10**9)


class ServiceCall(_SpecStruct, frozen=True, kw_only=True):
    """A service call, with the fields of its request."""

    name: str
    type: str
    request: dict[str, Any] = {}


class AfterReadyStep(_SpecStruct, frozen=True, kw_only=True):
    """A step that runs when the graph is ready: exactly one of a command and a service call."""

    command: tuple[str, ...] = ()
    service: ServiceCall | None = None
    timeout: Duration = Duration(30 * 10**9)


class Graph(_SpecStruct, frozen=True, kw_only=True):
    """The nodes under test, and the placement of nodes without a container.

    `separate` runs each node in its own process, `shared` all of one kind in one process,
    `harness` in the process of the harness.
    """

    placement: Literal["separate", "shared", "harness"] = "separate"
    nodes: dict[str, Node]


class Ratio(_SpecStruct, frozen=True, kw_only=True):
    """How many outputs answer how many inputs."""

    inputs: int = 1
    outputs: int = 1


TruthKind = Literal["disparity", "tag"]
"""What a ground truth says of an image: the disparity of each pixel, or the pose of its tag."""


class Truth(_SpecStruct, frozen=True, kw_only=True):
    """What the messages of a monitor are compared with, in the ground truth of the recording.

    Attributes:
        kind: what it says.
        name: of what: a stereo pair (disparity), or an image topic of the recording (tag).
    """

    kind: TruthKind
    name: str


class Monitor(_SpecStruct, frozen=True, kw_only=True):
    """A monitored topic. `match` is how its messages are matched to inputs.

    Attributes:
        answers: the inputs that its messages answer; empty means all inputs with a known path to
            the topic.
        label: how reports call it; its name if empty.
        taps: whether the topics on the path to it are monitored, too, for the latency of each hop.
        process: with the harness in the graph, the node or process that gets the monitor; empty to
            find it.
        truth: what its messages are compared with, after the measurement.
    """

    topic: str
    format: str
    match: Literal["stamp", "order"] = "stamp"
    answers: tuple[str, ...] = ()
    ratio: Ratio = Ratio()
    qos: QoS | None = None
    label: str = ""
    taps: bool = False
    process: str = msgspec.field(name="in", default="")
    truth: Truth | None = None


class Search(_SpecStruct, frozen=True, kw_only=True):
    """The search for the highest sustained rate.

    `holds` are conditions on a probe in addition to the one that always applies: the backlog of
    unanswered messages must not grow. `confirm` is how long the lower end of the result is played
    whole; 0 for not at all.
    """

    min: Rate
    max: Rate
    precision: Share = Share(0.02)
    holds: tuple[Requirement, ...] = ()
    probe: Duration = PROBE
    confirm: Duration = CONFIRM
    confidence: Share = Share(CONFIDENCE)


class GateBase(_SpecStruct, frozen=True, kw_only=True):
    """How the base of a comparison with a revision is built and set up.

    Attributes:
        build: commands, run in the top of its work tree.
        setup: a setup file or an installation, relative to that, or NAME=VALUE; empty for none.
        timeout: of each command.
    """

    build: tuple[tuple[str, ...], ...] = ()
    setup: str = ""
    timeout: Duration = Duration(30 * 60 * 10**9)


class Gate(_SpecStruct, frozen=True, kw_only=True):
    """How verdicts are reached, and their consequences.

    Attributes:
        confidence: of every verdict, unless an objective sets its own.
        inconclusive: the effect of an inconclusive verdict on the exit status.
        confirm: whether a FAIL counts only if a second run in new processes confirms it.
        time_budget: the maximum duration of measuring, including everything that is optional.
        interference: what other load on the machine does to a verdict.
        base: how the base of a comparison with a revision is built.
    """

    confidence: Share = Share(CONFIDENCE)
    inconclusive: Literal["report", "pass", "fail"] = "report"
    confirm: bool = True
    time_budget: Duration | None = None
    interference: Literal["tolerate", "note", "strict"] = "note"
    base: GateBase = GateBase()


class Benchmark(_SpecStruct, frozen=True, kw_only=True):
    """What is played: `iterations` of `duration` at each of `rates`, and an optional search.

    `max_iterations` is their maximum number while a verdict is inconclusive; 0 means `iterations`.
    `starts` is the number of starts as written; `Spec.starts` is the one that applies.
    """

    duration: Duration = Duration(2_500_000_000)
    iterations: int = 10
    starts: int | None = None
    max_iterations: int = 0
    rates: tuple[Rate, ...] = ()
    search: Search | None = None
    warm_up: Duration = Duration(10**9)
    start_timeout: Duration = Duration(30 * 10**9)
    drain_timeout: Duration = Duration(5 * 10**9)
    gate: Gate = Gate()


class Objective(_SpecStruct, frozen=True, kw_only=True):
    """One service-level objective: requirements at one offered rate.

    Attributes:
        at: None for requirements on the whole search (`peak.rate`), and for those `at_peak`, the
            highest rate that the search finds.
        level: the effect of a failure: only `error` fails the run; `off` skips the objective.
        when: values that variables must have for the objective to apply.
        confidence: None means that of the gate.
    """

    at: Rate | None = None
    level: Literal["error", "warn", "info", "off"] = "error"
    when: dict[str, Scalar] = {}
    confidence: Share | None = None
    require: tuple[Requirement, ...]
    at_peak: bool = False


class Requires(_SpecStruct, frozen=True, kw_only=True):
    """What the machine of a run must be.

    Attributes:
        arch: as the kernel calls it, such as ``aarch64``; any if empty.
        gpu: whether it needs one.
        cores: the fewest CPUs.
        ros_distro: any if empty.
        labels: of the machine, with patterns such as ``carter-*``.
    """

    arch: str = ""
    gpu: bool = False
    cores: int = 0
    ros_distro: str = ""
    labels: dict[str, Scalar] = {}


class Spec(_SpecStruct, frozen=True, kw_only=True):
    """One complete benchmark. `segment` is the size of the transport's shared memory."""

    r2bspec: Literal[1]
    name: str
    title: str = ""
    description: str = ""
    labels: dict[str, Scalar] = {}
    requires: Requires | None = None
    environment: tuple[str, ...] = ()
    variables: dict[str, Scalar] = {}
    namespace: str = "r2b"
    transport: Literal["inherit", "shared_memory", "udp"] = "shared_memory"
    harness: Harness = Harness()
    data_loader: DataLoader = DataLoader()
    preprocessors: dict[str, Node] = {}
    containers: dict[str, Container] = {}
    setup: dict[str, SetupStep] = {}
    playback: Playback
    graph: Graph
    ready: dict[str, ReadyProbe] = {}
    after_ready: dict[str, AfterReadyStep] = {}
    monitors: dict[str, Monitor]
    benchmark: Benchmark = Benchmark()
    slos: dict[str, Objective] = {}
    segment: Size | None = None

    @property
    def live(self) -> bool:
        """Whether nothing is played, because the graph has a source of its own."""
        return self.playback.mode == "live"

    @property
    def has_external_nodes(self) -> bool:
        """Whether a node already runs, so that a run cannot restart it."""
        nodes = (*self.preprocessors.values(), *self.graph.nodes.values())
        return any(each.kind.role is None for each in nodes)

    @property
    def starts(self) -> int:
        """How often all processes are started, each time for a part of the iterations."""
        if self.has_external_nodes:
            return 1
        return self.benchmark.starts or default_starts(self.benchmark.iterations)
