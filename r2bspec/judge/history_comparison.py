"""Compares a run with earlier runs: a history gates, a stored run is advisory.

A FAIL by a history is confirmed by a second run before it counts, as one by a single session is
(`r2bspec.judge.confirmation`), but at the full confidence. The second run is compared with the same
history: one whose mean is low by chance, or whose runs are alike by chance, fails both. Of
unchanged graphs exactly on the limit, with histories of m normal runs, both runs fail in (% of
400,000)

    second at    m = 5    m = 10    m = 30
    90 %          1.36      0.92      0.62
    95 %          0.92      0.55      0.34

and the promise is at most 1 %.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Final

import msgspec

from r2bspec.judge.baseline_ratio import StoredValues, advise_by_stored_run, judge_history
from r2bspec.judge.baseline_requirements import (
    BaselineQuestion,
    iteration_values,
    judge_baseline_requirements,
    run_value,
    with_requirement_verdicts,
)
from r2bspec.judge.confirmation import confirm_requirement
from r2bspec.judge.decision_policy import DecisionPolicy
from r2bspec.judge.judge_requirement import iterations_at
from r2bspec.judge.judge_samples import judge
from r2bspec.judge.verdict import RequirementVerdict, Verdict
from r2bspec.language.benchmark_defaults import CONFIDENCE
from r2bspec.language.spec import Objective
from r2bspec.measure.samples import RunSamples, starts_of
from r2bspec.record.baseline_file import BaselineRecord

Objectives = Mapping[str, Objective]

_CONFIRMED = "A second run confirmed the comparison with the history."
_NO_SECOND_RUN = "No second run was made to confirm it."
_NOT_COUNTED = "With 'gate.confirm: false' the second run does not count."
_NOT_CONFIRMED = "A second run did not confirm the comparison with the history."

HISTORY_CONFIRMATION_CONFIDENCE: Final = CONFIDENCE
"""The confidence at which the second run is judged by the same history."""


def judge_with_baseline(
    verdict: Verdict,
    objectives: Objectives,
    samples: RunSamples,
    fresh: RunSamples | None,
    policy: DecisionPolicy,
    baseline: BaselineRecord,
) -> Verdict:
    """A verdict whose requirements of the baseline are judged by earlier runs.

    Args:
        verdict: on the run by itself.
        objectives: that were judged.
        samples: the run.
        fresh: the second run that was made because the first fails by the history, if any.
        policy: by which it was judged.
        baseline: the baseline runs.
    """
    found = compare_with_baseline(verdict, objectives, samples, policy, baseline)
    if not fails_by_history(found) or found.outcome in {"invalid", "incomplete"}:
        return found
    if fresh is None or not policy.confirm:
        sentence = _NO_SECOND_RUN if fresh is None else _NOT_COUNTED
        return msgspec.structs.replace(found, reason=f"{found.reason} {sentence}")
    at_policy_confidence = {
        name: msgspec.structs.replace(objective, confidence=None)
        for name, objective in objectives.items()
    }
    alike = replace(policy, confidence=HISTORY_CONFIRMATION_CONFIDENCE, looks=None)
    second_verdict = compare_with_baseline(
        judge(at_policy_confidence, fresh, alike), at_policy_confidence, fresh, alike, baseline
    )
    usable = (
        () if second_verdict.outcome in {"invalid", "incomplete"} else second_verdict.requirements
    )
    second = {_key(one): one for one in usable}
    # What failed without the history has had its own confirmation session.
    requirements = tuple(
        confirm_requirement(one, second.get(_key(one)))
        if one.method == "prediction interval"
        else one
        for one in found.requirements
    )
    confirmed = with_requirement_verdicts(found, requirements, policy)
    sentence = _CONFIRMED if fails_by_history(confirmed) else _NOT_CONFIRMED
    return msgspec.structs.replace(confirmed, reason=f"{confirmed.reason} {sentence}")


def compare_with_baseline(
    verdict: Verdict,
    objectives: Objectives,
    samples: RunSamples,
    policy: DecisionPolicy,
    baseline: BaselineRecord,
) -> Verdict:
    """The same without confirmation."""
    return judge_baseline_requirements(
        verdict, objectives, samples, policy, lambda question: _answer(question, samples, baseline)
    )


def fails_by_history(verdict: Verdict) -> bool:
    """Whether a verdict is a FAIL that a second run has to confirm."""
    return any(
        one.outcome == "fail" and one.level == "error" and one.method == "prediction interval"
        for one in verdict.requirements
    )


def _answer(
    question: BaselineQuestion, samples: RunSamples, baseline: BaselineRecord
) -> RequirementVerdict:
    one = question.comparison
    before = baseline.find(one.at_hz, one.monitor, one.metric)
    if baseline.kind == "history":
        new = run_value(question.info, one.monitor, one.at_hz, samples)
        return judge_history(one, before.values, new)
    return advise_by_stored_run(
        one,
        StoredValues(before.values, before.starts),
        StoredValues(
            iteration_values(question.info, one.monitor, one.at_hz, samples),
            starts_of(iterations_at(samples.iterations, one.at_hz)),
        ),
    )


def _key(one: RequirementVerdict) -> tuple[str, str, str | None, float | None]:
    return one.objective, one.text, one.monitor, one.at_hz
