"""What the controller and its children say to each other.

Each message is one line of JSON on a local socket (`r2bspec.harness.control_channel`). The
controller sends a `Command` and the child answers with one `Reply`; a child may send `Failed` at
any time. Samples do not travel here: they are rows in files that both sides map
(`r2bspec.ipc.sample_files`).
"""

from __future__ import annotations

from typing import Any, Literal

import msgspec

from r2bspec.ipc.schedule import Schedule
from r2bspec.plan.plan import InputPlan, MonitorPlan, NodePlan

CONTROL_FD_VARIABLE = "R2BSPEC_CONTROL_FD"
"""Names the control channel of a process; with ``_PART`` after it, that of a part of it."""

RUN_ID_VARIABLE = "R2BSPEC_RUN_ID"


class _Message(msgspec.Struct, frozen=True, kw_only=True, tag_field="say"):
    """Base of all messages; the JSON key `say` names the class."""


class ConfigureLoader(_Message, frozen=True, kw_only=True, tag=True):
    """Be the loader: publish `sources` (topic: type), record `recorded` (topic: type).

    `buffer_dir` holds one buffer per source and receives one per recorded topic.

    Attributes:
        buffer_only: topics that are buffered and not published. With `retime`, the times of these
            and of
            the sources become those at which it was their turn.
        static: whether the buffered /tf_static is published, latched, before anything else.
    """

    sources: dict[str, str]
    recorded: dict[str, str]
    buffer_dir: str
    buffer_only: tuple[str, ...] = ()
    retime: bool = False
    static: bool = False


class ConfigurePlayer(_Message, frozen=True, kw_only=True, tag=True):
    """Be the player: publish `inputs` from the buffers, and `transforms` (topics) along with them.

    The answer, `Ready`, says which inputs have a header. What to publish when comes with `Follow`.
    """

    inputs: tuple[InputPlan, ...]
    buffer_dir: str
    rows: str
    transforms: tuple[str, ...] = ()


class Follow(_Message, frozen=True, kw_only=True, tag=True):
    """Hold ready in memory what this schedule plays. `Ready` answers it."""

    schedule: Schedule


class ConfigureMonitor(_Message, frozen=True, kw_only=True, tag=True):
    """Be the monitor: watch `monitors`, writing rows to ``ROWS_DIR/NAME.rows``.

    On the topics of `guarded`, every publisher is looked at; see `ForeignPublisher`.
    """

    monitors: tuple[MonitorPlan, ...]
    rows_dir: str
    guarded: tuple[str, ...] = ()


class ConfigureHost(_Message, frozen=True, kw_only=True, tag=True):
    """Be the host of these Python nodes; `base_dir` is where ``./file.py`` is looked for."""

    nodes: tuple[NodePlan, ...]
    base_dir: str
    executor: Literal["single_threaded", "multi_threaded"] = "single_threaded"
    threads: int = 0


class ConfigureHarness(_Message, frozen=True, kw_only=True, tag=True):
    """Be the parts of the harness in one process; each part is configured over its own channel.

    `Ready` answers it. A `ConfigureHost` that follows puts nodes beside the parts.
    """

    parts: tuple[str, ...]


class ConfigureCaller(_Message, frozen=True, kw_only=True, tag=True):
    """Call a service once with a request; `Called` follows `Ready`."""

    service: str
    type: str
    request: dict[str, Any]
    timeout_ns: int


class ContainerComponents(msgspec.Struct, frozen=True, kw_only=True):
    """The full name of a container's node, and the components to be loaded into it, in order."""

    container: str
    nodes: tuple[NodePlan, ...]


class ConfigureComponents(_Message, frozen=True, kw_only=True, tag=True):
    """Load components into containers that run; `Composed` follows `Ready`."""

    containers: tuple[ContainerComponents, ...]
    timeout_ns: int


class Subscribe(_Message, frozen=True, kw_only=True, tag=True):
    """Make the subscriptions. A topic without QoS of its own waits for its writer to be seen.

    The answer, `Matched`, comes at once; a topic that still waits counts 0.
    """


class Watch(_Message, frozen=True, kw_only=True, tag=True):
    """Read these topics, too, until `Unwatch`. `Matched` answers it.

    A topic without QoS of its own is read with that of its writer; one that has no writer now, or
    a type that is not installed, is not read at all.
    """

    monitors: tuple[MonitorPlan, ...]


class Unwatch(_Message, frozen=True, kw_only=True, tag=True):
    """Stop reading what `Watch` named; its rows stay. `Matched` answers it."""


class CountMatches(_Message, frozen=True, kw_only=True, tag=True):
    """Ask how many endpoints of others each own endpoint is matched with."""


class Discover(_Message, frozen=True, kw_only=True, tag=True):
    """Ask which endpoints exist on these topics."""

    topics: tuple[str, ...]


class Survey(_Message, frozen=True, kw_only=True, tag=True):
    """Ask which nodes and services exist."""


class ListForeign(_Message, frozen=True, kw_only=True, tag=True):
    """Ask which publishers were ever seen on guarded topics that may be no process's of the run."""


class Load(_Message, frozen=True, kw_only=True, tag=True):
    """Publish every source message once and record what comes out.

    `max_output_gap_ns` is how long no output may come before the loader stops waiting for more. In
    `real_time` messages go out when they were recorded, whatever has come out by then.
    """

    max_output_gap_ns: int
    real_time: bool = False


class Play(_Message, frozen=True, kw_only=True, tag=True):
    """Publish `steps` steps at `rate_hz`. The answer, `Played`, comes when that is done.

    A rate of 0 is that of the recording. A loader publishes the first so many of its messages once
    more, and records nothing.
    """

    rate_hz: float
    steps: int


class Stop(_Message, frozen=True, kw_only=True, tag=True):
    """Stop playing after the step at hand. Only `Played` answers it."""


class Shutdown(_Message, frozen=True, kw_only=True, tag=True):
    """Clean up and exit with status 0. Not answered."""


Command = (
    ConfigureLoader
    | ConfigurePlayer
    | Follow
    | ConfigureMonitor
    | ConfigureHost
    | ConfigureHarness
    | ConfigureCaller
    | ConfigureComponents
    | Subscribe
    | Watch
    | Unwatch
    | CountMatches
    | Discover
    | Survey
    | ListForeign
    | Load
    | Play
    | Stop
    | Shutdown
)


class Ready(_Message, frozen=True, kw_only=True, tag=True):
    """The child is configured. What it says is what a host found of its nodes, but for two fields.

    `headers` says of each topic of a player whether its type begins with a header, `rmw` which
    middleware a monitor has loaded. `endpoints`
    lists (node, topic, type, ``publishes`` or ``subscribes``), `undeclared` the parameters given
    that the node does not declare, as (node, parameter), `parameters` what each node does declare,
    and `unmatched` the remappings that changed no name of the node's, as (node, name before as
    written, full name after).
    """

    endpoints: tuple[tuple[str, str, str, str], ...] = ()
    undeclared: tuple[tuple[str, str], ...] = ()
    parameters: dict[str, tuple[str, ...]] = {}
    unmatched: tuple[tuple[str, str, str], ...] = ()
    headers: dict[str, bool] = {}
    rmw: str = ""


class Matched(_Message, frozen=True, kw_only=True, tag=True):
    """How many endpoints of others each topic is matched with.

    Of a host, `counts` are the readers of what its nodes write, and `publisher_counts` the writers
    of what they read.
    """

    counts: dict[str, int]
    publisher_counts: dict[str, int] = {}


class Endpoint(msgspec.Struct, frozen=True, kw_only=True):
    """One endpoint as discovery shows it."""

    node: str
    type: str
    reliability: str
    durability: str


class QosMismatch(msgspec.Struct, frozen=True):
    """A writer and a reader of a topic whose QoS never match; `why` is what the middleware says."""

    writer: str
    reader: str
    topic: str
    why: str


class Discovered(_Message, frozen=True, kw_only=True, tag=True):
    """Which endpoints exist: topic to writers, topic to readers; and which pairs never match."""

    writers: dict[str, tuple[Endpoint, ...]]
    readers: dict[str, tuple[Endpoint, ...]]
    qos_mismatches: tuple[QosMismatch, ...] = ()


class Surveyed(_Message, frozen=True, kw_only=True, tag=True):
    """The full names of all nodes, services and topics that are seen."""

    nodes: tuple[str, ...]
    services: tuple[str, ...]
    topics: tuple[str, ...] = ()


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


class ForeignPublishers(_Message, frozen=True, kw_only=True, tag=True):
    """All that were seen on guarded topics since the monitor was started."""

    publishers: tuple[ForeignPublisher, ...]


class Called(_Message, frozen=True, kw_only=True, tag=True):
    """The service answered, with this."""

    response: str


class Composed(_Message, frozen=True, kw_only=True, tag=True):
    """All components are loaded; these are the full names of their nodes, in order."""

    nodes: tuple[str, ...]


class Loaded(_Message, frozen=True, kw_only=True, tag=True):
    """How many messages went out and came in, by topic."""

    published: dict[str, int]
    recorded: dict[str, int]


class Played(_Message, frozen=True, kw_only=True, tag=True):
    """How many steps were published."""

    steps: int


class Failed(_Message, frozen=True, kw_only=True, tag=True):
    """The child cannot go on. `message` is for the user, `detail` for the log."""

    code: str
    message: str
    hint: str = ""
    detail: str = ""


Reply = (
    Ready
    | Matched
    | Discovered
    | Surveyed
    | ForeignPublishers
    | Called
    | Composed
    | Loaded
    | Played
    | Failed
)

_COMMANDS: msgspec.json.Decoder[Command] = msgspec.json.Decoder(Command)
_REPLIES: msgspec.json.Decoder[Reply] = msgspec.json.Decoder(Reply)


def control_variable(part: str = "") -> str:
    """The variable that holds the number of a control channel's socket."""
    return f"{CONTROL_FD_VARIABLE}_{part.upper()}" if part else CONTROL_FD_VARIABLE


def encode(message: Any) -> bytes:
    """Write a message as one line."""
    return msgspec.json.encode(message) + b"\n"


def decode_command(line: bytes) -> Command:
    """Read a command.

    Raises:
        msgspec.ValidationError: the line is no command.
    """
    return _COMMANDS.decode(line)


def decode_reply(line: bytes) -> Reply:
    """Read a reply.

    Raises:
        msgspec.ValidationError: the line is no reply.
    """
    return _REPLIES.decode(line)
