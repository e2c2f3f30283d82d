"""The words that all reports share: the first line, requirements, the search, base and head.

The first line has the verdict, the requirement that decided it with its numbers, what is open
beside it, and what changed:

    ✘ FAIL blur: work.graph.p50 112 % [111, 114] of origin/main@9b1e44f, limit 105 % at 30 Hz;
    latency.p50 is open on this busy machine; blur.py changed

Of a FAIL it is the requirement furthest beyond its limit, of a PASS the one nearest to it, and of
an INCONCLUSIVE the open one whose estimate is nearest to its limit or furthest beyond. Where runs
are compared, a PASS names a ratio to the base before any other number.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterator, Sequence
from typing import Final

from r2bspec.diagnostics.quote import first_words, join_words, pluralize
from r2bspec.errors import split_output
from r2bspec.judge.measure.metrics import RunMetrics
from r2bspec.judge.measure.units import at_rate, show
from r2bspec.judge.methods.peak_bracket import bracket_confidence, peak_doubts
from r2bspec.judge.result import Result
from r2bspec.judge.verdict import OverallOutcome, RequirementVerdict, Verdict
from r2bspec.language.comparison_grammar import ComparisonError, Requirement, parse_requirement
from r2bspec.record.graph_identity import revision_text
from r2bspec.record.run_record import Probe, SearchRecord, StartRecord

OUTCOME_WORDS: Final[dict[OverallOutcome, str]] = {
    "pass": "✔ PASS",
    "fail": "✘ FAIL",
    "inconclusive": "? INCONCLUSIVE",
    "invalid": "! INVALID",
    "incomplete": "! INCOMPLETE",
}
"""Each outcome with its mark: never shown by colour alone."""

_NAMED_CHANGES: Final = 3
"""Changes of the code that the first line of a report names; it counts the others."""

_MAX_CHANGES: Final = 12
"""Changes of the code that are listed one by one where the first line does not name them all."""

_MOST_DIGITS: Final = 6
"""Digits of a value that looks like its limit with fewer."""

_SUSTAINED: Final = {
    "pass": "was sustained",
    "fail": "was not sustained",
    "inconclusive": "is undecided",
}


# The first line.


def headline(result: Result) -> str:
    """Return the first line of the reports of a run."""
    verdict = result.verdict
    of_start = " of this start of" if verdict.starts == 1 else ""
    line = f"{overall_word(verdict)}{of_start} {result.name}: {_decisive(result)}"
    return _with_changes(line, result)


def requirement_headline(
    verdict: RequirementVerdict, result: Result, *, name_monitor: bool = False
) -> str:
    """Return the first line for a single requirement."""
    value = _value(verdict, result, name_monitor=name_monitor)
    return _with_changes(f"{OUTCOME_WORDS[verdict.outcome]} {result.name}: {value}", result)


def reason_after(line: str, verdict: Verdict) -> str:
    """Return the verdict in one sentence, unless the first line of the report contains it."""
    reason = " ".join(split_output(verdict.reason)[0].split())
    return "" if reason.rstrip(".") in line else reason


def base_name(result: Result) -> str:
    """Return what a run was compared with, in few words; empty without a comparison."""
    pairs = result.pairs
    if pairs is None:
        return ""
    if pairs.control:
        return "itself"
    base = result.base_identity.revision if result.base_identity is not None else None
    # Without a name the user gave a spec or a folder, which says more than its commit.
    return revision_text(base) if base is not None and base.name else pairs.against


def is_busy(result: Result) -> bool:
    """Return True if other programs affected at least half of the iterations."""
    played = sum(len(rate.iterations) for rate in result.metrics.rates)
    disturbed = {one.segment for one in result.verdict.disturbed if not one.rerun_of}
    return bool(disturbed) and 2 * len(disturbed) >= played


def open_on_busy_machine(verdict: RequirementVerdict, result: Result) -> bool:
    """Return True if a requirement is open, and other programs can be the cause."""
    if verdict.outcome != "inconclusive" or verdict.estimate is None:
        return False
    return verdict.weakened or verdict.left_open or is_busy(result)


def _with_changes(line: str, result: Result) -> str:
    line, base = " ".join(line.split()), base_name(result)
    changes = first_words(result.changes, _NAMED_CHANGES) if result.changes else ""
    against = f" against {base}" if changes and base and base not in line else ""
    return f"{line}; {changes}{against}" if changes else line


def _decisive(result: Result) -> str:
    """Return the requirement that decided, with its numbers, and what is open beside it."""
    verdict = result.verdict
    counted = [requirement for requirement in verdict.requirements if requirement.level == "error"]
    if not verdict.is_judged or not counted:
        return split_output(verdict.reason)[0].rstrip(".")
    several = several_monitors(verdict)
    by_outcome: dict[str, list[RequirementVerdict]] = {"pass": [], "fail": [], "inconclusive": []}
    for requirement in counted:
        by_outcome[requirement.outcome].append(requirement)
    failed, open_, passed = (by_outcome[key] for key in ("fail", "inconclusive", "pass"))

    def value(requirement: RequirementVerdict) -> str:
        return _value(requirement, result, name_monitor=several)

    if failed:
        more = f", and {len(failed) - 1} more failed" if len(failed) > 1 else ""
        return f"{value(max(failed, key=_excess))}{more}{_beside(open_, result)}"
    ratios = [requirement for requirement in passed if requirement.compared is not None]
    blocking = [requirement for requirement in open_ if not requirement.left_open]
    if blocking:
        telling = max(blocking, key=_openness)
        number = f"{len(blocking)} of {len(counted)} open, " if len(counted) > 1 else "open is "
        if all(open_on_busy_machine(requirement, result) for requirement in blocking):
            return f"{number}{value(telling)}: not shown on this busy machine{_decided(ratios)}"
        # What would decide it is the last sentence; the table has the others.
        remedy = telling.remedy.rstrip(".").rpartition(". ")[2]
        remedy = f"; {remedy[:1].lower()}{remedy[1:]}" if remedy else ""
        return f"{number}{value(telling)}{_decided(ratios)}{remedy}"
    of_kind = ratios or passed
    if not of_kind:
        return verdict.reason.rstrip(".")
    number = f"{len(of_kind)} ratios" if ratios else f"{len(of_kind)}"
    place = f", the nearest of {number} to its limit" if len(of_kind) > 1 else ""
    return f"{value(max(of_kind, key=_used))}{place}{_beside(open_, result)}"


def _beside(open_: Sequence[RequirementVerdict], result: Result) -> str:
    """Return what is open beside a decision."""
    if not open_:
        return ""
    names = join_words([*dict.fromkeys(one.metric for one in open_)], "and")
    verb = "are" if " and " in names else "is"
    busy = any(open_on_busy_machine(one, result) for one in open_)
    return f"; {names} {verb} open{' on this busy machine' if busy else ''}"


def _decided(ratios: Sequence[RequirementVerdict]) -> str:
    """Return the ratio that is decided beside what is open, nearest to its limit."""
    if not ratios:
        return ""
    nearest = max(ratios, key=_used)
    return f"; {nearest.metric} {show(nearest.estimate, 'share')}{_spaced_interval(nearest)} passes"


def _value(verdict: RequirementVerdict, result: Result, *, name_monitor: bool) -> str:
    """Return the number that decided a requirement, next to its limit."""
    requirement = _parsed(verdict)
    at = "" if verdict.at_hz is None else f" {at_rate(verdict.at_hz, own_pace(result.metrics))}"
    if verdict.method == "sequential probe":
        return f"{show(verdict.at_hz, 'Hz')} {_SUSTAINED[verdict.outcome]}"
    if requirement is None or (verdict.estimate is None and not verdict.lost):
        text = requirement_text(verdict, name_monitor=name_monitor)
        return f"{text}{at}: {verdict.reason[:1].lower()}{verdict.reason[1:].rstrip('.')}"
    name = verdict.metric
    if name_monitor and verdict.monitor is not None:
        name = f"{verdict.monitor}.{name}"
    limit = show(verdict.limit, verdict.unit)
    if verdict.compared is not None:
        ratio = f"{show(verdict.estimate, 'share')}{_spaced_interval(verdict)}"
        return f"{name} {ratio} of {base_name(result) or 'the base'}, limit {limit}{at}"
    if verdict.lost:
        return f"{name} is a lost message{at}, limit {limit}"
    if verdict.outcome == "inconclusive":
        estimate = show(verdict.estimate, verdict.unit)
        return f"{name} {estimate}{_spaced_interval(verdict)}{at}, limit {limit}"
    return f"{name} {_relation(verdict, requirement)}{at}"


def _relation(verdict: RequirementVerdict, requirement: Requirement) -> str:
    """Return the estimate and its limit with the sign between them: ``46.4 ms > 40 ms``.

    The sign of a requirement that is met is its own, as far as it holds for the estimate.
    """
    estimate, limit = verdict.estimate or 0.0, verdict.limit
    if limit is None:
        return show(estimate, verdict.unit)
    sign = "=" if estimate == limit else ">" if estimate > limit else "<"
    operator = requirement.op
    if verdict.outcome == "pass" and operator in {"<", "<=", ">", ">="} and sign in operator:
        sign = operator
    for digits in range(3, _MOST_DIGITS + 1):
        shown, bound = (show(value, verdict.unit, digits) for value in (estimate, limit))
        if shown != bound or "=" in sign:
            break
    else:
        sign = "≈"
    return f"{shown} {sign} {bound}"


def _parsed(verdict: RequirementVerdict) -> Requirement | None:
    """Return the requirement; None for ``sustained``, and for a text that is none."""
    try:
        requirement = parse_requirement(verdict.text)
    except ComparisonError:
        return None
    return requirement if requirement.bound is not None else None


def _excess(verdict: RequirementVerdict) -> float:
    """Return how far a requirement is beyond its limit; what was not measured is furthest."""
    return math.inf if verdict.estimate is None else _share_of_limit(verdict, verdict.estimate)


def _openness(verdict: RequirementVerdict) -> float:
    """Return how far the estimate of an open requirement is; what was not measured tells least."""
    return -math.inf if verdict.estimate is None else _share_of_limit(verdict, verdict.estimate)


def _used(verdict: RequirementVerdict) -> float:
    """Return how much of the room up to its limit a requirement uses, at the end of its bounds."""
    requirement = _parsed(verdict)
    if requirement is None or verdict.estimate is None:
        return -math.inf
    end = verdict.upper if requirement.op in {"<", "<="} else verdict.lower
    return _share_of_limit(verdict, verdict.estimate if end is None else end)


def _share_of_limit(verdict: RequirementVerdict, value: float) -> float:
    """Return 1 at the limit, more beyond it.

    Ratios count from 1, what is measured against the offered rate from that rate, and other
    quantities from 0. Limits that leave no room, such as 0 messages, have no share: they come last.
    """
    requirement, limit = _parsed(verdict), verdict.limit
    if requirement is None or limit is None or requirement.op in {"==", "!="} or limit <= 0:
        return -math.inf
    bound = requirement.bound
    if verdict.compared is not None:
        return math.log(value) / math.log(limit) if value > 0 and limit != 1 else -math.inf
    if bound is not None and bound.of_offered and bound.value != 1:
        offered = limit / bound.value
        return (offered - value) / (offered - limit)
    if requirement.op in {"<", "<="}:
        return value / limit
    return limit / value if value > 0 else math.inf


# Requirements.


def overall_word(verdict: Verdict) -> str:
    """Return the outcome with its mark; a run without judged requirements has not passed."""
    if verdict.outcome == "pass" and not verdict.requirements:
        return "– NOT JUDGED"
    return OUTCOME_WORDS[verdict.outcome]


def outcome_title(verdict: Verdict) -> str:
    """Return the outcome in lower case, for the title of a message."""
    return f"{verdict.outcome}{' of this start' if verdict.starts == 1 else ''}"


def verdict_word(one: RequirementVerdict) -> str:
    """Return the outcome of a requirement, with its level if it does not fail the run."""
    word = "? OPEN" if one.left_open else OUTCOME_WORDS[one.outcome]
    if one.outcome == "pass" or one.level == "error":
        return word
    return f"{word} ({'warning' if one.level == 'warn' else 'information'})"


def sentences(one: RequirementVerdict) -> list[str]:
    """Return the reason of a verdict, its notes, and what would decide it."""
    return [text for text in (one.reason, *one.notes, one.remedy) if text]


def several_monitors(verdict: Verdict) -> bool:
    """Return True if requirements need the monitor's name to be distinguished."""
    return len({requirement.monitor for requirement in verdict.requirements} - {None}) > 1


def requirement_text(one: RequirementVerdict, *, name_monitor: bool) -> str:
    """Return the requirement as written; on request with the monitor that it left out."""
    text = one.text.strip()
    if not name_monitor or one.monitor is None or text.startswith(f"{one.monitor}."):
        return text
    return f"{one.monitor}.{text}"


def estimate_text(one: RequirementVerdict) -> str:
    """Return the estimate with its unit, or that it is a lost message."""
    return "lost" if one.lost else show(one.estimate, one.unit)


def bounds_text(one: RequirementVerdict) -> str:
    """Return the bounds: ``[111, 114]``, with a unit if the estimate has another.

    Empty if they say nothing: both are the estimate, or the only bound is 0.
    """
    if one.lower is None and one.upper is None:
        return "observed" if one.method == "observation" else ""
    if one.lower is None or one.upper is None:
        end, sign = (one.upper, "≤") if one.lower is None else (one.lower, "≥")
        return "" if sign == "≥" and end == 0 else f"[{sign} {show(end, one.unit)}]"
    ends = [show(value, one.unit) for value in (one.lower, one.upper)]
    if ends[0] == ends[1] == show(one.estimate, one.unit):
        return ""
    unit = show(one.estimate, one.unit).partition(" ")[2]
    if all(end.partition(" ")[2] == unit for end in ends):
        ends = [end.partition(" ")[0] for end in ends]
    return f"[{', '.join(ends)}]"


def _spaced_interval(one: RequirementVerdict) -> str:
    text = bounds_text(one)
    return f" {text}" if text.startswith("[") else ""


def interval_text(lower: float | None, upper: float | None, unit: str, digits: int = 3) -> str:
    """Return an interval, one-sided if only one side is bounded; empty without bounds."""
    if lower is None:
        return "" if upper is None else f"≤ {show(upper, unit, digits)}"
    if upper is None:
        return f"≥ {show(lower, unit, digits)}"
    return f"{show(lower, unit, digits)} … {show(upper, unit, digits)}"


# The search.


def probe_mark(probe: Probe) -> str:
    """Return the mark of a probe; ``~`` if it kept up, but was too short to bound the losses."""
    if probe.holds is None:
        return "~" if probe.keeps_up else "?"
    return "✔" if probe.holds else "✘"


def all_probes(metrics: RunMetrics) -> list[Probe]:
    """Return the probes of the search, then those of required rates."""
    return [*(metrics.search.probes if metrics.search is not None else ()), *metrics.sustained]


def peak_text(search: SearchRecord) -> str:
    """Return the peak as a bracket, its confidence, what limited it, and the number of probes.

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


# Base and head, code and machine.


def comparison(result: Result) -> Iterator[str]:
    """Yield sentences on gate and base for the reader."""
    yield from (f"{text[:1].upper()}{text[1:]}" for text in result.gate)
    # The first line of a report names only some of the changes.
    if len(result.changes) > _NAMED_CHANGES:
        more = len(result.changes) - _MAX_CHANGES
        others = f", {more} more" if more > 0 else ""
        yield f"Changed since the base: {', '.join(result.changes[:_MAX_CHANGES])}{others}."
    pairs = result.pairs
    if pairs is None:
        return
    noun = "start" if pairs.by_turns else "pair"
    how = "of both sides, played by turns" if pairs.by_turns else "of interleaved runs"
    played = f"{pairs.used} of {pairs.planned} {noun}s" if pairs.used < pairs.planned else ""
    what = f"Compared with {pairs.against}"
    what = "Control: the graph compared with itself" if pairs.control else what
    yield f"{what}, in {played or pluralize(pairs.used, noun)} {how}."
    base, head = result.base_identity, result.identity
    if base is not None and head is not None and base.digest == head.digest:
        yield "Base and head have loaded the same code."
    if pairs.environment:
        yield f"The environment of the base differs in {', '.join(sorted(pairs.environment))}."
    yield from (f"Difference from base to head: {difference}" for difference in pairs.differences)


def revisions(result: Result) -> tuple[str, str]:
    """Return the revisions of head and base; empty if unknown."""
    head, base = (
        revision_text(identity.revision) if identity is not None else ""
        for identity in (result.identity, result.base_identity)
    )
    return head, base


def revisions_text(head: str, base: str) -> str:
    """Return the revisions that were run, in words; empty if unknown."""
    if head and base and head != base:
        return f"head {head}, base {base}"
    return f"revision {head}" if head else ""


def code_text(result: Result) -> str:
    """Return the revisions that were run; empty if unknown."""
    return revisions_text(*revisions(result))


def code_facts(result: Result) -> dict[str, str]:
    """Return what is known of the code: the revision, each node, and each package."""
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
    """Return what set the rate of messages if none was offered; else an empty text."""
    return next((rate.pace for rate in metrics.rates if not rate.offered_hz), "")


def loaded_rmw(result: Result) -> str:
    """Return the middleware (RMW implementation) of the run; empty if unknown."""
    return result.versions.get("rmw", "")


def starts_text(starts: Sequence[StartRecord]) -> str:
    """Return how often all processes were started, and how long a start took.

    The time is the median of the starts after the first, which loads more, if there are any. Empty
    if unknown.
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
