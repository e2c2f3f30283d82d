"""Probing one rate on the running graph: play until the result is clear, then judge.

Whether a rate is sustained is decided as a probe ends. If others used the machine meanwhile, a rate
that was sustained is sustained all the same: the graph did more in the same time. A rate that was
not, or that stayed undecided, says nothing about the graph if the interference can explain it:

    the output rate + w x the offered rate  >=  (1 - precision) x the offered rate

with w the largest share of the time that others can have taken
(`r2bspec.judge.measure.host_usage.taken_share`). What comes out of an overloaded graph bounds its
capacity only if w is at most half the precision.

Such a probe is played again. If it is disturbed again, the search uses it to aim, but not as a
bound (`r2bspec.execute.measurement.peak_search.unexplained_end`). On a machine that is always busy
that would double every search, so after `MAX_FUTILE_REPLAYS` that were disturbed again there are
no more in a batch of starts.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Final, Literal

import msgspec

from r2bspec.execute.measurement.peak_search import LongPlays, ProbeOutcome
from r2bspec.execute.run_context import MEASURE_PHASE, RunContext
from r2bspec.execute.start.segment_observation import SegmentObservation
from r2bspec.execute.start.segments import SegmentHeading, SegmentPlayer
from r2bspec.judge.measure.metric_catalogue import resolve
from r2bspec.judge.measure.metric_values import metric_value
from r2bspec.judge.rate_decision import (
    Criterion,
    InterimLook,
    ProbeEstimate,
    ProbeJudgement,
    estimate_probe,
    judge_final,
    judge_interim,
    plan_interim_looks,
    worst_judgement,
)
from r2bspec.judge.requirement_case import limit_of
from r2bspec.judge.verdict import InterferencePolicy
from r2bspec.language.benchmark_defaults import (
    CONFIDENCE,
    MAX_LONGER,
    MIN_PROBE_STEPS,
    OVERLOAD_PROBES,
    PROBE,
    SEARCH_CONFIRMATIONS,
    SEARCH_PROBES,
)
from r2bspec.language.comparison_grammar import Requirement
from r2bspec.plan.plan import Plan, SearchPlan
from r2bspec.record.run_record import Probe

_DEFAULT_PRECISION = 0.02
_TITLES = {
    "probe": "probing",
    "saturation": "overloading with",
    "confirmation": "confirming",
}

MAX_FUTILE_REPLAYS: Final = 2


@dataclass(frozen=True)
class _Play:
    """How one rate is played.

    Attributes:
        kind: the kind of the segment, and its name before its number.
        purpose: for the record.
        limit_s: how long it is played at most, without what few messages need.
        ends_on: the results that end it before that.
        whole: whether only the end of the play can show that the rate is sustained.
        enough: whether it is played longer at low rates, for enough messages to bound the losses.
        proven_hz: the rate with which other plays have shown that the graph keeps up.
    """

    kind: Literal["probe", "sustained"]
    purpose: Literal["probe", "saturation", "confirmation"]
    limit_s: float
    ends_on: frozenset[bool] = frozenset()
    whole: bool = False
    enough: bool = False
    proven_hz: float = 0.0


class RateProber:
    """Probes rates; of several monitors, the worst one decides."""

    def __init__(
        self,
        plan: Plan,
        segment_player: SegmentPlayer,
        context: RunContext,
    ) -> None:
        """Prepare to probe.

        Args:
            plan: the plan of the run.
            segment_player: plays the probes.
            context: the context of the run; receives a note about each outcome.
        """
        search = plan.search
        self._plan = plan
        self._segment_player = segment_player
        self._note = context.note
        self._limit_s = search.probe_ns / 1e9 if search else PROBE.seconds
        self._conditions = search.holds if search else ()
        self._criterion = Criterion(
            precision=search.precision if search else _DEFAULT_PRECISION,
            loss=max((_allowed_loss(condition) for condition in self._conditions), default=0.0),
            confidence=search.confidence if search else CONFIDENCE,
        )
        self._affected = AffectedProbes(
            plan.gate.interference, self._criterion.precision, segment_player, context
        )
        self._numbers = itertools.count(1)

    def probe(self, rate_hz: float) -> ProbeOutcome:
        """Probe one rate for the search, until it is clear whether the graph keeps up."""
        play = _Play("probe", "probe", self._limit_s, frozenset({True, False}))
        return self._play(play, rate_hz)

    def probe_sustained(self, rate_hz: float) -> ProbeOutcome:
        """Probe one rate for an objective that requires it to be sustained."""
        ends_on = frozenset({False})
        play = _Play("sustained", "probe", self._limit_s, ends_on, whole=True, enough=True)
        return self._play(play, rate_hz)

    def long_plays(self, search: SearchPlan, allows: Callable[[], bool]) -> LongPlays:
        """Return the parts of the search other than short probes.

        Args:
            search: the search of the plan.
            allows: whether there is time for more than a bracket needs.
        """
        confirm_s = search.confirm_ns / 1e9

        overload = _Play("probe", "saturation", self._limit_s)
        whole = _Play("probe", "confirmation", confirm_s, whole=True, enough=True)

        def confirm(rate_hz: float, proven_hz: float) -> ProbeOutcome:
            return self._play(replace(whole, proven_hz=proven_hz), rate_hz)

        def upper(rate_hz: float, needed_s: float) -> ProbeOutcome:
            limit_s = min(max(needed_s, self._limit_s), max(confirm_s, self._limit_s))
            play = replace(whole, limit_s=limit_s, ends_on=frozenset({False}), enough=False)
            return self._play(play, rate_hz)

        return LongPlays(
            overload=lambda rate_hz: self._play(overload, rate_hz),
            confirm=confirm if confirm_s else None,
            upper=upper if confirm_s else None,
            budget_s=OVERLOAD_PROBES * self._limit_s,
            search_s=SEARCH_PROBES * self._limit_s + SEARCH_CONFIRMATIONS * confirm_s,
            # At most one queue for each node.
            stages=sum(
                len(process.nodes) + (process.role == "command")
                for process in self._plan.processes_in(MEASURE_PHASE)
            )
            or 1,
            loss=self._criterion.loss,
            conditions=any(not _allowed_loss(condition) for condition in self._conditions),
            allows=allows,
        )

    def _steps(self, play: _Play, rate_hz: float) -> int:
        steps = max(MIN_PROBE_STEPS, math.ceil(play.limit_s * rate_hz))
        if play.enough:
            # Of several inputs that have one output, each output takes as many steps.
            steps_per_output = max(
                (monitor.ratio_inputs / monitor.ratio_outputs for monitor in self._plan.monitors),
                default=1.0,
            )
            needed = math.ceil(self._criterion.messages_without_loss * max(steps_per_output, 1.0))
            steps = max(steps, min(needed, MAX_LONGER * steps))
        return steps

    def _play(self, play: _Play, rate_hz: float) -> ProbeOutcome:
        """Play a probe, and again if others disturbed it and that can explain its outcome."""
        return self._affected.play(lambda: self._play_once(play, rate_hz))

    def _play_once(self, play: _Play, rate_hz: float) -> ProbeOutcome:
        number = next(self._numbers)
        name = f"{play.kind}-{number:03d}"
        steps = self._steps(play, rate_hz)
        interim = _InterimMonitor(
            self._criterion,
            steps / rate_hz,
            lambda each: self._estimate(rate_hz, each),
            play,
        )
        observation = self._segment_player.play(
            SegmentHeading(play.kind, name, f"{_TITLES[play.purpose]} {rate_hz:.4g} Hz", number),
            rate_hz,
            steps,
            interim.watch if play.ends_on else None,
        )
        estimates = self._estimate(rate_hz, observation)
        judgement = interim.conclude(estimates)
        if judgement.holds or judgement.keeps_up:
            judgement = self._check_conditions(judgement, observation, rate_hz)
        why = judgement.reason.removeprefix("undecided: ")
        self._note(f"{rate_hz:.4g} Hz {_STATES[judgement.holds]}: {why}")
        worst = min(estimates, key=lambda each: each.overall.delivered_hz, default=None)
        return ProbeOutcome(
            Probe(
                segment=self._segment_player.segment_id_for(name),
                rate_hz=rate_hz,
                delivered_hz=worst.overall.delivered_hz if worst is not None else 0.0,
                holds=judgement.holds,
                reason=judgement.reason,
                confidence=self._criterion.confidence,
                purpose=play.purpose,
                keeps_up=judgement.keeps_up,
                lost_at_most=judgement.lost_at_most,
                played_s=observation.playback.size / rate_hz,
            ),
            limited_by_player=judgement.limited_by_player,
            departures=worst.departures if worst is not None else None,
            drop_share=worst.overall.drop_share if worst is not None else 0.0,
        )

    def _estimate(self, rate_hz: float, observation: SegmentObservation) -> list[ProbeEstimate]:
        if not observation.playback.size:
            return []
        return [
            estimate_probe(
                rate_hz,
                observation.playback,
                observation.monitors[plan.name],
                observation.matched(plan.name).matching,
                observation.now_ns,
            )
            for plan in self._plan.monitors
            if plan.counts_answers
        ]

    def _check_conditions(
        self, judgement: ProbeJudgement, observation: SegmentObservation, rate_hz: float
    ) -> ProbeJudgement:
        """Check the conditions of the spec for a sustained rate on the measurements."""
        names = [plan.name for plan in self._plan.monitors]
        samples = observation.samples(self._segment_player.segments[-1])
        for condition in self._conditions:
            named, metric = resolve(condition.metric, names)
            for monitor in [named] if named else names:
                measured = metric_value(metric, monitor, samples)
                if condition.bound is None:
                    continue
                limit = limit_of(condition, rate_hz, metric, samples.monitors[monitor].per_step)
                if measured is not None and condition.is_met(measured, limit):
                    continue
                shown = "not measured" if measured is None else f"measured {measured:.4g}"
                reason = f"{condition} is not met: {shown}"
                return replace(judgement, holds=False, reason=reason, keeps_up=False)
        return judgement


_STATES = {None: "is undecided", True: "is sustained", False: "is not sustained"}


def _allowed_loss(condition: Requirement) -> float:
    """Return the drop rate that a condition allows, as a fraction; 0 for other conditions."""
    if not condition.metric.endswith("drop_rate") or condition.bound is None:
        return 0.0
    return condition.bound.value if condition.op in {"<", "<="} else 0.0


@dataclass
class _InterimMonitor:
    """Evaluates a probe at the planned looks, and keeps the result of the first clear one."""

    criterion: Criterion
    limit_s: float
    estimate_all: Callable[[SegmentObservation], list[ProbeEstimate]]
    play: _Play
    _number: int = 0
    _decided: list[ProbeJudgement] = field(default_factory=list)
    _ended_at: InterimLook | None = None

    def __post_init__(self) -> None:
        looks = plan_interim_looks(self.limit_s)
        # A play that nothing ends before its time has one look.
        self._looks = looks if self.play.ends_on else (InterimLook(self.limit_s, 1.0),)

    def watch(self, observation: SegmentObservation, elapsed_s: float) -> bool:
        """Return whether the result is clear; called while playing."""
        due = [look for look in self._looks[self._number : -1] if look.at_s <= elapsed_s]
        if not due:
            return False
        self._number += len(due)
        judgements = [
            judge_interim(estimate, self.criterion, due[-1])
            for estimate in self.estimate_all(observation)
        ]
        worst = worst_judgement(judgements)
        state = True if worst.keeps_up else worst.holds
        if state not in self.play.ends_on:
            return False
        self._ended_at, self._decided = due[-1], judgements
        return True

    def conclude(self, estimates: list[ProbeEstimate]) -> ProbeJudgement:
        """Return the result, after the graph has drained."""
        decided: Sequence[ProbeJudgement | None] = self._decided or [None] * len(estimates)
        return worst_judgement(
            [
                judge_final(
                    estimate,
                    self.criterion,
                    self._ended_at or self._looks[-1],
                    judged,
                    whole=self.play.whole,
                    proven_hz=self.play.proven_hz,
                )
                for estimate, judged in zip(estimates, decided, strict=True)
            ]
        )


@dataclass
class AffectedProbes:
    """Plays probes, and repeats those that other programs have disturbed.

    Attributes:
        policy: ``gate.interference``; with ``tolerate``, interference explains nothing.
        precision: the precision of the search.
        segment_player: plays them.
        context: the context of the run; without time left, nothing is played again.
    """

    policy: InterferencePolicy
    precision: float
    segment_player: SegmentPlayer
    context: RunContext
    _futile: int = 0

    def play(self, probe: Callable[[], ProbeOutcome]) -> ProbeOutcome:
        """Play a probe, and repeat it once if a disturbance can explain its outcome."""
        first = self._with_interference(probe())
        segment = self.segment_player.segments[-1]
        if (
            not first.probe.explained
            or self._futile >= MAX_FUTILE_REPLAYS
            or not self.context.budget.allows(
                f"no rerun of {first.probe.segment}, which host interference affected",
                (segment.ended_ns - segment.began_ns) / 1e9,
            )
        ):
            return first
        reasons = ", ".join(first.probe.disturbed)
        self.context.note(f"host interference in {first.probe.segment} ({reasons}): repeating it")
        again = self._with_interference(probe())
        if again.probe.explained:
            self._futile += 1
        rerun = msgspec.structs.replace(again.probe, rerun_of=first.probe.segment)
        return replace(again, probe=rerun)

    def _with_interference(self, outcome: ProbeOutcome) -> ProbeOutcome:
        """Return the outcome with the host interference, and whether that explains it."""
        segment = self.segment_player.segments[-1]
        interference = self.context.host.between(segment.began_ns, segment.ended_ns)
        probe = msgspec.structs.replace(
            outcome.probe,
            by_player=outcome.limited_by_player,
            disturbed=interference.reasons,
        )
        if interference.reasons and self.policy != "tolerate":
            probe = msgspec.structs.replace(
                probe,
                taken=interference.taken,
                explained=probe.holds is not True and self._can_explain(probe, interference.taken),
            )
        return replace(outcome, probe=probe)

    def _can_explain(self, probe: Probe, taken: float) -> bool:
        if probe.purpose == "saturation":
            return taken > self.precision / 2
        possible_hz = probe.delivered_hz + taken * probe.rate_hz
        return possible_hz >= (1 - self.precision) * probe.rate_hz
