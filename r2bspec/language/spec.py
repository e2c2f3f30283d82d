"""The language: one typed, frozen value for a whole document, and the declaration of its keys.

`Spec` is both what the rest of the program reads and what the language is made of: each field is
declared once, as `r2bspec.language.declaration` explains, and everything that is known of a key
follows from there. Its sections are in `spec_graph` and `spec_benchmark`.

Names are kept as the user wrote them; the plan resolves `image` to `/r2b/image`. Quantities are
exact (`r2bspec.language.quantities`).
"""

from typing import Annotated, Any, ClassVar, Literal

from r2bspec.language import names
from r2bspec.language.benchmark_defaults import default_starts
from r2bspec.language.declaration import Record, Written, key
from r2bspec.language.spec_benchmark import (
    Arrivals,
    BagSource,
    Benchmark,
    Call,
    DataLoader,
    GateBase,
    Harness,
    Monitor,
    MonitorSettings,
    Network,
    Objective,
    Pacing,
    Playback,
    PlaybackInput,
    StartWaits,
    Transport,
    Tune,
)
from r2bspec.language.spec_graph import (
    AfterReadyStep,
    Container,
    Graph,
    Launch,
    LifecycleState,
    Node,
    Nodes,
    ParameterSource,
    ParameterValue,
    ProcessSettings,
    QoS,
    ReadyProbe,
    Scalar,
    Scheduling,
    ServiceCall,
    SetupStep,
    StartedProcess,
    Variables,
)
from r2bspec.safe_io.limits import MAX_SPEC_ENTRIES

__all__ = [
    "Arrivals",
    "BagSource",
    "Call",
    "Container",
    "GateBase",
    "Graph",
    "Launch",
    "LifecycleState",
    "Monitor",
    "MonitorSettings",
    "Network",
    "Node",
    "Objective",
    "Pacing",
    "ParameterSource",
    "ParameterValue",
    "PlaybackInput",
    "ProcessSettings",
    "QoS",
    "ReadyProbe",
    "Requires",
    "Scalar",
    "Scheduling",
    "ServiceCall",
    "Spec",
    "StartWaits",
    "StartedProcess",
    "Tune",
]


class Requires(Record, frozen=True, kw_only=True):
    """What the machine of a run must be. A run is refused on any other one.

    Attributes:
        arch: The architecture, as uname -m prints it.
        gpu: Whether the machine must have a GPU.
        cores: The fewest CPUs.
        ros_distro: The ROS distribution.
        labels: Labels of the machine; values may be patterns.
    """

    about = key({"arch": "aarch64", "gpu": True})

    arch: Annotated[str, key("aarch64")] = ""
    gpu: bool = False
    cores: Annotated[int, key(4, minimum=0)] = 0
    ros_distro: Annotated[str, key("jazzy")] = ""
    labels: Annotated[
        dict[
            names.LabelName,
            Annotated[Scalar, key("carter", description="The value of the label.")],
        ],
        key({"robot": "carter"}),
    ] = {}


class VariableDeclaration(Record, frozen=True, kw_only=True):
    """The value of the variable, or a map that declares it, with its value under 'value'.

    Attributes:
        type: The type of the value.
        value: The value.
        default: The same as 'value'.
        description: The purpose of the variable.
    """

    type: Literal[
        "string",
        "integer",
        "number",
        "boolean",
        "duration",
        "rate",
        "size",
        "share",
        "power",
        "energy",
    ] = "string"
    value: Annotated[Scalar | None, key("30 Hz", 1280)] = None
    default: Annotated[Scalar | None, key("30 Hz", 1280)] = None
    description: Annotated[str, key("The camera's rate.")] = ""

    @classmethod
    def from_keys(cls, keys: dict[str, Any]) -> Scalar | None:
        """Return the value; None if it has none."""
        value: Scalar | None = keys.get("value", keys.get("default"))
        return value


_Variable = Annotated[
    Scalar,
    Written(Scalar | VariableDeclaration),
    key(1280, "30 Hz", {"type": "rate", "value": "30 Hz"}),
]


class Matrix(Record, frozen=True, kw_only=True):
    """Cases of this benchmark that differ in variables.

    Attributes:
        axes: Variables with their values; every combination is a case.
        exclude: Combinations to leave out.
        cases: Further cases by name, with their variables.
    """

    about = key({"axes": {"threads": [1, 2, 4]}})

    axes: Annotated[
        dict[
            names.VariableName,
            Annotated[
                tuple[Annotated[Scalar, key(1, "30 Hz", description="One value.")], ...],
                key([1, 2, 4], description="The values of the variable.", at_least=1),
            ],
        ],
        key({"threads": [1, 2, 4]}),
    ] = {}
    exclude: Annotated[
        tuple[Annotated[Variables, key(description="Variables and values.")], ...],
        key([{"threads": 4, "rate": "60 Hz"}]),
    ] = ()
    cases: Annotated[
        dict[names.Name, Annotated[Variables, key(description="The variables of the case.")]],
        key({"night": {"bag": "r2b_lounge"}}),
    ] = {}


class Spec(Record, frozen=True, kw_only=True):
    """A benchmark of a ROS 2 graph, for r2bspec.

    Attributes:
        r2bspec: The version of the language.
        name: The name of the benchmark, in results and baselines.
        title: A title of one line, shown in reports.
        description: What is measured, and why.
        extends: The file that this file extends: maps are merged, lists replaced, and null removes
            a key.
        labels: Labels that reports show.
        requires: What the machine of a run must be; others are refused.
        environment: The environment variables that $(env NAME) may read.
        variables: Values for $(var name); --var name=value replaces one.
        matrix: Cases that differ in variables, each with its own verdict, as name[threads=2].
        namespace: The namespace of nodes and of relative topics.
        transport: How messages travel: shared_memory, with segments for the largest message; udp;
            or inherit, as the environment says.
        network: Emulated delay, loss and rate of a network between the processes; needs Linux and
            'transport: udp'.
        harness: Where the player and the monitors run.
        data_loader: The recorded topics to load, and their names in the graph.
        preprocessors: Nodes that prepare the recorded messages before anything is measured.
        containers: Processes for several nodes, by name.
        setup: Commands that run once, in this order, before anything is started.
        playback: How the buffered messages are played to the graph.
        graph: The graph under test.
        ready: Conditions for the graph to be ready, besides connected topics.
        after_ready: Steps that run once, in this order, between readiness and playing.
        monitors: The monitored topics, by the names that requirements use.
        benchmark: What is played: rates, iterations, starts, and a search.
        slos: The objectives that decide the verdict, by name.
        tune: What 'r2bspec tune' may change, and what it looks for.
    """

    r2bspec: Annotated[Literal[1], key(changes="neither")]
    name: Annotated[names.Name, key("apriltag_node", changes="neither")]
    title: Annotated[str, key("AprilTag detection, 720p colour", changes="neither")] = ""
    description: Annotated[str, key("Detection on a colour camera at 720p.", changes="neither")] = (
        ""
    )
    extends: ClassVar[
        Annotated[str, key("base.yaml", path=True, not_empty=True, loader=True, changes="neither")]
    ]
    labels: Annotated[
        dict[
            names.LabelName,
            Annotated[Scalar, key("720p", description="The value of the label.")],
        ],
        key({"resolution": "720p", "robot": "carter"}, changes="neither"),
    ] = {}
    requires: Annotated[Requires | None, key(changes="neither")] = None
    environment: Annotated[
        tuple[
            Annotated[
                names.EnvironmentName, key("DATA_DIR", description="The name of a variable.")
            ],
            ...,
        ],
        key(["DATA_DIR"], changes="graph"),
    ] = ()
    variables: Annotated[
        dict[names.VariableName, _Variable],
        key({"width": 1280, "rate": "30 Hz"}, changes="neither"),
    ] = {}
    matrix: ClassVar[Annotated[Matrix, key(loader=True, changes="neither")]]
    namespace: Annotated[names.Namespace, key("r2b", changes="graph")] = "r2b"
    transport: Annotated[Transport, key(default="shared_memory", changes="load")] = Transport()
    network: Annotated[Network | None, key(changes="load")] = None
    harness: Annotated[Harness, key(changes="load")] = Harness()
    data_loader: Annotated[DataLoader, key(unless_live=True, changes="load")] = DataLoader()
    preprocessors: Annotated[Nodes, key(changes="graph")] = {}
    containers: Annotated[
        dict[names.NodeName, Container],
        key({"vision": {"executable": "component_container_mt"}}, changes="graph"),
    ] = {}
    setup: Annotated[
        dict[names.Name, SetupStep],
        key({"model": SetupStep.about.examples[0]}, changes="graph"),
    ] = {}
    playback: Annotated[Playback, key(changes="load")]
    graph: Annotated[Graph, key(changes="graph")]
    ready: Annotated[
        dict[names.Name, ReadyProbe],
        key({"model_loaded": ReadyProbe.about.examples[0]}, changes="graph"),
    ] = {}
    after_ready: Annotated[
        dict[names.Name, AfterReadyStep],
        key({"enable": AfterReadyStep.about.examples[0]}, changes="graph"),
    ] = {}
    monitors: Annotated[
        dict[names.MonitorName, Monitor],
        key(
            {"detections": Monitor.about.examples[0]},
            at_least=1,
            at_most=MAX_SPEC_ENTRIES,
            unless_calls=True,
            changes="load",
        ),
    ] = {}
    benchmark: Annotated[Benchmark, key(changes="load")] = Benchmark()
    slos: Annotated[
        dict[names.Name, Objective],
        key({"keeps_up": Objective.about.examples[0]}, changes="neither"),
    ] = {}
    tune: Annotated[Tune, key(changes="neither")] = Tune()

    @property
    def live(self) -> bool:
        """Whether nothing is played, because the graph has a source of its own."""
        return self.playback.mode == "live"

    @property
    def outputs(self) -> dict[str, Monitor]:
        """All that is measured, by name: the monitored topics, and the answers to calls."""
        found = dict(self.monitors)
        for name, call in self.playback.calls.items():
            found |= call.answers(name)
        return found

    @property
    def plays_topics(self) -> bool:
        """Whether recorded messages are played."""
        return not self.live and (bool(self.playback.inputs) or not self.playback.calls)

    @property
    def recorded_calls(self) -> dict[str, Call]:
        """The calls whose requests are recorded, by name."""
        return {name: call for name, call in self.playback.calls.items() if call.source is not None}

    @property
    def has_own_rate(self) -> bool:
        """Whether the recording, or the graph's own source, determines the rate of messages."""
        return self.playback.mode in {"timeline", "live"}

    @property
    def irregular_arrivals(self) -> Arrivals | None:
        """When steps come, if not at equal intervals."""
        return None if self.playback.arrivals.kind == "fixed" else self.playback.arrivals

    @property
    def has_external_nodes(self) -> bool:
        """Whether a node already runs, so that a run cannot restart it."""
        nodes = (*self.preprocessors.values(), *self.graph.nodes.values())
        return any(node.kind.role is None for node in nodes)

    @property
    def starts(self) -> int:
        """How often all processes are started, each time for a part of the iterations."""
        if self.has_external_nodes:
            return 1
        return self.benchmark.starts or default_starts(self.benchmark.iterations)
