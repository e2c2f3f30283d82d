"""A run against earlier runs: a history gates, a stored run advises.

A FAIL by a history is confirmed by a fresh run before it counts, as one by a single batch is
(`r2bspec.judge.confirmation`), but at the full confidence. The fresh run meets the same history:
one whose mean happens to be low, or whose runs happen to be alike, fails both. Of unchanged graphs
exactly on the limit, with histories of m normal runs, both runs fail in (% of 400,000)

    second at    m = 5    m = 10    m = 30
    90 %          1.36      0.92      0.62
    95 %          0.92      0.55      0.34

and at most 1 % is what is promised.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Final

import msgspec

from r2bspec.judge.baseline_ratio import advise_by_stored_run, judge_history
from r2bspec.judge.baseline_requirements import (
    BaselineQuestion,
    iteration_values,
    judge_baseline_requirements,
    run_value,
    with_requirement_verdicts,
)
from r2bspec.judge.confirmation import confirm_requirement
from r2bspec.judge.decision_policy import DecisionPolicy
from r2bspec.judge.judge_samples import judge
from r2bspec.judge.verdict import RequirementVerdict, Verdict
from r2bspec.language.confidence import CONFIDENCE
from r2bspec.language.spec import Objective
from r2bspec.measure.samples import RunSamples
from r2bspec.record.baseline_file import BaselineRecord

Objectives = Mapping[str, Objective]

HISTORY_CONFIRMATION_CONFIDENCE: Final = CONFIDENCE
"""The confidence at which a fresh run is judged by the history that the first one failed by."""


def judge_with_baseline(
    verdict: Verdict,
    objectives: Objectives,
    samples: RunSamples,
    fresh: RunSamples | None,
    policy: DecisionPolicy,
    baseline: BaselineRecord,
) -> Verdict:
    """A verdict whose requirements of the baseline are answered by earlier runs.

    Args:
        verdict: on the run by itself.
        objectives: that were judged.
        samples: the run.
        fresh: a fresh run that was made because it fails by the history, if one was.
        policy: by which it was judged.
        baseline: the baseline runs.
    """
    found = compare_with_baseline(verdict, objectives, samples, policy, baseline)
    if not fails_by_history(found) or found.outcome in {"invalid", "incomplete"}:
        return found
    if fresh is None:
        return msgspec.structs.replace(
            found, reason=f"{found.reason} No fresh run was made to confirm it."
        )
    asked = {
        name: msgspec.structs.replace(objective, confidence=None)
        for name, objective in objectives.items()
    }
    alike = replace(policy, confidence=HISTORY_CONFIRMATION_CONFIDENCE, looks=None)
    again = compare_with_baseline(judge(asked, fresh, alike), asked, fresh, alike, baseline)
    usable = () if again.outcome in {"invalid", "incomplete"} else again.requirements
    second = {_key(one): one for one in usable}
    # What failed by the run itself has been confirmed, or not, by a batch of that run.
    requirements = tuple(
        confirm_requirement(one, second.get(_key(one)))
        if one.method == "prediction interval"
        else one
        for one in found.requirements
    )
    confirmed = with_requirement_verdicts(found, requirements, policy)
    said = "confirmed" if fails_by_history(confirmed) else "did not confirm"
    return msgspec.structs.replace(
        confirmed, reason=f"{confirmed.reason} A fresh run {said} what the history shows."
    )


def compare_with_baseline(
    verdict: Verdict,
    objectives: Objectives,
    samples: RunSamples,
    policy: DecisionPolicy,
    baseline: BaselineRecord,
) -> Verdict:
    """The same without a thought of confirming it."""
    return judge_baseline_requirements(
        verdict, objectives, samples, policy, lambda asked: _answer(asked, samples, baseline)
    )


def fails_by_history(verdict: Verdict) -> bool:
    """Whether a verdict is a FAIL that a fresh run has to confirm."""
    return any(
        one.outcome == "fail" and one.level == "error" and one.method == "prediction interval"
        for one in verdict.requirements
    )


def _answer(
    asked: BaselineQuestion, samples: RunSamples, baseline: BaselineRecord
) -> RequirementVerdict:
    one = asked.comparison
    before = baseline.find(one.at_hz, one.monitor, one.metric)
    if baseline.kind == "history":
        return judge_history(one, before, run_value(asked.info, one.monitor, one.at_hz, samples))
    return advise_by_stored_run(
        one, before, iteration_values(asked.info, one.monitor, one.at_hz, samples)
    )


def _key(one: RequirementVerdict) -> tuple[str, str, str | None, float | None]:
    return one.objective, one.text, one.monitor, one.at_hz
