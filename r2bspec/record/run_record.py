"""The record of a run, as frozen values. The samples themselves are arrays in files.

A run folder contains::

    spec.yaml          the resolved spec
    plan.json          the plan of the run
    record.json        a `RunRecord`: this module, written last and atomically
    result.json        metrics and verdicts, computed from all of the above
    samples/SEGMENT/   playback.npy, monitor.NAME.npy for each monitor, and anatomy.npy with the
                       events in the processes of the graph, where they were observed from inside
    resources.npy      CPU and memory of every process over the whole run
    interference.npy   host interference over the whole run
    devices.npy        GPUs and the energy of processors, likewise, where the machine tells
    loaded_files.json  the files that each process of the graph loaded (`loaded_files`)
    logs/PROCESS.log   the output of each process
    profile/PROCESS/   what a profiler wrote

All times are CLOCK_MONOTONIC nanoseconds of the host, unless the name says otherwise.
"""

from __future__ import annotations

import enum
import math
from typing import Annotated, Any, Literal

import msgspec

from r2bspec.language.spec_benchmark import ArrivalKind
from r2bspec.record.graph_identity import GraphIdentity, check_machine_facts
from r2bspec.safe_io.limits import MAX_PROCESSES, MAX_SEGMENTS

# What is calculated with is refused where it is read; a damaged record can have any number.
Count = Annotated[int, msgspec.Meta(ge=0)]
Number = Annotated[int, msgspec.Meta(ge=1, le=MAX_SEGMENTS)]
"""Of a segment or a start."""
ExitNumber = Annotated[int, msgspec.Meta(ge=0, le=255)]
"""Of an error that ended a run."""
Hertz = Annotated[float, msgspec.Meta(ge=0)]
Confidence = Annotated[float, msgspec.Meta(ge=0, lt=1)]


SegmentKind = Literal[
    "warm_up",
    "probe",
    "sustained",
    "iteration",
    "confirmation",
    "recorded",
    "anatomy",
    "turns",
    "work_turns",
]
"""The purpose of a segment; those of the confirmation run after a failure are ``confirmation``, the
messages of ``recorded`` are in a bag of the run folder, and ``anatomy`` is the one that is observed
from inside where the others are not. ``turns`` was played by turns with the other side of a
comparison; its `index` is the place of the rate in the plan, from 1. So was ``work_turns``, with
the graphs of both sides on the same core."""

TurnKind = Literal["turns", "work_turns"]
"""The kinds of segments by turns: of metrics of messages, and of work."""


class Segment(msgspec.Struct, frozen=True, kw_only=True):
    """Playback at one rate; a rate of 0 is that of the recording, or of the graph's own source.

    `id` is the name of its folder in ``samples/``. `steps` is the requested number of steps. The
    sending window is from the first due time to `ended_ns`, the end of the last period. `complete`
    is False if the playback was interrupted. `played_before` is the number of steps that the graph
    had received before this segment. `rerun_of` is the id of the iteration affected by host
    interference that this one replaces, or empty. `monitor_held_ns` is the time for which the
    monitor was stalled: messages that arrived in this time are recorded, but their arrival times
    are unknown.

    Attributes:
        start: the start of the graph's processes that it was played in, from 1.
        live: whether nothing was played, because the graph has its own source. The window is then
            the one in which messages were received, and `steps` is 0.
        arrivals: when its steps came, if not at equal intervals: the period of `rate_hz` is then
            only their mean interval.
        core: the CPU on which both graphs of a comparison were played; None if on all.
        clock_offset_ns: in a live segment, the system clock minus CLOCK_MONOTONIC; None if that
            changed by more than a millisecond.
    """

    id: str
    kind: SegmentKind
    rate_hz: Hertz
    index: Number
    steps: Count
    began_ns: int
    ended_ns: int
    complete: bool
    played_before: Count = 0
    rerun_of: str = ""
    live: bool = False
    clock_offset_ns: int | None = None
    monitor_held_ns: Count = 0
    start: Number = 1
    core: int | None = None
    arrivals: ArrivalKind | msgspec.UnsetType = msgspec.UNSET

    @property
    def length_s(self) -> float:
        """The length of the sending window in seconds."""
        return (self.ended_ns - self.began_ns) / 1e9


class Probe(msgspec.Struct, frozen=True, kw_only=True):
    """A probe: the offered rate, the delivered rate, and whether the rate is sustained (`holds`).

    `holds` is None if undecided. `confidence` is one-sided. `purpose` is why it was played: to test
    a rate, to measure an overloaded graph, or to confirm the lower end of the bracket. `keeps_up`
    tells whether the backlog does not grow, whatever is lost: a rate that keeps up is undecided if
    too few messages were played to show that few enough are lost (`lost_at_most`).

    Attributes:
        disturbed: the host interference during the probe, in words; empty for none.
        explained: whether that can explain why the rate was not sustained: then the probe says
            nothing about the graph.
        taken: the largest share of the time that others can have taken from the run; 0 without
            interference.
        rerun_of: the segment of the probe in whose place, because of interference, it was played.
        by_player: whether the rate was not sustained because the player could not offer it.
    """

    segment: str
    rate_hz: Hertz
    delivered_hz: Hertz
    holds: bool | None
    reason: str
    confidence: Confidence = 0.0
    purpose: Literal["probe", "saturation", "confirmation"] = "probe"
    keeps_up: bool | None = None
    lost_at_most: float | None = None
    played_s: float = 0.0
    disturbed: tuple[str, ...] = ()
    explained: bool = False
    taken: float = 0.0
    rerun_of: str = ""
    by_player: bool = False


class CapacityRecord(msgspec.Struct, frozen=True, kw_only=True):
    """What an overloaded graph processes, in steps per second, from `played_s` seconds of playing.

    The bounds are those of a two-sided interval at the confidence of the search.
    """

    hz: float
    lower_hz: float
    upper_hz: float | None
    played_s: float


Limit = Literal["graph", "player", "range", "interrupted", "interference"]
Proof = Literal["", "confirmed", "probes", "open"]


class SearchRecord(msgspec.Struct, frozen=True, kw_only=True):
    """The result of the peak search.

    The peak is between `holds_hz`, the highest sustained rate (None if there is none), and
    `fails_hz`, the upper end: the lowest rate that was not sustained, or the upper bound of the
    capacity of the overloaded graph (None if there is none: the peak is at least `holds_hz`).
    `limited_by` is what limits it: with ``interference``, the lowest rate that was not sustained
    failed during host interference that can explain it, and `fails_hz` is the lowest one that
    failed otherwise. The bracket is as narrow as `precision`, a relative width, unless probes in it
    were undecided; `confidence` is that of the bracket (0: not stated).

    `proof` says how the lower end was shown: it was played whole for `proof_s` seconds
    (`confirmed`); only in probes, of which the one at the lower end lasted `proof_s` seconds
    (`probes`); or it was not, because it was refuted or stayed undecided when it was played whole
    (`open`). It is empty in records of versions that did not state it. At the lower end at most the
    share `lost_at_most` was lost. `unsteady` has a text for each way in which the graph is not
    steady, and `unsteady_ratio` is the ratio of its fastest speed to its slowest. In `watched_s`
    seconds of playing it was examined for that; 0 in records of versions that did not state it.
    """

    probes: tuple[Probe, ...]
    holds_hz: float | None
    fails_hz: float | None
    limited_by: Limit
    precision: float = 0.0
    confidence: Confidence = 0.0
    proof: Proof = ""
    proof_s: float = 0.0
    lost_at_most: float | None = None
    max_lost: float | None = None
    capacity: CapacityRecord | None = None
    unsteady: tuple[str, ...] = ()
    unsteady_ratio: float = 1.0
    watched_s: float = 0.0
    refuted: str = ""

    @property
    def upper_hz(self) -> float | None:
        """The upper bound of the peak of the graph; None if only a lower bound is known.

        A rate that the player could not offer is not a bound for the graph.
        """
        return None if self.limited_by == "player" else self.fails_hz

    @property
    def shown(self) -> bool:
        """Whether the bracket has the stated confidence."""
        return self.proof in {"", "confirmed"} and not self.unsteady and not self.refuted

    @property
    def recurs_s(self) -> float:
        """A stop that recurs at least this often would have shown, at the confidence; 0 if unknown.

        An event at random times, every T seconds on average, does not occur in t with the
        probability exp(-t / T): T is a third of t for 95 % (rule of three).
        """
        return self.watched_s / -math.log1p(-self.confidence) if self.confidence else 0.0

    @property
    def disturbed(self) -> tuple[str, ...]:
        """The host interference in the last probe that it explains; empty for none."""
        reasons = [probe.disturbed for probe in self.probes if probe.explained]
        return reasons[-1] if reasons else ()

    @property
    def open_hz(self) -> tuple[float, ...]:
        """The rates in the bracket whose probes were undecided, ascending."""
        lower, upper = self.holds_hz or 0.0, self.fails_hz or float("inf")
        decided = {probe.rate_hz for probe in self.probes if probe.holds is not None}
        rates_hz = {
            probe.rate_hz for probe in self.probes if probe.holds is None and not probe.keeps_up
        } - decided
        return tuple(sorted(rate for rate in rates_hz if lower < rate < upper))


class ThreadSchedulingRecord(msgspec.Struct, frozen=True, kw_only=True):
    """The scheduling of `count` equal threads of one name, as the kernel reports it."""

    thread: str
    policy: str
    priority: int
    nice: int
    cpus: tuple[int, ...]
    count: int = 1


class ProcessRecord(msgspec.Struct, frozen=True, kw_only=True):
    """A process of the run.

    Attributes:
        exit_code: negative for a signal, None if it is unknown.
        signals: those that the run has sent to it, in order.
        parts: the parts of the harness, if it is a process of the graph that contains some.
        scheduling: the scheduling of its threads after the warm-up, as the kernel reports it.
    """

    name: str
    role: str
    pid: int
    exit_code: int | None
    signals: tuple[int, ...] = ()
    parts: tuple[str, ...] = ()
    scheduling: tuple[ThreadSchedulingRecord, ...] = ()

    @property
    def ended_as_told(self) -> bool:
        """Whether it exited with 0, or because of a signal from the run."""
        code = self.exit_code
        return code in {0, None} or any(code in {-signal, 128 + signal} for signal in self.signals)


class OutputGapRecord(msgspec.Struct, frozen=True, kw_only=True):
    """An output that stopped during the measurement, and the diagnosis.

    `segment` is where this was detected; afterwards some steps were played while the messages of
    every topic were counted. `reason` is the first fault on the path; `way` has the publishers, the
    subscriptions and the number of messages of each topic of the path. `late` is the number of
    missing outputs that came meanwhile; with matching by order, these are not recognised.
    """

    segment: str
    topic: str
    reason: str
    way: tuple[str, ...]
    late: int = 0


UNPAIRED_HELP = (
    "allow differences of stamps with 'pairing: {slop: ...}', play an input between the steps with "
    "'rate: recorded' (only what was stamped as a step has its stamp), play them with "
    "'mode: timeline', or in specs of their own; 'unpaired: drop' in 'playback' agrees to play the "
    "rest alone"
)
_UNKNOWN_TIME_HELP = (
    "let the preprocessor keep the stamps of its inputs, or play the steps of 'mode: looping', "
    "which have no times; 'unpaired: drop' in 'playback' agrees to play the rest alone"
)
_WARNING_SHARE = 0.05
_ERROR_SHARE = 0.5


class UnplayedMessages(msgspec.Struct, frozen=True, kw_only=True):
    """Messages of an input that were not played.

    Attributes:
        topic: the input, by its full name.
        count: how many of the `total` messages were not played.
        cause: they have no ``partner``, a message of the same stamp in all other inputs; or, in a
            timeline, no message of the ``recording`` has their stamp, so that their time is
            unknown.
        agreed: whether the spec agrees to it (``playback.unpaired: drop``).
        at_least: whether there may be more.
        slop_ns: the largest difference of stamps within which a partner was looked for.
    """

    topic: str
    count: Count
    total: Count
    cause: Literal["partner", "recording"] = "partner"
    agreed: bool = False
    at_least: bool = False
    slop_ns: Count = 0

    @property
    def clause(self) -> str:
        """The reason as a clause, without a full stop."""
        lack = {
            "partner": f"have no partner within {self.slop_ns / 1e6:g} ms"
            if self.slop_ns
            else "have no partner of the same stamp",
            "recording": "have a stamp that no recorded message has",
        }[self.cause]
        about = "at least " if self.at_least else ""
        return f"{about}{self.count:,} of {self.total:,} messages of {self.topic} {lack}"

    @property
    def text(self) -> str:
        """The reason and the consequence, without a full stop."""
        return f"{self.clause} and were not played"

    @property
    def help(self) -> str:
        """The remedy."""
        return UNPAIRED_HELP if self.cause == "partner" else _UNKNOWN_TIME_HELP

    @property
    def is_warning(self) -> bool:
        """Whether enough are missing for a warning; never if the spec allows it."""
        return not self.agreed and self.count > _WARNING_SHARE * self.total

    @property
    def is_most(self) -> bool:
        """Whether most messages are missing."""
        return self.count > _ERROR_SHARE * self.total


class Difference(msgspec.Struct, frozen=True, kw_only=True):
    """A difference between the running graph and the spec.

    Attributes:
        code: the code of the rule of ``r2bspec validate`` that finds the same error.
        part: a `parameter` or a `remapping` of a node, its `lifecycle`, `executor`, `plugin` or
            `package`, the `node` itself, or an `endpoint`.
        owner: the full name of the node, or the part of the harness.
        name: the parameter, the left side of the remapping, the full name of the topic, or the
            transition.
        topic: the full name that is the target of the remapping; of an endpoint, the topic that has
            one instead.
        harmless: whether the run could continue nevertheless.
    """

    code: str
    message: str
    part: Literal[
        "parameter",
        "remapping",
        "lifecycle",
        "executor",
        "plugin",
        "package",
        "node",
        "endpoint",
    ]
    owner: str
    name: str
    topic: str = ""
    help: str = ""
    harmless: bool = False


class ConfirmationRecord(msgspec.Struct, frozen=True, kw_only=True):
    """The confirmation run after a failure.

    Its segments have the kind ``confirmation``. Segments named by the probes in `search` and
    `sustained` belong to these; the others are iterations. Only what the failed requirements need
    was measured again; otherwise `search` is None and `sustained` empty.
    """

    search: SearchRecord | None
    sustained: tuple[Probe, ...]


class StartRecord(msgspec.Struct, frozen=True, kw_only=True):
    """A start of all processes, up to its first measured segment.

    Attributes:
        number: as in `Segment.start`.
        began_ns: when it began: before the processes of the start before it were ended.
        ready_ns: when the graph was warmed up.
        confirms: whether it is one of the confirmation run.
    """

    number: Number
    began_ns: int
    ready_ns: int
    confirms: bool = False

    @property
    def cost_ns(self) -> int:
        """The duration of the start."""
        return self.ready_ns - self.began_ns


class ProfileRecord(msgspec.Struct, frozen=True, kw_only=True):
    """The observation of a process by a profiler, in an iteration after everything that counts.

    Attributes:
        process: its name.
        profiler: the name of the profiler.
        files: what the profiler wrote, as paths in the run folder.
        rate_hz: the rate of the iteration.
        began_ns: before the profiler was started.
        ended_ns: after it had ended.
        error: why the profile is missing or not whole; empty if it is whole.
    """

    process: str
    profiler: str
    files: tuple[str, ...] = ()
    rate_hz: Hertz = 0.0
    began_ns: int
    ended_ns: int
    error: str = ""


class AnatomyKind(enum.IntEnum):
    """The kind of a row of events (`r2bspec.record.sample_arrays.ANATOMY_FIELDS`).

    A publication lasts from the call of rcl to its return, and so does a take. `TRIGGER` is a guard
    condition: the executor of rclpy triggers one before and after each callback. `CALLBACK` is a
    callback of rclcpp, which reports itself when a callback begins and ends. `WAIT` is a wait of an
    executor for work, `TIMER` the call of a timer that is due.
    """

    PUBLISH = 1
    TAKE = 2
    CALLBACK = 3
    TRIGGER = 4
    WAIT = 5
    TIMER = 6
    SEND_REQUEST = 7
    TAKE_REQUEST = 8
    SEND_RESPONSE = 9
    TAKE_RESPONSE = 10
    ENQUEUE = 11
    DEQUEUE = 12


AnatomyObjectKind = Literal["publisher", "subscription", "timer", "client", "service", "buffer"]


class AnatomyObject(msgspec.Struct, frozen=True, kw_only=True):
    """The object to which events belong.

    Attributes:
        process: indexes `AnatomyRecord.processes`.
        name: the name of the topic or service, with its namespace; of a buffer, its topic; or
            empty.
        node: the name of its node with its namespace; empty if it is not known.
    """

    process: int
    kind: AnatomyObjectKind
    name: str = ""
    node: str = ""


class AnatomyProcess(msgspec.Struct, frozen=True, kw_only=True):
    """A process that was observed from inside.

    Attributes:
        name: the name of the process of the plan to which it belongs.
        pid: its id.
        lost: events for which it had no room.
    """

    name: str
    pid: int
    lost: int = 0


class AnatomyRecord(msgspec.Struct, frozen=True, kw_only=True):
    """The observation of a start from inside; the samples of its segments have the events.

    Attributes:
        start: the start of the graph's processes, as in its segments.
        processes: those that were observed.
        objects: those of the events: publishers, subscriptions and others.
        error: why nothing was observed, or not everything; otherwise empty.
    """

    start: int
    processes: tuple[AnatomyProcess, ...] = ()
    objects: tuple[AnatomyObject, ...] = ()
    error: str = ""


class RunRecord(msgspec.Struct, frozen=True, kw_only=True):
    """A run, complete or not.

    `sustained` has one probe for each rate of the plan's `sustained_hz`. `dataset` is the bag, with
    its hash; `machine` and `versions` describe host and software. `events` are (monotonic time,
    text): the beginnings of phases, and notes. `confirmation` is the confirmation run, if there was
    one. `output_gaps` are outputs that stopped; `differences` those between the running graph and
    the spec. `left_out` has one sentence for each optional part that was not played, with the
    reason; `unplayed` has the messages of inputs that were not. `starts` are those whose graph was
    warmed up. `profiles` are those of an iteration that counts for nothing. `identity` is what the
    graph consists of; None if that was not determined. `gate` is what reports say of the merge
    gate, one sentence each. `exit_status` is that of the error that ended the run; 0 without an
    error. `samples` has the SHA-256 of every file of samples by its path in the run folder; those
    of the whole run are in no incomplete record, because they grow until the run has ended.
    """

    r2bspec_record: Literal[1] = 1
    run_id: str
    plan_hash: str
    started_at: str
    ended_at: str
    status: Literal["complete", "incomplete", "invalid"]
    reason: str
    dataset: dict[str, Any]
    machine: dict[str, Any]
    versions: dict[str, str]
    processes: Annotated[tuple[ProcessRecord, ...], msgspec.Meta(max_length=MAX_PROCESSES)]
    segments: tuple[Segment, ...]
    search: SearchRecord | None
    sustained: tuple[Probe, ...]
    events: tuple[tuple[int, str], ...]
    confirmation: ConfirmationRecord | None = None
    output_gaps: tuple[OutputGapRecord, ...] = ()
    differences: tuple[Difference, ...] = ()
    left_out: tuple[str, ...] = ()
    starts: tuple[StartRecord, ...] = ()
    unplayed: tuple[UnplayedMessages, ...] = ()
    profiles: tuple[ProfileRecord, ...] = ()
    anatomies: tuple[AnatomyRecord, ...] = ()
    identity: GraphIdentity | None = None
    gate: tuple[str, ...] = ()
    exit_status: ExitNumber = 0
    samples: dict[str, str] = {}

    def __post_init__(self) -> None:
        check_machine_facts(self.machine)
