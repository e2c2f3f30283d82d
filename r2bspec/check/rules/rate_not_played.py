"""Objectives at rates that are not played."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, Rule, value_key
from r2bspec.language.spec import Objective
from r2bspec.measure.metric_catalogue import METRICS


def _find(context: Context) -> Findings:
    if context.has_own_rate:
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
    """Whether any requirement is about iterations; a sustained rate has its own probe."""
    return any(
        (info := METRICS.get(each.metric)) is None or info.statistic not in {"sequential", "search"}
        for each in objective.require
    )


RULE = Rule(code="R2B504", find=_find)
