"""Requirements that a run of the declared length cannot confirm."""

from __future__ import annotations

import math

from r2bspec.check.rule_api import (
    Context,
    Finding,
    Findings,
    KnownMetric,
    Rule,
    known_metrics,
    max_wrong_share,
    quote,
    value_key,
)
from r2bspec.judge.statistics.rule_of_three import min_sample_size
from r2bspec.language.quantities import Rate

# An iteration of n messages has n - 1 intervals, and n - 2 differences between intervals.
_LOST_SAMPLES = {"interval": 1, "jitter": 2}


def _find(context: Context) -> Findings:
    for each in known_metrics(context):
        located = each.located
        max_share = max_wrong_share(each)
        if located.role != "objective" or located.at is None or max_share is None:
            continue
        needed = min_sample_size(max_share, located.confidence)
        if needed is None:
            yield _unprovable(each)
        elif located.at in context.spec.benchmark.rates:
            finding = _too_few(context, each, located.at, needed)
            if finding is not None:
                yield finding


def _unprovable(each: KnownMetric) -> Finding:
    return Finding(
        message=f"no number of messages can confirm {quote(each.located.requirement.text)}",
        path=each.located.path,
        help="require 'missed == 0', which is about the observed messages, or allow a small share",
        suppressed_by={each.located.subject},
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
        message=f"{played:,} messages at {at} cannot confirm "
        f"{quote(each.located.requirement.text)}: at least {needed:,} are needed",
        path=each.located.path,
        help=(
            f"set 'benchmark.iterations' to {enough} or more, or increase 'benchmark.duration'"
            if enough
            else "increase 'benchmark.duration'"
        )
        + "; if some messages violate the bound, several times as many are needed",
        suppressed_by={each.located.subject, value_key(("slos", each.located.objective, "at"))},
    )


RULE = Rule(code="R2B510", find=_find)
