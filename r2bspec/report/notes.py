"""What a reader must know to interpret the results: sentences, the most important first.

A report shows at most five of them, and none of an ordinary run that passes; the others stand in
the HTML, and elsewhere with ``--verbose``. What is true of every run alike is no note: it stands in
the documentation of verdicts. A sentence
that the report has said already, such as the reason of a failed requirement, is left out.
"""

from __future__ import annotations

from collections.abc import Container, Iterable, Iterator, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Final, NamedTuple

from r2bspec.diagnostics.quote import first_words, join_words, pluralize
from r2bspec.judge.measure.own_pace import own_pace_text
from r2bspec.judge.measure.units import at_rate, show
from r2bspec.judge.result import Result
from r2bspec.judge.verdict import DisturbedIteration, RequirementVerdict
from r2bspec.language.spec_benchmark import ACCEPTED, FEEDBACK
from r2bspec.middleware.middleware import middleware_named
from r2bspec.record.run_record import Probe, ProfileRecord
from r2bspec.report import report_wording as wording
from r2bspec.report.headline import headline

MOST_NOTES: Final = 5
"""Notes of a report that is not verbose."""

_MAX_LISTED: Final = 6
"""Affected iterations, or other parts of a run of one kind, that are listed one by one."""

_HOST_INTERFERENCE: Final = "Host interference"
"""Words of every note that names what other programs did."""


class Weight(IntEnum):
    """How much a note matters, the most first."""

    BUSY = 0
    """Nothing but other programs leaves the run open: what they did is said first and alone."""
    BROKEN = 1
    """The run, a process or an output did not do what it was to do."""
    OPEN = 2
    """What a requirement that is not met, or not decided, rests on."""
    INTERFERENCE = 3
    """Other programs took part."""
    PLAYED = 4
    """What was played, received and compared is not all that the spec names."""
    MEANING = 5
    """What a value includes."""
    DETAIL = 6
    """True, but no reason to read the results in another way; only in a verbose report."""


@dataclass(frozen=True, slots=True)
class Note:
    """A sentence, and how much it matters."""

    weight: Weight
    text: str


@dataclass(frozen=True, slots=True)
class Notes:
    """The notes that a report shows, and the number of those that it leaves out."""

    shown: tuple[str, ...]
    others: tuple[str, ...]

    @property
    def more(self) -> str:
        """How many are left out, and where they are; empty if none are."""
        if not self.others:
            return ""
        number = pluralize(len(self.others), "more note")
        return f"{number}: with --verbose, or in the HTML report"


def notes(result: Result, *, verbose: bool = False) -> Notes:
    """The notes of a result: five at most, or all of them."""
    ordered = all_notes(result)
    if verbose:
        return Notes(tuple(note.text for note in ordered), ())
    busy = [note.text for note in ordered if note.weight is Weight.BUSY]
    important = busy or [note.text for note in ordered if note.weight < Weight.DETAIL]
    important = important[:MOST_NOTES]
    return Notes(tuple(important), tuple(note.text for note in ordered[len(important) :]))


def all_notes(result: Result) -> tuple[Note, ...]:
    """Every note once, the most important first; notes of one weight keep their order."""
    said = _said(result)
    texts: dict[str, Note] = {}
    for note in _weighted(result):
        text = " ".join(note.text.split())
        if text and text.rstrip(".").lower() not in said:
            texts.setdefault(text, Note(note.weight, text))
    return tuple(sorted(texts.values(), key=lambda note: note.weight))


def notes_of_an_open_run(result: Result) -> tuple[str, ...]:
    """The main notes on an inconclusive run, for one line: what other programs did to it, if any.

    Without host interference it is the first note on what is open. Nothing for other outcomes.
    """
    if result.verdict.outcome != "inconclusive":
        return ()
    main = [note for note in all_notes(result) if note.weight <= Weight.INTERFERENCE]
    busy = [note.text for note in main if note.weight is Weight.BUSY]
    of_host = [note.text for note in main if _HOST_INTERFERENCE in note.text]
    return tuple(busy[:2] or of_host[:1] or [note.text for note in main[:1]])


def _said(result: Result) -> str:
    """What every report says before its notes, in lower case."""
    texts = [headline(result), result.verdict.reason]
    for verdict in result.verdict.requirements:
        if verdict.outcome != "pass":
            texts += (verdict.reason, verdict.remedy)
    return " ".join(texts).lower()


def _weighted(result: Result) -> Iterator[Note]:
    """The notes in the order in which they are worked out."""
    machine = [*_machine_notes(result)]
    of_host = Weight.BUSY if machine else Weight.INTERFERENCE
    found = [*_interference(result)]
    interference = map(_interference_text, found)
    summary = []
    if len(found) > 1:
        affected = join_words([one.affected for one in found], "and")
        summary = [f"{_HOST_INTERFERENCE} in {affected}; for example, {found[0].example}"]
    ended_outputs = (
        f"No more messages on {gap.topic} in {gap.segment}. {gap.reason}"
        for gap in result.output_gaps
    )
    decisions = result.pairs.notes if result.pairs is not None else ()
    harmless_differences = (
        f"{difference.code}: {difference.message}; {difference.help}"
        for difference in result.differences
        if difference.harmless
    )
    groups: tuple[tuple[Weight, Iterable[str]], ...] = (
        (Weight.BROKEN, _status_notes(result)),
        (Weight.BROKEN, ended_outputs),
        # Each start has a process of the name; that all end in one way is one note.
        (Weight.BROKEN, _exit_notes(result)),
        (Weight.BUSY, machine),
        (Weight.OPEN, _requirement_notes(result, ("fail", "inconclusive"))),
        (Weight.INTERFERENCE, (f"{text[:1].upper()}{text[1:]}" for text in decisions)),
        (of_host, summary),
        (Weight.DETAIL if summary else of_host, interference),
        (Weight.PLAYED, unplayed_notes(result)),
        (Weight.PLAYED, result.left_out),
        (Weight.PLAYED, _message_anomalies(result)),
        (Weight.PLAYED, harmless_differences),
        (Weight.MEANING, _live_notes(result)),
        (Weight.MEANING, wording.joined_notes(result)),
        (Weight.MEANING, profile_notes(result.profiles)),
        (Weight.MEANING, _reception_notes(result)),
        (Weight.DETAIL, _requirement_notes(result, ("pass",))),
        (Weight.DETAIL, wording.overhead_notes(result)),
    )
    yield from (Note(weight, text) for weight, texts in groups for text in texts)


def _status_notes(result: Result) -> Iterator[str]:
    """Why the run ended early, or cannot be judged."""
    said = _said(result)
    if result.status != "complete" and (not result.reason or result.reason.lower() not in said):
        yield f"The run is {result.status}: {result.reason or 'no reason was recorded'}"
    if result.metrics.incomplete:
        yield f"Cut short, and not included in any value: {', '.join(result.metrics.incomplete)}"
    for unusable in result.verdict.unusable:
        where = f" {at_rate(unusable.offered_hz)}" if unusable.offered_hz else ""
        if unusable.reason.rstrip(".").lower() not in said:
            yield f"Cannot be judged{where}: {unusable.reason}"


def _machine_notes(result: Result) -> Iterator[str]:
    """Whether nothing but host interference leaves a run open."""
    verdict = result.verdict
    open_requirements = [
        requirement
        for requirement in verdict.requirements
        if requirement.level == "error" and requirement.outcome == "inconclusive"
    ]
    if verdict.outcome == "inconclusive" and all(
        requirement.weakened for requirement in open_requirements
    ):
        yield (
            "What is open is not shown on this busy machine, which other programs used. Run again "
            "when it has nothing else to do; 'gate.interference: tolerate' judges it as it is."
        )


def _requirement_notes(result: Result, outcomes: Sequence[str]) -> Iterator[str]:
    """The notes of requirements with these outcomes; one that several have is told once."""
    several = wording.several_monitors(result.verdict)
    about: dict[str, list[str]] = {}
    for verdict in result.verdict.requirements:
        if verdict.outcome in outcomes:
            for text in dict.fromkeys(verdict.notes):
                about.setdefault(text, []).append(_where(verdict, several=several))
    for text, where in about.items():
        yield f"{first_words(where, 1)}: {text}"


def _where(verdict: RequirementVerdict, *, several: bool) -> str:
    at = f" {at_rate(verdict.at_hz)}" if verdict.at_hz else ""
    return f"{wording.requirement_text(verdict, name_monitor=several)}{at}"


def _exit_notes(result: Result) -> Iterator[str]:
    for process in result.processes:
        if not process.ended_as_told:
            ended = f"exit code {process.exit_code}"
            if process.exit_code is not None and process.exit_code < 0:
                ended = f"signal {-process.exit_code}"
            yield f"Process {process.name} ended with {ended}"


def profile_notes(profiles: Sequence[ProfileRecord]) -> Iterator[str]:
    """The files of each profile, or why there are none, a sentence each."""
    for profile in profiles:
        at = f" {at_rate(profile.rate_hz)}" if profile.rate_hz else ""
        heading = f"Profile of {profile.process}{at}, with {profile.profiler}"
        if not profile.files:
            yield f"{heading}, is missing: {profile.error}"
            continue
        yield f"{heading}: {', '.join(profile.files)}" + (
            f" ({profile.error})" if profile.error else ""
        )


def unplayed_notes(result: Result) -> Iterator[str]:
    """The messages of inputs that were not played, a sentence for each input."""
    for text in result.unplayed:
        agreed = ", as 'playback.unpaired' allows" if text.agreed else ""
        yield f"{'Warning: ' if text.is_warning else ''}{text.text}{agreed}"


class _Interference(NamedTuple):
    """What other programs disturbed, of one kind.

    Attributes:
        affected: how much of it, such as ``2 of 6 iterations``.
        texts: each disturbed one with the reasons, and what became of it.
        example: a reason.
    """

    affected: str
    texts: list[str]
    example: str


def _interference(result: Result) -> Iterator[_Interference]:
    """Everything that other programs disturbed, and how."""
    rates, probes = result.metrics.rates, wording.all_probes(result.metrics)
    kinds: tuple[tuple[str, int, list[_Disturbed]], ...] = (
        (
            "iterations",
            sum(len(rate.iterations) + len(rate.reruns) for rate in rates),
            [(_iteration_name(one), one.reasons, _rerun(one)) for one in result.verdict.disturbed],
        ),
        (
            "probes",
            len(probes),
            [(show(one.rate_hz, "Hz"), one.disturbed, _probe_outcome(one)) for one in probes],
        ),
        (
            "measurements of the overhead",
            len(result.harness_overhead),
            [(one.topic, one.disturbed, "") for one in result.harness_overhead],
        ),
    )
    for kind, number, parts in kinds:
        disturbed = [part for part in parts if part[1]]
        if disturbed:
            texts = [
                f"{name} ({', '.join(filter(None, (*reasons, outcome)))})"
                for name, reasons, outcome in disturbed
            ]
            affected = f"{len(disturbed)} of {max(number, len(disturbed))} {kind}"
            yield _Interference(affected, texts, disturbed[0][1][0])


_Disturbed = tuple[str, tuple[str, ...], str]
"""The name of a part of a run, what disturbed it, if anything, and what became of it."""


def _interference_text(one: _Interference) -> str:
    """The first of them, and how many more there are."""
    more = len(one.texts) - _MAX_LISTED
    rest = f"; and {more} more, in result.json" if more > 0 else ""
    return f"{_HOST_INTERFERENCE} in {one.affected}: {'; '.join(one.texts[:_MAX_LISTED])}{rest}"


def _iteration_name(one: DisturbedIteration) -> str:
    return f"{one.segment} {at_rate(one.rate_hz)}" if one.rate_hz else one.segment


def _rerun(one: DisturbedIteration) -> str:
    return f"played again as {one.rerun}" if one.rerun else ""


def _probe_outcome(one: Probe) -> str:
    """What became of a probe that other programs disturbed."""
    texts = [f"played in place of {one.rerun_of}"] if one.rerun_of else []
    if one.holds:
        texts.append("sustained all the same")
    elif one.explained:
        texts.append("which can explain that it was not sustained")
    return ", ".join(texts)


def _live_notes(result: Result) -> Iterator[str]:
    """What is unknown in a live run."""
    live = [rate for rate in result.metrics.rates if rate.pace == "source"]
    if not live:
        return
    yield (
        "The graph has its own source: the messages it sent are not recorded, so missed ones are "
        "unknown"
    )
    for rate in live:
        for name, seen in rate.pooled.monitors.items():
            if seen.received and seen.latency.n < seen.received:
                yield (
                    f"{name}: the latency of {show(seen.received - seen.latency.n, 'count')} "
                    "messages is unknown: they have no stamp of this machine's clock"
                )


def _reception_notes(result: Result) -> Iterator[str]:
    """What latencies include because the middleware does not say when messages were received."""
    rmw = wording.loaded_rmw(result)
    seen = [monitor for rate in result.metrics.rates for monitor in rate.pooled.monitors.values()]
    received, untimed = (
        sum(sample.received for sample in seen),
        sum(sample.untimed for sample in seen),
    )
    if 2 * untimed > received:
        what = "gives no times of reception"
    elif rmw and received and middleware_named(rmw).stamps_when_taken:
        what = "stamps messages when they are taken, not when they are received"
    else:
        return
    yield (
        f"{rmw or 'The middleware'} {what}: all latencies include the time until the monitor takes "
        "a message, and do not compare with those of other middlewares"
    )


def _is_feedback(name: str, measured: Container[str]) -> bool:
    """Whether a monitor has the feedback of an action, which tells of each goal several times."""
    action = name.removesuffix(FEEDBACK)
    return action != name and action in measured and f"{action}{ACCEPTED}" in measured


def _message_anomalies(result: Result) -> Iterator[str]:
    """Messages that did not arrive exactly once, in order, and in response to an input."""
    for rate in result.metrics.rates:
        for name, seen in rate.pooled.monitors.items():
            where = f"{name} {at_rate(rate.offered_hz, rate.pace)}"
            if not seen.received:
                yield f"{where} received nothing"
            elif seen.unknown_latency:
                yield f"{where}: the latency is unknown: {seen.unknown_latency}"
            if seen.own_period_s is not None:
                hz = rate.offered_hz if len(result.metrics.rates) == 1 and seen.answered else 0.0
                yield f"{where}: {own_pace_text(seen.own_period_s, 1 / hz if hz else 0.0)}"
                continue
            if seen.expected != seen.sent:
                inputs, outputs = show(seen.sent, "count"), show(seen.expected, "count")
                yield f"{where}: {inputs} inputs, {outputs} outputs expected"
            odd = {
                "duplicated": 0 if _is_feedback(name, rate.pooled.monitors) else seen.duplicates,
                "reordered": seen.reordered,
                "matched no input": (seen.unmatched or 0) - (seen.overdue or 0),
                "arrived in a later segment (counted as missed)": seen.overdue,
                "arrived before the input": seen.early,
            }
            texts = [f"{show(count, 'count')} {what}" for what, count in odd.items() if count]
            if texts:
                yield f"{where}: of {show(seen.received, 'count')} messages, {', '.join(texts)}"
