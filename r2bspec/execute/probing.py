"""One probe of a rate on the real graph: play until the answer is clear, then judge."""

from __future__ import annotations

import itertools
from typing import Literal

from r2bspec.execute.holding import Judgement, judge_probe
from r2bspec.execute.playing import Observed, Stage
from r2bspec.execute.search import Outcome
from r2bspec.measure.catalogue import resolve
from r2bspec.measure.delivery import Delivery, delivery
from r2bspec.measure.values import value
from r2bspec.plan.model import Plan
from r2bspec.record.model import Probe
from r2bspec.spec.requirement import Requirement

_PROBE_NS = 3_000_000_000
_LEAST_STEPS = 20


class Prober:
    """Probes rates; the graph's slowest monitor decides."""

    def __init__(self, plan: Plan, stage: Stage) -> None:
        search = plan.search
        self._plan = plan
        self._stage = stage
        self._precision = search.precision if search else 0.02
        self._duration_s = (search.probe_ns if search else _PROBE_NS) / 1e9
        self._holds: tuple[Requirement, ...] = search.holds if search else ()
        self._numbers = itertools.count(1)

    def probe(self, rate_hz: float) -> Outcome:
        """Probe one rate for the search."""
        return self._play("probe", rate_hz)

    def sustain(self, rate_hz: float) -> Outcome:
        """Probe one rate for an objective that requires it to be sustained."""
        return self._play("sustained", rate_hz)

    def _play(self, kind: Literal["probe", "sustained"], rate_hz: float) -> Outcome:
        number = next(self._numbers)
        clear = False

        def watch(observed: Observed, elapsed_s: float) -> bool:
            nonlocal clear
            judgement = self._judge(rate_hz, observed, elapsed_s, final=False, early=False)
            clear = judgement.holds is not None
            return clear

        observed = self._stage.play(
            kind,
            f"{kind}-{number:03d}",
            rate_hz,
            max(_LEAST_STEPS, round(self._duration_s * rate_hz)),
            index=number,
            watch=watch,
        )
        judgement = self._judge(rate_hz, observed, self._duration_s, final=True, early=clear)
        judgement = self._conditions(judgement, observed)
        slowest = min(self._deliveries(rate_hz, observed), key=lambda each: each.settled_hz)
        return Outcome(
            Probe(
                segment=f"{kind}-{number:03d}",
                rate_hz=rate_hz,
                delivered_hz=slowest.delivered_hz,
                holds=bool(judgement.holds),
                reason=judgement.reason,
            ),
            by_player=judgement.by_player,
        )

    def _deliveries(self, rate_hz: float, observed: Observed) -> list[Delivery]:
        return [
            delivery(
                rate_hz,
                observed.playback,
                observed.monitors[plan.name],
                observed.matching(plan.name),
                observed.now_ns,
            )
            for plan in self._plan.monitors
        ]

    def _judge(
        self, rate_hz: float, observed: Observed, elapsed_s: float, *, final: bool, early: bool
    ) -> Judgement:
        """The judgement over all monitors: one that does not hold decides."""
        if not observed.playback.size:
            return Judgement(None, "nothing published yet")
        judgements = [
            judge_probe(each, self._precision, elapsed_s, final=final, closed_early=early)
            for each in self._deliveries(rate_hz, observed)
        ]
        for wanted in (False, None, True):
            for each in judgements:
                if each.holds is wanted:
                    return each
        return Judgement(None, "no monitor")

    def _conditions(self, judgement: Judgement, observed: Observed) -> Judgement:
        """Add the conditions that the spec puts on a rate that holds."""
        if not judgement.holds or not self._holds:
            return judgement
        names = [plan.name for plan in self._plan.monitors]
        samples = observed.samples(self._stage.segments[-1])
        for condition in self._holds:
            named, metric = resolve(condition.metric, names)
            for monitor in [named] if named else names:
                measured = value(metric, monitor, samples)
                bound = condition.bound
                if bound is None or (
                    measured is not None and condition.holds(measured, bound.value)
                ):
                    continue
                shown = "nothing was measured" if measured is None else f"it is {measured:.4g}"
                return Judgement(holds=False, reason=f"{condition} does not hold: {shown}")
        return judgement
