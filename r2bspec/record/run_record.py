"""What was observed in a run, as frozen values. The samples themselves are arrays in files.

A run folder holds::

    spec.yaml          the spec with every substitution done
    plan.json          the plan that was carried out
    record.json        a `RunRecord`: this module, written last, whole or not at all
    result.json        metrics and verdicts, computed from all of the above
    samples/SEGMENT/   playback.npy, monitor.NAME.npy for each monitor, and tap.TOPIC.npy for
                       each tapped topic, with dots for its slashes
    resources.npy      CPU and memory of every process over the whole run
    surroundings.npy   what else happened on the machine meanwhile
    logs/PROCESS.log   what each process printed

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
"""One row per step: the unique header stamp (system clock) that all inputs of the step carry, when
publishing was due, when it began, when the last input of the step was handed over, and of which
inputs of the plan the step has messages: bit k stands for input k; -1 for all of them. In a
timeline a step begins, and is due, with the first of its messages."""

MONITOR_FIELDS = (
    ("stamp_ns", "<i8"),
    ("received_ns", "<i8"),
    ("taken_ns", "<i8"),
    ("bytes", "<i8"),
)
"""One row per received message, in the order of arrival: its header stamp (0 where the type has
none), when the middleware received it, when the monitor had it, and its serialised size."""

RESOURCE_FIELDS = (
    ("time_ns", "<i8"),
    ("process", "<i4"),
    ("cpu_s", "<f8"),
    ("memory_bytes", "<i8"),
)
"""One row per process and sampling time: `process` indexes `RunRecord.processes`, with -1 for the
whole machine and -2 for the controller; `cpu_s` is the processor time used so far, in seconds,
summed over all cores and the process's descendants (for -2: without them); `memory_bytes` is the
resident set (for -1: memory in use)."""

INTERFERENCE_FIELDS = (
    ("time_ns", "<i8"),
    ("busy_s", "<f8"),
    ("stolen_s", "<f8"),
    ("waited_s", "<f8"),
    ("throttled_s", "<f8"),
)
"""One row per sampling time, everything but the time summed up since some point in the past, in
seconds, and NaN where the system does not tell: processor time used on the cores that the run may
use, and processor time of theirs that other virtual machines got; the time in which some task
waited for a processor (PSI, ``some``); the time for which the control group had no quota left, or a
core was throttled for heat."""


SegmentKind = Literal["warm_up", "probe", "sustained", "iteration", "confirmation"]
"""What a segment was played for; ``confirmation``: in the fresh batch that follows a failure."""


class Segment(msgspec.Struct, frozen=True, kw_only=True):
    """One stretch of playing at one rate; a rate of 0 is that of the recording, or of the source.

    `id` names its folder below ``samples/``. `steps` is how many steps were asked for. The
    sending window runs from the first due time to `ended_ns`, the end of the last period.
    `complete` is False if playing was cut short. `played_before` is how many steps the graph had
    been given before the first one of this segment. `rerun_of` is the id of the disturbed iteration
    in whose place it was played, or empty. For `monitor_held_ns` the process that watches had no
    processor: what arrived meanwhile is there, but when it arrived is not known.

    Attributes:
        live: whether nothing was played, because the graph has a source of its own. The window is
            then that in which messages were received, and `steps` is 0.
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


class Probe(msgspec.Struct, frozen=True, kw_only=True):
    """One probe: what was offered, what came out, and whether the rate holds.

    `holds` is None where that stayed open. `confidence` is how sure the answer is, one-sided;
    0 in records of versions that did not state it.
    """

    segment: str
    rate_hz: float
    delivered_hz: float
    holds: bool | None
    reason: str
    confidence: float = 0.0


class SearchRecord(msgspec.Struct, frozen=True, kw_only=True):
    """The outcome of a search for the peak rate.

    The peak lies between `holds_hz`, the highest rate that held (None where none did), and
    `fails_hz`, the lowest that did not (None where none failed: the peak is at least `holds_hz`).
    `limited_by` says what set it. The bracket is as narrow as `precision`, a relative width, unless
    probes between its ends stayed open; `confidence` is how sure it is (0: not stated).
    """

    probes: tuple[Probe, ...]
    holds_hz: float | None
    fails_hz: float | None
    limited_by: Literal["graph", "player", "range", "interrupted"]
    precision: float = 0.0
    confidence: float = 0.0

    @property
    def upper_hz(self) -> float | None:
        """What the peak of the graph is below; None where only a lower bound is known.

        A rate that the player could not offer bounds the player, not the graph.
        """
        return None if self.limited_by == "player" else self.fails_hz

    @property
    def open_hz(self) -> tuple[float, ...]:
        """The rates within the bracket whose probes stayed open, ascending."""
        lower, upper = self.holds_hz or 0.0, self.fails_hz or float("inf")
        decided = {probe.rate_hz for probe in self.probes if probe.holds is not None}
        found = {probe.rate_hz for probe in self.probes if probe.holds is None} - decided
        return tuple(sorted(rate for rate in found if lower < rate < upper))


class ProcessRecord(msgspec.Struct, frozen=True, kw_only=True):
    """A process that ran. `exit_code` is negative for a signal, None if it was never collected."""

    name: str
    role: str
    pid: int
    exit_code: int | None


class FloorRecord(msgspec.Struct, frozen=True, kw_only=True):
    """What harness and transport take with nothing under test, for one input.

    Measured before the nodes were started, from the player to a reader on the input `topic` itself;
    `received` of `sent` messages of at most `bytes` bytes arrived. Latency is from publication to
    the arrival in the middleware, lateness from the due time to publication; None without samples.
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
    """An output that fell silent while something was measured, and where its messages stop.

    `segment` is the one in which that was noticed; afterwards some steps were played and every
    topic was watched. `reason` names the first break; `way` says of each topic who writes and who
    reads it, and how many messages passed.
    """

    segment: str
    topic: str
    reason: str
    way: tuple[str, ...]


class Difference(msgspec.Struct, frozen=True, kw_only=True):
    """Something in which the real graph is not the one of the spec.

    Attributes:
        code: that of the rule of ``r2bspec validate`` which finds the same where it can be known.
        part: what it is about: a `parameter` or a `remapping` of a node, or an `endpoint`.
        owner: the full name of the node, or the part of the harness, that has it.
        name: the parameter, the left side of the remapping, or the full name of the topic.
        topic: the full name that the remapping would have given.
        harmless: whether the run could go on all the same.
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
    """The fresh batch that was played after a failure.

    Its segments have the kind ``confirmation``. Those that the probes in `search` and `sustained`
    name are theirs, the others are iterations. What nothing failed by was not played again: None,
    or no probes. `floor` is that of its own processes, as in `RunRecord`.
    """

    search: SearchRecord | None
    sustained: tuple[Probe, ...]
    floor: tuple[FloorRecord, ...] = ()


class RunRecord(msgspec.Struct, frozen=True, kw_only=True):
    """A run, complete or not.

    `sustained` has one probe for each rate of the plan's `sustained_hz`. `dataset` says which
    bag was read, with its hash; `machine` and `versions` where and with what.
    `events` are (monotonic time, text): phases entered and everything notable. `floor` has one
    entry per input; it is empty where nothing is played, or where measuring would have disturbed.
    `confirmation` is there if a failure was followed by a fresh batch. `silences` are outputs that
    stopped, `differences` what of the real graph is not as the spec says. `left_out` says, a
    sentence each, what the verdict might have used and was not played, and why.
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
