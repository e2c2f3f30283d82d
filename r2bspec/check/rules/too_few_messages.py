"""Requirements that no run of the declared length can show to hold."""

from __future__ import annotations

import math

from r2bspec.check.rule_api import (
    Context,
    Finding,
    Iterator,
    KnownMetric,
    Rule,
    Severity,
    example,
    known_metrics,
    quote,
    suppression_keys,
)
from r2bspec.judge.statistics.rule_of_three import min_sample_size
from r2bspec.language.quantities import Rate

# Values that an iteration has fewer than messages: what lies between them, and between those.
_LOST_SAMPLES = {"interval": 1, "jitter": 2}


def _find(context: Context) -> Iterator[Finding]:
    for each in known_metrics(context):
        located = each.located
        max_share = _max_wrong_share(each)
        if located.role != "objective" or located.at is None or max_share is None:
            continue
        needed = min_sample_size(max_share, located.confidence)
        if needed is None:
            yield _unprovable(each)
        elif located.at in context.spec.benchmark.rates:
            finding = _too_few(context, each, located.at, needed)
            if finding is not None:
                yield finding


def _max_wrong_share(each: KnownMetric) -> float | None:
    """The share of messages that may be on the wrong side; None if no share decides."""
    requirement, info = each.located.requirement, each.info
    if requirement.bound is None or requirement.windows_share is not None:
        return None
    if requirement.bound.of_baseline or requirement.op not in {"<", "<=", ">", ">="}:
        return None
    ceiling = requirement.op in {"<", "<="}
    if info.statistic == "percentile" and info.quantile is not None:
        return 1 - info.quantile if ceiling else info.quantile
    if info.statistic == "share":
        return requirement.bound.value if ceiling else 1 - requirement.bound.value
    return None


def _unprovable(each: KnownMetric) -> Finding:
    return Finding(
        message=f"no number of messages can show that {quote(each.located.requirement.text)}",
        path=each.located.path,
        help="require 'missed == 0' of what is observed, or allow a small share",
        suppressed_by=frozenset({each.located.subject}),
    )


def _too_few(context: Context, each: KnownMetric, at: Rate, needed: int) -> Finding | None:
    benchmark = context.spec.benchmark
    per_iteration = round(at.hz * benchmark.duration.seconds) - _LOST_SAMPLES.get(
        each.info.family, 0
    )
    iterations = max(benchmark.iterations, benchmark.max_iterations)
    played = max(per_iteration, 0) * iterations
    if played >= needed:
        return None
    enough = math.ceil(needed / per_iteration) if per_iteration > 0 else 0
    return Finding(
        message=f"{played:,} messages at {at} can never show that "
        f"{quote(each.located.requirement.text)}; that takes {needed:,} at least",
        path=each.located.path,
        help=(
            f"set 'benchmark.iterations' to {enough} or more, or play longer ones"
            if enough
            else "make 'benchmark.duration' longer"
        )
        + "; with some messages over the bound it takes several times as many",
        suppressed_by=frozenset(
            {each.located.subject, suppression_keys.value(("slos", each.located.objective, "at"))}
        ),
    )


RULE = Rule(
    code="R2B510",
    title="a requirement that a run of this length can never settle",
    severity=Severity.ERROR,
    why="A verdict needs 95 % confidence. To show that at most 1 % of all messages are late takes "
    "299 messages of which none is late; with fewer, the best possible run is inconclusive.",
    failing=example(
        benchmark="{duration: 5 s, iterations: 1, rates: [30 Hz]}",
        slos="{fast: {at: 30 Hz, require: [latency.p99 < 50 ms]}}",
    ),
    passing=example(
        benchmark="{duration: 5 s, iterations: 5, rates: [30 Hz]}",
        slos="{fast: {at: 30 Hz, require: [latency.p99 < 50 ms]}}",
    ),
    find=_find,
)
