"""Whether a run of the declared length can confirm what is required, and fits its time.

The statistics behind it are in docs/verdicts.md: a share is confirmed by a number of messages, a
mean by a number of iterations, and both only to a confidence below 100 %.
"""

from __future__ import annotations

import math

from r2bspec.check.check_context import Context
from r2bspec.check.requirement_metrics import KnownMetric, max_wrong_share
from r2bspec.check.rule import Finding, Findings, Pointer, rule, value_key
from r2bspec.diagnostics.diagnostic import Path
from r2bspec.diagnostics.quote import pluralize, quote
from r2bspec.judge.statistics.rule_of_three import min_sample_size
from r2bspec.language.benchmark_defaults import MIN_ITERATIONS, default_starts
from r2bspec.language.quantities import Duration, Rate

# An iteration of n messages has n - 1 intervals, and n - 2 differences between intervals.
_LOST_SAMPLES = {"interval": 1, "jitter": 2}


@rule("R2B510")
def too_few_messages(context: Context) -> Findings:
    """Requirements that a run of the declared length cannot confirm."""
    for metric in context.known_metrics:
        located = metric.located
        max_share = max_wrong_share(metric)
        if located.role != "objective" or located.at is None or max_share is None:
            continue
        needed = min_sample_size(max_share, located.confidence)
        if needed is None:
            yield _unprovable(metric)
        elif located.at in context.spec.benchmark.rates:
            finding = _too_few(context, metric, located.at, needed)
            if finding is not None:
                yield finding


def _unprovable(metric: KnownMetric) -> Finding:
    return Finding(
        message=f"no number of messages can confirm {quote(metric.located.requirement.text)}",
        path=metric.located.path,
        help="require 'missed == 0', which is about the observed messages, or allow a small share",
        suppressed_by={metric.located.subject},
    )


def _too_few(context: Context, metric: KnownMetric, at: Rate, needed: int) -> Finding | None:
    benchmark = context.spec.benchmark
    per_iteration = round(at.hz * benchmark.duration.seconds) - _LOST_SAMPLES.get(
        metric.info.family, 0
    )
    iterations = max(benchmark.iterations, benchmark.max_iterations)
    played = max(per_iteration, 0) * iterations
    if played >= needed:
        return None
    enough = math.ceil(needed / per_iteration) if per_iteration > 0 else 0
    return Finding(
        message=f"{played:,} messages at {at} cannot confirm "
        f"{quote(metric.located.requirement.text)}: at least {needed:,} are needed",
        path=metric.located.path,
        help=(
            f"set 'benchmark.iterations' to {enough} or more, or increase 'benchmark.duration'"
            if enough
            else "increase 'benchmark.duration'"
        )
        + "; if some messages violate the bound, several times as many are needed",
        suppressed_by={metric.located.subject, value_key(("slos", metric.located.objective, "at"))},
    )


@rule("R2B511")
def too_few_iterations(context: Context) -> Findings:
    """Bounds on means with a single iteration."""
    benchmark = context.spec.benchmark
    if max(benchmark.iterations, benchmark.max_iterations) > 1:
        return
    for metric in context.known_metrics:
        located = metric.located
        compared = located.requirement.op in {"<", "<=", ">", ">="}
        if metric.info.statistic == "mean" and compared and located.role == "objective":
            yield Finding(
                message=f"one iteration cannot confirm {quote(located.requirement.text)}",
                path=located.path,
                help="set 'benchmark.iterations' to 2 or more; 5 or more give a useful interval",
                related=(Pointer("'iterations' is 1", ("benchmark", "iterations")),),
                suppressed_by={located.subject, value_key(("slos", located.objective, "at"))},
            )


_MIN_MESSAGES = 2


@rule("R2B513")
def iteration_too_short(context: Context) -> Findings:
    """Iterations that play fewer than two messages."""
    duration = context.spec.benchmark.duration
    for index, rate in enumerate(context.spec.benchmark.rates):
        steps = round(rate.hz * duration.seconds)
        if steps < _MIN_MESSAGES:
            needed = Duration(round(_MIN_MESSAGES / rate.hz * 1e9))
            yield Finding(
                message=f"an iteration of {duration} at {rate} plays {pluralize(steps, 'message')}",
                path=("benchmark", "rates", index),
                help=f"set 'duration' to {needed} or longer, for at least two messages",
                related=(Pointer(f"an iteration takes {duration}", ("benchmark", "duration")),),
            )


@rule("R2B520")
def too_few_windows(context: Context) -> Findings:
    """Shares of windows that the declared number of windows cannot confirm."""
    benchmark = context.spec.benchmark
    iterations = max(benchmark.iterations, benchmark.max_iterations)
    for metric in context.known_metrics:
        located = metric.located
        requirement = located.requirement
        if requirement.windows_share is None or located.role != "objective":
            continue
        windows = benchmark.duration.ns // requirement.window_ns * iterations
        needed = min_sample_size(1 - requirement.windows_share, located.confidence)
        if needed is not None and windows >= needed:
            continue
        length = Duration(requirement.window_ns)
        yield Finding(
            message=f"{pluralize(windows, 'window')} of {length} cannot confirm "
            f"{quote(requirement.text)}"
            + (f": at least {needed:,} are needed" if needed is not None else ""),
            path=located.path,
            help="allow a small share of windows to violate the bound"
            if needed is None
            else "increase 'duration' or 'iterations', use shorter windows, or require a smaller "
            "share",
            related=(
                Pointer(f"an iteration takes {benchmark.duration}", ("benchmark", "duration")),
            ),
            suppressed_by={located.subject},
        )


@rule("R2B521")
def time_budget_too_short(context: Context) -> Findings:
    """Time budgets that are shorter than the iterations."""
    benchmark = context.spec.benchmark
    budget = benchmark.gate.time_budget
    rates = 1 if context.has_own_rate else len(set(benchmark.rates))
    needed = benchmark.duration.ns * benchmark.iterations * rates
    if budget is not None and needed > budget.ns:
        yield Finding(
            message=f"time budget of {budget} is too short: the iterations take {Duration(needed)}",
            path=("benchmark", "gate", "time_budget"),
            help=f"set 'time_budget' to {Duration(needed)} or more, or play fewer or shorter "
            "iterations",
            related=(
                Pointer(f"'iterations' is {benchmark.iterations}", ("benchmark", "iterations")),
            ),
        )


@rule("R2B522")
def confidence_out_of_range(context: Context) -> Findings:
    """Confidences that are not between 50 % and 100 %."""
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
        if confidence is not None and not 0.5 < confidence < 1:
            yield Finding(
                message=f"a confidence of {confidence * 100:g} % "
                + ("cannot be reached" if confidence >= 1 else "is no better than chance"),
                path=path,
                help="use 95 % or, for about 50 % more messages, 99 %",
                suppresses=frozenset(requirement.subject for requirement in context.requirements),
            )


@rule("R2B530")
def iterations_per_start(context: Context) -> Findings:
    """Starts with fewer than two iterations each."""
    benchmark = context.spec.benchmark
    starts = benchmark.starts or 1
    if starts == 1 or benchmark.iterations >= MIN_ITERATIONS * starts:
        return
    fitting = default_starts(benchmark.iterations)
    fewer = f"'starts' to {fitting}, or " if fitting > 1 else ""
    yield Finding(
        message=f"{starts} starts need at least {MIN_ITERATIONS * starts} iterations, two each: "
        f"there {'is' if benchmark.iterations == 1 else 'are'} "
        f"{pluralize(benchmark.iterations, 'iteration')}",
        path=("benchmark", "starts"),
        help=f"set {fewer}'iterations' to {MIN_ITERATIONS * starts} or more; with 'starts: 1' the "
        "verdict is about one start of the processes",
        related=(Pointer(f"'iterations' is {benchmark.iterations}", ("benchmark", "iterations")),),
    )


@rule("R2B531")
def starts_of_external_nodes(context: Context) -> Findings:
    """Several starts of a graph with nodes that a run cannot start."""
    starts = context.spec.benchmark.starts or 1
    if starts > 1 and context.spec.has_external_nodes:
        yield Finding(
            message="'starts' has no effect: r2bspec cannot restart the external nodes of the "
            "graph, so the run has one start",
            path=("benchmark", "starts"),
            help="write 'starts: 1', and run several times, each time with external nodes that "
            "were restarted; or let r2bspec start the nodes",
        )
