"""Bounds on means with a single iteration."""

from __future__ import annotations

from r2bspec.check.rule_api import (
    Context,
    Finding,
    Findings,
    Pointer,
    Rule,
    known_metrics,
    quote,
    value_key,
)


def _find(context: Context) -> Findings:
    benchmark = context.spec.benchmark
    if max(benchmark.iterations, benchmark.max_iterations) > 1:
        return
    for each in known_metrics(context):
        located = each.located
        compared = located.requirement.op in {"<", "<=", ">", ">="}
        if each.info.statistic == "mean" and compared and located.role == "objective":
            yield Finding(
                message=f"one iteration cannot confirm {quote(located.requirement.text)}",
                path=located.path,
                help="set 'benchmark.iterations' to 2 or more; 5 or more give a useful interval",
                related=(Pointer("'iterations' is 1", ("benchmark", "iterations")),),
                suppressed_by={located.subject, value_key(("slos", located.objective, "at"))},
            )


RULE = Rule(code="R2B511", find=_find)
