"""`graph` and what belongs to it: nodes, topics, containers, and the steps around their start.

What a description says is shown to the authors of specs; see `r2bspec.language.declaration`.
"""

from typing import Annotated, Any, ClassVar, Final, Literal

from r2bspec.language import names
from r2bspec.language.declaration import Record, Written, key
from r2bspec.language.node_kinds import NodeKind, kind_of, kinds_text
from r2bspec.language.quantities import Duration, Size
from r2bspec.safe_io.limits import MAX_PARAMETER_SOURCES, MAX_SPEC_ENTRIES

Scalar = bool | int | float | str
ParameterValue = Scalar | list[Any]

Variables = Annotated[
    dict[names.VariableName, Annotated[Scalar, key(2, "30 Hz", description="The value.")]],
    key({"threads": 2}),
]

Word = Annotated[str, key("--fast", description="An argument.")]
Command = Annotated[tuple[Word, ...], key(at_least=1)]
Environment = Annotated[
    dict[
        names.EnvironmentName,
        Annotated[
            str,
            Written(Scalar),
            key(4, "fast", description="The value, as it is written.", as_text=True),
        ],
    ],
    key({"OMP_NUM_THREADS": 4}, description="Environment variables of the process."),
]


_Cpus = Annotated[
    tuple[
        Annotated[int, key(0, 2, description="The number of a CPU, counted from 0.", minimum=0)],
        ...,
    ],
    key([2, 3]),
]
_Nice = Annotated[int, key(-5, minimum=-20, maximum=19)]


class Scheduling(Record, frozen=True, kw_only=True):
    """How the process is scheduled, with all its threads. What the system does not permit is
    refused before the run.

    Attributes:
        policy: The policy: other is the usual one, batch and idle yield to it, fifo and rr are of
            real time. Default: that of the process which starts it.
        priority: The priority among threads of real time, from 1 to 99; with fifo and rr only.
    """

    about = key({"policy": "fifo", "priority": 40})

    policy: Literal["other", "batch", "idle", "fifo", "rr"] | None = None
    priority: Annotated[int, key(40, minimum=0, maximum=99)] = 0


class ProcessSettings(Record, frozen=True, kw_only=True):
    """How a process is started: keys of nodes and containers that the plan has as they are.

    What is declared here is a key of the language and a field of `r2bspec.plan.plan.ProcessPlan` at
    once, and is refused where r2bspec starts no process.

    Attributes:
        cpus: The CPUs of the process; empty means all.
        nice: The niceness of the process; values below 0 need permission.
        executor: Whether the callbacks of Python nodes, or of component_container_isolated, run one
            after another or in parallel.
        threads: The threads of the executor; 0 means its default.
    """

    cpus: _Cpus = ()
    nice: _Nice = 0
    scheduling: Scheduling | None = None
    executor: Literal["single_threaded", "multi_threaded"] = "single_threaded"
    threads: Annotated[int, key(4, minimum=0)] = 0


class StartedProcess(ProcessSettings, frozen=True, kw_only=True):
    """What nodes and containers say of their process, but for its environment.

    Attributes:
        prefix: Words before the command line, such as a profiler.
        memory_limit: The maximum resident memory of the process. If it is exceeded, the run fails.
    """

    prefix: Annotated[tuple[Word, ...], key(["perf", "record", "-g"])] = ()
    memory_limit: Annotated[Size | None, key("2 GiB", positive=True)] = None


PROCESS_KEYS: Final = StartedProcess.__struct_fields__
"""Keys of a node that are about its process."""


def _profile(
    depth: int, *, reliability: str = "reliable", durability: str = "volatile"
) -> dict[str, Any]:
    return {
        "reliability": reliability,
        "durability": durability,
        "history": "keep_last",
        "depth": depth,
    }


PROFILES: Final[dict[str, dict[str, Any]]] = {
    "default": _profile(10),
    "sensor_data": _profile(5, reliability="best_effort"),
    "services": _profile(10),
    "parameters": _profile(1000),
    "system_default": _profile(1),
    "clock": _profile(1, reliability="best_effort"),
    "rosout": _profile(1000, durability="transient_local"),
}
"""The quality-of-service profiles of ROS, by their names in rclpy and rmw.

All fields are given explicitly, so that results do not depend on the defaults of a middleware.
`system_default`, which leaves every choice to the middleware, has the values that its publishers
use.
"""

RMW_NUMBERS: Final = {
    "reliability": {"reliable": 1, "best_effort": 2},
    "durability": {"transient_local": 1, "volatile": 2},
    "history": {"keep_last": 1, "keep_all": 2},
    "liveliness": {"automatic": 1, "manual_by_topic": 3},
}
"""The policies of a profile as in ``rmw/types.h``."""

_ProfileName = Annotated[str, key(words=tuple(PROFILES))]


class QoS(Record, frozen=True, kw_only=True):
    """A quality-of-service profile; the default is the one that rclpy uses for `depth=10`.

    Attributes:
        profile: The profile that this map changes.
        reliability: Whether lost messages are sent again. A reliable subscription does not match a
            best-effort publisher.
        durability: Whether a later subscription gets the last messages.
        history: Whether the last 'depth' messages are kept, or all.
        depth: The number of messages that keep_last keeps.
        deadline: The longest time between two messages that is offered or requested; by default
            any.
        lifespan: How long a message may be delivered after it was published; by default forever.
        liveliness: How a publisher shows that it is alive.
        lease_duration: How long it may be silent until it counts as dead; by default forever.
    """

    about = key("sensor_data", {"reliability": "best_effort", "depth": 5})
    word = _ProfileName

    profile: ClassVar[Annotated[_ProfileName, key("default", default="default")]]
    reliability: Literal["reliable", "best_effort"] = "reliable"
    durability: Literal["volatile", "transient_local"] = "volatile"
    history: Literal["keep_last", "keep_all"] = "keep_last"
    depth: Annotated[int, key(10, minimum=1)] = 10
    deadline: Annotated[Duration | None, key("200 ms", positive=True)] = None
    lifespan: Annotated[Duration | None, key("1 s", positive=True)] = None
    liveliness: Literal["automatic", "manual_by_topic"] = "automatic"
    lease_duration: Annotated[Duration | None, key("1 s", positive=True)] = None

    @classmethod
    def from_word(cls, word: str) -> "QoS":
        """Return the profile of that name."""
        return cls(**PROFILES[word])

    @classmethod
    def from_keys(cls, keys: dict[str, Any]) -> "QoS":
        """Return a profile with all fields of the one that it is based on, and its own."""
        return cls(**PROFILES[keys.pop("profile", "default")] | keys)

    def words(self) -> list[str]:
        """Return the fields that differ from the default and that discovery tells, as text."""
        told = ("reliability", "durability", "deadline", "lifespan", "liveliness", "lease_duration")
        return [
            f"{name} {getattr(self, name)}"
            for name in told
            if getattr(self, name) != getattr(QoS(), name)
        ]


class Container(StartedProcess, frozen=True, kw_only=True):
    """A process for several nodes.

    Attributes:
        executable: A container of rclcpp_components for plugins, or python for Python nodes.
        arguments: Arguments of a container of rclcpp_components.
    """

    about = key({"executable": "component_container_mt", "threads": 4})

    executable: Literal[
        "component_container",
        "component_container_mt",
        "component_container_isolated",
        "python",
    ] = "component_container"
    arguments: Annotated[tuple[Word, ...], key(["--ros-args", "--log-level", "warn"])] = ()
    env: Environment = {}


class Launch(Record, frozen=True, kw_only=True):
    """A launch file: 'package' and 'file', or 'path'. The remappings and the namespace of the node
    apply to everything that it starts.

    Attributes:
        package: The ROS package of the launch file.
        file: The launch file, relative to the share folder of the package.
        path: The launch file, relative to this file.
        arguments: The arguments of the launch file.
    """

    about = key({"package": "image_proc", "file": "launch/image_proc.launch.py"})

    package: Annotated[names.PackageName, key("image_proc")] = ""
    file: Annotated[names.SomeText, key("launch/image_proc.launch.py")] = ""
    path: Annotated[names.FilePath, key("./detector.launch.py", path=True)] = ""
    arguments: Annotated[
        dict[
            names.ParameterName,
            Annotated[Scalar, key("false", description="The value of the argument.")],
        ],
        key({"use_sim_time": "false"}),
    ] = {}


class ParameterSource(Record, frozen=True, kw_only=True):
    """One part of a node's parameters: a parameter file, or values."""

    file: str = ""
    values: dict[str, ParameterValue] = {}


_Value = Annotated[
    Scalar | list[Annotated[Scalar, key(0.5, "left", description="An item of the list.")]],
    key(
        *(1280, "36h11", [0.1, 0.2]),
        description="A string, a number, a boolean, or a list of one of these.",
    ),
]
_Values = Annotated[dict[names.ParameterName, _Value], key({"width": 1280, "height": 720})]
_File = Annotated[str, key("./camera.yaml", path=True, not_empty=True)]
_Parameters = Annotated[
    dict[str, ParameterValue],
    Written(
        _Values
        | _File
        | tuple[
            Annotated[
                _Values | _File,
                key(
                    *("./camera.yaml", {"width": 1280}),
                    description="Parameters by name, or the path of a parameter file.",
                ),
            ],
            ...,
        ]
    ),
    key(
        *({"width": 1280, "height": 720}, "./camera.yaml", ["./camera.yaml", {"width": 1280}]),
        at_most=MAX_PARAMETER_SOURCES,
    ),
]
_Type = Annotated[
    names.MessageType,
    key(
        "sensor_msgs/msg/Image",
        description="The message type, as 'ros2 topic list -t' shows it.",
    ),
]


LifecycleState = Literal["unconfigured", "inactive", "active"]


class Node(StartedProcess, frozen=True, kw_only=True):
    """A node of the graph or of the preprocessors.

    The keys of exactly one kind are given (`r2bspec.language.node_kinds`).

    Attributes:
        description: What the node does.
        python: module.Class, or ./file.py:Class: a subclass of rclpy's Node, a function that
            returns a node, or a main() that calls rclpy.init.
        package: The ROS package of the plugin or the executable.
        plugin: The C++ class of a component.
        executable: The executable of the package, as for 'ros2 run'.
        command: A program with its arguments, run without a shell. ROS arguments follow after
            --ros-args if the node has a namespace, remappings, parameters, 'publishes' or
            'subscribes'.
        launch: A launch file: 'package' and 'file', or 'path'. Remappings and namespace of the node
            apply to everything that it starts.
        external: Whether the node already runs. The run waits for it and does not stop it.
        container: The container of the node; without one, graph.placement applies.
        lifecycle: The state to which the run brings a lifecycle node: all are configured in the
            order of the spec, then activated. Default: the run changes no state.
        intra_process: Whether a plugin exchanges messages by pointer within its container
            ('use_intra_process_comms'). Both sides need it.
        extra_arguments: Further arguments with which a plugin is loaded.
        arguments: Arguments of an executable or a command.
        namespace: The namespace of the node, below that of the benchmark.
        parameters: ROS parameters: a map, a parameter file, or a list of both, of which later items
            win. Nested names have dots: camera.fx.
        remappings: Names in the code of the node, and the topics to use instead.
        publishes: The published topics, by their names in the code, with their types, if 'validate'
            cannot read them.
        subscribes: The topics to which it subscribes, likewise.
        qos: The QoS profiles of its topics, by their names in its code.
        parameter_sources: Files and values in the order in which they apply; empty if there is no
            file, because `parameters` is then complete.
    """

    about = key(
        {"python": "r2bspec.nodes.RelayNode", "remappings": {"input": "image"}},
        description=f"A node: exactly one of {kinds_text()}.",
    )

    description: Annotated[str, key("Finds tags in the left image.")] = ""
    python: Annotated[
        str,
        names.PYTHON_NODE,
        key("r2bspec.nodes.ResizeNode", "./my_nodes.py:Detector", path=True),
    ] = ""
    package: Annotated[names.PackageName, key("image_proc")] = ""
    plugin: Annotated[str, names.PLUGIN, key("image_proc::ResizeNode")] = ""
    executable: Annotated[str, names.FILE_NAME, key("rectify_node")] = ""
    command: Annotated[Command, key(["./build/detector", "--fast"])] = ()
    launch: Launch | None = None
    external: bool = False
    container: Annotated[names.NodeName, key("vision")] = ""
    lifecycle: Annotated[LifecycleState | None, key("active")] = None
    intra_process: bool = False
    extra_arguments: Annotated[_Values, key({"forward_global_arguments": False})] = {}
    arguments: Annotated[tuple[Word, ...], key(["--fast"])] = ()
    namespace: Annotated[names.Namespace, key("left")] = ""
    parameters: _Parameters = {}
    remappings: Annotated[
        dict[
            names.Topic,
            Annotated[names.Topic, key("tag_detections", description="The topic to use.")],
        ],
        key({"image": "camera/image_raw"}, topics=True),
    ] = {}
    publishes: Annotated[
        dict[names.Topic, _Type],
        key({"detections": "geometry_msgs/msg/PoseArray"}, topics=True),
    ] = {}
    subscribes: Annotated[
        dict[names.Topic, _Type], key({"image": "sensor_msgs/msg/Image"}, topics=True)
    ] = {}
    qos: Annotated[dict[names.Topic, QoS], key({"image": "sensor_data"}, topics=True)] = {}
    env: Environment = {}
    parameter_sources: Annotated[tuple[ParameterSource, ...], key(derived=True)] = ()

    @classmethod
    def from_keys(cls, keys: dict[str, Any]) -> "Node":
        """Parameters of several maps are one map; files are kept beside it."""
        written = keys.get("parameters")
        if isinstance(written, str | tuple):
            parts = written if isinstance(written, tuple) else (written,)
            maps = [part for part in parts if isinstance(part, dict)]
            keys["parameters"] = {name: value for part in maps for name, value in part.items()}
            if len(maps) < len(parts):
                keys["parameter_sources"] = tuple(
                    ParameterSource(file=part)
                    if isinstance(part, str)
                    else ParameterSource(values=part)
                    for part in parts
                )
        return cls(**keys)

    @property
    def kind(self) -> NodeKind:
        """The kind of the node."""
        return kind_of(self)

    @property
    def parameter_files(self) -> tuple[str, ...]:
        """The parameter files, in the order in which they apply."""
        return tuple(
            parameter_source.file
            for parameter_source in self.parameter_sources
            if parameter_source.file
        )


Nodes = Annotated[
    dict[names.NodeName, Node],
    key({"resize": {"python": "r2bspec.nodes.ResizeNode"}}, at_most=MAX_SPEC_ENTRIES),
]


class Graph(Record, frozen=True, kw_only=True):
    """The graph under test.

    Attributes:
        placement: The processes of nodes without a container: separate runs each node in its own
            process, shared runs nodes of the same kind in one process, harness runs them in the
            process of the harness.
        nodes: The nodes under test, by name.
    """

    about = key({"nodes": {"apriltag": {"python": "r2bspec.nodes.AprilTagNode"}}})

    placement: Literal["separate", "shared", "harness"] = "separate"
    nodes: Nodes


class SetupStep(Record, frozen=True, kw_only=True):
    """A command that runs before anything else is started.

    Attributes:
        command: The program with its arguments, run without a shell.
        creates: The file that the command creates. If the file exists, the command is skipped.
        timeout: The maximum duration of the command.
        directory: The working directory; default: the folder of this file.
    """

    about = key(
        {
            "command": ["trtexec", "--onnx=model.onnx", "--saveEngine=model.plan"],
            "creates": "model.plan",
        }
    )

    command: Annotated[Command, key(["./build_model.sh"])]
    creates: Annotated[str, key("model.plan", path=True)] = ""
    timeout: Annotated[Duration, key("10 min", default="10 min", positive=True)] = Duration(
        600 * 10**9
    )
    directory: Annotated[str, key("./models", path=True)] = ""
    env: Environment = {}


class LogLine(Record, frozen=True, kw_only=True):
    """A line in the output of a process.

    Attributes:
        process: The node or the container whose output is read.
        pattern: A regular expression to find in the line, in RE2 syntax.
    """

    about = key({"process": "detector", "pattern": "model loaded"})

    process: Annotated[names.NodeName, key("detector")]
    pattern: Annotated[names.SomeText, key("model loaded")]


class ReadyProbe(Record, frozen=True, kw_only=True):
    """A readiness probe: exactly one of 'file', 'service', 'log' and 'topic'.

    Attributes:
        file: A file that exists.
        service: A service that is available.
        log: A line in the output of a process.
        topic: A topic that is published.
        timeout: The maximum wait.
    """

    about = key({"log": {"process": "detector", "pattern": "model loaded"}})

    file: Annotated[str, key("model.plan", path=True)] = ""
    service: Annotated[names.GraphTopic, key("detector/set_parameters")] = ""
    log: LogLine | None = None
    topic: Annotated[names.GraphTopic, key("detector/status")] = ""
    timeout: Annotated[Duration, key("30 s", positive=True)] = Duration(30 * 10**9)


RequestFields = dict[
    names.ParameterName,
    Annotated[
        Any,
        key(
            *(True, 1.5),
            description="The value of the field: a scalar, a list or a map.",
        ),
    ],
]


class ServiceCall(Record, frozen=True, kw_only=True):
    """A service call.

    Attributes:
        name: The service.
        type: Its type, as 'ros2 service list -t' shows it.
        request: The fields of the request; omitted fields have their defaults.
    """

    about = key(
        {"name": "detector/enable", "type": "std_srvs/srv/SetBool", "request": {"data": True}}
    )

    name: Annotated[names.GraphTopic, key("detector/enable")]
    type: Annotated[names.ServiceType, key("std_srvs/srv/SetBool")]
    request: Annotated[RequestFields, key({"data": True})] = {}


class ActionCall(Record, frozen=True, kw_only=True):
    """A goal for an action.

    Attributes:
        name: The action.
        type: Its type, as 'ros2 action list -t' shows it.
        goal: The fields of the goal; omitted fields have their defaults.
    """

    about = key(
        {"name": "fibonacci", "type": "example_interfaces/action/Fibonacci", "goal": {"order": 5}}
    )

    name: Annotated[names.GraphTopic, key("fibonacci")]
    type: Annotated[names.ActionType, key("example_interfaces/action/Fibonacci")]
    goal: Annotated[RequestFields, key({"order": 5})] = {}


class AfterReadyStep(Record, frozen=True, kw_only=True):
    """A step: exactly one of 'command' and 'service'.

    Attributes:
        command: The program with its arguments, run without a shell.
        service: A service call.
        timeout: The maximum duration of the step.
    """

    about = key({"service": {"name": "detector/enable", "type": "std_srvs/srv/Trigger"}})

    command: Annotated[Command, key(["ros2", "lifecycle", "set", "/r2b/detector", "activate"])] = ()
    service: ServiceCall | None = None
    timeout: Annotated[Duration, key("30 s", positive=True)] = Duration(30 * 10**9)
