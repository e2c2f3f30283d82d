"""What would decide a share that the messages so far leave undecided, in words."""

from __future__ import annotations

import math

from r2bspec.judge.decision import Question
from r2bspec.judge.statistics.binomial import (
    lower_bound,
    messages_to_settle,
    upper_bound,
)
from r2bspec.judge.statistics.level_interval import LevelMargin
from r2bspec.judge.statistics.order_statistics import PercentileInterval
from r2bspec.judge.statistics.rule_of_three import min_sample_size
from r2bspec.judge.statistics.t_interval import iterations_to_settle
from r2bspec.judge.verdict import ShareTest
from r2bspec.judge.verdict_wording import clustering
from r2bspec.measure.units import show

_MAX_RUN_FACTOR = 100
"""Runs more than this many times longer are not proposed, unless they need so few messages that
none over the limit would settle it."""

_LARGER = 1.1
"""The forecast goes in steps of 5 %."""

_MAX_LEVELS = 200
"""More iterations or starts than this are not proposed."""


def share_remedy(question: Question, test: ShareTest, things: str = "messages") -> str:
    """What would decide a binomial test that is undecided."""
    if test.allowed <= 0:
        return (
            "No number of messages can prove that none is ever lost. Require an observed count "
            "(missed == 0), or allow a small share."
        )
    inflation = test.n / test.effective_n
    needed = messages_to_settle(
        test.share,
        test.allowed,
        question.confidence,
        max_messages=max(
            _MAX_RUN_FACTOR * test.effective_n,
            _LARGER * (min_sample_size(test.allowed, question.confidence) or 0),
        ),
    )
    if needed is None:
        return (
            f"The observed share ({show(test.share, 'share')}) is too close to the allowed one "
            f"({show(test.allowed, 'share')}) for a longer run to decide. Change the limit or the "
            "graph."
        )
    # The forecast goes in steps and may fall a little short of the messages there are.
    needed = max(math.ceil(needed * inflation), test.n + 1)
    iterations = math.ceil(needed * len(question.iterations) / test.n)
    iterations = max(iterations, len(question.iterations) + 1)
    return (
        f"{_clustering_note(question, test, things)}About {iterations} iterations like these ("
        f"{show(needed, 'count')} {things}) would decide it, if the share stays the same."
    )


def levels_remedy(question: Question, interval: PercentileInterval, levels: LevelMargin) -> str:
    """What would decide a percentile that only the levels of iterations or starts leave open."""
    needed = iterations_to_settle(
        interval.estimate, levels.deviation, question.limit, question.confidence, _MAX_LEVELS
    )
    if needed is None:
        return (
            f"The percentile is too close to {question.limit_text} for {levels.pieces} that differ "
            f"by {show(levels.deviation, question.info.unit)}: change the limit, or use a quieter "
            "machine."
        )
    needed = max(needed, levels.number + 1)
    return f"About {needed} {levels.pieces} would decide it, if they differ by as much."


def _clustering_note(question: Question, test: ShareTest, things: str) -> str:
    """That clustering leaves the test undecided, where it does."""
    counts = test.over, test.n, question.confidence
    if test.effective_n >= test.n:
        return ""
    if upper_bound(*counts) <= test.allowed or lower_bound(*counts) > test.allowed:
        return (
            f"As many independent {things} would have decided it, but those over the limit come "
            f"{clustering(test)}. "
        )
    return ""
