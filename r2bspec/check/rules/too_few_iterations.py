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
                message=f"one iteration can never show that {quote(located.requirement.text)}",
                path=located.path,
                help="set 'benchmark.iterations' to 2 at least; 5 or more make a useful interval",
                related=(Pointer("one iteration", ("benchmark", "iterations")),),
                suppressed_by={located.subject, value_key(("slos", located.objective, "at"))},
            )


RULE = Rule(
    code="R2B511",
    title="a bound on a mean with a single iteration",
    severity="error",
    why="How much a mean scatters is seen in how much iterations differ, and one differs from "
    "nothing: such a requirement stays inconclusive for ever.",
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
