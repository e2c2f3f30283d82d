"""The wording shared by all reports: requirements, bounds, the search, harness and code."""

from __future__ import annotations

import statistics
from collections.abc import Iterator, Sequence

from r2bspec.diagnostics.quote import pluralize
from r2bspec.judge.measure.metrics import RunMetrics
from r2bspec.judge.measure.units import show
from r2bspec.judge.methods.peak_bracket import bracket_confidence, peak_doubts
from r2bspec.judge.result import Result
from r2bspec.judge.verdict import OverallOutcome, RequirementVerdict, Verdict
from r2bspec.record.graph_identity import revision_text
from r2bspec.record.run_record import HarnessOverheadRecord, Probe, SearchRecord, StartRecord

OUTCOME_WORDS: dict[OverallOutcome, str] = {
    "pass": "✔ PASS",
    "fail": "✘ FAIL",
    "inconclusive": "? INCONCLUSIVE",
    "invalid": "! INVALID",
    "incomplete": "! INCOMPLETE",
}
"""Each outcome with its mark: never shown by colour alone."""


NAMED_CHANGES = 3
"""Changes of the code that the first line of a report names; it counts the others."""

_MAX_CHANGES = 12
"""Changes of the code that are listed one by one where the first line does not name them all."""


def overall_word(verdict: Verdict) -> str:
    """The outcome with its mark; a run of which nothing was judged has passed nothing."""
    if verdict.outcome == "pass" and not verdict.requirements:
        return "– NOT JUDGED"
    return OUTCOME_WORDS[verdict.outcome]


def verdict_word(one: RequirementVerdict) -> str:
    """The outcome of a requirement, and its level where it does not fail the run."""
    word = OUTCOME_WORDS[one.outcome]
    if one.outcome == "pass" or one.level == "error":
        return word
    return f"{word} ({'warning' if one.level == 'warn' else 'information'})"


def sentences(one: RequirementVerdict) -> list[str]:
    """The reason of a verdict, its notes, and what would decide it."""
    return [text for text in (one.reason, *one.notes, one.remedy) if text]


def several_monitors(verdict: Verdict) -> bool:
    """Whether requirements need the monitor's name to be distinguished."""
    return len({requirement.monitor for requirement in verdict.requirements} - {None}) > 1


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
    lower, upper = show(one.lower, one.unit), show(one.upper, one.unit)
    return lower if lower == upper else interval_text(one.lower, one.upper, one.unit)


def interval_text(lower: float | None, upper: float | None, unit: str, digits: int = 3) -> str:
    """An interval, one-sided where only one side is bounded; empty if none is."""
    if lower is None:
        return "" if upper is None else f"≤ {show(upper, unit, digits)}"
    if upper is None:
        return f"≥ {show(lower, unit, digits)}"
    return f"{show(lower, unit, digits)} … {show(upper, unit, digits)}"


PROBE_MARKS = {True: "✔", False: "✘", None: "?"}
"""Marks of a probe's outcome."""

KEPT_UP_MARK = "~"
"""The mark of a rate with which the graph kept up, in a probe too short to bound the losses."""


def probe_mark(probe: Probe) -> str:
    """The mark of a probe."""
    return KEPT_UP_MARK if probe.keeps_up and probe.holds is None else PROBE_MARKS[probe.holds]


def all_probes(metrics: RunMetrics) -> list[Probe]:
    """The probes of the search, then those of required rates."""
    return [*(metrics.search.probes if metrics.search is not None else ()), *metrics.sustained]


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
        peak = "not found" if upper is None else f"below {show(upper, 'Hz')}"
    elif upper is None:
        peak = f"at least {show(lower, 'Hz')}"
    else:
        peak = f"between {show(lower, 'Hz')} and {show(upper, 'Hz')}"
    parts = [peak, limits[search.limited_by]]
    if search.limited_by == "interference":
        parts.append(f"during the probes above, {'; '.join(search.disturbed)}")
    if search.open_hz:
        first, last = (show(rate_hz, "Hz") for rate_hz in (search.open_hz[0], search.open_hz[-1]))
        several = len(search.open_hz) > 1
        parts.insert(1, f"undecided from {first} to {last}" if several else f"undecided at {first}")
    if sure := bracket_confidence(search):
        parts.append(sure)
    parts += [f"{peak_doubt[:1].lower()}{peak_doubt[1:]}" for peak_doubt in peak_doubts(search)]
    return " · ".join([*parts, f"{len(search.probes)} probes"])


def comparison(result: Result) -> Iterator[str]:
    """The gate and the base of a result, a sentence each; nothing without them."""
    yield from (f"{text[:1].upper()}{text[1:]}" for text in result.gate)
    # The first line of a report names only some of the changes.
    if len(result.changes) > NAMED_CHANGES:
        more = len(result.changes) - _MAX_CHANGES
        others = f", {more} more" if more > 0 else ""
        yield f"Changed since the base: {', '.join(result.changes[:_MAX_CHANGES])}{others}."
    pairs = result.pairs
    if pairs is not None:
        noun = "start" if pairs.by_turns else "pair"
        how = "of both sides, played by turns" if pairs.by_turns else "of interleaved runs"
        played = f"{pairs.used} of {pairs.planned} {noun}s" if pairs.used < pairs.planned else ""
        played = played or pluralize(pairs.used, noun)
        what = (
            "Control: the graph compared with itself"
            if pairs.control
            else (f"Compared with {pairs.against}")
        )
        yield f"{what}, in {played} {how}."
        base, head = result.base_identity, result.identity
        if base is not None and head is not None and base.digest == head.digest:
            yield "Base and head have loaded the same code."
        if pairs.environment:
            yield f"The environment of the base differs in {', '.join(sorted(pairs.environment))}."
        yield from (
            f"Difference from base to head: {difference}" for difference in pairs.differences
        )


def revisions(result: Result) -> tuple[str, str]:
    """The revision of the head, and that of the base; empty where they are not known."""
    head, base = (
        revision_text(identity.revision) if identity is not None else ""
        for identity in (result.identity, result.base_identity)
    )
    return head, base


def revisions_text(head: str, base: str) -> str:
    """The revisions that were run, in words; empty where they are not known."""
    if head and base and head != base:
        return f"head {head}, base {base}"
    return f"revision {head}" if head else ""


def code_text(result: Result) -> str:
    """The revisions that were run; empty where they are not known."""
    return revisions_text(*revisions(result))


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


def own_pace(metrics: RunMetrics) -> str:
    """What set the rate of messages, where none was offered; else empty."""
    return next((rate.pace for rate in metrics.rates if not rate.offered_hz), "")


def loaded_rmw(result: Result) -> str:
    """The middleware (RMW implementation) of the run; empty if unknown."""
    return result.versions.get("rmw", "")


def outcome_title(verdict: Verdict) -> str:
    """The outcome in lower case, for the title of a message; of a single start it says so."""
    return f"{verdict.outcome}{' of this start' if verdict.starts == 1 else ''}"


def starts_text(starts: Sequence[StartRecord]) -> str:
    """How often all processes were started, and what that took each time; empty if unknown.

    The time is the median of the starts after the first, in which more was to be loaded, if there
    are any.
    """
    if not starts:
        return ""
    confirming = sum(start.confirms for start in starts)
    number = len(starts) - confirming
    text = f"{number} start{'s' if number > 1 else ''}"
    if confirming:
        text += f" and {confirming} to confirm"
    cost_s = statistics.median(start.cost_ns for start in (starts[1:] or starts)) / 1e9
    return f"{text}, {show(cost_s, 's', 2)}{' each' if len(starts) > 1 else ''}"


def overhead_placement(overheads: tuple[HarnessOverheadRecord, ...]) -> str:
    """Between how many processes the overhead was measured; empty in records without it."""
    processes = max((overhead.processes for overhead in overheads), default=0)
    return {1: "within one process", 2: "between two processes"}.get(processes, "")


def joined_notes(result: Result) -> Iterator[str]:
    """In which processes of the graph player and monitors ran."""
    seen = dict.fromkeys(
        (process.name, process.parts) for process in result.processes if process.parts
    )
    for name, parts in seen:
        yield (
            f"Process {name} contains the {' and the '.join(parts)} of the harness: its processor "
            "time, memory and page faults include theirs"
        )


def overhead_notes(result: Result) -> Iterator[str]:
    """With which placement of the harness the overhead was measured, and how large it is."""
    where = overhead_placement(result.harness_overhead)
    latencies_ns = [
        overhead.latency_p50_ns
        for overhead in result.harness_overhead
        if overhead.latency_p50_ns is not None
    ]
    if where and latencies_ns:
        placement = result.harness_overhead[0].placement
        overhead = show(max(latencies_ns) / 1e9, "s")
        yield (
            f"The harness overhead is about {overhead} at p50 without the load of the graph, "
            f"{where} (harness.placement: {placement}); the latencies contain it"
        )
