"""The record of a run, as frozen values. The samples themselves are arrays in files.

A run folder contains::

    spec.yaml          the resolved spec
    plan.json          the plan of the run
    record.json        a `RunRecord`: this module, written last and atomically
    result.json        metrics and verdicts, computed from all of the above
    samples/SEGMENT/   playback.npy, monitor.NAME.npy for each monitor, and tap.TOPIC.npy for
                       each tapped topic, with dots instead of slashes
    resources.npy      CPU and memory of every process over the whole run
    surroundings.npy   host interference over the whole run
    logs/PROCESS.log   the output of each process

All times are CLOCK_MONOTONIC nanoseconds of the host, unless the name says otherwise.
"""

from __future__ import annotations

from typing import Any, Literal

import msgspec

PLAYBACK_FIELDS = (
    ("stamp_ns", "<i8"),
    ("due_ns", "<i8"),
    ("published_ns", "<i8"),
    ("done_ns", "<i8"),
    ("inputs", "<i8"),
)
"""One row per step: the unique header stamp (system clock) of all inputs of the step; the times at
which publishing was due, at which it began, and at which the last input was published; and the
inputs of the plan of which the step has messages: bit k for input k, -1 for all of them. In a
timeline a step is due, and begins, with its first message."""

MONITOR_FIELDS = (
    ("stamp_ns", "<i8"),
    ("received_ns", "<i8"),
    ("taken_ns", "<i8"),
    ("bytes", "<i8"),
)
"""One row per received message, in order of arrival: its header stamp (0 if the type has none), the
times at which the middleware received it and at which the monitor took it, and its serialised
size."""

RESOURCE_FIELDS = (
    ("time_ns", "<i8"),
    ("process", "<i4"),
    ("cpu_s", "<f8"),
    ("memory_bytes", "<i8"),
)
"""One row per process and sampling time: `process` indexes `RunRecord.processes`, with -1 for the
whole machine and -2 for the controller; `cpu_s` is the cumulative CPU time in seconds, summed over
all cores and the descendants of the process (for -2: without them); `memory_bytes` is the resident
set (for -1: memory in use)."""

INTERFERENCE_FIELDS = (
    ("time_ns", "<i8"),
    ("busy_s", "<f8"),
    ("stolen_s", "<f8"),
    ("waited_s", "<f8"),
    ("throttled_s", "<f8"),
)
"""One row per sampling time. All values but the time are cumulative, in seconds, and NaN if the
system does not provide them: the CPU time used on the cores that the run may use; their CPU time
taken by other virtual machines; the time in which some task waited for a CPU (PSI, ``some``); the
time in which the control group had used up its quota, or a core was throttled for heat."""


SegmentKind = Literal["warm_up", "probe", "sustained", "iteration", "confirmation"]
"""The purpose of a segment; those of the confirmation run after a failure are ``confirmation``."""


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
        clock_offset_ns: in a live segment, the system clock minus CLOCK_MONOTONIC; None if that
            changed by more than a millisecond.
    """

    id: str
    kind: SegmentKind
    rate_hz: float
    index: int
    steps: int
    began_ns: int
    ended_ns: int
    complete: bool
    played_before: int = 0
    rerun_of: str = ""
    live: bool = False
    clock_offset_ns: int | None = None
    monitor_held_ns: int = 0
    start: int = 1


class Probe(msgspec.Struct, frozen=True, kw_only=True):
    """One probe: the offered rate, the delivered rate, and whether the rate is sustained (`holds`).

    `holds` is None if undecided. `confidence` is one-sided; 0 in records of versions that did not
    state it.
    """

    segment: str
    rate_hz: float
    delivered_hz: float
    holds: bool | None
    reason: str
    confidence: float = 0.0


class SearchRecord(msgspec.Struct, frozen=True, kw_only=True):
    """The result of the peak search.

    The peak is between `holds_hz`, the highest sustained rate (None if there is none), and
    `fails_hz`, the lowest rate that was not sustained (None if there is none: the peak is at least
    `holds_hz`). `limited_by` is what limits it. The bracket is as narrow as `precision`, a relative
    width, unless probes in it were undecided; `confidence` is that of the bracket (0: not stated).
    """

    probes: tuple[Probe, ...]
    holds_hz: float | None
    fails_hz: float | None
    limited_by: Literal["graph", "player", "range", "interrupted"]
    precision: float = 0.0
    confidence: float = 0.0

    @property
    def upper_hz(self) -> float | None:
        """The upper bound of the peak of the graph; None if only a lower bound is known.

        A rate that the player could not offer is not a bound for the graph.
        """
        return None if self.limited_by == "player" else self.fails_hz

    @property
    def open_hz(self) -> tuple[float, ...]:
        """The rates in the bracket whose probes were undecided, ascending."""
        lower, upper = self.holds_hz or 0.0, self.fails_hz or float("inf")
        decided = {probe.rate_hz for probe in self.probes if probe.holds is not None}
        found = {probe.rate_hz for probe in self.probes if probe.holds is None} - decided
        return tuple(sorted(rate for rate in found if lower < rate < upper))


class ProcessRecord(msgspec.Struct, frozen=True, kw_only=True):
    """A process of the run.

    Attributes:
        exit_code: negative for a signal, None if it is unknown.
        signals: those that the run has sent to it, in order.
    """

    name: str
    role: str
    pid: int
    exit_code: int | None
    signals: tuple[int, ...] = ()

    @property
    def ended_as_told(self) -> bool:
        """Whether it exited with 0, or because of a signal that the run has sent to it."""
        code = self.exit_code
        return code in {0, None} or any(code in {-each, 128 + each} for each in self.signals)


class FloorRecord(msgspec.Struct, frozen=True, kw_only=True):
    """The harness overhead for one input: latency of harness and transport without the graph.

    It is measured before the nodes are started, from the player to a subscription on the input
    `topic`; `received` of `sent` messages of at most `bytes` bytes arrived. Latency is from
    publication to the arrival in the middleware, lateness from the due time to publication; None
    without samples.
    """

    topic: str
    bytes: int
    rate_hz: float
    sent: int
    received: int
    latency_p50_ns: int | None
    latency_p99_ns: int | None
    lateness_p50_ns: int | None
    lateness_p99_ns: int | None


class SilenceRecord(msgspec.Struct, frozen=True, kw_only=True):
    """An output that stopped during the measurement, and the diagnosis.

    `segment` is the one in which this was detected; afterwards some steps were played while the
    messages of every topic were counted. `reason` is the first fault on the path; `way` has the
    publishers, the subscriptions and the number of messages of each topic of the path.
    """

    segment: str
    topic: str
    reason: str
    way: tuple[str, ...]


class Difference(msgspec.Struct, frozen=True, kw_only=True):
    """A difference between the running graph and the spec.

    Attributes:
        code: of the rule of ``r2bspec validate`` that finds the same error.
        part: a `parameter` or a `remapping` of a node, or an `endpoint`.
        owner: the full name of the node, or the part of the harness.
        name: the parameter, the left side of the remapping, or the full name of the topic.
        topic: the full name that is the target of the remapping.
        harmless: whether the run could continue nevertheless.
    """

    code: str
    message: str
    part: Literal["parameter", "remapping", "endpoint"]
    owner: str
    name: str
    topic: str = ""
    help: str = ""
    harmless: bool = False


class ConfirmationRecord(msgspec.Struct, frozen=True, kw_only=True):
    """The confirmation run after a failure.

    Its segments have the kind ``confirmation``. Segments named by the probes in `search` and
    `sustained` belong to these; the others are iterations. Only what the failed requirements need
    was measured again; otherwise `search` is None and `sustained` empty. `floor` is the harness
    overhead of its own processes, as in `RunRecord`.
    """

    search: SearchRecord | None
    sustained: tuple[Probe, ...]
    floor: tuple[FloorRecord, ...] = ()


class RunRecord(msgspec.Struct, frozen=True, kw_only=True):
    """A run, complete or not.

    `sustained` has one probe for each rate of the plan's `sustained_hz`. `dataset` is the bag, with
    its hash; `machine` and `versions` describe host and software. `events` are (monotonic time,
    text): the beginnings of phases, and notes. `floor` has the harness overhead of each input; it
    is empty if nothing is played, or if its measurement would have affected the graph.
    `confirmation` is the confirmation run, if there was one. `silences` are outputs that stopped,
    `differences` those between the running graph and the spec. `left_out` has one sentence for
    each optional part that was not played, with the reason.
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
    processes: tuple[ProcessRecord, ...]
    segments: tuple[Segment, ...]
    search: SearchRecord | None
    sustained: tuple[Probe, ...]
    events: tuple[tuple[int, str], ...]
    floor: tuple[FloorRecord, ...] = ()
    confirmation: ConfirmationRecord | None = None
    silences: tuple[SilenceRecord, ...] = ()
    differences: tuple[Difference, ...] = ()
    left_out: tuple[str, ...] = ()
