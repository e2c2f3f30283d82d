"""The table of samples of a monitor: a row is an expected output, or another received message.

For an expected output, which may never have come, a row says when its step was due and published;
for every message, when it was received. Rows belong to spans, one per segment. Several iterations
are one table, joined; parts are selected by masks. All metrics of a monitor are computed from its
table.

Where inputs may have any number of outputs, each output that came counts as expected. In a live
run, and of outputs with a pace of their own, nothing is due. Each message then counts as
an expected output that was due when it was received, and what was sent or missed is unknown.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from r2bspec.judge.measure.matching import (
    CLOCK_ERROR_NS,
    NO_MATCH,
    MatchedMonitor,
    MessageKind,
    count_reordered,
    source_times_ns,
)
from r2bspec.judge.measure.metric import Metric, Outputs
from r2bspec.judge.measure.own_pace import MIN_UNASKED, PaceEvidence, fitting_match, own_period_s
from r2bspec.judge.measure.times import (
    Seconds,
    edge_gaps,
    faster_half,
    intervals,
    jitter,
    seconds,
    throughput,
)
from r2bspec.record.run_record import Segment
from r2bspec.record.sample_arrays import Rows

SAMPLE_DTYPE: Final = np.dtype(
    [
        ("span", "<i4"),
        ("kind", "<i1"),
        ("due_ns", "<i8"),
        ("published_ns", "<i8"),
        ("newest_ns", "<i8"),
        ("received_ns", "<i8"),
        ("arrival", "<i8"),
        ("untimed", "?"),
    ]
)
"""A row of the table: the place of its span, what it is (`MessageKind`), when its step was due and
published, when the newest input in it was published, when it was received, its place among all
messages in the order of arrival, and whether its time of reception is that of taking
(`MONITOR_FIELDS`). `NO_MATCH` stands for a time that is unknown, or of an output that never came.
Expected outputs are in the order of the steps, or of arrival where inputs have any number."""

_NOTHING: Final[Seconds] = np.empty(0)


@dataclass(frozen=True)
class Span:
    """A segment, and the time in which outputs of it are due.

    Attributes:
        segment: that it is, or is of.
        sent: steps played. Each has one expected output, unless the ratio is another.
        window_ns: see `r2bspec.judge.measure.times.throughput`, as `period_ns`.
        ended_ns: the end of the time in which outputs are due.
        began_ns: its beginning; None is when the first output can come.
        given_hz: the throughput, where it is not that of the rows.
        taken: the share of the time by which the faster half of the values, which then stand for
            all, are shortened; None for the values as they are.
    """

    segment: Segment
    sent: int
    window_ns: float
    period_ns: float
    ended_ns: int
    began_ns: int | None = None
    given_hz: float | None = None
    taken: float | None = None

    def gaps_of(self, outputs: Rows) -> Seconds:
        """Return the intervals between outputs, and the end gaps that count (`edge_gaps`)."""
        arrived = _arrived(outputs)
        if not arrived.size:
            return _NOTHING
        gaps = edge_gaps(arrived, self._soonest_ns(outputs), self.ended_ns)
        ends = np.array([gap for gap in gaps if gap], dtype=np.int64)
        return np.concatenate((intervals(arrived), seconds(ends)))

    def throughput_of(self, outputs: Rows) -> float:
        """Return the throughput; see `r2bspec.judge.measure.times.throughput`."""
        arrived = _arrived(outputs)
        if self.given_hz is not None or not arrived.size:
            return self.given_hz or 0.0
        return throughput(arrived, self._soonest_ns(outputs), self.window_ns, self.period_ns)

    def _soonest_ns(self, outputs: Rows) -> int:
        if self.began_ns is not None:
            return self.began_ns
        latency = _elapsed(outputs[_came(outputs)], "published_ns")
        return int(outputs["published_ns"][0]) + round(float(latency.min()) * 1e9)


def _came(outputs: Rows) -> NDArray[np.bool_]:
    came: NDArray[np.bool_] = np.not_equal(outputs["received_ns"], NO_MATCH)
    return came


def _arrived(outputs: Rows) -> NDArray[np.int64]:
    """Return when the outputs that came were received, ascending."""
    return np.sort(outputs["received_ns"][_came(outputs)])


def _elapsed(outputs: Rows, since: str) -> Seconds:
    return seconds(outputs["received_ns"] - outputs[since])


@dataclass(frozen=True)
class MonitorSamples:
    """The samples of a monitor in some spans.

    Counts are of the rows: ``expected = answered + missed``, and ``received = answered + duplicates
    + unmatched``.

    Attributes:
        rows: of type `SAMPLE_DTYPE`, in the order of the spans.
        spans: one segment, or several that are joined.
        per_step: expected outputs per step, on average.
        by_order: whether outputs are matched by order. If one is then missing, too many or early,
            it is unknown which step each of them answers.
        kind: the kind of the outputs.
    """

    rows: Rows
    spans: tuple[Span, ...]
    per_step: float = 1.0
    by_order: bool = False
    kind: Outputs = "answers"

    @property
    def own_pace(self) -> bool:
        """Whether outputs answer no input."""
        return self.kind in {"own pace", "live"}

    @classmethod
    def joined(cls, samples: Sequence[MonitorSamples]) -> MonitorSamples:
        """Return the samples of a monitor over several iterations, at least one."""
        rows = np.concatenate([sample.rows for sample in samples])
        offsets = np.cumsum([0, *(len(sample.spans) for sample in samples[:-1])])
        rows["span"] += np.repeat(offsets, [sample.rows.size for sample in samples]).astype("<i4")
        return replace(
            samples[0], rows=rows, spans=tuple(span for sample in samples for span in sample.spans)
        )

    def with_outputs(self, received_ns: NDArray[np.int64], throughput_hz: float) -> MonitorSamples:
        """Return the samples of one span with other times of reception of the expected outputs.

        It is then known which step each output answers.

        Args:
            received_ns: one for each expected output; `NO_MATCH` for one that never comes.
            throughput_hz: of the span.
        """
        rows = self.rows.copy()
        rows["kind"][rows["kind"] == MessageKind.SURPLUS] = MessageKind.UNMATCHED
        expected = rows["kind"] == MessageKind.EXPECTED
        rows["received_ns"][expected] = received_ns
        places = np.argsort(np.argsort(received_ns, kind="stable"), kind="stable")
        rows["arrival"][expected] = np.where(received_ns == NO_MATCH, NO_MATCH, places)
        spans = tuple(replace(span, given_hz=throughput_hz) for span in self.spans)
        return replace(self, rows=rows, spans=spans, by_order=False)

    def shortened(self, taken: float) -> MonitorSamples:
        """Return the samples with the slower half of all times replaced by the faster half.

        Args:
            taken: the share by which they are shortened.
        """
        hz = self.throughput_hz / (1 - taken)
        spans = tuple(replace(span, taken=taken, given_hz=hz) for span in self.spans)
        return replace(self, spans=spans)

    # What was expected, and what came.

    @cached_property
    def outputs(self) -> Rows:
        """The rows of the expected outputs, in the order of the steps."""
        expected: Rows = self.rows[self.rows["kind"] == MessageKind.EXPECTED]
        return expected

    @cached_property
    def came(self) -> NDArray[np.bool_]:
        """Whether each expected output arrived."""
        return _came(self.outputs)

    @property
    def sent(self) -> int:
        """Steps played; if no output was expected, messages."""
        return sum(span.sent for span in self.spans)

    @property
    def expected(self) -> int:
        """The number of expected outputs."""
        return int(self.outputs.size)

    @cached_property
    def answered(self) -> int:
        """Expected outputs that arrived."""
        return int(np.count_nonzero(self.came))

    @property
    def missed(self) -> int:
        """Expected outputs that never arrived."""
        return self.expected - self.answered

    @property
    def received(self) -> int:
        """Messages that arrived."""
        return int(np.count_nonzero(_came(self.rows)))

    @property
    def duplicates(self) -> int:
        """Messages of a step that already has its output."""
        return self._count(MessageKind.DUPLICATE)

    @property
    def unmatched(self) -> int:
        """Messages that match no step."""
        return int(np.count_nonzero(self.rows["kind"] >= MessageKind.UNMATCHED))

    @property
    def overdue(self) -> int:
        """Unmatched messages that are outputs of a step of an earlier segment."""
        return self._count(MessageKind.OVERDUE)

    @property
    def surplus(self) -> int:
        """Unmatched messages, by order, beyond the expected outputs."""
        return self._count(MessageKind.SURPLUS)

    def _count(self, kind: MessageKind) -> int:
        return int(np.count_nonzero(self.rows["kind"] == kind))

    @property
    def untimed(self) -> int:
        """Messages whose time of reception is the time at which they were taken."""
        return int(np.count_nonzero(self.rows["untimed"]))

    @property
    def reordered(self) -> int:
        """Outputs that arrived after the output of a later step (RFC 4737)."""
        if self.own_pace:
            return 0
        return sum(
            count_reordered(np.argsort(outputs["arrival"][_came(outputs)], kind="stable"))
            for outputs, _ in self._by_span()
        )

    @property
    def late(self) -> int:
        """Outputs that arrived after the segment had ended."""
        if self.own_pace:
            return 0
        ends_ns = np.array([span.segment.ended_ns for span in self.spans], dtype=np.int64)
        came = self.outputs[self.came]
        return int(np.count_nonzero(came["received_ns"] > ends_ns[came["span"]]))

    @cached_property
    def early(self) -> int:
        """Outputs that arrived before their step was published, which is impossible."""
        if self.own_pace:
            return 0
        came = self.outputs[self.came]
        return int(np.count_nonzero(came["received_ns"] < came["published_ns"] - CLOCK_ERROR_NS))

    # The values of single messages, in seconds.

    @cached_property
    def latency(self) -> Seconds:
        """Received - published of each output, in the order of the steps; empty if unknown.

        Published is when publishing of the step's first input began; received is when the
        middleware received the first output. If several steps lead to one output, the last of them
        counts: the graph could not respond before. In a live run it is the age.
        """
        if self.own_pace:
            return self.age if self.kind == "live" else _NOTHING
        return self._pair_times(self.came, "published_ns")

    @cached_property
    def latency_from_due(self) -> Seconds:
        """The latency since the step was due: delays of the playback count."""
        return _NOTHING if self.own_pace else self._pair_times(self.came, "due_ns")

    @cached_property
    def age(self) -> Seconds:
        """Received - published of the newest input in each output; empty if unknown."""
        return self._pair_times(self.came & (self.outputs["newest_ns"] != NO_MATCH), "newest_ns")

    def _pair_times(self, known: NDArray[np.bool_], since: str) -> Seconds:
        if self.unknown_latency:
            return _NOTHING
        if all(span.taken is None for span in self.spans):
            return _elapsed(self.outputs[known], since)
        return self._times(lambda outputs, _: _elapsed(outputs, since), known)

    @cached_property
    def interval(self) -> Seconds:
        """The intervals between outputs, with the gaps at an end of a span that count.

        No interval spans two iterations.
        """
        return self._times(lambda outputs, span: span.gaps_of(outputs))

    @cached_property
    def jitter(self) -> Seconds:
        """How much consecutive intervals between outputs differ."""
        return self._times(lambda outputs, _: jitter(_arrived(outputs)))

    def _times(
        self, of: Callable[[Rows, Span], Seconds], known: NDArray[np.bool_] | None = None
    ) -> Seconds:
        """Return the times of each span, one after the other."""
        found = []
        for outputs, span in self._by_span(known):
            times = of(outputs, span)
            found.append(times if span.taken is None else faster_half(times) * (1 - span.taken))
        return found[0] if len(found) == 1 else np.concatenate([_NOTHING, *found])

    def _by_span(self, known: NDArray[np.bool_] | None = None) -> Iterator[tuple[Rows, Span]]:
        """Yield the expected outputs of each span, or those of them that are known."""
        outputs = self.outputs if known is None else self.outputs[known]
        edges = np.searchsorted(outputs["span"], np.arange(len(self.spans) + 1))
        for number, span in enumerate(self.spans):
            yield outputs[edges[number] : edges[number + 1]], span

    @property
    def latency_by_step(self) -> Seconds:
        """The latency of each expected output; NaN if it never came."""
        values = np.full(self.expected, np.nan)
        values[self.came] = self.latency
        return values

    @cached_property
    def throughput_hz(self) -> float:
        """The mean of the spans' throughputs; see `r2bspec.judge.measure.times.throughput`."""
        rates = [span.throughput_of(outputs) for outputs, span in self._by_span()]
        return sum(rates) / len(rates)

    # What is known of them.

    @property
    def unknown_latency(self) -> str:
        """Why it is unknown which step each output answers, as a clause; empty if it is known.

        See `Matching.pairs_known`.
        """
        if not self.by_order:
            return ""
        faults = {
            f"{self.missed:,} of {self.expected:,} are missing": self.missed,
            f"{self.surplus:,} are more than the {self.expected:,} expected": self.surplus,
            f"{self.early:,} came before their input": self.early,
        }
        found = " and ".join(text for text, count in faults.items() if count)
        return f"outputs are matched by order, and {found}" if found else ""

    def knows(self, metric: Metric) -> bool:
        """Return True if a metric is known of these outputs."""
        return metric.known_of(self.kind) and not (metric.of_pairs and self.unknown_latency)

    def reports(self, metric: Metric) -> bool:
        """Return True if results have a metric of outputs of this kind."""
        return self.kind in metric.reported_of

    @property
    def own_period_s(self) -> float | None:
        """The period of outputs with a pace of their own; None for other outputs."""
        return own_period_s(self.pace, self.overdue)

    @property
    def fitting_match(self) -> str:
        """What the monitor should declare if a ratio or any number fits better; else empty."""
        if self.kind != "answers" or self.per_step != 1 or self.by_order:
            return ""
        strides, counts, delays = [_NOTHING], [_NOTHING], [0.0]
        for number, span in enumerate(self.spans):
            rows = self.rows[self.rows["span"] == number]
            came, expected = _came(rows), rows["kind"] == MessageKind.EXPECTED
            step_ns = (span.segment.ended_ns - span.segment.began_ns) / max(1, span.sent)
            strides.append(np.diff(np.flatnonzero(came[expected])).astype(np.float64))
            answers = came & (expected | (rows["kind"] == MessageKind.DUPLICATE))
            _, found = np.unique(rows["published_ns"][answers], return_counts=True)
            counts.append(found.astype(np.float64))
            if step_ns and found.size:
                latency = np.median(_elapsed(rows[came & expected], "published_ns"))
                delays.append(float(latency) * 1e9 / step_ns)
        return fitting_match(np.concatenate(strides), np.concatenate(counts), max(delays))

    @property
    def pace(self) -> tuple[PaceEvidence, ...]:
        """What each segment shows about the pace of the outputs, if inputs were played for them."""
        if self.own_pace:
            return ()
        evidence = []
        for number, span in enumerate(self.spans):
            rows = self.rows[(self.rows["span"] == number) & _came(self.rows)]
            received, segment = np.sort(rows["received_ns"]), span.segment
            step_ns = (segment.ended_ns - segment.began_ns) / max(1, span.sent)
            due_ns = np.unique(rows["due_ns"][rows["kind"] == MessageKind.EXPECTED])
            if segment.arrivals and due_ns.size > 1:
                # Compared with the usual interval of outputs, which is not their mean.
                step_ns = float(np.median(np.diff(due_ns)))
            if span.sent:
                evidence.append(
                    PaceEvidence(
                        received[1:] - received[:-1],
                        unasked=int(np.count_nonzero(rows["kind"] != MessageKind.EXPECTED)),
                        least=1 if self.by_order else MIN_UNASKED,
                        step_ns=step_ns,
                    )
                )
        return tuple(evidence)


PlayedEarlier = Callable[[NDArray[np.int64]], NDArray[np.bool_]]


def monitor_samples(
    segment: Segment, matched: MatchedMonitor, played_earlier: PlayedEarlier | None = None
) -> MonitorSamples:
    """Return the samples of a monitor in a segment in which inputs were played.

    Args:
        segment: in which it was received.
        matched: what was received, and which steps that answers.
        played_earlier: which of some stamps are those of steps of earlier segments, if known.
    """
    steps, received, matching = matched.steps, matched.rows, matched.matching
    if matched.match == "own_pace":
        in_time = received["received_ns"] >= segment.began_ns
        in_time &= received["received_ns"] < segment.ended_ns
        step = matching.step[in_time]
        newest = np.full(step.size, NO_MATCH, np.int64)
        newest[step != NO_MATCH] = steps["published_ns"][step[step != NO_MATCH]]
        return _unasked(segment, received[in_time], newest)
    kind = matching.kind
    if played_earlier is not None and matching.unmatched:
        unmatched = np.flatnonzero(kind >= MessageKind.UNMATCHED)
        overdue = played_earlier(received["stamp_ns"][unmatched])
        kind = kind.copy()
        kind[unmatched[overdue]] = MessageKind.OVERDUE
    others = np.flatnonzero(kind != MessageKind.EXPECTED)
    rows = np.full(matching.first_row.size + others.size, NO_MATCH, dtype=SAMPLE_DTYPE)
    rows["span"], rows["arrival"] = 0, np.concatenate((matching.first_row, others))
    rows["kind"] = MessageKind.EXPECTED
    rows["kind"][matching.first_row.size :] = kind[others]
    expected = rows[: matching.first_row.size]
    expected["due_ns"] = steps["due_ns"][matching.trigger_steps]
    expected["published_ns"] = steps["published_ns"][matching.trigger_steps]
    expected["newest_ns"] = expected["published_ns"]
    came = rows["arrival"] != NO_MATCH
    places = rows["arrival"][came]
    rows["received_ns"][came] = received["received_ns"][places]
    repeated = np.flatnonzero(rows["kind"] == MessageKind.DUPLICATE)
    steps_repeated = matching.step[rows["arrival"][repeated]]
    rows["published_ns"][repeated] = steps["published_ns"][steps_repeated]
    rows["untimed"] = False
    rows["untimed"][came] = received["received_ns"][places] == received["taken_ns"][places]
    if matched.match == "any":
        length_ns = segment.ended_ns - segment.began_ns
        began_ns = segment.began_ns
        if expected.size:
            fastest_ns = (expected["received_ns"] - expected["published_ns"]).min()
            began_ns = int(steps["published_ns"][0] + fastest_ns)
        span = Span(segment, int(steps.size), length_ns, 0.0, segment.ended_ns, began_ns)
        return MonitorSamples(rows, (span,), kind="any")
    period_ns = output_period_ns(segment, int(steps.size), matching.per_step)
    window_ns = matching.trigger_steps.size * period_ns
    ended_ns = segment.began_ns + round(window_ns)
    if segment.arrivals:
        # The last steps of some arrivals are due at the end, and have no period after them.
        period_ns = 0.0
    span = Span(segment, int(steps.size), window_ns, period_ns, ended_ns)
    return MonitorSamples(rows, (span,), matching.per_step, matching.by_order)


def output_period_ns(segment: Segment, steps: int, per_step: float) -> float:
    """Return the time in which one output is due, on average, in a segment with these steps.

    Steps after the last whole group of a ratio have no expected output, and no time either.
    """
    return (segment.ended_ns - segment.began_ns) / (steps * per_step) if steps else 0.0


def live_samples(segment: Segment, received: Rows) -> MonitorSamples:
    """Return the samples of a monitor of a graph with its own source."""
    stamped = source_times_ns(segment, received)
    newest = np.full(received.size, NO_MATCH, np.int64) if stamped is None else stamped
    return _unasked(segment, received, newest)


def _unasked(segment: Segment, received: Rows, newest: NDArray[np.int64]) -> MonitorSamples:
    """Return what one monitor received between the ends of a segment, each message as a step.

    Args:
        segment: the segment of the messages.
        received: rows of type `MONITOR_DTYPE`.
        newest: when the newest input in each message was published, or `NO_MATCH`.
    """
    rows = np.zeros(received.size, SAMPLE_DTYPE)
    rows["due_ns"] = rows["received_ns"] = received["received_ns"]
    # Nothing was due: a message is placed at the time of its reception.
    rows["published_ns"] = np.where(newest == NO_MATCH, received["received_ns"], newest)
    rows["newest_ns"], rows["arrival"] = newest, np.arange(received.size)
    rows["untimed"] = received["received_ns"] == received["taken_ns"]
    length_ns = segment.ended_ns - segment.began_ns
    span = Span(segment, received.size, length_ns, 0.0, segment.ended_ns, segment.began_ns)
    return MonitorSamples(rows, (span,), kind="live" if segment.live else "own pace")
