"""What would decide a share that the messages so far leave undecided, in words."""

from __future__ import annotations

import math

from r2bspec.judge.decision import Question
from r2bspec.judge.statistics.binomial import lower_bound, messages_to_settle, upper_bound
from r2bspec.judge.verdict import ShareTest
from r2bspec.judge.verdict_wording import clustering
from r2bspec.measure.units import show

_MAX_RUN_FACTOR = 100
"""Runs more than this many times longer are not proposed."""


def settle_share(question: Question, test: ShareTest, things: str = "messages") -> str:
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
        max_messages=_MAX_RUN_FACTOR * test.effective_n,
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
