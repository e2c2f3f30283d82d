"""What would settle a share that the messages so far leave open, in words."""

from __future__ import annotations

import math

from r2bspec.measure.units import show
from r2bspec.slo.model import CONFIDENCE, ShareTest
from r2bspec.slo.question import Question
from r2bspec.slo.statistics.binomial import messages_to_settle

_MOST = 100
"""Runs more than this many times longer are not worth proposing."""


def settle_share(question: Question, test: ShareTest) -> str:
    """What would settle a binomial test that is open."""
    if test.allowed <= 0:
        return (
            "No number of messages can prove that nothing is ever lost. State what was observed "
            "(missed == 0), or allow a small share."
        )
    needed = messages_to_settle(test.share, test.allowed, CONFIDENCE, most=_MOST * test.n)
    if needed is None:
        return (
            f"The share seen ({show(test.share, 'share')}) is too close to what is allowed "
            f"({show(test.allowed, 'share')}): a longer run will hardly tell. Move the limit, or "
            "change the graph."
        )
    # The forecast goes in steps and may fall a little short of the messages there are.
    needed = max(needed, test.n + 1)
    iterations = math.ceil(needed * len(question.iterations) / test.n)
    iterations = max(iterations, len(question.iterations) + 1)
    return (
        f"About {iterations} iterations like these (some {show(needed, 'count')} messages) would "
        "settle it, if the share stays what it is."
    )
