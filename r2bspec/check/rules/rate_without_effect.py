"""Rates and searches in playback modes without a selectable rate."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, Rule, quote


def _find(context: Context) -> Findings:
    if not context.has_own_rate:
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


RULE = Rule(code="R2B408", find=_find)
