"""The plan: everything that a run will do, as frozen values that serialise to canonical JSON.

Topic and node names are fully resolved here (``/r2b/image``). Times are nanoseconds, rates hertz.
Paths are as the spec wrote them, relative to the spec's folder, so that a plan has the same bytes
on every machine.
"""

from __future__ import annotations

from typing import Any, Literal

import msgspec

from r2bspec.spec.model import Objective, QoS, Scalar
from r2bspec.spec.requirement import Requirement


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
    """The recorded messages. `source` is the bag as the spec names it."""

    source: str
    kind: Literal["recorded", "synthetic"]
    sha256: str
    start_ns: int
    end_ns: int | None
    topics: tuple[BagTopicPlan, ...]


class NodePlan(_Value, frozen=True, kw_only=True):
    """A node: its resolved name, what it is, and its parameters and remappings as written.

    `target` is ``module.Class`` or ``./file.py:Class`` for Python nodes and empty otherwise.
    """

    name: str
    node: str
    namespace: str
    target: str
    parameters: dict[str, Any]
    remappings: dict[str, str]


class ProcessPlan(_Value, frozen=True, kw_only=True):
    """One process. `env` holds only the changes to the environment that the run gives to all.

    ``$(python)`` in `argv` stands for the interpreter that runs r2bspec; ``$(executable P E)``
    for the path of executable E of package P in the ament index. `nodes` of a command are what the
    spec calls it; a bare command need not be a ROS node.
    """

    name: str
    role: Literal["loader", "player", "monitor", "host", "command"]
    phase: Literal["preprocess", "measure"]
    argv: tuple[str, ...]
    env: dict[str, str]
    nodes: tuple[NodePlan, ...] = ()


class TopicPlan(_Value, frozen=True, kw_only=True):
    """A topic: who writes and who reads it, by process-independent names.

    Writers and readers are full node names (``/r2b/apriltag``), ``loader``, ``player`` or
    ``monitor``; the loader reads what it records for playback. Where a node's interface is unknown,
    it is listed in neither. An empty type is unknown.
    """

    name: str
    type: str
    phase: Literal["preprocess", "measure"]
    writers: tuple[str, ...]
    readers: tuple[str, ...]


class InputPlan(_Value, frozen=True, kw_only=True):
    """An input of the graph: the topic played, and where its messages come from.

    `bag_topic`, as the spec writes it, is set where they come straight from the bag; otherwise
    they are what the preprocessors publish on `source`.
    """

    topic: str
    type: str
    source: str
    bag_topic: str
    qos: QoS


class MonitorPlan(_Value, frozen=True, kw_only=True):
    """A watched topic. `qos` None means: whatever its writer offers."""

    name: str
    topic: str
    type: str
    match: Literal["stamp", "order"]
    qos: QoS | None


class SearchPlan(_Value, frozen=True, kw_only=True):
    """The search for the peak rate; `precision` is a relative width, as a fraction."""

    min_hz: float
    max_hz: float
    precision: float
    probe_ns: int
    holds: tuple[Requirement, ...]


class PlayPlan(_Value, frozen=True, kw_only=True):
    """`iterations` times `duration_ns` at one rate."""

    rate_hz: float
    duration_ns: int
    iterations: int


class Plan(_Value, frozen=True, kw_only=True):
    """The whole run.

    `phases` are those of load, preprocess, start, warm_up, search, sustained, play and collect
    that happen, in this order. `sustained_hz` are the rates that an objective requires to be
    sustained and that get one sequential probe each. `largest_message_bytes` is over the bag topics
    that are used, and 0 if unknown.
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
    playback_mode: Literal["looping"]
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
