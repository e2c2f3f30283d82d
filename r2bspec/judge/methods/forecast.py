"""What would settle a share that the messages so far leave open, in words."""

from __future__ import annotations

import math

from r2bspec.judge.decision import Question
from r2bspec.judge.statistics.binomial import lower_bound, messages_to_settle, upper_bound
from r2bspec.judge.verdict import ShareTest
from r2bspec.judge.verdict_wording import clustering
from r2bspec.measure.units import show

_MAX_RUN_FACTOR = 100
"""Runs more than this many times longer are not worth proposing."""


def settle_share(question: Question, test: ShareTest, things: str = "messages") -> str:
    """What would settle a binomial test that is open."""
    if test.allowed <= 0:
        return (
            "No number of messages can prove that nothing is ever lost. State what was observed "
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
            f"The share seen ({show(test.share, 'share')}) is too close to what is allowed "
            f"({show(test.allowed, 'share')}): a longer run will hardly tell. Move the limit, or "
            "change the graph."
        )
    # The forecast goes in steps and may fall a little short of the messages there are.
    needed = max(math.ceil(needed * inflation), test.n + 1)
    iterations = math.ceil(needed * len(question.iterations) / test.n)
    iterations = max(iterations, len(question.iterations) + 1)
    return (
        f"{_clustering_note(question, test, things)}About {iterations} iterations like these (some "
        f"{show(needed, 'count')} {things}) would settle it, if the share stays what it is."
    )


def _clustering_note(question: Question, test: ShareTest, things: str) -> str:
    """That it is the bursts which leave it open, where it is."""
    counts = test.over, test.n, question.confidence
    if test.effective_n >= test.n:
        return ""
    if upper_bound(*counts) <= test.allowed or lower_bound(*counts) > test.allowed:
        return (
            f"As many {things} one by one would have decided, but these come {clustering(test)}, "
            "and another run may meet more of them, or fewer. "
        )
    return ""
