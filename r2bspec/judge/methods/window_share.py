"""``latency.p99 < 50 ms in 99 % of 1 s windows``: the exact binomial test over windows.

Each complete window of each iteration (`r2bspec.measure.metric_values`) has a value of the metric,
and either meets the bound or does not. At most a share 1 - SHARE of all windows may not. That is a
bound on a percentile of the windows' values, and is judged as one: with the effective number of
windows, for bad windows come in bursts as bad messages do. For a lower limit the values are
negated.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from r2bspec.judge.decision import Answer, Decider, Question, WindowCondition, decide
from r2bspec.judge.evidence_limits import share_notes
from r2bspec.judge.methods.forecast import share_remedy
from r2bspec.judge.methods.mean_bound import MAX_LOST_SHARE
from r2bspec.judge.methods.percentile_bound import percentile_notes, percentile_texts
from r2bspec.judge.methods.share_bound import share_test
from r2bspec.judge.statistics.effective_sample_size import (
    BadFlags,
    EffectiveSample,
    effective_sample,
)
from r2bspec.judge.statistics.order_statistics import (
    RankedMessages,
    allowed_share,
    percentile_interval,
)
from r2bspec.judge.verdict import Outcome, ShareTest
from r2bspec.judge.verdict_wording import counted_noun, share_sentence
from r2bspec.measure.metric_values import WindowValues, has_windows, window_values
from r2bspec.measure.samples import LOSS_SENSITIVE_FAMILIES
from r2bspec.measure.times import Seconds
from r2bspec.measure.units import show


def judge_windows(question: Question) -> Answer:
    """Decide a requirement that must be met in a share of windows, which it names."""
    windows = question.windows
    if windows is None:
        raise ValueError(f"{question.requirement.text} names no windows")
    if not has_windows(question.info):
        return Answer(
            outcome="fail",
            method="none",
            reason=f"{question.info.name} is a metric of a run, not of a window.",
        )
    worst = math.inf if question.is_upper_bound else -math.inf
    found = [
        window_values(question.info, question.monitor or "", one, windows.window_ns, worst)
        for one in question.iterations
    ]
    pieces = [np.array(one.values) for one in found]
    if not any(piece.size for piece in pieces):
        return _without_windows(question, windows, found)
    if question.is_equality:
        return _judge_equality(question, windows, pieces)
    answer = _judge_ordered(question, windows, pieces)
    return _without_lost(question, windows, found, answer)


def _without_lost(
    question: Question, windows: WindowCondition, found: list[WindowValues], answer: Answer
) -> Answer:
    """The answer with regard to lost outputs, which the mean latency of a window leaves out.

    Windows that lost more than 1 % may be slower than their means: a PASS must allow for that.
    """
    of_latency = question.info.family in LOSS_SENSITIVE_FAMILIES
    if not (of_latency and question.info.statistic == "mean" and question.is_upper_bound):
        return answer
    lossy = [np.array([share > MAX_LOST_SHARE for share in one.lost]) for one in found]
    number = sum(int(np.count_nonzero(flags)) for flags in lossy)
    if answer.outcome != "pass" or not number:
        return answer
    counted = [
        np.where(flags, math.inf, one.values) if flags.size else np.array(one.values)
        for one, flags in zip(found, lossy, strict=True)
    ]
    total = sum(len(one.values) for one in found)
    left_out = (
        f"{show(number, 'count')} of {show(total, 'count')} {counted_noun(question)} lost more "
        f"than {show(MAX_LOST_SHARE, 'share')} of their outputs, which a mean leaves out"
    )
    if _judge_ordered(question, windows, counted).outcome == "pass":
        note = f"{left_out}. If they do not count as met, the requirement passes, too."
        return replace(answer, notes=(*answer.notes, note))
    return replace(
        answer,
        outcome="inconclusive",
        reason=f"{left_out}, and without them {answer.reason[:1].lower()}{answer.reason[1:]}",
        remedy="State a percentile, in which lost outputs count, or a drop_rate.",
        notes=(),
    )


def _without_windows(
    question: Question, windows: WindowCondition, found: list[WindowValues]
) -> Answer:
    length = show(windows.window_ns / 1e9, "s")
    if any(one.without for one in found):
        reason = f"A window of {length} has too few messages for {question.info.name}."
    else:
        reason = f"No iteration is as long as a window of {length}."
    return Answer(
        outcome="inconclusive",
        method="none",
        reason=reason,
        remedy="Use longer windows, or make the iterations longer.",
    )


def _judge_ordered(question: Question, windows: WindowCondition, pieces: list[Seconds]) -> Answer:
    """The test with its bounds in the metric's unit."""
    sign = 1.0 if question.is_upper_bound else -1.0
    ranked = RankedMessages(
        [sign * piece for piece in pieces], question.design(allowed_share(windows.share))
    )
    interval = percentile_interval(ranked, windows.share, question.confidence)
    outcome = decide(
        passes=question.is_met(sign * interval.upper),
        fails=not question.is_met(sign * interval.lower),
    )
    bad = sum(int(np.count_nonzero(flags)) for flags in _bad(question, pieces))
    test = _test(question, windows, ranked.effective_sample(bad))
    lower, upper = sorted((sign * interval.lower, sign * interval.upper))
    estimate = sign * interval.estimate
    answer = _answer(question, test, outcome)
    shown = replace(interval, estimate=estimate, lower=lower, upper=upper)
    reason, remedy = percentile_texts(question, test, shown, outcome, counted_noun(question))
    return replace(
        answer,
        estimate=estimate,
        lower=lower,
        upper=upper,
        reason=reason,
        remedy=remedy,
        notes=percentile_notes(question, interval, outcome),
    )


def _judge_equality(question: Question, windows: WindowCondition, pieces: list[Seconds]) -> Answer:
    """The test alone: with == and != the windows' values have no order that matters."""
    design = question.design(allowed_share(windows.share))
    test = _test(question, windows, effective_sample(_bad(question, pieces), design))
    outcome = decide(passes=test.upper <= test.allowed, fails=test.lower > test.allowed)
    return _answer(question, test, outcome)


def _bad(question: Question, pieces: list[Seconds]) -> list[BadFlags]:
    return [
        np.array([not question.is_met(value) for value in piece], dtype=np.bool_)
        for piece in pieces
    ]


def _test(question: Question, windows: WindowCondition, sample: EffectiveSample) -> ShareTest:
    return share_test(sample, allowed_share(windows.share), question.confidence)


def _answer(question: Question, test: ShareTest, outcome: Outcome) -> Answer:
    return Answer(
        outcome=outcome,
        method="binomial over windows",
        reason=share_sentence(question, test, outcome),
        remedy=share_remedy(question, test, counted_noun(question))
        if outcome == "inconclusive"
        else "",
        notes=share_notes(question, outcome),
        n=test.n,
        effective_n=test.effective_n,
        over=test.over,
        bursts=test.bursts,
        share=test,
    )


DECIDER = Decider(
    takes=lambda question: question.windows is not None,
    decide=lambda question, _: judge_windows(question),
)
