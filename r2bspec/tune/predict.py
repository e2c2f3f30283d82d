"""What a deployment would do, before it is tried: latency and peak rate, each with an interval.

The model is first asked what is known: the latencies of the run itself. If it does not reproduce
them, it is not believed. What it is off by there is a part of every interval.

With B simulations, each with other observations in other order and another draw of what the run
does not show, m the mean and s the standard deviation of the logarithms of a percentile, and r the
logarithm of measured over simulated percentile of the run itself, the 90 % interval of a latency is

    exp(m + r / 2 ± (sqrt((1.645 s)^2 + f^2) + |r| / 2))

with a constant f for what changes from one start to the next. It is at least as wide, to either
side, as what the n messages of the run leave open of the percentile q: the ranks
n q ± 1.645 sqrt(n q (1 - q)), and, where these are beyond the slowest message, further by

    a ln((1 - 0.05^(1/n)) / (1 - q))

with the mean a of the logarithms of the slowest fifth, over that of the fastest of it (Hill,
Annals of Statistics 3, 1975): the slowest of n is beyond the quantile 0.05^(1/n) in 95 of 100 runs.
The interval of the peak has the smallest and the largest of the simulations in it.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from r2bspec.errors import UsageError
from r2bspec.judge.measure.anatomy import Anatomy
from r2bspec.judge.measure.run_samples import read_samples, read_segment
from r2bspec.judge.measure.samples import SegmentSamples
from r2bspec.judge.measure.times import percentile, rank
from r2bspec.judge.measure.units import show
from r2bspec.plan.plan import Plan
from r2bspec.record.run_folder import Run
from r2bspec.safe_io.limits import MAX_PREDICTED_RATES
from r2bspec.tune.deployed_model import DeployedModel, draw, graph_nodes
from r2bspec.tune.observed_graph import (
    MIN_STEPS,
    NotKnownError,
    ObservedSegment,
    observe,
    undisturbed,
)
from r2bspec.tune.prediction import (
    Estimate,
    LatencyPrediction,
    Prediction,
    nothing_known,
    requirement_answers,
)
from r2bspec.tune.processor_time import CAUSES
from r2bspec.tune.queue_model import GraphModel, Seconds, block_places, simulate

PERCENTILES: Final = ("p50", "p99")

_SIMULATIONS: Final = 12
_PEAK_SIMULATIONS: Final = 6
_STEPS: Final = (300, 900)
"""The fewest and the most steps of a simulation."""

_TOLERANCE: Final = {"p50": 0.25, "p99": 0.45}
"""By how much the model may be off for the run itself, as a logarithm."""

_ONE_SIDED: Final = 1.645
"""The quantile of the normal distribution for either end of a 90 % interval."""

_FEWEST_IN_TAIL: Final = 5
"""Messages from which the openness of the tail is estimated, where a fifth of all are fewer."""

_FLOOR: Final = {"p50": 0.12, "p99": 0.3}
_PEAK_ERROR: Final = 0.06

_SATURATED: Final = 0.9
"""The load of a thread from which on latencies are not predicted: they depend on too little."""

_NEAR_PEAK: Final = 0.75
"""Likewise the share of the peak."""

_LEAST_SCATTER: Final = 0.05
"""Of the speed of processors from one iteration to the next, as a logarithm."""

_UNDISTURBED: Final = 0.1
"""A graph that waits so little for processors would wait as little in another deployment."""

_WIDEST: Final = 6.0
"""An interval whose ends differ by a larger factor says nothing."""

_RATE_DEPENDENT: Final = 0.15
"""A node whose mean work differs by more between observed rates has no work of its own."""

_SHOWN_NODES: Final = 5
_MAX_LOST: Final = 0.01
_SLOWEST_HZ, _FASTEST_HZ = 0.01, 20_000.0
_SEED: Final = 20


@dataclass(frozen=True)
class Measured:
    """What the run itself says of a percentile, as logarithms.

    Attributes:
        off: measured over simulated.
        below: how far the true one may be below the measured one.
        above: likewise above.
    """

    off: float
    below: float
    above: float

    @classmethod
    def of(cls, off: float, times: Seconds, q: float) -> Measured:
        """From the latencies of the run, at least one."""
        logs = np.log(np.sort(times))
        n, at = logs.size, logs[rank(q, logs.size) - 1]
        middle, half = n * q, _ONE_SIDED * math.sqrt(n * q * (1 - q))
        lower, upper = max(1, math.floor(middle - half)), min(n, math.ceil(middle + half))
        tail = logs[-max(_FEWEST_IN_TAIL, n // 5) :]
        beyond = math.log((1 - 0.05 ** (1 / n)) / (1 - q)) if upper == n else 0.0
        above = logs[upper - 1] - at + max(0.0, beyond) * float(tail[1:].mean() - tail[0])
        return cls(off, float(at - logs[lower - 1]), float(above))


@dataclass(frozen=True)
class _Found:
    """The percentiles of some simulations of one rate, by monitor; infinity for lost messages."""

    values: Mapping[tuple[str, str], Sequence[float]]
    load: float
    busiest: str


def predict_deployment(
    run: Run, plan: Plan, *, rates_hz: Sequence[float] = (), cores: int | None = None
) -> Prediction:
    """Predict what a plan would do, from a run of the same graph with an anatomy.

    Args:
        run: of the graph, in any deployment.
        plan: of the deployment.
        rates_hz: the rates to predict; without any, those of the plan.
        cores: of the machine; without it, those of the run's machine.

    Raises:
        RecordError: a file of the run is missing or damaged.
        UsageError: the run is of another graph.
    """
    own, observed = (graph_nodes(each) for each in (plan, run.plan))
    if own - observed and observed - own:
        raise UsageError(
            f"the run is of another graph: it has {_shown_nodes(observed)} ({run.plan.name}), and "
            f"{plan.name} has {_shown_nodes(own)}",
            hint="Name a run of this spec, from 'r2bspec run SPEC --anatomy', or the spec of this "
            "run.",
        )
    return Predictor(run).predict(plan, rates_hz=rates_hz, cores=cores)


def _shown_nodes(names: Collection[str]) -> str:
    shown = sorted(names)[:_SHOWN_NODES]
    more = f" and {len(names) - len(shown)} more" if len(names) > len(shown) else ""
    return ", ".join(shown) + more


class Predictor:
    """Predicts deployments of the graph of a run, which is read once.

    Args:
        run: with an anatomy.

    Raises:
        RecordError: a file of the run is missing or damaged.
    """

    def __init__(self, run: Run) -> None:
        self._plan = run.plan
        self._cores = int(run.record.machine.get("cores") or 1)
        self._refused = ""
        joined: dict[str, Anatomy] = {}
        try:
            self._views = [undisturbed(observe(run, self._cores, "nobody", joined))]
            self._segments = self._views[0]
            if max(segment.taken for segment in self._segments) > _UNDISTURBED:
                # What threads wait for is not seen; simulations assume each cause in turn.
                self._views += [
                    undisturbed(observe(run, self._cores, cause, joined)) for cause in CAUSES[:-1]
                ]
            _check_rates(self._segments)
            self._scatter = _scatter(self._segments)
            self._residuals = self._calibrate(run)
        except NotKnownError as unknown:
            self._refused = str(unknown)

    def predict(
        self, plan: Plan, *, rates_hz: Sequence[float] = (), cores: int | None = None
    ) -> Prediction:
        """The prediction of a plan; see `predict_deployment`."""
        cores = cores or self._cores
        if self._refused:
            return nothing_known(plan, cores, self._refused)
        try:
            models = self._models(plan, cores)
        except NotKnownError as unknown:
            return nothing_known(plan, cores, str(unknown))
        wanted = [each.at.si for each in plan.objectives.values() if each.at is not None]
        own = sorted({*wanted, *(play.rate_hz for play in plan.play)} - {0.0})
        rates = rates_hz or own
        if len(rates) > MAX_PREDICTED_RATES:
            most = f"choose up to {MAX_PREDICTED_RATES} with --rate"
            return nothing_known(plan, cores, f"{len(rates):,} rates take too long; {most}")
        latencies: list[LatencyPrediction] = []
        loads = []
        peak = self._peak(models)
        for rate_hz in rates:
            found = self._simulate(models, plan, rate_hz)
            loads.append((rate_hz, found.busiest, found.load))
            latencies += [
                LatencyPrediction(
                    monitor=monitor,
                    metric=f"latency.{name}",
                    rate_hz=rate_hz,
                    estimate=self._estimate(rate_hz, monitor, name, values, found, peak),
                )
                for (monitor, name), values in found.values.items()
            ]
            latencies += [
                LatencyPrediction(
                    monitor=monitor,
                    metric=f"latency.{name}",
                    rate_hz=rate_hz,
                    estimate=Estimate(reason="what has a pace of its own has no latency"),
                )
                for monitor in sorted(_paced(plan))
                for name in PERCENTILES
            ]
        return Prediction(
            name=plan.name,
            cores=cores,
            latencies=tuple(latencies),
            peak=peak,
            loads=tuple(loads),
            requirements=tuple(requirement_answers(plan, rates, latencies, peak)),
        )

    def _models(self, plan: Plan, cores: int) -> list[DeployedModel]:
        return [
            DeployedModel(view, self._plan, plan, own_cores=self._cores, cores=cores)
            for view in self._views
        ]

    def _calibrate(self, run: Run) -> dict[float, dict[tuple[str, str], Measured]]:
        """By rate, monitor and percentile, what was measured.

        Raises:
            NotKnownError: the model does not reproduce the run.
        """
        if len(_paced(run.plan)) == len(run.plan.monitors):
            raise NotKnownError(
                "every monitor has a pace of its own, so no latency checks the model"
            )
        samples = read_samples(run)
        models = self._models(run.plan, self._cores)
        counting = {one.segment.id: one for each in samples.iterations.values() for one in each}
        names = {segment.name for segment in self._segments}
        # An iteration that is observed after everything that counts checks the model, and may
        # differ from those that count: it begins a start.
        observed = [
            counting.get(segment.id) or read_segment(run, segment)
            for segment in run.record.segments
            if segment.id in names
        ]
        residuals: dict[float, dict[tuple[str, str], Measured]] = {}
        for rate_hz in sorted({segment.rate_hz for segment in self._segments}):
            simulated = self._simulate(models, run.plan, rate_hz)
            of_rate = [one for one in observed if math.isclose(one.segment.rate_hz, rate_hz)]
            played = [one for one in of_rate if one.segment.id in counting] or list(
                samples.iterations_at(rate_hz)
            )
            residuals[rate_hz] = {}
            for (monitor, name), values in simulated.values.items():
                q, middle = int(name[1:]) / 100, _middle(values)
                times, lost = _latencies(played, monitor)
                measured = percentile(times, q, lost)
                if measured is None or times.size < MIN_STEPS:
                    raise NotKnownError(
                        f"too few messages of {monitor} were measured at {show(rate_hz, 'Hz')}: "
                        f"{times.size}, and {MIN_STEPS} are needed"
                    )
                own_times, own_lost = _latencies(of_rate, monitor)
                own = percentile(own_times, q, own_lost)
                if own is not None and _off(own, middle) > _TOLERANCE[name]:
                    raise NotKnownError(
                        "the model does not reproduce the run: at "
                        f"{rate_hz:g} Hz {monitor}.latency.{name} is {_ms(own)}, and "
                        f"{_ms(middle)} in the model"
                    )
                if math.isinf(measured) and math.isinf(middle):
                    continue
                if _off(measured, middle) > 2 * _TOLERANCE[name]:
                    raise NotKnownError(
                        f"the observed iteration is unlike the others: at {rate_hz:g} Hz "
                        f"{monitor}.latency.{name} is {_ms(measured)} in these, and "
                        f"{_ms(middle)} in its model"
                    )
                off = math.log(measured / middle)
                residuals[rate_hz][monitor, name] = Measured.of(off, times, q)
        return residuals

    def _estimate(
        self,
        rate_hz: float,
        monitor: str,
        name: str,
        values: Sequence[float],
        found: _Found,
        peak: Estimate,
    ) -> Estimate:
        if peak.high is not None and rate_hz > peak.high:
            return Estimate(
                reason=f"the graph does not keep up: its peak is below {peak.high:.3g} Hz"
            )
        if rate_hz > min(_NEAR_PEAK * (peak.value or math.inf), peak.low or math.inf):
            if peak.high is None:
                return Estimate(reason=f"the peak is not known: {peak.reason}")
            reason = f"it is near the peak, {show(peak.low, 'Hz')} … {show(peak.high, 'Hz')}"
            return Estimate(reason=reason)
        if found.load > _SATURATED:
            busy = f"{min(found.load, 1.0) * 100:.0f} %"
            return Estimate(reason=f"{found.busiest} is busy for {busy} of the time")
        residuals = self._residuals[_nearest(rate_hz, self._residuals)]
        if (monitor, name) not in residuals:
            return Estimate(reason="in the run it is that of a step without a message")
        of_run = residuals[monitor, name]
        if not all(map(math.isfinite, values)):
            return Estimate(reason="too many messages are lost in a part of the simulations")
        logs = np.log(values)
        spread = math.hypot(_ONE_SIDED * float(logs.std(ddof=1)), _FLOOR[name])
        middle, half = float(logs.mean()) + of_run.off / 2, spread + abs(of_run.off) / 2
        below, above = max(half, of_run.below), max(half, of_run.above)
        value, low, high = (math.exp(middle + by) for by in (0, -below, above))
        if high > _WIDEST * low:
            return Estimate(reason=f"all that is known is {_ms(low)} to {_ms(high)}")
        return Estimate(value=value, low=low, high=high)

    def _simulate(self, models: Sequence[DeployedModel], plan: Plan, rate_hz: float) -> _Found:
        random = np.random.default_rng(_SEED)
        places = self._places(rate_hz)
        steps = _steps(plan, rate_hz)
        answering = {
            monitor.name
            for monitor in plan.monitors
            if monitor.ratio_inputs == monitor.ratio_outputs
        }
        paced = _paced(plan)
        values: dict[tuple[str, str], list[float]] = {}
        busy: list[tuple[float, ...]] = []
        processes: tuple[str, ...] = ()
        for number in range(_SIMULATIONS):
            deployed = models[number % len(models)]
            drawn = draw(places, self._scatter, random)
            model = deployed.model(drawn)
            chosen = block_places(steps, deployed.counts(drawn), random)
            seen = simulate(model, _due(steps, rate_hz), chosen, random)
            busy.append(seen.busy)
            processes = tuple(executor.process for executor in model.executors)
            for monitor, latency in seen.latency_s.items():
                if monitor in paced:
                    continue
                came = latency[~np.isnan(latency)]
                lost = steps - came.size if monitor in answering else 0
                for name in PERCENTILES:
                    value = percentile(came, int(name[1:]) / 100, lost)
                    values.setdefault((monitor, name), []).append(
                        math.inf if value is None else value
                    )
        loads = np.mean(busy, axis=0)
        place = int(np.argmax(loads))
        return _Found(values, float(loads[place]), processes[place])

    def _places(self, rate_hz: float) -> list[int]:
        nearest = _nearest(rate_hz, {segment.rate_hz for segment in self._segments})
        return [
            place
            for place, each in enumerate(self._segments)
            if math.isclose(each.rate_hz, nearest)
        ]

    def _peak(self, models: Sequence[DeployedModel]) -> Estimate:
        """The highest rate at which the graph keeps up."""
        random = np.random.default_rng(_SEED + 1)
        places = list(range(len(self._segments)))
        near_hz, factor = max(segment.rate_hz for segment in self._segments), 2.0
        found: list[float] = []
        for number in range(_PEAK_SIMULATIONS):
            deployed = models[number % len(models)]
            drawn = draw(places, self._scatter, random)
            model = deployed.model(drawn)
            chosen = block_places(_STEPS[0], deployed.counts(drawn), random)
            near_hz = _highest_rate(model, near_hz, factor, chosen, random)
            found.append(near_hz)
            factor = 1.15  # others are not far from it
        # All of them are possible: no deployment is to be ruled out by the mean of some.
        low, high = min(found) / (1 + _PEAK_ERROR), max(found) * (1 + _PEAK_ERROR)
        if max(found) >= _FASTEST_HZ:
            reason = f"it is above {show(low, 'Hz')}, and rates above that are not simulated"
            return Estimate(low=low, reason=reason)
        return Estimate(value=float(np.median(found)), low=low, high=high)


def _scatter(segments: Sequence[ObservedSegment]) -> float:
    """The standard deviation of the logarithm of the work of a step, from iteration to iteration.

    Of each rate by itself: the work may depend on the rate.
    """
    logs: dict[float, list[float]] = {}
    for each in segments:
        work = sum(
            callback.work_s
            for inputs in each.inputs.values()
            for one in inputs
            for callback in one.callbacks
        )
        logs.setdefault(each.rate_hz, []).append(math.log(max(work, 1e-9) / max(each.steps, 1)))
    squares = sum(
        float(((np.array(of_rate) - np.mean(of_rate)) ** 2).sum()) for of_rate in logs.values()
    )
    degrees = len(segments) - len(logs)
    return max(_LEAST_SCATTER, math.sqrt(squares / degrees) if degrees else 0.0)


def _check_rates(segments: Sequence[ObservedSegment]) -> None:
    """Refuse nodes whose work depends on the rate.

    Raises:
        NotKnownError: there is one.
    """
    works: dict[str, dict[float, list[float]]] = {}
    for segment in segments:
        for node, inputs in segment.inputs.items():
            work = [callback.work_s for each in inputs for callback in each.callbacks]
            works.setdefault(node, {}).setdefault(segment.rate_hz, []).extend(work)
    for node, by_rate in works.items():
        means = {rate: float(np.mean(work)) for rate, work in by_rate.items() if work}
        errors = {
            rate: float(np.std(work)) / math.sqrt(len(work))
            for rate, work in by_rate.items()
            if work
        }
        least, most = min(means, key=means.__getitem__), max(means, key=means.__getitem__)
        apart = means[most] - means[least]
        if apart > _RATE_DEPENDENT * means[least] + 3 * math.hypot(errors[least], errors[most]):
            raise NotKnownError(
                f"the callbacks of {node} take {_ms(means[least])} at {least:g} Hz and "
                f"{_ms(means[most])} at {most:g} Hz: what they take at other rates is not known"
            )


def _paced(plan: Plan) -> set[str]:
    """The monitors of what has a pace of its own: no message of it answers a step."""
    return {monitor.name for monitor in plan.monitors if monitor.match == "own_pace"}


def _steps(plan: Plan, rate_hz: float) -> int:
    """As many as a run of the plan plays at a rate, within limits."""
    seconds = sum(play.duration_ns * play.iterations for play in plan.play[:1]) / 1e9
    return int(min(max(rate_hz * (seconds or 10.0), _STEPS[0]), _STEPS[1]))


def _highest_rate(
    model: GraphModel,
    near_hz: float,
    factor: float,
    places: Sequence[tuple[int, float]],
    random: np.random.Generator,
) -> float:
    """The rate up to which a model keeps up, to 3 %.

    From a rate that may be near, steps of a factor lead to where it changes; bisection follows.
    """
    low = high = near_hz
    if _keeps_up(model, near_hz, places, random):
        while high < _FASTEST_HZ and _keeps_up(model, high := factor * high, places, random):
            low = high
    else:
        while low > _SLOWEST_HZ and not _keeps_up(model, low := low / factor, places, random):
            high = low
    while high / low > 1.03:
        middle = math.sqrt(low * high)
        if _keeps_up(model, middle, places, random):
            low = middle
        else:
            high = middle
    return math.sqrt(low * high)


def _keeps_up(
    model: GraphModel,
    rate_hz: float,
    places: Sequence[tuple[int, float]],
    random: np.random.Generator,
) -> bool:
    steps = len(places)
    most_lost = _MAX_LOST * steps
    seen = simulate(model, _due(steps, rate_hz), places, random, most_lost=most_lost)
    if seen.overwritten > most_lost:
        return False
    # Without losses, what comes later and later shows that the backlog grows.
    for latency in seen.latency_s.values():
        known = latency[~np.isnan(latency)]
        third = known.size // 3
        if third and known[-third:].mean() - known[:third].mean() > 0.01 * steps / rate_hz:
            return False
    return True


def _due(steps: int, rate_hz: float) -> Seconds:
    return np.arange(steps, dtype=np.float64) / rate_hz


def _nearest(rate_hz: float, rates: Mapping[float, object] | set[float]) -> float:
    return min(rates, key=lambda each: abs(math.log(each / rate_hz)))


def _middle(values: Sequence[float]) -> float:
    return float(np.exp(np.mean(np.log(values)))) if all(map(math.isfinite, values)) else math.inf


def _latencies(played: Sequence[SegmentSamples], monitor: str) -> tuple[Seconds, int]:
    """The latencies of a monitor in some iterations, and how many messages never came."""
    seen = [each.monitors[monitor] for each in played if monitor in each.monitors]
    times = np.concatenate([np.empty(0), *(each.times["latency"] for each in seen)])
    return times, sum(each.missed for each in seen)


def _off(measured: float, simulated: float) -> float:
    """How far two percentiles are from each other, as a logarithm; lost messages are infinity."""
    if all(math.isfinite(value) and value > 0 for value in (measured, simulated)):
        return abs(math.log(measured / simulated))
    return 0.0 if measured == simulated else math.inf


def _ms(seconds: float) -> str:
    return f"{seconds * 1e3:.3g} ms"
