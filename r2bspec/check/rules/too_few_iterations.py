"""Bounds on means with a single iteration."""

from __future__ import annotations

from r2bspec.check.rule_api import (
    Context,
    Finding,
    Findings,
    Pointer,
    Rule,
    example,
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


RULE = Rule(
    code="R2B511",
    title="too few iterations to confirm a bound on a mean",
    severity="error",
    why="The confidence interval of a mean is computed from the spread between iterations. One "
    "iteration has no spread, so the requirement stays inconclusive.",
    failing=example(
        benchmark="{duration: 20 s, iterations: 1, rates: [30 Hz]}",
        slos="{fast: {at: 30 Hz, require: [throughput.mean >= 97 % of offered]}}",
    ),
    passing=example(
        benchmark="{duration: 5 s, iterations: 4, rates: [30 Hz]}",
        slos="{fast: {at: 30 Hz, require: [throughput.mean >= 97 % of offered]}}",
    ),
    find=_find,
)
