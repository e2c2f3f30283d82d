"""A bound on a share of messages, by the exact binomial test on the counts of all iterations."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from r2bspec.judge.decision import Answer, Decider, Question, decide
from r2bspec.judge.evidence_limits import correlation_notes, share_notes
from r2bspec.judge.methods.forecast import share_remedy
from r2bspec.judge.statistics.autocorrelation import serial_inflation
from r2bspec.judge.statistics.binomial import burst_tolerance, lower_bound, upper_bound
from r2bspec.judge.statistics.effective_sample_size import EffectiveSample, effective_sample
from r2bspec.judge.verdict import Outcome, ShareTest
from r2bspec.judge.verdict_wording import share_sentence
from r2bspec.measure.samples import MonitorSamples, starts_of


def judge_share(question: Question) -> Answer:
    """Decide a requirement on ``drop_rate``: missed outputs, of the expected ones."""
    seen = [one.monitors[question.monitor or ""] for one in question.iterations]
    sample = effective_sample(
        [np.logical_not(one.steps.answered) for one in seen], question.design(question.limit)
    )
    if not sample.n:
        return Answer(outcome="inconclusive", method="none", reason="No step was played.")
    test = share_test(
        sample,
        question.limit,
        question.confidence,
        lost=sample.bad,
        ceiling=question.is_upper_bound,
    )
    towards, against = (
        (test.upper, test.lower) if question.is_upper_bound else (test.lower, test.upper)
    )
    outcome = decide(passes=question.is_met(towards), fails=not question.is_met(against))
    return Answer(
        outcome=outcome,
        method="exact binomial",
        reason=share_sentence(question, test, outcome),
        remedy=share_remedy(question, test) if outcome == "inconclusive" else "",
        notes=_notes(question, seen, outcome),
        estimate=test.share,
        lower=test.lower,
        upper=test.upper,
        n=test.n,
        effective_n=test.effective_n,
        over=test.over,
        bursts=test.bursts,
        share=test,
    )


def _notes(question: Question, seen: Sequence[MonitorSamples], outcome: Outcome) -> tuple[str, ...]:
    """What the decision cannot know, such as how much successive starts resemble each other."""
    notes, starts = share_notes(question, outcome), starts_of(question.iterations)
    if outcome == "inconclusive":
        return notes
    several = len(set(starts)) > 1
    numbers = np.array(starts if several else range(len(seen)))
    missed = np.bincount(numbers, [one.missed for one in seen])
    expected = np.bincount(numbers, [one.expected for one in seen])
    shares = (missed[expected > 0] / expected[expected > 0]).tolist()
    pieces = "starts" if several else "iterations"
    return (*notes, *correlation_notes(pieces, len(shares), serial_inflation(shares)))


def share_test(
    sample: EffectiveSample,
    allowed: float,
    confidence: float,
    *,
    lost: int = 0,
    ceiling: bool = True,
) -> ShareTest:
    """The binomial test on counts whose effective sample size is known.

    Args:
        sample: the counts.
        allowed: the share that is allowed, or, where `ceiling` is False, required.
        confidence: of each bound by itself.
        lost: how many of the bad ones never arrived.
        ceiling: whether the share must be small.
    """
    return ShareTest(
        n=sample.n,
        effective_n=sample.messages,
        over=sample.bad,
        bursts=sample.bursts,
        clustering=sample.cause,
        lost=lost,
        share=sample.bad / sample.n,
        lower=lower_bound(sample.bad_messages, sample.messages, confidence),
        upper=upper_bound(sample.bad_messages, sample.messages, confidence),
        allowed=allowed,
        burst_tolerance=burst_tolerance(sample.bad, sample.n, allowed, confidence)
        if ceiling
        else None,
    )


DECIDER = Decider(
    takes=lambda question: question.info.statistic == "share" and not question.is_equality,
    decide=lambda question, _: judge_share(question),
)
