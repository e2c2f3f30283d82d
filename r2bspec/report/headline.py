"""The first line of every report: the verdict, the one number that decided it, and what changed.

    ✘ FAIL blur: latency.p99 46.4 ms > 40 ms at 30 Hz; blur.py changed against origin/main@9b1e44f

Of a FAIL it is the requirement furthest beyond its limit, of a PASS the one nearest to it, and of
an INCONCLUSIVE the first that is open, with what would decide it. Where runs are compared, a PASS
names a ratio to the base before any other number. A ratio is written with its interval:
``latency.p50 116 % [114, 119] of main@9b1e44f, limit 107 %``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from r2bspec.diagnostics.quote import first_words
from r2bspec.judge.measure.units import at_rate, show
from r2bspec.judge.result import Result
from r2bspec.judge.verdict import RequirementVerdict, Verdict
from r2bspec.language.comparison_grammar import ComparisonError, Requirement, parse_requirement
from r2bspec.record.graph_identity import revision_text
from r2bspec.report import report_wording as wording

_MOST_DIGITS: Final = 6
"""Digits of a value that looks like its limit with fewer."""

_SUSTAINED: Final = {
    "pass": "was sustained",
    "fail": "was not sustained",
    "inconclusive": "was neither shown to be sustained nor not to be",
}


def headline(result: Result) -> str:
    """The first line of the reports of a run: the verdict and the number that decided it."""
    verdict, base = result.verdict, base_name(result)
    of_start = " of this start of" if verdict.starts == 1 else ""
    decisive = _decisive(verdict, base, wording.own_pace(result.metrics))
    text = f"{wording.overall_word(verdict)}{of_start} {result.name}: {decisive}"
    return _with_changes(" ".join(text.split()), result, base)


def requirement_headline(
    verdict: RequirementVerdict, result: Result, *, name_monitor: bool = False
) -> str:
    """The same line about one requirement, for a report that shows each by itself."""
    base = base_name(result)
    value = _value(verdict, base, wording.own_pace(result.metrics), name_monitor=name_monitor)
    text = f"{wording.OUTCOME_WORDS[verdict.outcome]} {result.name}: {value}"
    return _with_changes(" ".join(text.split()), result, base)


def _with_changes(line: str, result: Result, base: str) -> str:
    """The line with what changed; the base is named once."""
    changes = changes_text(result.changes, "" if base in line else base)
    return "; ".join(filter(None, [line, changes]))


def reason_after(line: str, verdict: Verdict) -> str:
    """The verdict in one sentence, unless the first line of the report has said it."""
    reason = " ".join(verdict.reason.split())
    return "" if reason.rstrip(".") in line else reason


def base_name(result: Result) -> str:
    """What a run was compared with, in few words; empty where it was not compared."""
    pairs = result.pairs
    base = result.base_identity.revision if result.base_identity is not None else None
    if pairs is not None:
        if pairs.control:
            return "itself"
        # Without a name the user gave a spec or a folder, which says more than its commit.
        return revision_text(base) if base is not None and base.name else pairs.against
    return ""


def changes_text(changes: Sequence[str], base: str) -> str:
    """What differs from the base, such as ``blur.py changed against origin/main@9b1e44f``."""
    if not changes:
        return ""
    named = first_words(changes, wording.NAMED_CHANGES)
    return f"{named}{f' against {base}' if base else ''}"


def _decisive(verdict: Verdict, base: str, pace: str) -> str:
    counted = [requirement for requirement in verdict.requirements if requirement.level == "error"]
    if verdict.outcome in {"invalid", "incomplete"} or not counted:
        return verdict.reason.rstrip(".")
    several = wording.several_monitors(verdict)

    def value(requirement: RequirementVerdict) -> str:
        return _value(requirement, base, pace, name_monitor=several)

    failed = [requirement for requirement in counted if requirement.outcome == "fail"]
    if failed:
        worst = max(failed, key=_excess)
        more = f", and {len(failed) - 1} more failed"
        return f"{value(worst)}{more if len(failed) > 1 else ''}"
    undecided = [requirement for requirement in counted if requirement.outcome == "inconclusive"]
    if undecided:
        first = undecided[0]
        number = f"{len(undecided)} of {len(counted)} open, " if len(counted) > 1 else "open is "
        # What would decide it is the last sentence; the table has the others.
        remedy = first.remedy.rstrip(".").rpartition(". ")[2]
        remedy = f"{remedy[:1].lower()}{remedy[1:]}"
        return f"{number}{value(first)}{f'; {remedy}' if remedy else ''}"
    ratios = [requirement for requirement in counted if requirement.compared is not None]
    of_kind = ratios or counted
    nearest = max(of_kind, key=_used)
    number = f"{len(of_kind)} ratios" if ratios else f"{len(of_kind)}"
    place = f", the nearest of {number} to its limit" if len(of_kind) > 1 else ""
    return f"{value(nearest)}{place}"


def _value(verdict: RequirementVerdict, base: str, pace: str, *, name_monitor: bool) -> str:
    """The number that decided a requirement, next to its limit."""
    requirement = _parsed(verdict)
    at = "" if verdict.at_hz is None else f" {at_rate(verdict.at_hz, pace)}"
    if verdict.method == "sequential probe":
        return f"{show(verdict.at_hz, 'Hz')} {_SUSTAINED[verdict.outcome]}"
    if requirement is None or (verdict.estimate is None and not verdict.lost):
        text = wording.requirement_text(verdict, name_monitor=name_monitor)
        return f"{text}{at}: {verdict.reason[:1].lower()}{verdict.reason[1:].rstrip('.')}"
    name = verdict.metric
    if name_monitor and verdict.monitor is not None:
        name = f"{verdict.monitor}.{name}"
    limit = show(verdict.limit, verdict.unit)
    if verdict.compared is not None:
        of = f" of {base}" if base else " of the base"
        return (
            f"{name} {show(verdict.estimate, 'share')}{_interval(verdict)}{of}, limit {limit}{at}"
        )
    windows = ""
    if requirement.windows_share is not None:
        share = show(requirement.windows_share, "share", 6)
        windows = f" in {share} of {show(requirement.window_ns / 1e9, 's')} windows"
    if verdict.lost:
        return f"{name} is that of a lost message{windows}{at}, limit {limit}"
    if verdict.outcome == "inconclusive":
        estimate = show(verdict.estimate, verdict.unit)
        return f"{name} {estimate}{_interval(verdict)}{windows}{at}, limit {limit}"
    return f"{name} {_relation(verdict, requirement)}{windows}{at}"


def _relation(verdict: RequirementVerdict, requirement: Requirement) -> str:
    """The estimate and its limit with the sign between them: ``46.4 ms > 40 ms``.

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


def _interval(verdict: RequirementVerdict) -> str:
    """The bounds in brackets, with the unit where the estimate does not share it."""
    if verdict.lower is None or verdict.upper is None:
        text = wording.interval_text(verdict.lower, verdict.upper, verdict.unit)
        return f" [{text}]" if text else ""
    ends = [show(value, verdict.unit) for value in (verdict.lower, verdict.upper)]
    unit = show(verdict.estimate, verdict.unit).partition(" ")[2]
    if all(end.partition(" ")[2] == unit for end in ends):
        ends = [end.partition(" ")[0] for end in ends]
    return f" [{', '.join(ends)}]"


def _parsed(verdict: RequirementVerdict) -> Requirement | None:
    """The requirement; None for ``sustained``, and for a text that is none."""
    try:
        requirement = parse_requirement(verdict.text)
    except ComparisonError:
        return None
    return requirement if requirement.bound is not None else None


def _excess(verdict: RequirementVerdict) -> float:
    """How far a failed requirement is beyond its limit; what was not measured is furthest."""
    if verdict.estimate is None:
        return math.inf
    return _share_of_limit(verdict, verdict.estimate)


def _used(verdict: RequirementVerdict) -> float:
    """How much of the room up to its limit a requirement uses, at the end of its interval."""
    requirement = _parsed(verdict)
    if requirement is None or verdict.estimate is None:
        return -math.inf
    end = verdict.upper if requirement.op in {"<", "<="} else verdict.lower
    return _share_of_limit(verdict, verdict.estimate if end is None else end)


def _share_of_limit(verdict: RequirementVerdict, value: float) -> float:
    """1 at the limit, more beyond it.

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
