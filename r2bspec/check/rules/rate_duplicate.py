"""Duplicate rates."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, Pointer, Rule
from r2bspec.language.quantities import Rate


def _find(context: Context) -> Findings:
    first: dict[Rate, int] = {}
    for index, rate in enumerate(context.spec.benchmark.rates):
        if rate in first:
            yield Finding(
                message=f"duplicate rate {rate}",
                path=("benchmark", "rates", index),
                help="remove it; to repeat every rate, increase 'iterations'",
                related=(Pointer("first listed here", ("benchmark", "rates", first[rate])),),
            )
        first.setdefault(rate, index)


RULE = Rule(code="R2B512", find=_find)
