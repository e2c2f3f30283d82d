"""Probing one rate on the running graph: play until the result is clear, then judge."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Literal

from r2bspec.execute.measurement.peak_search import ProbeOutcome
from r2bspec.execute.measurement.segment_observation import SegmentObservation
from r2bspec.execute.measurement.segments import SegmentHeading, SegmentPlayer
from r2bspec.judge.rate_decision import (
    Criterion,
    ProbeEstimate,
    ProbeJudgement,
    estimate_probe,
    judge_final,
    judge_interim,
    plan_interim_looks,
    worst_judgement,
)
from r2bspec.language.confidence import CONFIDENCE
from r2bspec.language.probe_length import MIN_PROBE_STEPS, PROBE
from r2bspec.language.requirement_grammar import Requirement
from r2bspec.measure.metric_catalogue import resolve
from r2bspec.measure.metric_values import metric_value
from r2bspec.plan.plan import Plan
from r2bspec.record.run_record import Probe

DEFAULT_PRECISION = 0.02
_STATE_TEXTS = {True: "is sustained", False: "is not sustained", None: "is undecided"}


class RateProber:
    """Probes rates; of several monitors, the worst one decides."""

    def __init__(
        self,
        plan: Plan,
        segment_player: SegmentPlayer,
        note: Callable[[str], None],
        disturbed: Callable[[Callable[[], ProbeOutcome]], ProbeOutcome] = lambda probe: probe(),
    ) -> None:
        """Prepare to probe.

        Args:
            plan: of the run.
            segment_player: plays the probes.
            note: receives a note about each outcome.
            disturbed: plays a probe, again if need be; see `AffectedProbes.play`.
        """
        search = plan.search
        self._disturbed = disturbed
        self._plan = plan
        self._segment_player = segment_player
        self._note = note
        self._limit_s = search.probe_ns / 1e9 if search else PROBE.seconds
        self._conditions = search.holds if search else ()
        self._criterion = Criterion(
            precision=search.precision if search else DEFAULT_PRECISION,
            loss=max((_allowed_loss(each) for each in self._conditions), default=0.0),
            confidence=search.confidence if search else CONFIDENCE,
        )
        self._numbers = itertools.count(1)

    def probe(self, rate_hz: float) -> ProbeOutcome:
        """Probe one rate for the search."""
        return self._disturbed(lambda: self._play("probe", rate_hz))

    def probe_sustained(self, rate_hz: float) -> ProbeOutcome:
        """Probe one rate for an objective that requires it to be sustained."""
        return self._disturbed(lambda: self._play("sustained", rate_hz))

    def _play(self, kind: Literal["probe", "sustained"], rate_hz: float) -> ProbeOutcome:
        number = next(self._numbers)
        name = f"{kind}-{number:03d}"
        steps = max(MIN_PROBE_STEPS, round(self._limit_s * rate_hz))
        interim = _InterimMonitor(
            self._criterion, steps / rate_hz, lambda each: self._estimate(rate_hz, each)
        )
        observation = self._segment_player.play(
            SegmentHeading(kind, name, f"probing {rate_hz:.4g} Hz", number),
            rate_hz,
            steps,
            interim.watch,
        )
        estimates = self._estimate(rate_hz, observation)
        judgement = interim.conclude(estimates)
        if judgement.holds:
            judgement = self._check_conditions(observation, rate_hz)
        self._note(f"{rate_hz:.4g} Hz {_STATE_TEXTS[judgement.holds]}: {judgement.reason}")
        return ProbeOutcome(
            Probe(
                segment=self._segment_player.segment_id_for(name),
                rate_hz=rate_hz,
                delivered_hz=min((each.overall.delivered_hz for each in estimates), default=0.0),
                holds=judgement.holds,
                reason=judgement.reason,
                confidence=self._criterion.confidence,
            ),
            limited_by_player=judgement.limited_by_player,
            relative_half_width=judgement.relative_half_width,
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
        ]

    def _check_conditions(self, observation: SegmentObservation, rate_hz: float) -> ProbeJudgement:
        """Check the conditions of the spec for a sustained rate on the measurements."""
        names = [plan.name for plan in self._plan.monitors]
        samples = observation.samples(self._segment_player.segments[-1])
        for condition in self._conditions:
            named, metric = resolve(condition.metric, names)
            for monitor in [named] if named else names:
                measured = metric_value(metric, monitor, samples)
                per_step = samples.monitors[monitor].per_step if metric.scope == "monitor" else 1.0
                limit = _limit(condition, rate_hz * per_step)
                if limit is None or (measured is not None and condition.is_met(measured, limit)):
                    continue
                shown = "not measured" if measured is None else f"measured {measured:.4g}"
                return ProbeJudgement(holds=False, reason=f"{condition} is not met: {shown}")
        return ProbeJudgement(holds=True, reason="delivered as offered")


def _limit(condition: Requirement, rate_hz: float) -> float | None:
    """The limit of a condition at one offered rate, in SI units; None if it has no bound."""
    if condition.bound is None:
        return None
    return condition.bound.value * (rate_hz if condition.bound.of_offered else 1.0)


def _allowed_loss(condition: Requirement) -> float:
    """The drop rate that a condition allows, as a fraction; 0 for other conditions."""
    if not condition.metric.endswith("drop_rate") or condition.bound is None:
        return 0.0
    return condition.bound.value if condition.op in {"<", "<="} else 0.0


class _InterimMonitor:
    """Evaluates a probe at the planned looks, and keeps the result of the first clear one."""

    def __init__(
        self,
        criterion: Criterion,
        limit_s: float,
        estimate_all: Callable[[SegmentObservation], list[ProbeEstimate]],
    ) -> None:
        self._criterion = criterion
        self._looks = plan_interim_looks(limit_s)
        self._estimate_all = estimate_all
        self._number = 0
        self._decided: list[bool | None] = []

    def watch(self, observation: SegmentObservation, elapsed_s: float) -> bool:
        """Whether the result is clear; called while playing."""
        due = [each for each in self._looks[self._number : -1] if each.at_s <= elapsed_s]
        if not due:
            return False
        self._number += len(due)
        judgements = [
            judge_interim(each, self._criterion, due[-1])
            for each in self._estimate_all(observation)
        ]
        if worst_judgement(judgements).holds is None:
            return False
        self._decided = [each.holds for each in judgements]
        return True

    def conclude(self, estimates: list[ProbeEstimate]) -> ProbeJudgement:
        """The result, after the graph has drained."""
        decided = self._decided or [None] * len(estimates)
        return worst_judgement(
            [
                judge_final(each, self._criterion, self._looks[-1], holds)
                for each, holds in zip(estimates, decided, strict=True)
            ]
        )
