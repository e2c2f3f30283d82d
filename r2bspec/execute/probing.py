"""One probe of a rate on the real graph: play until the answer is clear, then judge."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Literal

from r2bspec.execute.holding import Criterion, Judgement, judge_finished_probe, judge_probe
from r2bspec.execute.playing import Observed, Stage
from r2bspec.execute.search import Outcome
from r2bspec.measure.catalogue import resolve
from r2bspec.measure.delivery import Delivery, delivery
from r2bspec.measure.values import value
from r2bspec.plan.model import Plan
from r2bspec.record.model import Probe
from r2bspec.spec.requirement import Requirement

_PRECISION = 0.02
_PROBE_NS = 3_000_000_000
_LEAST_STEPS = 20


class Prober:
    """Probes rates; of several monitors, the one that does worst decides."""

    def __init__(self, plan: Plan, stage: Stage, note: Callable[[str], None]) -> None:
        search = plan.search
        self._plan = plan
        self._stage = stage
        self._note = note
        self._duration_s = (search.probe_ns if search else _PROBE_NS) / 1e9
        self._conditions = search.holds if search else ()
        self._criterion = Criterion(
            precision=search.precision if search else _PRECISION,
            loss=max((_allowed_loss(each) for each in self._conditions), default=0.0),
        )
        self._numbers = itertools.count(1)

    def probe(self, rate_hz: float) -> Outcome:
        """Probe one rate for the search."""
        return self._play("probe", rate_hz)

    def sustain(self, rate_hz: float) -> Outcome:
        """Probe one rate for an objective that requires it to be sustained."""
        return self._play("sustained", rate_hz)

    def _play(self, kind: Literal["probe", "sustained"], rate_hz: float) -> Outcome:
        number = next(self._numbers)
        name = f"{kind}-{number:03d}"

        def watch(observed: Observed, elapsed_s: float) -> bool:
            judgements = [
                judge_probe(each, self._criterion, elapsed_s)
                for each in self._deliveries(rate_hz, observed)
            ]
            return _worst(judgements).holds is not None

        observed = self._stage.play(
            kind,
            name,
            rate_hz,
            max(_LEAST_STEPS, round(self._duration_s * rate_hz)),
            title=f"probing {rate_hz:.4g} Hz",
            index=number,
            watch=watch,
        )
        deliveries = self._deliveries(rate_hz, observed)
        judgement = _worst([judge_finished_probe(each, self._criterion) for each in deliveries])
        if judgement.holds:
            judgement = self._check_conditions(observed, rate_hz)
        word = "holds" if judgement.holds else "does not hold"
        self._note(f"{rate_hz:.4g} Hz {word}: {judgement.reason}")
        return Outcome(
            Probe(
                segment=self._stage.id_of(name),
                rate_hz=rate_hz,
                delivered_hz=min((each.delivered_hz for each in deliveries), default=0.0),
                holds=bool(judgement.holds),
                reason=judgement.reason,
            ),
            by_player=judgement.by_player,
        )

    def _deliveries(self, rate_hz: float, observed: Observed) -> list[Delivery]:
        if not observed.playback.size:
            return []
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

    def _check_conditions(self, observed: Observed, rate_hz: float) -> Judgement:
        """The conditions that the spec puts on a rate that holds, on what was measured."""
        names = [plan.name for plan in self._plan.monitors]
        samples = observed.samples(self._stage.segments[-1])
        for condition in self._conditions:
            named, metric = resolve(condition.metric, names)
            for monitor in [named] if named else names:
                measured = value(metric, monitor, samples)
                per_step = samples.monitors[monitor].per_step if metric.scope == "monitor" else 1.0
                limit = _limit(condition, rate_hz * per_step)
                if limit is None or (measured is not None and condition.holds(measured, limit)):
                    continue
                shown = "nothing was measured" if measured is None else f"it is {measured:.4g}"
                return Judgement(holds=False, reason=f"{condition} does not hold: {shown}")
        return Judgement(holds=True, reason="delivered as offered")


def _limit(condition: Requirement, rate_hz: float) -> float | None:
    """The limit of a condition at one offered rate, in SI units; None if it has no bound."""
    if condition.bound is None:
        return None
    return condition.bound.value * (rate_hz if condition.bound.of_offered else 1.0)


def _allowed_loss(condition: Requirement) -> float:
    """The drop rate that a condition admits, as a fraction; 0 for one about something else."""
    if not condition.metric.endswith("drop_rate") or condition.bound is None:
        return 0.0
    return condition.bound.value if condition.op in {"<", "<="} else 0.0


def _worst(judgements: list[Judgement]) -> Judgement:
    """One that does not hold decides, then one that is open."""
    order = {False: 0, None: 1, True: 2}
    nothing = Judgement(None, "nothing was published yet")
    return min(judgements, key=lambda each: order[each.holds], default=nothing)
