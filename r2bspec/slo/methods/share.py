"""A bound on a share of messages, by the exact binomial test on the counts of all iterations."""

from __future__ import annotations

from r2bspec.slo.methods.forecast import settle_share
from r2bspec.slo.model import CONFIDENCE, ShareTest
from r2bspec.slo.question import Answer, Question, decide
from r2bspec.slo.statistics.binomial import lower_bound, upper_bound
from r2bspec.slo.wording import share_sentence


def judge_share(question: Question) -> Answer:
    """Decide a requirement on ``drop_rate``: steps without an answer, of the steps sent."""
    seen = [one.monitors[question.monitor or ""] for one in question.iterations]
    n, missed = sum(one.sent for one in seen), sum(one.missed for one in seen)
    if not n:
        return Answer(outcome="inconclusive", method="none", reason="No step was played.")
    test = ShareTest(
        n=n,
        over=missed,
        lost=missed,
        share=missed / n,
        lower=lower_bound(missed, n, CONFIDENCE),
        upper=upper_bound(missed, n, CONFIDENCE),
        allowed=question.limit,
    )
    if question.wants_less:
        outcome = decide(passes=question.holds(test.upper), fails=not question.holds(test.lower))
    else:
        outcome = decide(passes=question.holds(test.lower), fails=not question.holds(test.upper))
    return Answer(
        outcome=outcome,
        method="exact binomial",
        reason=share_sentence(question, test, outcome),
        settle=settle_share(question, test) if outcome == "inconclusive" else "",
        estimate=test.share,
        lower=test.lower,
        upper=test.upper,
        n=n,
        over=missed,
        share=test,
    )
