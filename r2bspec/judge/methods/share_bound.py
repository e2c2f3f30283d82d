"""A bound on a share of messages, by the exact binomial test on the counts of all iterations."""

from __future__ import annotations

import numpy as np

from r2bspec.judge.decision import Answer, Decider, Question, decide
from r2bspec.judge.methods.forecast import settle_share
from r2bspec.judge.statistics.binomial import lower_bound, upper_bound, withstands
from r2bspec.judge.statistics.effective_sample_size import Effective, effective
from r2bspec.judge.verdict import ShareTest
from r2bspec.judge.verdict_wording import share_sentence


def judge_share(question: Question) -> Answer:
    """Decide a requirement on ``drop_rate``: steps without an answer, of the steps sent."""
    seen = [one.monitors[question.monitor or ""] for one in question.iterations]
    worth = effective([np.logical_not(one.steps.answered) for one in seen])
    if not worth.n:
        return Answer(outcome="inconclusive", method="none", reason="No step was played.")
    test = share_test(
        worth, question.limit, question.confidence, lost=worth.bad, ceiling=question.wants_less
    )
    towards, against = (test.upper, test.lower) if question.wants_less else (test.lower, test.upper)
    outcome = decide(passes=question.holds(towards), fails=not question.holds(against))
    return Answer(
        outcome=outcome,
        method="exact binomial",
        reason=share_sentence(question, test, outcome),
        settle=settle_share(question, test) if outcome == "inconclusive" else "",
        estimate=test.share,
        lower=test.lower,
        upper=test.upper,
        n=test.n,
        effective_n=test.effective_n,
        over=test.over,
        bursts=test.bursts,
        share=test,
    )


def share_test(
    worth: Effective, allowed: float, confidence: float, *, lost: int = 0, ceiling: bool = True
) -> ShareTest:
    """The binomial test on counts whose effective number is known.

    Args:
        worth: the counts.
        allowed: the share that is allowed, or, where `ceiling` is False, demanded.
        confidence: of each bound by itself.
        lost: how many of the bad ones never arrived.
        ceiling: whether few are good.
    """
    return ShareTest(
        n=worth.n,
        effective_n=worth.messages,
        over=worth.bad,
        bursts=worth.bursts,
        clustering=worth.cause,
        lost=lost,
        share=worth.bad / worth.n,
        lower=lower_bound(worth.bad_messages, worth.messages, confidence),
        upper=upper_bound(worth.bad_messages, worth.messages, confidence),
        allowed=allowed,
        withstands=withstands(worth.bad, worth.n, allowed, confidence) if ceiling else None,
    )


DECIDER = Decider(
    takes=lambda question: question.info.statistic == "share" and not question.is_equality,
    decide=lambda question, _: judge_share(question),
)
