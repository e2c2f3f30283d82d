"""The wording shared by all reports: requirements, bounds, the search, and notes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from r2bspec.judge.result import Result
from r2bspec.judge.verdict import DisturbedIteration, OverallOutcome, RequirementVerdict, Verdict
from r2bspec.measure.metrics import RunMetrics
from r2bspec.measure.units import at_rate, show
from r2bspec.record.run_record import SearchRecord

OUTCOME_WORDS: dict[OverallOutcome, str] = {
    "pass": "✔ PASS",
    "fail": "✘ FAIL",
    "inconclusive": "? INCONCLUSIVE",
    "invalid": "! INVALID",
    "incomplete": "! INCOMPLETE",
}
"""Each outcome with its mark: never shown by colour alone."""


_MAX_LISTED_ITERATIONS = 6
"""Affected iterations that are listed one by one."""


def verdict_word(one: RequirementVerdict) -> str:
    """The outcome of a requirement, and its level where it does not fail the run."""
    word = OUTCOME_WORDS[one.outcome]
    if one.outcome == "pass" or one.level == "error":
        return word
    return f"{word} ({'warning' if one.level == 'warn' else 'information'})"


def sentences(one: RequirementVerdict) -> list[str]:
    """The reason of a verdict, its notes, and what would decide it."""
    return [text for text in (one.reason, *one.notes, one.settle) if text]


def several_monitors(verdict: Verdict) -> bool:
    """Whether requirements need the monitor's name to be distinguished."""
    return len({one.monitor for one in verdict.requirements} - {None}) > 1


def requirement_text(one: RequirementVerdict, *, name_monitor: bool) -> str:
    """The requirement as written; on request with the monitor that it left out."""
    text = one.text.strip()
    if not name_monitor or one.monitor is None or text.startswith(f"{one.monitor}."):
        return text
    return f"{one.monitor}.{text}"


def estimate_text(one: RequirementVerdict) -> str:
    """The estimate with its unit, or that it is a lost message."""
    return "lost" if one.lost else show(one.estimate, one.unit)


def bounds_text(one: RequirementVerdict) -> str:
    """The confidence interval, one-sided where only one side is bounded."""
    if one.lower is None and one.upper is None:
        return "observed" if one.method == "observation" else ""
    if one.lower is None:
        return f"≤ {show(one.upper, one.unit)}"
    if one.upper is None:
        return f"≥ {show(one.lower, one.unit)}"
    lower, upper = show(one.lower, one.unit), show(one.upper, one.unit)
    return lower if lower == upper else f"{lower} … {upper}"


PROBE_MARKS = {True: "✔", False: "✘", None: "?"}
"""Marks of a probe's outcome."""


def peak_text(search: SearchRecord) -> str:
    """The peak as a bracket, its confidence, what limited it, and the number of probes.

    A peak that is limited only by the player or by the range of the search is a lower bound.
    """
    limits = {
        "graph": "limited by the graph",
        "player": "limited by the player, not by the graph",
        "range": "limited by the search range",
        "interrupted": "the search was interrupted",
    }
    lower, upper = search.holds_hz, search.upper_hz
    if lower is None:
        found = "not found" if upper is None else f"below {show(upper, 'Hz')}"
    elif upper is None:
        found = f"at least {show(lower, 'Hz')}"
    else:
        found = f"between {show(lower, 'Hz')} and {show(upper, 'Hz')}"
    parts = [found, limits[search.limited_by]]
    if search.open_hz:
        parts.insert(1, undecided_rates_text(search))
    if search.confidence:
        parts.append(f"{show(search.confidence, 'share', 4)} confidence")
    return " · ".join([*parts, f"{len(search.probes)} probes"])


def undecided_rates_text(search: SearchRecord) -> str:
    """The undecided rates of the bracket."""
    first, *others = search.open_hz
    if not others:
        return f"undecided at {show(first, 'Hz')}"
    return f"undecided from {show(first, 'Hz')} to {show(others[-1], 'Hz')}"


def comparison(result: Result) -> Iterator[str]:
    """The baseline of a result, a sentence each; nothing without one."""
    pairs, earlier = result.pairs, result.baseline
    if pairs is not None:
        played = f"{pairs.used} of {pairs.planned} pairs" if pairs.used < pairs.planned else ""
        played = played or ("1 pair" if pairs.used == 1 else f"{pairs.used} pairs")
        if pairs.control:
            yield f"Control: the graph compared with itself, in {played} of interleaved runs."
        else:
            yield f"Compared with {pairs.against}, in {played} of interleaved runs."
        if pairs.environment:
            yield f"The environment of the base differs in {', '.join(sorted(pairs.environment))}."
        yield from (f"Difference from base to head: {each}" for each in pairs.differences)
    if earlier is not None:
        runs = "1 run" if len(earlier.run_ids) == 1 else f"{len(earlier.run_ids)} runs"
        if earlier.kind == "history":
            yield f"Compared with {runs} of the history {earlier.source}."
        else:
            yield f"Compared with the stored run {earlier.source} (advisory)."
        yield from (f"Difference: {each}" for each in earlier.differences)


def _of_pairs(result: Result) -> tuple[str, ...]:
    """The notes of a comparison."""
    return result.pairs.notes if result.pairs is not None else ()


def own_pace(metrics: RunMetrics) -> str:
    """What set the rate of messages, where none was offered; else empty."""
    return next((rate.pace for rate in metrics.rates if not rate.offered_hz), "")


def loaded_rmw(result: Result) -> str:
    """The middleware (RMW implementation) of the run; empty if unknown."""
    rmw = result.versions.get("rmw", "")
    # Earlier versions recorded the variable, or this if it was not set.
    return "" if rmw == "default" else rmw


def notes(result: Result) -> Iterator[str]:
    """What a reader must know to interpret the results, a sentence each."""
    if result.status != "complete":
        yield f"The run is {result.status}: {result.reason or 'no reason was recorded'}"
    if result.metrics.incomplete:
        yield f"Cut short, and not included in any value: {', '.join(result.metrics.incomplete)}"
    for one in result.verdict.unusable:
        where = f" {at_rate(one.offered_hz)}" if one.offered_hz else ""
        yield f"Cannot be judged{where}: {one.reason}"
    for stopped in result.silences:
        yield f"No more messages on {stopped.topic} in {stopped.segment}. {stopped.reason}"
    for difference in result.differences:
        if difference.harmless:
            yield f"{difference.code}: {difference.message}; {difference.help}"
    yield from (f"{each[:1].upper()}{each[1:]}" for each in _of_pairs(result))
    yield from affected_iteration_notes(result.verdict.disturbed)
    yield from result.left_out
    yield from _live_notes(result)
    yield from _message_anomalies(result)
    for process in result.processes:
        if not process.ended_as_told:
            ended = f"exit code {process.exit_code}"
            if process.exit_code is not None and process.exit_code < 0:
                ended = f"signal {-process.exit_code}"
            yield f"Process {process.name} ended with {ended}"


def affected_iteration_notes(disturbed: Sequence[DisturbedIteration]) -> Iterator[str]:
    """The iterations affected by host interference, its causes, and the reruns, by rate."""
    for rate_hz in dict.fromkeys(one.rate_hz for one in disturbed):
        found = [one for one in disturbed if one.rate_hz == rate_hz]
        listed = [_affected_iteration_text(one) for one in found[:_MAX_LISTED_ITERATIONS]]
        more = (
            f"; and {len(found) - _MAX_LISTED_ITERATIONS} more, in result.json"
            if len(found) > _MAX_LISTED_ITERATIONS
            else ""
        )
        at = f" {at_rate(rate_hz)}" if rate_hz else ""
        yield f"Host interference{at}: {'; '.join(listed)}{more}"


def _affected_iteration_text(one: DisturbedIteration) -> str:
    again = f", played again as {one.rerun}" if one.rerun else ""
    return f"{one.segment} ({', '.join(one.reasons)}{again})"


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


def _message_anomalies(result: Result) -> Iterator[str]:
    """Messages that did not arrive exactly once, in order, and in response to an input."""
    for rate in result.metrics.rates:
        for name, seen in rate.pooled.monitors.items():
            where = f"{name} {at_rate(rate.offered_hz, rate.pace)}"
            if not seen.received:
                yield f"{where} received nothing"
            if seen.expected != seen.sent:
                inputs, outputs = show(seen.sent, "count"), show(seen.expected, "count")
                yield f"{where}: {inputs} inputs, {outputs} outputs expected"
            odd = {
                "duplicated": seen.duplicates,
                "reordered": seen.reordered,
                "matched no input": (seen.unmatched or 0) - (seen.overdue or 0),
                "arrived in a later segment (counted as missed)": seen.overdue,
                "arrived before the input": seen.early,
            }
            texts = [f"{show(count, 'count')} {what}" for what, count in odd.items() if count]
            if texts:
                yield f"{where}: of {show(seen.received, 'count')} messages, {', '.join(texts)}"
