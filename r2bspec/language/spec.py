"""The typed, frozen values that a spec becomes once it is parsed, substituted and checked.

These classes and the JSON Schema (`r2bspec.language.schema`) describe the same language; a test
holds them together. Two kinds of things differ, and both are marked: keys that the loader uses up
(``extends``, ``matrix``, ``repeat``) are in the schema only, and the few fields in `DERIVED_FIELDS`
are here only: shorthands are written out into them (`r2bspec.language.shorthand`).

Names are kept as the user wrote them: resolving `image` to `/r2b/image` is the plan's business.
Quantities are exact (`r2bspec.language.quantities`).
"""

from __future__ import annotations

from typing import Any, Literal

import msgspec

from r2bspec.language.confidence import CONFIDENCE
from r2bspec.language.node_kinds import NodeKind, kind_of
from r2bspec.language.probe_length import PROBE
from r2bspec.language.quantities import Duration, Rate, Share, Size
from r2bspec.language.requirement_grammar import Requirement

DERIVED_FIELDS = {
    "Node": ("parameter_sources",),
    "Objective": ("at_peak",),
    "Spec": ("segment",),
}
"""Fields that no document has: what a shorthand or a mixed value is written out into."""

Scalar = bool | int | float | str
ParameterValue = Scalar | list[Any]


class _SpecStruct(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Base of all language values: immutable and closed."""


class BagSource(_SpecStruct, frozen=True, kw_only=True):
    """Where the recorded messages come from: exactly one of `dataset` and `path`."""

    dataset: str = ""
    path: str = ""
    sha256: str = ""


class Window(_SpecStruct, frozen=True, kw_only=True):
    """The part of the recording that is used, counted from its first message."""

    start: Duration = Duration(0)
    end: Duration | None = None


class DataLoader(_SpecStruct, frozen=True, kw_only=True):
    """The recording, the window, and which recorded topic becomes which topic in the graph.

    Attributes:
        bag: the recording, or the first of `bags`; names nothing in a live benchmark.
        bags: all of them where the document lists several, else empty; see `sources`.
        publish_tf: whether recorded /tf is played along with the inputs.
        publish_tf_static: whether recorded /tf_static is published in advance.
        real_time: whether messages reach the preprocessors as they were recorded in time,
            instead of as fast as these can take them.
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


class Plugin(_SpecStruct, frozen=True, kw_only=True):
    """A C++ component that stands in for a part of the harness."""

    package: str
    plugin: str
    parameters: dict[str, ParameterValue] = {}


class Harness(_SpecStruct, frozen=True, kw_only=True):
    """Who plays and watches.

    Attributes:
        placement: `separate` processes for player and monitors, or one `shared` process.
        data_loader: with `ros2_benchmark`, the component in place of its own; None is its own.
    """

    kind: Literal["r2bspec", "ros2_benchmark"] = "r2bspec"
    placement: Literal["separate", "shared"] = "separate"
    data_loader: Plugin | None = None
    playback: Plugin | None = None
    monitor: Plugin | None = None


class Container(_SpecStruct, frozen=True, kw_only=True):
    """A process that holds several nodes; `threads` 0 leaves the number to the executor."""

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
    """One part of a node's parameters: a parameters file, or values."""

    file: str = ""
    values: dict[str, ParameterValue] = {}


class Node(_SpecStruct, frozen=True, kw_only=True):
    """A node of the graph or of the preprocessors.

    The keys of exactly one kind are given (`r2bspec.language.node_kinds`).

    Attributes:
        container: the name of the container that it runs in; empty leaves it to the placement.
        parameters: the values that the document gives, of all maps, the later ones winning.
        parameter_sources: files and values in the order in which they apply; empty if there is
            no file, since `parameters` then says all.
        qos: the profile of a topic, as the node's code names it, where the document knows it.
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
        """Which of the kinds of node this is."""
        return kind_of(self)

    @property
    def parameter_files(self) -> tuple[str, ...]:
        """The parameter files, in the order in which they apply."""
        return tuple(each.file for each in self.parameter_sources if each.file)


class PlaybackInput(_SpecStruct, frozen=True, kw_only=True):
    """A topic that the graph reads: where its messages were buffered, and their type.

    `timestamp` is `none` for messages whose header must stay as it was recorded.
    """

    source: str = msgspec.field(name="from")
    format: str
    qos: QoS = QoS()
    timestamp: Literal["header", "none"] = "header"


class Timeline(_SpecStruct, frozen=True, kw_only=True):
    """How recorded time becomes time of play.

    Attributes:
        speed: of play, relative to the recording.
        translations: by how much an input is played, and stamped, later than it was recorded.
    """

    speed: Share = Share(1.0)
    translations: dict[str, Duration] = {}


class Playback(_SpecStruct, frozen=True, kw_only=True):
    """How the buffered messages are played. `buffer` is messages per input; 0 means all.

    A `live` benchmark plays nothing: its `inputs` are empty.

    Attributes:
        record_timeline: whether a timeline is taken from what came out of the preprocessors,
            instead of from the recording.
        tf: whether stamps inside /tf are shifted like all others, or kept.
    """

    mode: Literal["timeline", "looping", "sweeping", "live"] = "looping"
    buffer: int = 0
    inputs: dict[str, PlaybackInput] = {}
    timeline: Timeline = Timeline()
    record_timeline: bool = False
    tf: Literal["shift", "keep"] = "shift"


class SetupStep(_SpecStruct, frozen=True, kw_only=True):
    """A command that runs before anything starts, unless the file `creates` is there."""

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
    """Something that must be so before the graph counts as ready: exactly one of the four."""

    file: str = ""
    service: str = ""
    log: LogLine | None = None
    topic: str = ""
    timeout: Duration = Duration(30 * 10**9)


class ServiceCall(_SpecStruct, frozen=True, kw_only=True):
    """A call of a service, with the fields of its request."""

    name: str
    type: str
    request: dict[str, Any] = {}


class AfterReadyStep(_SpecStruct, frozen=True, kw_only=True):
    """What is done once the graph stands: exactly one of a command and a service call."""

    command: tuple[str, ...] = ()
    service: ServiceCall | None = None
    timeout: Duration = Duration(30 * 10**9)


class Graph(_SpecStruct, frozen=True, kw_only=True):
    """The nodes under test, and where those run that name no container.

    `separate` is a process each, `shared` one process for all, `harness` beside the harness.
    """

    placement: Literal["separate", "shared", "harness"] = "separate"
    nodes: dict[str, Node]


class Ratio(_SpecStruct, frozen=True, kw_only=True):
    """How many outputs answer how many inputs."""

    inputs: int = 1
    outputs: int = 1


class Monitor(_SpecStruct, frozen=True, kw_only=True):
    """A topic that is watched. `match` says how its messages find the input they answer.

    Attributes:
        answers: the inputs that it answers; empty for those from which a way to it is known.
        label: how reports call it; its name if empty.
        taps: whether the topics on the way to it are watched, too, to tell where time goes.
        parameters: of the component that watches, where the harness has such.
    """

    topic: str
    format: str
    match: Literal["stamp", "order"] = "stamp"
    answers: tuple[str, ...] = ()
    ratio: Ratio = Ratio()
    qos: QoS | None = None
    label: str = ""
    taps: bool = False
    parameters: dict[str, ParameterValue] = {}


class Search(_SpecStruct, frozen=True, kw_only=True):
    """The search for the highest rate that holds.

    `holds` are conditions on one probe beyond the one that always applies: the backlog of
    unanswered messages must not grow.
    """

    min: Rate
    max: Rate
    precision: Share = Share(0.02)
    holds: tuple[Requirement, ...] = ()
    probe: Duration = PROBE
    confidence: Share = Share(CONFIDENCE)


class Gate(_SpecStruct, frozen=True, kw_only=True):
    """How verdicts are reached, and what they lead to.

    Attributes:
        confidence: of every verdict, unless an objective says otherwise.
        inconclusive: what the exit status says where the data decide nothing.
        confirm: whether a FAIL must be found again, in fresh processes.
        time_budget: the longest time that measuring may take, with everything that is optional.
    """

    confidence: Share = Share(CONFIDENCE)
    inconclusive: Literal["report", "pass", "fail"] = "report"
    confirm: bool = True
    time_budget: Duration | None = None


class Benchmark(_SpecStruct, frozen=True, kw_only=True):
    """What is played: `iterations` times `duration` at each of `rates`, and an optional search.

    `max_iterations` is how many there may be where fewer decide nothing; 0 means `iterations`.
    """

    duration: Duration = Duration(5 * 10**9)
    iterations: int = 5
    max_iterations: int = 0
    rates: tuple[Rate, ...] = ()
    search: Search | None = None
    warm_up: Duration = Duration(10**9)
    start_timeout: Duration = Duration(30 * 10**9)
    drain_timeout: Duration = Duration(5 * 10**9)
    gate: Gate = Gate()


class Objective(_SpecStruct, frozen=True, kw_only=True):
    """One service-level objective: requirements that must hold at one offered rate.

    Attributes:
        at: None for requirements that concern the search as a whole (`peak.rate`), and for
            those `at_peak`, the highest rate that the search finds.
        level: of a failure: only `error` fails the run; `off` is not judged at all.
        when: values that variables must have for the objective to count.
        confidence: None means that of the gate.
    """

    at: Rate | None = None
    level: Literal["error", "warn", "info", "off"] = "error"
    when: dict[str, Scalar] = {}
    confidence: Share | None = None
    require: tuple[Requirement, ...]
    at_peak: bool = False


class Spec(_SpecStruct, frozen=True, kw_only=True):
    """One benchmark, complete. `segment` is the size of the transport's shared memory."""

    r2bspec: Literal[1]
    name: str
    title: str = ""
    description: str = ""
    labels: dict[str, Scalar] = {}
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
        """Whether nothing is played: the graph has a source of its own."""
        return self.playback.mode == "live"
