"""From a run to its result, and the result as JSON.

The same run gives the same bytes whenever and wherever it is judged: nothing in a result depends
on the machine or the moment of judging.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Final

import msgspec

from r2bspec.diagnostics.plain_text import escaped_json
from r2bspec.judge.confirmation import confirm_run, needs_confirmation
from r2bspec.judge.decision_policy import DecisionPolicy, decision_policy, without_own_confidence
from r2bspec.judge.measure.anatomy_summary import AnatomySummary, anatomy_summaries
from r2bspec.judge.measure.metrics import RunMetrics, summarise
from r2bspec.judge.measure.run_samples import read_samples
from r2bspec.judge.measure.samples import RunSamples
from r2bspec.judge.methods.peak_bracket import with_refuted_peak
from r2bspec.judge.pipeline import judge
from r2bspec.judge.result import ObjectiveText, PairsResult, Result
from r2bspec.judge.verdict import Verdict
from r2bspec.language.benchmark_defaults import CONFIRMATION_CONFIDENCE
from r2bspec.language.spec import Objective
from r2bspec.plan.plan import GatePlan
from r2bspec.record.graph_identity import GraphIdentity, identity_differences
from r2bspec.record.run_folder import Run
from r2bspec.record.run_record import RunRecord
from r2bspec.safe_io.safe_json import decode_json

_CONFIRMED = "Confirmed by a second run in new processes."
_NOT_CONFIRMED = "It had failed, but a second run in new processes did not confirm the failure."
_NOT_PLAYED_AGAIN = "No second run was made to confirm it."
_NOT_COUNTED = "With 'gate.confirm: false' its second run does not count."


def result_of(
    run: Run,
    objectives: Mapping[str, Objective] | None = None,
    judged_by: str = "",
    gate: GatePlan | None = None,
    samples: RunSamples | None = None,
) -> Result:
    """Measure and judge a run.

    Args:
        run: the opened run.
        objectives: to judge it by; the run's own objectives if None.
        judged_by: the name of the spec of `objectives`, if it is another.
        gate: of that spec; the run's own gate if None.
        samples: of the run, where they have been read.

    Raises:
        RecordError: a file of the run is missing or damaged.
    """
    samples = samples or read_samples(run)
    objectives = run.plan.objectives if objectives is None else objectives
    policy = decision_policy(run.plan, gate)
    verdict = judge_with_confirmation(objectives, samples, policy)
    return build_result(
        run,
        objectives,
        judged_by,
        metrics=summarise(with_refuted_peak(samples)),
        verdict=verdict,
        anatomies=anatomy_summaries(run, samples.summaries),
    )


def judge_with_confirmation(
    objectives: Mapping[str, Objective], samples: RunSamples, policy: DecisionPolicy
) -> Verdict:
    """Judge a run and, if it fails, the confirmation session that was played after it.

    A pure function, like `judge`. The reason of a FAIL says whether it was confirmed; without a
    confirmation session the FAIL counts.

    Args:
        objectives: by name.
        samples: the run.
        policy: of the first session.
    """
    first = judge(objectives, samples, policy)
    if not needs_confirmation(first):
        return first
    if samples.confirmation is None:
        return first.saying(_NOT_PLAYED_AGAIN)
    if not policy.confirm:
        return first.saying(_NOT_COUNTED)
    second = judge_confirmation(objectives, samples.confirmation, first, policy)
    verdict = confirm_run(first, second, policy.inconclusive)
    verdict = verdict.saying(_CONFIRMED if needs_confirmation(verdict) else _NOT_CONFIRMED)
    return msgspec.structs.replace(verdict, disturbed=(*first.disturbed, *second.disturbed))


def judge_confirmation(
    objectives: Mapping[str, Objective],
    confirmation: RunSamples,
    first: Verdict,
    policy: DecisionPolicy,
) -> Verdict:
    """Judge the confirmation session alone, at `CONFIRMATION_CONFIDENCE`, with its looks.

    Args:
        objectives: by name.
        confirmation: the confirmation session.
        first: the verdict on the first session; only what failed there is judged again.
        policy: of the first session.
    """
    # One start plays as many iterations as have failed, and is judged once.
    looks = policy.looks if policy.looks is not None and policy.looks.after_starts else None
    policy = replace(policy, confidence=CONFIRMATION_CONFIDENCE, looks=looks)
    verdict = judge(without_own_confidence(objectives), confirmation, policy)
    failed = first.failed_keys
    judged_again = tuple(one for one in verdict.requirements if one.key in failed)
    return msgspec.structs.replace(verdict, requirements=judged_again)


_OF_RECORD: Final = (
    *("run_id", "status", "reason", "started_at", "ended_at", "plan_hash"),
    *("dataset", "machine", "versions", "processes", "output_gaps"),
    *("differences", "left_out", "starts", "unplayed", "profiles", "identity", "gate"),
)
"""What a result has as the record of its run has it."""


def build_result(
    run: Run,
    objectives: Mapping[str, Objective],
    judged_by: str,
    *,
    metrics: RunMetrics,
    verdict: Verdict,
    pairs: PairsResult | None = None,
    base_identity: GraphIdentity | None = None,
    anatomies: tuple[AnatomySummary, ...] = (),
) -> Result:
    """Return the result of one or several runs that have been measured and judged."""
    record, plan = run.record, run.plan
    changes: tuple[str, ...] = ()
    if base_identity is not None and record.identity is not None:
        changes = identity_differences(base_identity, record.identity)
    return Result(
        name=plan.name,
        title=plan.title,
        labels=plan.labels,
        monitor_labels={monitor.name: monitor.label for monitor in plan.monitors if monitor.label},
        spec=run.spec_text(),
        judged_by=judged_by,
        objectives={
            name: ObjectiveText(
                at=str(objective.at) if objective.at is not None else "",
                require=tuple(requirement.text for requirement in objective.require),
            )
            for name, objective in objectives.items()
        },
        metrics=metrics,
        verdict=_on_what_was_played(verdict, record),
        pairs=pairs,
        anatomies=anatomies or msgspec.UNSET,
        load=plan.load or msgspec.UNSET,
        base_identity=base_identity,
        changes=changes,
        **{name: getattr(record, name) for name in _OF_RECORD},
    )


def _on_what_was_played(verdict: Verdict, record: RunRecord) -> Verdict:
    """The verdict, saying which messages it is not about, where these are more than a few."""
    missing = [requirement.text for requirement in record.unplayed if requirement.is_warning]
    return verdict.saying(f"{'; '.join(missing)}.") if missing else verdict


def to_json(result: Result) -> bytes:
    """Return the content of ``result.json``: fields in declared order, two spaces, a newline."""
    return escaped_json(msgspec.json.format(msgspec.json.encode(result), indent=2) + b"\n")


def from_json(content: bytes) -> Result:
    """Read what `to_json` wrote.

    Raises:
        msgspec.DecodeError: it is not a result of this version.
    """
    return decode_json(content, Result)
