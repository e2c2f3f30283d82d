"""What a reader must know to interpret the results: sentences, the most important first.

A report shows at most five notes, and none for an ordinary run that passes; with ``--verbose`` it
shows all. What is true of every run alike is no note: it is in the documentation of verdicts. A
sentence that the report already contains, such as the reason of a failed requirement, is left out.
If a busy machine leaves a run open, that is said first and alone, so that no advice about the graph
contradicts it.
"""

from __future__ import annotations

from collections.abc import Container, Iterator, Sequence
from typing import Final

from r2bspec.diagnostics.quote import first_words, join_words
from r2bspec.judge.measure.metric import Scope
from r2bspec.judge.measure.own_pace import own_pace_text
from r2bspec.judge.measure.units import at_rate, show
from r2bspec.judge.result import Result
from r2bspec.judge.verdict import RequirementVerdict
from r2bspec.language.spec_benchmark import ACCEPTED, FEEDBACK
from r2bspec.record.run_record import ProfileRecord
from r2bspec.report import wording
from r2bspec.report.anatomy_table import anatomies_of, blocker_text, share

MOST_NOTES: Final = 5
"""Notes of a report that is not verbose."""

_IDLE_SHARE: Final = 0.1
"""Of the period, that a process may use without messages, unnoticed."""


def notes(result: Result, *, verbose: bool = False) -> tuple[str, ...]:
    """Return the notes of a result, each once: five at most, or all of them."""
    busy = tuple(_busy_notes(result))
    if busy and not verbose:
        return busy
    said = _said(result)
    flat = (" ".join(text.split()) for text in (*busy, *_in_order(result, verbose=verbose)))
    texts = [*dict.fromkeys(text for text in flat if text.rstrip(".").lower() not in said)]
    return tuple(texts if verbose else texts[:MOST_NOTES])


def _said(result: Result) -> str:
    """Return what every report says before its notes, in lower case."""
    texts = [wording.headline(result), result.verdict.reason]
    for verdict in result.verdict.requirements:
        if verdict.outcome != "pass":
            texts += (verdict.reason, verdict.remedy)
    return " ".join(texts).lower()


def _in_order(result: Result, *, verbose: bool) -> Iterator[str]:
    """Yield all notes: first what has failed, then what open verdicts rest on, then the rest."""
    yield from _status_notes(result)
    for gap in result.output_gaps:
        yield f"No more messages on {gap.topic} in {gap.segment}. {gap.reason}"
    yield from _exit_notes(result)
    yield from _fitting_matches(result)
    yield from _requirement_notes(result, ("fail", "inconclusive"))
    yield from _untested(result)
    is_complete = not any(one.left_open for one in result.verdict.requirements)
    if verbose or result.verdict.outcome != "pass" or not is_complete:
        yield interference_text(result)
    yield from _anatomy_notes(result)
    yield from unplayed_notes(result)
    yield from result.left_out
    yield from _message_anomalies(result)
    yield from idle_work_notes(result)
    for difference in result.differences:
        if difference.harmless:
            yield f"{difference.code}: {difference.message}; {difference.help}"
    if verbose:
        decisions = result.pairs.notes if result.pairs is not None else ()
        yield from (f"{text[:1].upper()}{text[1:]}" for text in decisions)
        yield from _requirement_notes(result, ("pass",))


def _anatomy_notes(result: Result) -> Iterator[str]:
    """Yield where the time goes that a missed latency takes, or the command that shows it."""
    late = [
        one
        for one in result.verdict.requirements
        # An output that answers no input has no latency, and no time that could be shown.
        if one.outcome == "fail"
        and "latency" in one.metric
        and (one.lost or one.estimate is not None)
    ]
    if not late or result.status != "complete":
        return
    paths = [path for anatomy in anatomies_of(result) for path in anatomy.paths if path.parts]
    if not paths:
        yield "'r2bspec run SPEC --anatomy' shows where the time of late outputs goes"
        return
    for path in {path.monitor: path for path in reversed(paths)}.values():
        most = max(path.parts, key=lambda part: part.share)
        yield (
            f"In the anatomy, {share(most.share)} of the latency of {path.monitor} is "
            f"{most.name} of {most.owner} (p99 {show(most.p99, 's')})"
        )
    blockers = [blocker for anatomy in anatomies_of(result) for blocker in anatomy.blockers]
    if blockers:
        yield blocker_text(max(blockers, key=lambda blocker: blocker.n * blocker.mean))


def _status_notes(result: Result) -> Iterator[str]:
    """Yield why the run ended early, or cannot be judged."""
    said = _said(result)
    if result.status != "complete" and (not result.reason or result.reason.lower() not in said):
        yield f"The run is {result.status}: {result.reason or 'no reason was recorded'}"
    if result.metrics.incomplete:
        yield f"Cut short, and not included in any value: {', '.join(result.metrics.incomplete)}"
    for unusable in result.verdict.unusable:
        where = f" {at_rate(unusable.offered_hz)}" if unusable.offered_hz else ""
        if unusable.reason.rstrip(".").lower() not in said:
            yield f"Cannot be judged{where}: {unusable.reason}"


def _busy_notes(result: Result) -> Iterator[str]:
    """Yield one sentence where a busy machine is what leaves a run open."""
    open_requirements = [
        requirement
        for requirement in result.verdict.requirements
        if requirement.level == "error" and requirement.outcome == "inconclusive"
    ]
    if result.verdict.outcome != "inconclusive" or not all(
        wording.open_on_busy_machine(requirement, result) for requirement in open_requirements
    ):
        return
    affected = interference_text(result) or "Other programs used this machine"
    way = "run again on an idle machine"
    if all(requirement.weakened for requirement in open_requirements):
        way += "; 'gate.interference: tolerate' judges it as it is"
    yield f"The machine was busy: {affected[:1].lower()}{affected[1:]}. To decide it, {way}."


def interference_text(result: Result) -> str:
    """Return a sentence on what other programs did to a run; empty if they did nothing."""
    rates, probes = result.metrics.rates, wording.all_probes(result.metrics)
    kinds: tuple[tuple[str, int, list[tuple[str, ...]]], ...] = (
        (
            "iterations",
            sum(len(rate.iterations) + len(rate.reruns) for rate in rates),
            [one.reasons for one in result.verdict.disturbed],
        ),
        ("probes", len(probes), [one.disturbed for one in probes]),
    )
    affected, example = [], ""
    for kind, number, parts in kinds:
        disturbed = [reasons for reasons in parts if reasons]
        if disturbed:
            affected.append(f"{len(disturbed)} of {max(number, len(disturbed))} {kind}")
            example = example or max(disturbed, key=len)[0]
    if not affected:
        return ""
    return f"Host interference in {join_words(affected, 'and')}; for example, {example}"


def idle_work_notes(result: Result) -> Iterator[str]:
    """Yield processes that use CPU without messages.

    Until the last output of a step has come, all cores together can have used no more processor
    time than cores × latency. So with the work w of a process in most steps (p50), the latency L
    from when a step was due to its last output in most steps (p90 of the slowest monitor), and the
    period P,

        w > cores × L + 0.1 P

    shows that it works when there is no message: a timer, a thread that waits actively, or work
    after the output.
    """
    cores = result.machine.get("cores")
    for rate in result.metrics.rates:
        monitors = rate.pooled.monitors.values()
        latencies = [seen.times("latency_from_due").p90 for seen in monitors]
        known = [latency for latency in latencies if latency is not None]
        if not rate.offered_hz or not known or len(known) < len(latencies) or not cores:
            continue
        within = int(cores) * max(known)
        for name, info, _ in rate.pooled.entries(Scope.WORK):
            work_s = rate.pooled.times(name).p50
            if not info.subject or not work_s or work_s <= within + _IDLE_SHARE / rate.offered_hz:
                continue
            yield (
                f"Process {info.subject} uses CPU without messages: {show(work_s, 's')} a step "
                f"{at_rate(rate.offered_hz)}, though the outputs have come after "
                f"{show(max(known), 's')}; {name} contains it"
            )


def _requirement_notes(result: Result, outcomes: Sequence[str]) -> Iterator[str]:
    """Yield the notes of requirements with these outcomes; one that several have is told once."""
    several = wording.several_monitors(result.verdict)
    about: dict[str, list[str]] = {}
    for verdict in result.verdict.requirements:
        if verdict.outcome in outcomes:
            for text in dict.fromkeys(verdict.notes):
                about.setdefault(text, []).append(_where(verdict, several=several))
    for text, where in about.items():
        yield f"{first_words(where, 1)}: {text}"


def _untested(result: Result) -> Iterator[str]:
    """Yield what would change a verdict and cannot be seen in the run, where some were bad.

    Where a run has met nothing bad, that is true of every run of its length.
    """
    several = wording.several_monitors(result.verdict)
    for verdict in result.verdict.requirements:
        if verdict.untested and (verdict.share is None or verdict.share.over > 0):
            yield f"{_where(verdict, several=several)}: {verdict.untested}"


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


def profile_texts(profiles: Sequence[ProfileRecord]) -> Iterator[str]:
    """Yield the files of each profile, or why there are none, a sentence each."""
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
    """Yield the messages of inputs that were not played, a sentence for each input."""
    for text in result.unplayed:
        agreed = ", as 'playback.unpaired' allows" if text.agreed else ""
        yield f"{'Warning: ' if text.is_warning else ''}{text.text}{agreed}"


def _is_feedback(name: str, measured: Container[str]) -> bool:
    """Return True if a monitor has the feedback of an action."""
    action = name.removesuffix(FEEDBACK)
    return action != name and action in measured and f"{action}{ACCEPTED}" in measured


def _fitting_matches(result: Result) -> Iterator[str]:
    """Yield how outputs answer inputs where the spec says otherwise, which explains losses."""
    for rate in result.metrics.rates:
        for name, seen in rate.pooled.monitors.items():
            if seen.fitting_match and seen.own_period_s is None:
                yield f"{name} {at_rate(rate.offered_hz, rate.pace)}: {seen.fitting_match}"


def _message_anomalies(result: Result) -> Iterator[str]:
    """Messages that did not arrive exactly once, in order, and in response to an input."""
    for rate in result.metrics.rates:
        for name, seen in rate.pooled.monitors.items():
            where = f"{name} {at_rate(rate.offered_hz, rate.pace)}"
            received = seen.count("received")
            if not received:
                yield f"{where} received nothing"
            elif seen.unknown_latency:
                yield f"{where}: the latency is unknown: {seen.unknown_latency}"
            if seen.own_period_s is not None:
                hz = (
                    rate.offered_hz
                    if len(result.metrics.rates) == 1 and seen.count("answered")
                    else 0.0
                )
                yield f"{where}: {own_pace_text(seen.own_period_s, 1 / hz if hz else 0.0)}"
                continue
            sent = seen.count("sent")
            if seen.is_expected and seen.expected != sent:
                inputs, outputs = show(sent, "count"), show(seen.expected, "count")
                yield f"{where}: {inputs} inputs, {outputs} outputs expected"
            odd = {
                "duplicated": 0
                if _is_feedback(name, rate.pooled.monitors)
                else seen.count("duplicates"),
                "reordered": seen.count("reordered"),
                "matched no input": seen.count("unmatched") - seen.count("overdue"),
                "arrived in a later segment (counted as missed)": seen.count("overdue"),
                "arrived before the input": seen.count("early"),
            }
            texts = [f"{show(count, 'count')} {what}" for what, count in odd.items() if count]
            if texts:
                yield f"{where}: of {show(received, 'count')} messages, {', '.join(texts)}"
