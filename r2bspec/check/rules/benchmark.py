"""The benchmark: which rates are played or searched, and whether a run of its length can decide.

The statistics behind it are in docs/verdicts.md: a share is decided by a number of messages, a mean
by a number of iterations, and both only to a confidence below 100 %.
"""

from __future__ import annotations

import math

from r2bspec.check.check_context import Context, KnownMetric, max_wrong_share
from r2bspec.check.rule import Finding, Findings, Pointer, rule, value_key
from r2bspec.diagnostics.diagnostic import Path
from r2bspec.diagnostics.quote import quote
from r2bspec.judge.measure.metric import Scope
from r2bspec.judge.measure.metric_catalogue import listed
from r2bspec.judge.statistics.rule_of_three import min_sample_size
from r2bspec.language.benchmark_defaults import LEAST_STARTS, MIN_CONFIDENCE
from r2bspec.language.quantities import Rate
from r2bspec.language.spec import Monitor, Objective
from r2bspec.plan.interim_looks import InterimLooks


@rule("R2B408")
def rate_without_effect(context: Context) -> Findings:
    """Find rates and searches in playback modes without a selectable rate."""
    monitors = context.spec.monitors.values()
    countable = any(monitor.counts_answers for monitor in monitors)
    if context.spec.benchmark.search and monitors and not countable:
        yield Finding(
            message="'search' has no effect: no monitor expects a number of outputs, without which "
            "no backlog is known",
            path=("benchmark", "search"),
            key=True,
            help="remove it, or add a monitor that matches by stamp or by order",
            suppresses={"rates"},
        )
    if not context.spec.has_own_rate:
        return
    mode = context.spec.playback.mode
    source = "the recording" if mode == "timeline" else "the source in the graph"
    benchmark = context.spec.benchmark
    for key, value in (("rates", benchmark.rates), ("search", benchmark.search)):
        if value:
            yield Finding(
                message=f"{quote(key)} has no effect with 'mode: {mode}': {source} sets the rate",
                path=("benchmark", key),
                key=True,
                help="remove it, or use 'mode: looping'",
                suppresses={"rates"},
            )
    for name, objective in context.spec.slos.items():
        if objective.at is not None or objective.at_peak:
            yield Finding(
                message=f"'at' has no effect with 'mode: {mode}': {source} sets the rate",
                path=("slos", name, "at"),
                help="remove 'at'",
                suppressed_by={"rates"},
            )


@rule("R2B500")
def benchmark_without_rate(context: Context) -> Findings:
    """Find benchmarks without a rate or a search."""
    benchmark = context.spec.benchmark
    sustained = any(each.requirement.metric == "sustained" for each in context.requirements)
    own = context.spec.has_own_rate
    if not own and not benchmark.rates and benchmark.search is None and not sustained:
        at = {value_key(("slos", name, "at")) for name in context.spec.slos}
        yield Finding(
            message="no 'rates' and no 'search': nothing would be played",
            path=("benchmark",),
            key=True,
            help="add 'rates: [30 Hz]' or 'search: {min: 5 Hz, max: 200 Hz}' under 'benchmark'",
            suppresses=frozenset(at),
        )


@rule("R2B535")
def two_starts(context: Context) -> Findings:
    """Find two starts, which leave a verdict open more often than one start does."""
    starts = context.spec.benchmark.starts
    if starts is not None and 1 < starts < LEAST_STARTS:
        yield Finding(
            message=f"{starts} starts do not show by how much starts differ",
            path=("benchmark", "starts"),
            help=f"set 'starts' to {LEAST_STARTS} or more, or to 1 for a verdict on one start",
        )


@rule("R2B504")
def rate_not_played(context: Context) -> Findings:
    """Find objectives at rates that are not played."""
    if context.spec.has_own_rate:
        return
    played = context.spec.benchmark.rates
    for name, objective in context.spec.slos.items():
        if objective.at is not None and objective.at not in played and _needs_playing(objective):
            rates = ", ".join(str(rate) for rate in played)
            yield Finding(
                message=f"no iteration is played at {objective.at}",
                path=("slos", name, "at"),
                help=f"add it to 'benchmark.rates' (played: {rates})"
                if played
                else "add it to 'benchmark.rates', which is empty",
                suppresses={value_key(("slos", name, "at"))},
            )


def _needs_playing(objective: Objective) -> bool:
    """Return whether any requirement is about iterations; a sustained rate has its own probe."""
    return any(
        (info := listed().get(requirement.metric)) is None
        or info.statistic not in {"sequential", "search"}
        for requirement in objective.require
    )


@rule("R2B505")
def requirement_without_rate(context: Context) -> Findings:
    """Find requirements that need a rate but have none."""
    if context.spec.has_own_rate:
        return
    rates = ", ".join(str(rate) for rate in context.spec.benchmark.rates)
    for metric in context.known_metrics:
        if metric.needs_rate and metric.info.statistic != "search":
            yield Finding(
                message=f"requirement on {quote(metric.info.name)} has no rate",
                path=metric.path,
                part=metric.metric_part,
                help=f"add 'at:' to the objective {quote(metric.objective)}"
                + (f"; played rates: {rates}" if rates else ""),
                suppresses={metric.subject},
            )


@rule("R2B506")
def peak_without_search(context: Context) -> Findings:
    """Find requirements on the peak in specs without a search."""
    if context.spec.benchmark.search is not None:
        return
    for name, objective in context.spec.slos.items():
        if objective.at_peak:
            yield Finding(
                message=f"objective {quote(name)} applies at the peak, but 'benchmark' has no "
                "search",
                path=("slos", name, "at"),
                help="add one under 'benchmark': 'search: {min: 5 Hz, max: 200 Hz}'",
            )
    for metric in context.known_metrics:
        if metric.info.statistic == "search":
            yield Finding(
                message=f"{quote(metric.info.name)} is required, but 'benchmark' has no search",
                path=metric.path,
                part=metric.metric_part,
                help="add one under 'benchmark': 'search: {min: 5 Hz, max: 200 Hz}'",
                suppresses={metric.subject},
            )


_SEARCH = ("benchmark", "search")


@rule("R2B507")
def peak_outside_search(context: Context) -> Findings:
    """Find requirements on the peak outside the range of the search."""
    search = context.spec.benchmark.search
    if search is None or search.min.hz >= search.max.hz:
        return
    for metric in context.known_metrics:
        bound = metric.requirement.bound
        if metric.info.statistic != "search" or bound is None or bound.dimension != "rate":
            continue
        if search.min.hz < bound.value <= search.max.hz:
            continue
        end = "max" if bound.value > search.max.hz else "min"
        limit = search.max if end == "max" else search.min
        yield Finding(
            message=f"a search from {search.min} to {search.max} cannot decide "
            f"{quote(metric.requirement.text)}",
            path=metric.path,
            part=metric.bound_part,
            help=f"set {quote(end)} of the search {'above' if end == 'max' else 'below'} "
            f"{bound.value:g} Hz",
            related=(
                Pointer(
                    f"the search {'ends' if end == 'max' else 'begins'} at {limit}", (*_SEARCH, end)
                ),
            ),
            suppressed_by={metric.subject},
        )


@rule("R2B508")
def search_range_empty(context: Context) -> Findings:
    """Find searches with an empty range."""
    search = context.spec.benchmark.search
    if search is not None and search.min.hz >= search.max.hz:
        yield Finding(
            message=f"search range is empty: 'max' ({search.max}) is not above 'min' "
            f"({search.min})",
            path=(*_SEARCH, "max"),
            help="set 'max', the highest rate that is tried, above 'min'",
            related=(Pointer("the search begins here", (*_SEARCH, "min")),),
        )


@rule("R2B510")
def too_few_messages(context: Context) -> Findings:
    """Find requirements that a run of the declared length cannot confirm."""
    for metric in context.known_metrics:
        max_share = max_wrong_share(metric)
        if metric.role != "objective" or metric.at is None or max_share is None:
            continue
        if not all(each.counts_answers for each in _monitors_of(metric, context)):
            # How many messages come is not known.
            continue
        needed = min_sample_size(max_share, _last_confidence(context, metric.confidence))
        if needed is None:
            yield Finding(
                message=f"no number of messages can confirm {quote(metric.requirement.text)}",
                path=metric.path,
                help="require 'missed == 0', which is about the observed messages, or allow a "
                "small share",
                suppressed_by={metric.subject},
            )
        elif metric.at in context.spec.benchmark.rates:
            finding = _too_few(context, metric, metric.at, needed)
            if finding is not None:
                yield finding


def _monitors_of(metric: KnownMetric, context: Context) -> list[Monitor]:
    """Return the monitors of which a metric is required.

    None if it is of a call, or of another scope.
    """
    if metric.info.scope is not Scope.MONITOR:
        return []
    monitors = context.spec.monitors
    return [monitors[name] for name in monitors if metric.monitor in (None, "", name)]


def _last_confidence(context: Context, confidence: float) -> float:
    """Return the confidence of a decision after all iterations, at the last interim look."""
    spec = context.spec
    looks = InterimLooks.planned(
        spec.benchmark.iterations, spec.starts, spec.benchmark.max_iterations
    )
    return looks.confidence_at(len(looks), confidence)


def _too_few(context: Context, metric: KnownMetric, at: Rate, needed: int) -> Finding | None:
    benchmark = context.spec.benchmark
    steps = round(at.hz * benchmark.duration.seconds)
    per_iteration = steps - metric.info.metric.fewer
    iterations = max(benchmark.iterations, benchmark.max_iterations)
    counted = max(per_iteration, 0) * iterations
    if counted >= needed:
        return None
    enough = math.ceil(needed / per_iteration) if per_iteration > 0 else 0
    return Finding(
        message=f"{counted:,} messages at {at} cannot confirm "
        f"{quote(metric.requirement.text)}: at least {needed:,} are needed",
        path=metric.path,
        help=(
            f"set 'benchmark.iterations' to {enough} or more, or increase 'benchmark.duration'"
            if enough
            else "increase 'benchmark.duration'"
        )
        + "; if some messages violate the bound, several times as many are needed",
        suppressed_by={metric.subject, value_key(("slos", metric.objective, "at"))},
    )


@rule("R2B522")
def confidence_out_of_range(context: Context) -> Findings:
    """Find confidences that are not from 51 % to below 100 %."""
    benchmark = context.spec.benchmark
    places: list[tuple[float | None, Path]] = [
        (benchmark.gate.confidence.fraction, ("benchmark", "gate", "confidence"))
    ]
    if benchmark.search is not None:
        places.append((benchmark.search.confidence.fraction, ("benchmark", "search", "confidence")))
    for name, objective in context.spec.slos.items():
        own = objective.confidence
        places.append((None if own is None else own.fraction, ("slos", name, "confidence")))
    for confidence, path in places:
        if confidence is not None and not MIN_CONFIDENCE <= confidence < 1:
            yield Finding(
                message=f"a confidence of {confidence * 100:g} % "
                + ("cannot be reached" if confidence >= 1 else "is hardly better than chance"),
                path=path,
                help="use 95 % or, for about 50 % more messages, 99 %",
                suppresses=frozenset(requirement.subject for requirement in context.requirements),
            )
