"""The typed, frozen values that a spec becomes once it is parsed, substituted and checked.

These classes and the JSON Schema (`r2bspec.spec.schema`) describe the same language; a test
holds them together. Names are kept as the user wrote them: resolving `image` to `/r2b/image` is
the plan's business. Quantities are exact (`r2bspec.spec.quantities`).
"""

from __future__ import annotations

from typing import Any, Literal

import msgspec

from r2bspec.spec.quantities import Duration, Rate, Share
from r2bspec.spec.requirement import Requirement

Scalar = bool | int | float | str
ParameterValue = Scalar | list[Any]


class _Value(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Base of all language values: immutable and closed."""


class BagSource(_Value, frozen=True, kw_only=True):
    """Where the recorded messages come from: exactly one of `dataset` and `path`."""

    dataset: str = ""
    path: str = ""
    sha256: str = ""


class Window(_Value, frozen=True, kw_only=True):
    """The part of the bag that is used, counted from its first message."""

    start: Duration = Duration(0)
    end: Duration | None = None


class DataLoader(_Value, frozen=True, kw_only=True):
    """The bag, the window, and which bag topic becomes which topic in the graph."""

    bag: BagSource
    window: Window = Window()
    topics: dict[str, str]


class QoS(_Value, frozen=True, kw_only=True):
    """A quality-of-service profile; the default is the one that rclpy uses for `depth=10`."""

    reliability: Literal["reliable", "best_effort"] = "reliable"
    durability: Literal["volatile", "transient_local"] = "volatile"
    history: Literal["keep_last", "keep_all"] = "keep_last"
    depth: int = 10


class Node(_Value, frozen=True, kw_only=True):
    """A node of the graph or of the preprocessors.

    Exactly one kind is given: `python`, `package` with `executable`, or `command`.
    """

    python: str = ""
    package: str = ""
    executable: str = ""
    command: tuple[str, ...] = ()
    arguments: tuple[str, ...] = ()
    namespace: str = ""
    parameters: dict[str, ParameterValue] = {}
    remappings: dict[str, str] = {}
    publishes: dict[str, str] = {}
    subscribes: dict[str, str] = {}
    env: dict[str, str] = {}

    @property
    def kind(self) -> Literal["python", "executable", "command"]:
        """Which of the three kinds of node this is."""
        if self.python:
            return "python"
        return "executable" if self.package else "command"


class PlaybackInput(_Value, frozen=True, kw_only=True):
    """A topic that the graph reads: where its messages were buffered, and their type."""

    source: str = msgspec.field(name="from")
    format: str
    qos: QoS = QoS()


class Playback(_Value, frozen=True, kw_only=True):
    """How the buffered messages are played. `buffer` is messages per input; 0 means all."""

    mode: Literal["looping"] = "looping"
    buffer: int = 0
    inputs: dict[str, PlaybackInput]


class Graph(_Value, frozen=True, kw_only=True):
    """The nodes under test; `placement` says whether each Python node gets its own process."""

    placement: Literal["separate", "shared"] = "separate"
    nodes: dict[str, Node]


class Monitor(_Value, frozen=True, kw_only=True):
    """A topic that is watched. `match` says how its messages find the input they answer."""

    topic: str
    format: str
    match: Literal["stamp", "order"] = "stamp"
    qos: QoS | None = None


class Search(_Value, frozen=True, kw_only=True):
    """The search for the highest rate that holds.

    `holds` are conditions on one probe beyond the one that always applies: the backlog of
    unanswered messages must not grow.
    """

    min: Rate
    max: Rate
    precision: Share = Share(0.02)
    holds: tuple[Requirement, ...] = ()
    probe: Duration = Duration(3 * 10**9)


class Benchmark(_Value, frozen=True, kw_only=True):
    """What is played: `iterations` times `duration` at each of `rates`, and an optional search."""

    duration: Duration = Duration(5 * 10**9)
    iterations: int = 5
    rates: tuple[Rate, ...] = ()
    search: Search | None = None
    warm_up: Duration = Duration(10**9)
    start_timeout: Duration = Duration(30 * 10**9)


class Objective(_Value, frozen=True, kw_only=True):
    """One service-level objective: requirements that must hold at one offered rate.

    `at` is None for requirements that concern the search as a whole (`peak.rate`).
    """

    at: Rate | None = None
    require: tuple[Requirement, ...]


class Spec(_Value, frozen=True, kw_only=True):
    """One benchmark, complete."""

    r2bspec: Literal[1]
    name: str
    title: str = ""
    description: str = ""
    labels: dict[str, Scalar] = {}
    environment: tuple[str, ...] = ()
    namespace: str = "r2b"
    transport: Literal["inherit", "shared_memory", "udp"] = "shared_memory"
    variables: dict[str, Scalar] = {}
    data_loader: DataLoader
    preprocessors: dict[str, Node] = {}
    playback: Playback
    graph: Graph
    monitors: dict[str, Monitor]
    benchmark: Benchmark = Benchmark()
    slos: dict[str, Objective] = {}
