"""The protocol between the controller and its child processes.

Each message is one line of JSON on a local socket (`r2bspec.harness.control_channel`). The
controller sends a `Command` and the child answers with one `Reply`; a child may send `Failed` at
any time. Samples are not sent here: they are rows in files that both sides read
(`r2bspec.ipc.sample_files`).
"""

from __future__ import annotations

import functools
import operator
from collections.abc import Iterable
from typing import Any, Final, Literal

import msgspec

from r2bspec.ipc.buffers import TF_STATIC, TF_TYPE
from r2bspec.ipc.schedule import Schedule, TimelineSchedule
from r2bspec.language.spec import QoS
from r2bspec.plan.plan import CallPlan, InputPlan, MonitorPlan, NodePlan

CONTROL_FD_VARIABLE = "R2BSPEC_CONTROL_FD"
"""Has the control channel of a process; with ``_PART`` appended, that of a part of it."""

CALLED_ROWS = "playback.rows"
"""The rows of a player that calls services, of the type `PLAYBACK_FIELDS`."""

NATIVE_LIBRARY_VARIABLE = "R2BSPEC_NATIVE_LIBRARY"
"""Has the path of the library of players and monitors, for a process of Python nodes."""

RUN_ID_VARIABLE = "R2BSPEC_RUN_ID"
MODULES_FOLDER_VARIABLE = "R2BSPEC_MODULES_FOLDER"


class Command(msgspec.Struct, frozen=True, kw_only=True, tag_field="type"):
    """A command of the controller; the JSON key `type` names the class."""


class Reply(msgspec.Struct, frozen=True, kw_only=True, tag_field="type"):
    """An answer of a child process; the JSON key `type` names the class."""


STATIC: Final = InputPlan(
    topic=TF_STATIC,
    type=TF_TYPE,
    source=TF_STATIC,
    bag_topic=TF_STATIC,
    qos=QoS(durability="transient_local", depth=1),
)
"""All static transforms, as one message."""


class ConfigureLoader(Command, frozen=True, kw_only=True, tag=True):
    """Configure the loader: publish `sources` (topic: type), record `recorded` (topic: type).

    `buffer_dir` contains one buffer per source and receives one per recorded topic.

    Attributes:
        buffer_only: topics that are buffered and not published. With `retime`, the times of these
            and of the sources are replaced by the times of publication.
        latched: is published from the buffers before anything else.
        clock: whether the system time is published on /clock.
    """

    sources: dict[str, str]
    recorded: dict[str, str]
    buffer_dir: str
    buffer_only: tuple[str, ...] = ()
    retime: bool = False
    latched: tuple[InputPlan, ...] = ()
    clock: bool = False


class ConfigurePlayer(Command, frozen=True, kw_only=True, tag=True):
    """Configure the player: publish `inputs` and `transforms` (topics) from the buffers.

    The reply, `Ready`, states which inputs have a header. `LoadSchedule` sets the schedule. Of the
    transforms, /tf is played; /tf_static is the observer's.
    """

    inputs: tuple[InputPlan, ...]
    buffer_dir: str
    rows: str
    transforms: tuple[str, ...] = ()


class ConfigureCalls(Command, frozen=True, kw_only=True, tag=True):
    """Configure a player that calls services; it writes the rows of playback and answers.

    `CountMatches` says for each service whether it is available.

    Attributes:
        buffer_dir: has the buffers of recorded requests.
        follows: the rows of a player that plays inputs: the services are called in its steps from
            now on, and not at times of their own.
        timeline: the times of the recorded requests, where these are kept.
    """

    calls: tuple[CallPlan, ...]
    rows_dir: str
    buffer_dir: str
    follows: str = ""
    timeline: TimelineSchedule | None = None


class LoadSchedule(Command, frozen=True, kw_only=True, tag=True):
    """Load the messages of this schedule into memory. The reply is `Ready`."""

    schedule: Schedule


class ConfigureMonitor(Command, frozen=True, kw_only=True, tag=True):
    """Configure the monitor: record `monitors` to ``ROWS_DIR/NAME.rows``, from `Subscribe` on."""

    monitors: tuple[MonitorPlan, ...]
    rows_dir: str


class ConfigureObserver(Command, frozen=True, kw_only=True, tag=True):
    """Configure the observer, which reports what discovery shows.

    On the topics of `guarded`, every publisher is examined; see `ForeignPublisher`. It also
    publishes messages without due times, which nodes need before anything is played: before it is
    ready, it has published for each topic of `latched` the message in its buffer, and with `clock`
    the system time on /clock.
    """

    guarded: tuple[str, ...] = ()
    buffer_dir: str = ""
    latched: tuple[InputPlan, ...] = ()
    clock: bool = False


class ConfigureHost(Command, frozen=True, kw_only=True, tag=True):
    """Configure the host of these Python nodes; ``./file.py`` is relative to `base_dir`."""

    nodes: tuple[NodePlan, ...]
    base_dir: str
    executor: Literal["single_threaded", "multi_threaded"] = "single_threaded"
    threads: int = 0


class Prepare(Command, frozen=True, kw_only=True, tag=True):
    """Import rclpy and these packages of messages; the role follows. The reply is `Prepared`."""

    packages: tuple[str, ...] = ()


class ConfigureHarness(Command, frozen=True, kw_only=True, tag=True):
    """Run these parts of the harness in one process; each is configured over its own channel.

    The reply is `Ready`. A subsequent `ConfigureHost` adds nodes to the process.
    """

    parts: tuple[str, ...]


class ConfigureCaller(Command, frozen=True, kw_only=True, tag=True):
    """Call a service once with a request; `Called` follows `Ready`."""

    service: str
    service_type: str
    request: dict[str, Any]
    timeout_ns: int


class ConfigureInspector(Command, frozen=True, kw_only=True, tag=True):
    """Write the interfaces of the nodes of a namespace to a JSON file; `Ready` follows.

    The first node is waited for `timeout_s` seconds.
    """

    namespace: str
    timeout_s: float
    file: str


class ConfigureComponents(Command, frozen=True, kw_only=True, tag=True):
    """Configure the process that loads components into running containers; see `LoadComponent`."""


class LoadComponent(Command, frozen=True, kw_only=True, tag=True):
    """Load a component into the container whose node has this full name. The reply is `Composed`.

    Attributes:
        timeout_ns: how long to wait for the container and for its answer.
    """

    container: str
    node: NodePlan
    timeout_ns: int


class Subscribe(Command, frozen=True, kw_only=True, tag=True):
    """Create subscriptions; the reply, `Matched`, is sent immediately.

    For a monitor: those of `monitors`, each with a QoS. For a loader: those of all topics that it
    records. A topic whose publisher has not been discovered waits and has the count 0.
    """

    monitors: tuple[MonitorPlan, ...] = ()


class StartTap(Command, frozen=True, kw_only=True, tag=True):
    """Also record these topics until `StopTap`. The reply is `Matched`.

    Each has a QoS. A topic whose type is not installed is not recorded.
    """

    monitors: tuple[MonitorPlan, ...]


class StopTap(Command, frozen=True, kw_only=True, tag=True):
    """Stop recording the topics of `StartTap`; their rows stay. The reply is `Matched`."""


class CountMatches(Command, frozen=True, kw_only=True, tag=True):
    """Query how many endpoints of other processes each endpoint is matched with."""


class ListModules(Command, frozen=True, kw_only=True, tag=True):
    """Ask a host for the files of the modules that its process has imported."""


class AwaitLatched(Command, frozen=True, kw_only=True, tag=True):
    """Wait, for a limited time, until all matched subscriptions have received latched messages.

    The reply is `Matched`.
    """


class Discover(Command, frozen=True, kw_only=True, tag=True):
    """Query the endpoints on these topics."""

    topics: tuple[str, ...]


class ListGraph(Command, frozen=True, kw_only=True, tag=True):
    """Query the nodes, services and topics."""


class ListParameters(Command, frozen=True, kw_only=True, tag=True):
    """Ask all nodes for the names of their parameters, except for these."""

    exclude: tuple[str, ...]
    timeout_ns: int


class ListLifecycle(Command, frozen=True, kw_only=True, tag=True):
    """Ask all lifecycle nodes for their states."""

    timeout_ns: int


Transition = Literal["configure", "activate"]


class ChangeState(Command, frozen=True, kw_only=True, tag=True):
    """Ask a lifecycle node, by its full name, to make a transition."""

    node: str
    transition: Transition
    timeout_ns: int


class DescribeNodes(Command, frozen=True, kw_only=True, tag=True):
    """Ask a host for the current interfaces of its nodes. The reply is `Ready`."""


class ListForeign(Command, frozen=True, kw_only=True, tag=True):
    """Ask for the publishers on guarded topics that may be of no process of the run."""


class Load(Command, frozen=True, kw_only=True, tag=True):
    """Publish every source message once and record the output.

    `max_output_gap_ns` is the time without output after which the loader stops waiting for more.
    In `real_time`, messages are published at their recorded times, without waiting for output.
    """

    max_output_gap_ns: int
    real_time: bool = False


class Play(Command, frozen=True, kw_only=True, tag=True):
    """Publish `steps` steps at `rate_hz`. The reply, `Played`, is sent after the last one.

    A rate of 0 is that of the recording.

    Attributes:
        begin_ns: when the first step is due, on the monotonic clock; 0 for soon.
        delays_ns: for each step, how much later than at the rate it is due; empty for no delay.
    """

    rate_hz: float
    steps: int
    begin_ns: int = 0
    delays_ns: tuple[int, ...] = ()


class WatchClocks(Command, frozen=True, kw_only=True, tag=True):
    """Record the processor time of these processes at each due time from now on.

    The reply is `Watched`.
    """

    pids: tuple[int, ...]


class Stop(Command, frozen=True, kw_only=True, tag=True):
    """Stop playing after the current step. There is no reply but that of `Play`."""


class Shutdown(Command, frozen=True, kw_only=True, tag=True):
    """Clean up and exit with status 0. There is no reply."""


class Prepared(Reply, frozen=True, kw_only=True, tag=True):
    """Everything is imported; until its role follows, the process waits without using the CPU."""


class Ready(Reply, frozen=True, kw_only=True, tag=True):
    """The child is configured. Except for two fields, all are from a host.

    With `is_program`, the function of a host creates and spins its nodes itself, and nothing is
    known of them. `headers` states for each topic of a player whether its type begins with a
    header, `rmw` which middleware a monitor has loaded. `endpoints` lists (node, topic, type,
    ``publishes`` or ``subscribes``), `undeclared` the parameters in the plan that the node does not
    declare, as (node, parameter), `parameters` the declared ones of each node, and `unmatched` the
    remappings that changed no name of the node, as (node, name before as written, full name after).
    `lifecycle` names the lifecycle nodes, for which all this may change when they are configured.
    """

    endpoints: tuple[tuple[str, str, str, str], ...] = ()
    undeclared: tuple[tuple[str, str], ...] = ()
    parameters: dict[str, tuple[str, ...]] = {}
    unmatched: tuple[tuple[str, str, str], ...] = ()
    lifecycle: tuple[str, ...] = ()
    headers: dict[str, bool] = {}
    rmw: str = ""
    is_program: bool = False


class Matched(Reply, frozen=True, kw_only=True, tag=True):
    """How many endpoints of other processes each topic is matched with.

    From a host, `counts` are the subscriptions of the topics that its nodes publish, and
    `publisher_counts` the publishers of the topics to which they subscribe.
    """

    counts: dict[str, int]
    publisher_counts: dict[str, int] = {}


class Modules(Reply, frozen=True, kw_only=True, tag=True):
    """The absolute paths of the files of all modules that a process has imported."""

    files: tuple[str, ...]


class Endpoint(msgspec.Struct, frozen=True, kw_only=True):
    """One discovered endpoint."""

    node: str
    type: str
    reliability: str
    durability: str


_SUBSCRIPTION_DEPTH = 1000
"""History depth of the subscriptions of the harness: a second at 1 kHz, so that a monitor that was
not scheduled for a while loses no messages. Only waiting messages use memory. With a depth of 100,
messages were lost on a busy machine."""


def weakest_offer(publishers: Iterable[Endpoint]) -> QoS:
    """Return a QoS that is compatible with all publishers of a topic.

    A subscription is compatible with publishers that offer more than it requests, so the weakest
    offer decides.
    """
    offers = [(publisher.reliability, publisher.durability) for publisher in publishers]
    reliable = all(reliability == "reliable" for reliability, _ in offers)
    transient = all(durability == "transient_local" for _, durability in offers)
    return QoS(
        reliability="reliable" if reliable else "best_effort",
        durability="transient_local" if transient else "volatile",
        depth=_SUBSCRIPTION_DEPTH,
    )


class QosMismatch(msgspec.Struct, frozen=True):
    """A publisher and a subscription with incompatible QoS; `why` is from the middleware."""

    writer: str
    reader: str
    topic: str
    why: str


class Discovered(Reply, frozen=True, kw_only=True, tag=True):
    """The publishers and subscriptions of each topic, and the pairs that never match."""

    writers: dict[str, tuple[Endpoint, ...]]
    readers: dict[str, tuple[Endpoint, ...]]
    qos_mismatches: tuple[QosMismatch, ...] = ()


class GraphSnapshot(Reply, frozen=True, kw_only=True, tag=True):
    """The full names of all discovered nodes, services and topics."""

    nodes: tuple[str, ...]
    services: tuple[str, ...]
    topics: tuple[str, ...] = ()


class ParameterLists(Reply, frozen=True, kw_only=True, tag=True):
    """The parameters of nodes that have responded, by full name, and which are lifecycle nodes."""

    parameters: dict[str, tuple[str, ...]]
    lifecycle: tuple[str, ...] = ()


class LifecycleStates(Reply, frozen=True, kw_only=True, tag=True):
    """The states of all lifecycle nodes, by full name; empty for one that does not answer."""

    states: dict[str, str]


class StateChanged(Reply, frozen=True, kw_only=True, tag=True):
    """The outcome of a transition, and the state of the node then; empty without an answer."""

    result: Literal["success", "failure", "no answer"]
    state: str = ""


class ForeignPublisher(msgspec.Struct, frozen=True, kw_only=True):
    """A publisher of which no process carries the id of the run.

    Attributes:
        gid: its identifier, in hexadecimal digits.
        processes: who it may be, for the user; empty where no process of this host fits.
    """

    topic: str
    node: str
    gid: str
    processes: tuple[str, ...] = ()


class ForeignPublishers(Reply, frozen=True, kw_only=True, tag=True):
    """All foreign publishers seen on guarded topics since the start of the observer."""

    publishers: tuple[ForeignPublisher, ...]


class Called(Reply, frozen=True, kw_only=True, tag=True):
    """The service has responded."""


class Composed(Reply, frozen=True, kw_only=True, tag=True):
    """The answer of a container: the component is loaded, or the reason why not."""

    loaded: bool
    reason: str = ""


class Loaded(Reply, frozen=True, kw_only=True, tag=True):
    """The number of messages published and recorded, by topic."""

    published: dict[str, int]
    recorded: dict[str, int]


class Played(Reply, frozen=True, kw_only=True, tag=True):
    """The number of published steps."""

    steps: int


class Watched(Reply, frozen=True, kw_only=True, tag=True):
    """The number of processes whose processor time is recorded: the first that were named."""

    clocks: int


class Failed(Reply, frozen=True, kw_only=True, tag=True):
    """The child cannot continue. `message` and `hint` are for the user."""

    code: str
    message: str
    hint: str = ""


_COMMANDS: msgspec.json.Decoder[Command] = msgspec.json.Decoder(
    functools.reduce(operator.or_, Command.__subclasses__())
)
_REPLIES: msgspec.json.Decoder[Reply] = msgspec.json.Decoder(
    functools.reduce(operator.or_, Reply.__subclasses__())
)


def control_variable(part: str = "") -> str:
    """Return the variable with the file descriptor of a control channel."""
    return f"{CONTROL_FD_VARIABLE}_{part.upper()}" if part else CONTROL_FD_VARIABLE


def encode(message: Any) -> bytes:
    """Encode a message as one line."""
    return msgspec.json.encode(message) + b"\n"


def decode_command(line: bytes) -> Command:
    """Decode a command.

    Raises:
        msgspec.DecodeError, ValueError: the line is not a command.
    """
    return _COMMANDS.decode(line)


def decode_reply(line: bytes) -> Reply:
    """Decode a reply.

    Raises:
        msgspec.DecodeError, ValueError: the line is not a reply.
    """
    return _REPLIES.decode(line)
