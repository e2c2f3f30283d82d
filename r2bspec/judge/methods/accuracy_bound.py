"""A bound on accuracy: the messages of one more iteration, compared with the truth.

Every image of the recording is played once, and the same image gives the same answer as a rule. So
the value is not a sample of anything, and has no interval: it is compared with the limit.
"""

from __future__ import annotations

from r2bspec.judge.decision import Answer, Decider, Question
from r2bspec.measure.metric_catalogue import kind_of
from r2bspec.measure.units import show
from r2bspec.record.run_record import AccuracyRecord, RunRecord


def judge_accuracy(question: Question, record: RunRecord) -> Answer:
    """Decide a requirement on a metric of scope ``truth``."""
    kind = kind_of(question.info.name)
    found = next(
        (one for one in record.accuracy if one.kind == kind and one.monitor == question.monitor),
        None,
    )
    if found is None:
        return Answer(
            outcome="inconclusive",
            method="none",
            reason="The messages of this run were not compared with a truth.",
            remedy=f"Add 'truth: {{kind: {kind}, ...}}' to the monitor, and run to the end.",
        )
    if found.problem:
        return Answer(
            outcome="inconclusive",
            method="none",
            reason=found.problem,
            remedy="Use a recording with a ground truth of its images.",
        )
    value = found.values.get(question.info.name)
    if value is None:
        return Answer(
            outcome="fail",
            method="comparison with truth",
            reason=f"{question.info.name} has no value. {_extent(found)}",
            n=found.outputs,
        )
    return Answer(
        outcome="pass" if question.is_met(value) else "fail",
        method="comparison with truth",
        reason=f"{question.info.name} is {show(value, question.info.unit)}. {_extent(found)}",
        estimate=value,
        n=found.outputs,
    )


def _extent(found: AccuracyRecord) -> str:
    answers = f"{found.outputs:,} of {found.steps:,} steps were answered and compared."
    return f"{found.text} {answers}".strip()


DECIDER = Decider(
    takes=lambda question: question.info.scope == "truth",
    decide=judge_accuracy,
    needs_iterations=False,
)
