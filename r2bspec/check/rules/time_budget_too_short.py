"""Time budgets that are shorter than the iterations."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, Pointer, Rule
from r2bspec.language.quantities import Duration


def _find(context: Context) -> Findings:
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


RULE = Rule(code="R2B521", find=_find)
