"""The wording shared by all reports: requirements, bounds, the search, and notes."""

from __future__ import annotations

import statistics
from collections.abc import Iterator, Sequence

from r2bspec.judge.methods.method_registry import METHODS
from r2bspec.judge.methods.peak_bracket import peak_doubts
from r2bspec.judge.result import Result
from r2bspec.judge.verdict import DisturbedIteration, OverallOutcome, RequirementVerdict, Verdict
from r2bspec.measure.metrics import RunMetrics
from r2bspec.measure.units import at_rate, show
from r2bspec.middleware.rmw_registry import middleware_named
from r2bspec.record.graph_identity import revision_text
from r2bspec.record.run_record import Probe, ProfileRecord, SearchRecord, StartRecord
from r2bspec.report.harness_wording import joined_notes, overhead_notes

OUTCOME_WORDS: dict[OverallOutcome, str] = {
    "pass": "✔ PASS",
    "fail": "✘ FAIL",
    "inconclusive": "? INCONCLUSIVE",
    "invalid": "! INVALID",
    "incomplete": "! INCOMPLETE",
}
"""Each outcome with its mark: never shown by colour alone."""


_MAX_CHANGES = 12
"""Changes of the code that are listed one by one."""

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
        compared = one.method == "observation" or METHODS[one.method].rests_on == "truth"
        return "observed" if compared else ""
    if one.lower is None:
        return f"≤ {show(one.upper, one.unit)}"
    if one.upper is None:
        return f"≥ {show(one.lower, one.unit)}"
    lower, upper = show(one.lower, one.unit), show(one.upper, one.unit)
    return lower if lower == upper else f"{lower} … {upper}"


PROBE_MARKS = {True: "✔", False: "✘", None: "?"}
"""Marks of a probe's outcome."""

KEPT_UP_MARK = "~"
"""The mark of a rate with which the graph kept up, in a probe too short to bound the losses."""


def probe_mark(probe: Probe) -> str:
    """The mark of a probe."""
    return KEPT_UP_MARK if probe.keeps_up and probe.holds is None else PROBE_MARKS[probe.holds]


PROBE_PURPOSES = {"saturation": "overload", "confirmation": "played whole"}
"""Why a rate was played, where it was not only to test it."""


def peak_text(search: SearchRecord) -> str:
    """The peak as a bracket, its confidence, what limited it, and the number of probes.

    A peak that is limited only by the player, by the range of the search, or by host interference
    during all probes above it, is a lower bound.
    """
    limits = {
        "graph": "limited by the graph",
        "player": "limited by the player, not by the graph",
        "range": "limited by the search range",
        "interrupted": "the search was interrupted",
        "interference": "the upper end is unknown"
        if search.upper_hz is None
        else "the upper end is rough",
    }
    lower, upper = search.holds_hz, search.upper_hz
    if lower is None:
        found = "not found" if upper is None else f"below {show(upper, 'Hz')}"
    elif upper is None:
        found = f"at least {show(lower, 'Hz')}"
    else:
        found = f"between {show(lower, 'Hz')} and {show(upper, 'Hz')}"
    parts = [found, limits[search.limited_by]]
    if search.limited_by == "interference":
        parts.append(f"during the probes above, {'; '.join(search.disturbed)}")
    if search.open_hz:
        parts.insert(1, undecided_rates_text(search))
    if search.shown and search.confidence:
        parts.append(f"{show(search.confidence, 'share', 4)} confidence")
    parts += [f"{each[:1].lower()}{each[1:]}" for each in peak_doubts(search)]
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


def code_lines(result: Result) -> Iterator[str]:
    """What was run: the revisions, what changed between them, and what is said of the gate."""
    head, base = (
        revision_text(identity.revision) if identity is not None else ""
        for identity in (result.identity, result.base_identity)
    )
    if head and base:
        yield f"head {head} · base {base}"
    elif head:
        yield f"revision {head}"
    if result.changes:
        yield f"Changed since the base: {', '.join(_shortened(result.changes))}."
    yield from result.gate


def code_facts(result: Result) -> dict[str, str]:
    """What is known of the code: the revision, each node, and each package; empty if nothing is."""
    if result.identity is None:
        return {}
    nodes = {
        f"node {name}": " ".join(
            filter(None, (node.package, node.version, node.digest[:12], node.unknown))
        )
        for name, node in result.identity.nodes.items()
    }
    packages = {f"package {name}": text for name, text in result.identity.packages.items()}
    return {"revision": revision_text(result.identity.revision), **nodes, **packages}


def _shortened(texts: Sequence[str]) -> Sequence[str]:
    more = len(texts) - _MAX_CHANGES
    return (*texts[:_MAX_CHANGES], f"{more} more") if more > 0 else texts


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


def outcome_heading(verdict: Verdict) -> str:
    """The outcome as the heading of a report; one that is about a single start says so."""
    return f"{OUTCOME_WORDS[verdict.outcome]}{_of_one_start(verdict)}"


def outcome_title(verdict: Verdict) -> str:
    """The outcome in lower case, for the title of a message; see `outcome_heading`."""
    return f"{verdict.outcome}{_of_one_start(verdict)}"


def _of_one_start(verdict: Verdict) -> str:
    return " of this start" if verdict.starts == 1 else ""


def starts_text(starts: Sequence[StartRecord]) -> str:
    """How often all processes were started, and what that took each time; empty if unknown.

    The time is the median of the starts after the first, in which more was to be loaded, if there
    are any.
    """
    if not starts:
        return ""
    confirming = sum(each.confirms for each in starts)
    number = len(starts) - confirming
    text = f"{number} start{'s' if number > 1 else ''}"
    if confirming:
        text += f" and {confirming} to confirm"
    cost_s = statistics.median(each.cost_ns for each in (starts[1:] or starts)) / 1e9
    return f"{text}, {show(cost_s, 's', 2)}{' each' if len(starts) > 1 else ''}"


def notes(result: Result) -> Iterator[str]:
    """What a reader must know to interpret the results, a sentence each."""
    if result.status != "complete":
        yield f"The run is {result.status}: {result.reason or 'no reason was recorded'}"
    yield from result.verdict.limits
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
    yield from accuracy_notes(result)
    yield from (f"{each[:1].upper()}{each[1:]}" for each in _of_pairs(result))
    yield from affected_iteration_notes(result.verdict.disturbed)
    yield from _disturbed_start_notes(result.starts)
    yield from unplayed_notes(result)
    yield from _disturbed_probe_notes(result.metrics)
    yield from joined_notes(result)
    yield from overhead_notes(result)
    yield from _disturbed_overhead_notes(result)
    yield from result.left_out
    yield from _live_notes(result)
    yield from _reception_notes(result)
    yield from _message_anomalies(result)
    yield from profile_notes(result.profiles)
    # Each start has a process of the name; that all end in one way is one note.
    yield from dict.fromkeys(_exit_notes(result))


def accuracy_notes(result: Result) -> Iterator[str]:
    """What the comparison with the truth found, a sentence or two for each monitor."""
    for one in result.accuracy:
        found = ", ".join(
            f"{name.removeprefix('accuracy.')} {show(value, 'share')}"
            for name, value in one.values.items()
        )
        said = one.problem or f"{found or 'no values'}. {one.text}".strip()
        compared = f"{one.outputs:,} of {one.steps:,} steps compared"
        yield f"Accuracy of {one.monitor}, {one.kind} of {one.of}, {compared}: {said}"


def _exit_notes(result: Result) -> Iterator[str]:
    for process in result.processes:
        if not process.ended_as_told:
            ended = f"exit code {process.exit_code}"
            if process.exit_code is not None and process.exit_code < 0:
                ended = f"signal {-process.exit_code}"
            yield f"Process {process.name} ended with {ended}"


def profile_notes(profiles: Sequence[ProfileRecord]) -> Iterator[str]:
    """The files of each profile, or why there are none, a sentence each."""
    for one in profiles:
        at = f" {at_rate(one.rate_hz)}" if one.rate_hz else ""
        heading = f"Profile of {one.process}{at}, with {one.profiler}"
        if not one.files:
            yield f"{heading}, is missing: {one.error}"
            continue
        yield f"{heading}: {', '.join(one.files)}" + (f" ({one.error})" if one.error else "")


def unplayed_notes(result: Result) -> Iterator[str]:
    """The messages of inputs that were not played, a sentence for each input."""
    for one in result.unplayed:
        agreed = ", as 'playback.unpaired' allows" if one.agreed else ""
        yield f"{'Warning: ' if one.is_warning else ''}{one.text}{agreed}"


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


def _disturbed_start_notes(starts: Sequence[StartRecord]) -> Iterator[str]:
    """The starts that other programs disturbed while their processes came up."""
    found = [each for each in starts if each.disturbed]
    if not found:
        return
    listed = [f"{each.number} ({', '.join(each.disturbed)})" for each in found]
    more = len(found) - _MAX_LISTED_ITERATIONS
    rest = f"; and {more} more, in result.json" if more > 0 else ""
    yield (
        f"Host interference while {len(found)} of {len(starts)} starts came up: "
        f"{'; '.join(listed[:_MAX_LISTED_ITERATIONS])}{rest}"
    )


def _disturbed_probe_notes(metrics: RunMetrics) -> Iterator[str]:
    """The probes that other programs disturbed, and what became of them."""
    searched = metrics.search.probes if metrics.search is not None else ()
    found = [one for one in (*searched, *metrics.sustained) if one.disturbed]
    if not found:
        return
    listed = [_disturbed_probe_text(one) for one in found[:_MAX_LISTED_ITERATIONS]]
    more = len(found) - _MAX_LISTED_ITERATIONS
    rest = f"; and {more} more, in result.json" if more > 0 else ""
    total = len(searched) + len(metrics.sustained)
    yield (f"Host interference during {len(found)} of {total} probes: {'; '.join(listed)}{rest}")


def _disturbed_probe_text(one: Probe) -> str:
    """Such as ``95 Hz (other processes used 1.7 of 2 cores; can explain the failure)``."""
    texts = list(one.disturbed)
    if one.rerun_of:
        texts.append(f"played in place of {one.rerun_of}")
    if one.holds:
        texts.append("sustained all the same")
    elif one.explained:
        texts.append("which can explain that it was not sustained")
    return f"{show(one.rate_hz, 'Hz')} ({', '.join(texts)})"


def _disturbed_overhead_notes(result: Result) -> Iterator[str]:
    """What disturbed the measurement of the harness overhead."""
    reasons = dict.fromkeys(each for one in result.floor for each in one.disturbed)
    if reasons:
        yield f"Host interference while the harness overhead was measured: {', '.join(reasons)}"


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


def _reception_notes(result: Result) -> Iterator[str]:
    """What latencies include because the middleware does not say when messages were received."""
    rmw = loaded_rmw(result)
    seen = [each for rate in result.metrics.rates for each in rate.pooled.monitors.values()]
    received, untimed = sum(each.received for each in seen), sum(each.untimed for each in seen)
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


def _message_anomalies(result: Result) -> Iterator[str]:
    """Messages that did not arrive exactly once, in order, and in response to an input."""
    for rate in result.metrics.rates:
        for name, seen in rate.pooled.monitors.items():
            where = f"{name} {at_rate(rate.offered_hz, rate.pace)}"
            if not seen.received:
                yield f"{where} received nothing"
            elif seen.unknown_latency:
                yield f"{where}: the latency is unknown: {seen.unknown_latency}"
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
