"""The sentences in which a verdict about a share or a percentile gives its reason."""

from __future__ import annotations

from typing import TYPE_CHECKING

from r2bspec.judge.measure.units import show
from r2bspec.judge.statistics.percentile_interval import LevelMargin, PercentileInterval
from r2bspec.judge.verdict import Outcome, ShareTest

if TYPE_CHECKING:
    from r2bspec.judge.requirement_case import RequirementCase

_MIN_EFFECTIVE_SHARE = 0.95
_MIN_WHOLE_COUNT = 10


def counted_noun(case: RequirementCase) -> str:
    """What is counted for a metric, in the plural."""
    if case.in_windows:
        return f"windows of {show(case.requirement.window_ns / 1e9, 's')}"
    return case.info.metric.noun


def share_sentence(case: RequirementCase, test: ShareTest, outcome: Outcome) -> str:
    """How many are on the wrong side of the limit, what that shows, and how many are allowed."""
    seen = (
        f"{show(test.over, 'count')} of {show(test.n, 'count')} {counted_noun(case)} "
        f"({_percent(test.share)}) {_wrong_side(case, test)}{_effective_size_text(test)}"
    )
    sure = f"at {case.confidence_text}"
    lower, upper = _percent(test.lower), _percent(test.upper)
    allowed = show(test.allowed, "share", 6)
    # A lower bound on a share (drop_rate > x) needs many; every other requirement allows a few.
    needs_many = not case.in_windows and case.info.quantile is None and not case.is_upper_bound
    needed = f"and more than {allowed} is required" if needs_many else f"and {allowed} is allowed"
    if outcome == "inconclusive":
        return f"{seen}; {sure} the true share is {lower} to {upper}, {needed}."
    if (outcome == "pass") != needs_many:
        return f"{seen}; {sure} the true share is at most {upper}, {needed}."
    return f"{seen}; {sure} the true share is at least {lower}, {needed}."


def level_sentence(case: RequirementCase, interval: PercentileInterval, levels: LevelMargin) -> str:
    """That iterations or starts differ by too much for a percentile to be decided."""
    unit = case.info.unit
    return (
        f"{case.info.name} is {show(interval.estimate, unit)}, but the {levels.number} "
        f"{levels.pieces} differ by {show(levels.deviation, unit)} (standard deviation); at "
        f"{case.confidence_text} it is {show(interval.lower, unit)} to "
        f"{show(interval.upper, unit)}, which includes the limit {case.limit_text}."
    )


def _effective_size_text(test: ShareTest) -> str:
    """Return the effective sample size, where starts, iterations or stretches differ."""
    n = test.effective_n
    if n > _MIN_EFFECTIVE_SHARE * test.n:
        return ""
    size = show(n, "count") if n >= _MIN_WHOLE_COUNT else show(n, "", 2)
    return (
        f", judged by the scatter of the {test.differ} (effective sample size {size} of "
        f"{show(test.n, 'count')})"
    )


def _wrong_side(case: RequirementCase, test: ShareTest) -> str:
    if case.in_windows:
        return f"do not meet {case.metric_text}"
    if case.info.statistic == "share":
        return "got no output"
    side = "over" if case.is_upper_bound else "under"
    lost = f", including {show(test.lost, 'count')} lost" if test.lost else ""
    return f"are {side} {case.limit_text}{lost}"


def _percent(share: float) -> str:
    """A share with two digits; a share below 1 is never written as 100 %."""
    text = show(share, "share", 2)
    return text if text != "100 %" or share == 1 else show(min(share, 0.999), "share")


def counts_decide(test: ShareTest) -> bool:
    """Whether the counts alone decide."""
    return test.upper <= test.allowed or test.lower > test.allowed
