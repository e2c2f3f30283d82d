"""Starts with fewer than two iterations each."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, Pointer, Rule, pluralize
from r2bspec.language.benchmark_defaults import MIN_ITERATIONS, default_starts


def _find(context: Context) -> Findings:
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


RULE = Rule(code="R2B530", find=_find)
