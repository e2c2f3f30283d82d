"""From the samples of a run to its verdict: a list of steps over one value.

The value is a `JudgedRequirement`: a requirement at one monitor, and the run that it is judged by.
It is decided by the method of its metric, at each planned interim look. Then `STEPS` are carried
out in their order, each on the verdict of the one before:

    downgrade_affected_fail         a FAIL that is not clear on a busy machine becomes open
    examine_affected_probes         the same for what rests on probes
    check_steadiness                a verdict that rests on a part unlike the rest becomes open

Reasons for which nothing can be decided come first, and the method of the metric last
(`decide_case`). The outcome of the run follows from the verdicts on its requirements. What a second
run changes is in `r2bspec.judge.confirmation`. A ratio to a baseline is decided by pairs
(`r2bspec.judge.pair_comparison`), and by no step.

No step makes a PASS of another outcome, so that the share of wrong passes is that of the decision.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import msgspec

from r2bspec.judge.affected_iterations import (
    REMEDY,
    affected_iterations_text,
    best_case_iteration,
    find_affected_iterations,
    judge_probe,
    unaffected_or_rerun,
)
from r2bspec.judge.decision_policy import DecisionPolicy, combine_looks
from r2bspec.judge.measure.metric import MetricInfo, Scope, Statistic
from r2bspec.judge.measure.metric_catalogue import MetricError, resolve, unknown_metric
from r2bspec.judge.measure.own_pace import own_pace_text, own_period_s
from r2bspec.judge.measure.sample_table import MonitorSamples
from r2bspec.judge.measure.samples import RunSamples, SegmentSamples
from r2bspec.judge.measure.units import show
from r2bspec.judge.methods import METHODS
from r2bspec.judge.methods.mean_bound import judge_mean
from r2bspec.judge.methods.peak_bracket import judge_peak, with_refuted_peak
from r2bspec.judge.methods.recorded_value import judge_observation, judge_sustained
from r2bspec.judge.methods.share_bounds import judge_percentile, judge_share
from r2bspec.judge.requirement_case import (
    Decision,
    RequirementCase,
    limit_of,
    requirement_verdict,
    undecided,
)
from r2bspec.judge.steady_state import find_unsteady_part, iteration_levels
from r2bspec.judge.unmet import FAIL_FROM_STARTS, early_doubt, untested
from r2bspec.judge.validity import PlaybackValidity
from r2bspec.judge.verdict import (
    EXIT_CODES,
    DisturbedIteration,
    OverallOutcome,
    RequirementVerdict,
    Unusable,
    Verdict,
    outcome_of,
)
from r2bspec.language.benchmark_defaults import CONFIDENCE
from r2bspec.language.comparison_grammar import Requirement
from r2bspec.language.spec import Objective
from r2bspec.record.run_record import RunRecord

Decide = Callable[[RequirementCase, RunRecord], Decision]
DecideRatio = Callable[[RequirementCase], RequirementVerdict]
_BY_RECORD: Final[dict[Statistic, Decide]] = {
    "search": judge_peak,
    "sequential": judge_sustained,
}
"""What decides the metrics that need no iteration, and are the same in all of them."""
_BY_ITERATIONS: Final[dict[Statistic, Decide]] = {
    "percentile": judge_percentile,
    "share": judge_share,
    "mean": judge_mean,
    "observation": judge_observation,
}

OWN_RATE: Final = 0.0
"""The rate where none is offered: that of a recording, or of the source of a live graph."""

_DEFAULT_POLICY = DecisionPolicy()
_SMOKE_REASON = "The graph works; a smoke run does not judge the SLOs."
_HIDDEN_LOSSES: Final = "Outputs are matched by order: a lost output and a duplicate cancel out."


def judge(
    objectives: Mapping[str, Objective],
    samples: RunSamples,
    policy: DecisionPolicy = _DEFAULT_POLICY,
    ratio: DecideRatio | None = None,
) -> Verdict:
    """Judge every requirement of every objective, and the run as a whole.

    A requirement passes or fails only if the samples show it at the stated confidence; otherwise it
    is inconclusive. What was not measured never passes. A metric of a monitor that is written
    without a monitor must be met at each monitor, and gets a verdict for each.

    The verdict is a pure function of its arguments: where interim looks are planned, each is
    repeated on the iterations that it had.

    Args:
        objectives: by name.
        samples: the run.
        policy: as the plan stated it before the run.
        ratio: decides a requirement of the baseline; None if the run was compared with none.
    """
    judged_objectives = {
        name: objective for name, objective in objectives.items() if objective.level != "off"
    }
    run = JudgedRun(judged_objectives, with_refuted_peak(samples), policy, ratio)
    return _run_verdict(run, tuple(map(_after_all_steps, run.requirements())))


@dataclass(frozen=True)
class JudgedRun:
    """The run that all requirements are judged by, with facts that are determined once."""

    objectives: Mapping[str, Objective]
    samples: RunSamples
    policy: DecisionPolicy
    ratio: DecideRatio | None = None

    @cached_property
    def playback_validity(self) -> PlaybackValidity:
        """The rates at which results are invalid."""
        return PlaybackValidity.of(self.samples)

    @cached_property
    def affected(self) -> Mapping[str, DisturbedIteration]:
        """The iterations that host interference affected, by their segments."""
        return find_affected_iterations(self.samples)

    @cached_property
    def unaffected_samples(self) -> RunSamples:
        """The run without affected iterations, or with unaffected reruns in their places."""
        return self.samples.with_each(self._unaffected)

    @cached_property
    def best_case_samples(self) -> RunSamples:
        """The run as it would have been, at best, without the interference."""
        return self.samples.with_each(lambda one: self._unaffected(one) or best_case_iteration(one))

    def _unaffected(self, one: SegmentSamples) -> SegmentSamples | None:
        return unaffected_or_rerun(one, self.samples, self.affected)

    def completed_looks(self, samples: RunSamples) -> int:
        """Return how many interim looks the iterations at all rates of the objectives allow.

        At least 1.

        Args:
            samples: the run, or a part of it.
        """
        rates = {
            rate
            for objective in self.objectives.values()
            if (rate := _objective_rate(objective, samples)) is not None
        }
        fewest = min((len(samples.iterations_at(rate)) for rate in rates), default=0)
        looks = self.policy.looks
        return max(1, looks.completed_looks(fewest)) if looks is not None else 1

    def requirements(self) -> Iterator[JudgedRequirement]:
        """Yield all requirements, at each of their monitors."""
        for name, objective in self.objectives.items():
            at_hz = _objective_rate(objective, self.samples)
            for requirement in objective.require:
                info, monitors, problem = _metric_of(requirement, self.samples)
                for monitor in monitors:
                    asked = RequirementCase(name, requirement, at_hz, info, monitor, math.nan)
                    yield JudgedRequirement(self, objective, asked, problem)


@dataclass(frozen=True)
class JudgedRequirement:
    """A requirement at one monitor, or of the run.

    Attributes:
        asked: the requirement without the samples to judge it by. Its rate is None if the objective
            has none, or is at a peak that the search has not found; 0 where the recording, or the
            graph's own source, sets it.
        problem: why the run has no such metric; empty if it has.
    """

    run: JudgedRun
    objective: Objective
    asked: RequirementCase
    problem: str = ""

    @property
    def confidence(self) -> float:
        """The confidence of its decision."""
        own = self.objective.confidence
        return own.fraction if own is not None else self.run.policy.confidence

    def decided_by(self, samples: RunSamples) -> RequirementVerdict:
        """Return the decision on the samples of the run, after all looks that they allow."""
        looks, policy, confidence = self.run.policy.looks, self.run.policy, self.confidence
        if looks is None:
            return self._decided_once(samples, confidence, early=policy.early)
        decisions = [
            self._decided_once(
                first_iterations(samples, end),
                looks.confidence_at(look, confidence),
                early=end < looks.declared,
            )
            for look, end in enumerate(
                looks.iterations[: self.run.completed_looks(samples)], start=1
            )
        ]
        return combine_looks(looks, decisions)

    def decided_by_part(self, samples: RunSamples) -> RequirementVerdict:
        """Return the decision on a part of the samples, as if it were the whole run."""
        return self._decided_once(samples, self.confidence)

    def decided_by_pairs(self) -> RequirementVerdict | None:
        """Return the decision on a ratio to a baseline; None for another requirement."""
        requirement, decide = self.asked.requirement, self.run.ratio
        if decide is None or self.problem or not requirement.of_baseline:
            return None
        case = self.case(self.run.samples, self.confidence)
        if requirement.bound is not None:
            case = replace(case, limit=requirement.bound.value)
        unpaired = latency_unknown_by_order(case.info, case.monitor, case.iterations)
        verdict = requirement_verdict(case, undecided(*unpaired)) if unpaired else decide(case)
        return self._finished(case, verdict)

    def rests_on_more_than(self, rest: RequirementVerdict, whole: RequirementVerdict) -> bool:
        """Return True if a part decides otherwise, and not only for lack of messages."""

        def distance(one: RequirementVerdict) -> float:
            """Return how far the estimate is in the direction of a FAIL."""
            if one.estimate is None:
                return math.inf
            return one.estimate if self.asked.is_upper_bound else -one.estimate

        if rest.outcome == whole.outcome:
            return False
        if whole.outcome == "pass":
            return distance(rest) > distance(whole)
        return distance(rest) < distance(whole)

    def _decided_once(
        self, samples: RunSamples, confidence: float, *, early: bool = False
    ) -> RequirementVerdict:
        case = self.case(samples, confidence)
        if self.problem:
            decision = Decision(outcome="fail", method="none", reason=self.problem)
        else:
            decision = decide_case(case, samples)
        verdict = requirement_verdict(case, decision)
        if early and decision.outcome != "inconclusive" and METHODS[decision.method].grows:
            too_few = len(set(case.starts)) < FAIL_FROM_STARTS
            verdict = verdict.held_back(early_doubt(case, verdict), opens=too_few)
        return self._finished(case, verdict)

    def _finished(self, case: RequirementCase, verdict: RequirementVerdict) -> RequirementVerdict:
        """Return the verdict with its level and what is said of all; none where all is invalid."""
        verdict = msgspec.structs.replace(verdict, level=self.objective.level)
        if self.problem:
            return verdict
        if _losses_may_hide(case):
            verdict = verdict.noted(_HIDDEN_LOSSES)
        if invalid := self.run.playback_validity.problem(case.info.statistic, case.at_hz):
            return msgspec.structs.replace(
                verdict,
                outcome="inconclusive",
                reason=invalid.reason,
                remedy=invalid.remedy,
                # They explain a verdict that is none.
                notes=(),
            )
        return verdict

    def case(self, samples: RunSamples, confidence: float = CONFIDENCE) -> RequirementCase:
        """Return the requirement with the samples to judge it by."""
        asked = self.asked
        if self.problem:
            return asked
        played = samples.iterations_at(asked.at_hz)
        per_step = 1.0
        if played and asked.monitor is not None:
            per_step = played[0].monitors[asked.monitor].per_step
        limit = limit_of(asked.requirement, asked.at_hz, asked.info, per_step)
        return replace(asked, limit=limit, iterations=played, confidence=confidence)


def first_iterations(samples: RunSamples, number: int) -> RunSamples:
    """Return the run as it was when `number` iterations had been played at each rate."""
    return replace(
        samples,
        iterations={rate: played[:number] for rate, played in samples.iterations.items()},
    )


def _objective_rate(objective: Objective, samples: RunSamples) -> float | None:
    """Return the offered rate of an objective; see `JudgedRequirement`."""
    if objective.at is not None:
        return objective.at.hz
    if samples.own_rate and not objective.at_peak:
        return OWN_RATE
    return samples.peak_hz if objective.at_peak else None


def _metric_of(
    requirement: Requirement, samples: RunSamples
) -> tuple[MetricInfo, Sequence[str | None], str]:
    """Return the metric of a requirement, its monitors, and what is wrong with it.

    Where it belongs to no monitor, or is wrong, the only monitor is None.
    """
    none = unknown_metric(requirement.metric)
    try:
        monitor, info = resolve(requirement.metric, samples.monitors, samples.subjects)
    except MetricError as error:
        hint = f"; did you mean {error.suggestion}?" if error.suggestion else "."
        problem = str(error)
        return none, (None,), f"{problem[:1].upper()}{problem[1:]}{hint}"
    bound = requirement.bound
    if bound is not None and not info.accepts(bound):
        problem = f"The metric {info.name} is a {info.dimension}, but its bound is a "
        return none, (None,), f"{problem}{bound.dimension}."
    if monitor is not None:
        return info, (monitor,), ""
    return info, samples.monitors if info.scope is Scope.MONITOR else (None,), ""


# The decision of a case.


def decide_case(case: RequirementCase, samples: RunSamples) -> Decision:
    """Return the first reason why nothing can be decided, or the decision of the method."""
    return (
        _undecidable(case, samples)
        or (_decided(case, samples) if case.info.statistic in _BY_RECORD else None)
        or _without_iterations(case)
        or _without_output(case)
        or _without_latency(case)
        or _without_events(case)
        or _decided(case, samples)
    )


def _decided(case: RequirementCase, samples: RunSamples) -> Decision:
    return method_of(case)(case, samples.record)


def method_of(case: RequirementCase) -> Decide:
    """Return the function that decides a requirement on one run.

    A ratio is decided by `judge.ratio_of_starts`.
    """
    statistic = case.info.statistic
    if statistic in _BY_RECORD:
        return _BY_RECORD[statistic]
    return judge_observation if case.is_equality else _BY_ITERATIONS[statistic]


def _undecidable(case: RequirementCase, samples: RunSamples) -> Decision | None:
    """Undecided where the run, whatever it measured, has no such value, or nothing to compare."""
    name, bound = case.info.name, case.requirement.bound
    if samples.mode == "live" and not case.info.metric.live:
        return undecided(f"{name} is unknown in a live run: what its source sent is not recorded.")
    if bound is not None and bound.of_offered and not case.at_hz:
        return undecided("The objective has no rate, so 'of offered' has no meaning.")
    if case.requirement.of_baseline:
        return undecided(
            "This run was not compared with a baseline.", "Use 'r2bspec gate' or 'r2bspec compare'."
        )
    return None


def _without_iterations(case: RequirementCase) -> Decision | None:
    """Undecided where nothing was played at the rate, or what was played is not answered."""
    if case.at_hz is None:
        return undecided(f"The objective does not state the rate of {case.info.name}.")
    if not case.iterations:
        at = f" at {show(case.at_hz, 'Hz')}" if case.at_hz else ""
        return undecided(
            f"No complete iteration was played{at}.", "Run the spec of this objective to its end."
        )
    kinds = {one.kind for one in case.monitor_samples if one.kind != "live"}
    if not all(map(case.info.metric.known_of, kinds)):
        why = "inputs have any number of outputs" if "any" in kinds else "outputs answer no input"
        return undecided(f"{case.info.name} is unknown at monitor '{case.monitor}': {why}.")
    return None


def _without_output(case: RequirementCase) -> Decision | None:
    """Return a failure if the monitor received no output at all."""
    seen = case.monitor_samples
    known = any(sample.answered for sample in seen)
    if case.monitor is None or known:
        return None
    if seen[0].own_pace:
        count = len(seen)
        reason = f"Monitor '{case.monitor}' received nothing in {show(count, 'count')} "
        reason += "iterations." if count > 1 else "iteration."
        return Decision(outcome="fail", method="none", reason=reason)
    received, sent = sum(sample.received for sample in seen), sum(sample.sent for sample in seen)
    overdue = sum(sample.overdue for sample in seen)
    if overdue:
        reason = (
            f"Monitor '{case.monitor}' received no answer in time for {show(sent, 'count')} "
            f"inputs, and {show(overdue, 'count')} in a later segment: increase "
            "'benchmark.drain_timeout' to measure how late they are."
        )
    elif not received:
        reason = f"Monitor '{case.monitor}' received nothing for {show(sent, 'count')} inputs."
    else:
        period_s = own_period_s([each for sample in seen for each in sample.pace])
        reason = (
            f"Monitor '{case.monitor}' received {show(received, 'count')} messages, but none "
            "has the stamp of an input: "
        )
        reason += (
            own_pace_text(period_s)
            if period_s is not None
            else "use 'match: order', or copy the stamp inside the graph."
        )
    return Decision(outcome="fail", method="none", reason=reason, n=sent)


def _without_latency(case: RequirementCase) -> Decision | None:
    """Undecided where a latency or an age is unknown in some iteration."""
    if case.monitor is None:
        return None
    if unpaired := latency_unknown_by_order(case.info, case.monitor, case.iterations):
        return undecided(*unpaired)
    seen = case.monitor_samples
    if not (case.info.metric.of_stamps and seen[0].own_pace):
        return None
    if not any(sample.received and not sample.age.size for sample in seen):
        return None
    if not case.iterations[0].live:
        return undecided(
            f"The messages at monitor '{case.monitor}' do not have the stamp of an input.",
            "Copy the stamp of the newest input in the node.",
        )
    return undecided(
        f"The messages at monitor '{case.monitor}' have no stamp of this machine's clock.",
        "Stamp the messages of the source with the system time.",
    )


def _without_events(case: RequirementCase) -> Decision | None:
    """Undecided where what was observed from inside is not whole."""
    observed = [one.summary for one in case.iterations if one.summary is not None]
    lost = max((one.lost for one in observed), default=0)
    if case.info.scope is not Scope.ANATOMY or not lost:
        return None
    return undecided(
        f"There was no room for {show(lost, 'count')} events of the graph: the observation of "
        f"{case.info.subject} is incomplete.",
        "Observe iterations that are shorter or fewer in a start, or 'anatomy: [NODE]' alone.",
    )


def latency_unknown_by_order(
    info: MetricInfo, monitor: str | None, iterations: Sequence[SegmentSamples]
) -> tuple[str, str] | None:
    """Return why a latency is unknown with matching by order, and what to do; else None."""
    if monitor is None or not info.metric.lost_is_slowest:
        return None
    seen = [iteration.monitors[monitor] for iteration in iterations]
    if not any(sample.unknown_latency for sample in seen):
        return None
    why = MonitorSamples.joined(seen).unknown_latency
    reason = (
        f"The latency at monitor '{monitor}' is unknown: {why}. "
        "Every later output may then answer another input."
    )
    return reason, "Match by stamp: use an output whose header keeps the stamp of its input."


def _losses_may_hide(case: RequirementCase) -> bool:
    """Return whether lost outputs are counted, and others may take their places."""
    return case.info.metric.counts_losses and any(seen.by_order for seen in case.monitor_samples)


# The steps.


def downgrade_affected_fail(
    judged: JudgedRequirement, played: RequirementVerdict
) -> RequirementVerdict:
    """Downgrade an unclear FAIL on a busy machine, and note that the machine was busy."""
    run = judged.run
    text = affected_iterations_text(played, run.affected)
    if run.policy.interference == "tolerate" or played.outcome == "pass" or not text:
        return played
    if METHODS[played.method].rests_on != "iterations":
        return played
    if played.outcome == "inconclusive":
        grows = METHODS[played.method].grows
        return msgspec.structs.replace(played, remedy=REMEDY) if grows else played
    unaffected = judged.decided_by_part(run.unaffected_samples)
    if played.method == "none" and played == unaffected:
        return played
    if unaffected.outcome == "fail":
        return played.noted(f"{text}. The unaffected part fails, too.")
    # What the whole machine uses is the use of others, too.
    of_machine = judged.asked.info.scope in {Scope.MACHINE, Scope.DEVICE}
    if not of_machine and judged.decided_by_part(run.best_case_samples).outcome == "fail":
        return played.noted(
            f"{text}. The faster half of the messages, sped up by that, fails, too."
        )
    return played.opened(f"{text}. A machine this busy does not show that it fails.", REMEDY)


def examine_affected_probes(
    judged: JudgedRequirement, verdict: RequirementVerdict
) -> RequirementVerdict:
    """Judge requirements on probes with regard to the interference during them."""
    return judge_probe(verdict, judged.run.samples.record, judged.run.policy.interference)


def check_steadiness(judged: JudgedRequirement, verdict: RequirementVerdict) -> RequirementVerdict:
    """Note parts of the iterations that differ, and downgrade a verdict that rests on them."""
    samples, at_hz, info = judged.run.samples, judged.asked.at_hz, judged.asked.info
    if not METHODS[verdict.method].grows or at_hz is None:
        return verdict
    iterations = samples.iterations_at(at_hz)
    part = find_unsteady_part(iteration_levels(info, judged.asked.monitor, iterations))
    if part is None:
        return verdict
    found, advice = part.text(info), part.advice(samples, iterations)
    if verdict.outcome == "inconclusive":
        return verdict.noted(f"{found} {advice}")
    rest = judged.decided_by_part(part.left_out_of(samples, at_hz))
    if not judged.rests_on_more_than(rest, verdict):
        return verdict.noted(f"{found} {advice}")
    would = {"pass": "be met", "fail": "fail", "inconclusive": "not be decided"}[rest.outcome]
    return msgspec.structs.replace(
        verdict.noted(f"{found} Without that part, the requirement would {would}."),
        outcome="inconclusive",
        remedy=advice,
    )


STEPS: Final[tuple[Callable[[JudgedRequirement, RequirementVerdict], RequirementVerdict], ...]] = (
    downgrade_affected_fail,
    examine_affected_probes,
    check_steadiness,
)


def _after_all_steps(judged: JudgedRequirement) -> RequirementVerdict:
    if (by_pairs := judged.decided_by_pairs()) is not None:
        return by_pairs
    verdict = judged.decided_by(judged.run.samples)
    for step in STEPS:
        verdict = step(judged, verdict)
    if verdict.outcome == "inconclusive" or not METHODS[verdict.method].grows:
        return verdict
    case = judged.case(judged.run.samples, verdict.confidence)
    return msgspec.structs.replace(verdict, untested=untested(case, verdict))


# The run.


def _run_verdict(run: JudgedRun, requirements: tuple[RequirementVerdict, ...]) -> Verdict:
    """Return the verdict on the run, with what it cannot know."""
    samples, validity = run.samples, run.playback_validity
    invalid = {**validity.probes, **validity.iterations}
    reasons = {requirement.reason for requirement in requirements}
    unusable = tuple(
        Unusable(offered_hz=rate, reason=invalid[rate].reason)
        for rate in sorted(invalid)
        # Without requirements the run was made for its figures alone.
        if not requirements or invalid[rate].reason in reasons
    )
    outcome, reason = _overall_outcome(run, requirements, unusable)
    judged = outcome not in {"invalid", "incomplete"}
    return Verdict(
        outcome=outcome,
        # The same mistake has the same status in the result as in the process that made it.
        exit_code=(samples.record.exit_status if samples.record.status != "complete" else 0)
        or EXIT_CODES[outcome],
        reason=reason,
        requirements=requirements,
        unusable=unusable,
        disturbed=tuple(run.affected.values()),
        starts=samples.starts if judged else 0,
    )


def _overall_outcome(
    run: JudgedRun,
    requirements: tuple[RequirementVerdict, ...],
    unusable: tuple[Unusable, ...],
) -> tuple[OverallOutcome, str]:
    """Return the outcome of the run, worst first, and one sentence for it."""
    record, policy = run.samples.record, run.policy
    if record.status == "invalid":
        return "invalid", record.reason or "The run is invalid."
    if record.status == "incomplete":
        return "incomplete", record.reason or "The run was cut short."
    if policy.smoke and not requirements:
        # A busy machine, on which the playback is late, does not matter either.
        return "pass", _SMOKE_REASON
    if unusable:
        rate_hz, why = unusable[0].offered_hz, unusable[0].reason
        return "invalid", f"At {show(rate_hz, 'Hz')}: {why}" if rate_hz else why
    return outcome_of(requirements, policy.inconclusive, run.samples.starts)
