"""Rates that are listed twice."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, Pointer, Rule, example
from r2bspec.language.quantities import Rate


def _find(context: Context) -> Findings:
    first: dict[Rate, int] = {}
    for index, rate in enumerate(context.spec.benchmark.rates):
        if rate in first:
            yield Finding(
                message=f"{rate} is played once, although it is listed twice",
                path=("benchmark", "rates", index),
                help="'iterations' says how often each rate is played",
                related=(Pointer("listed here already", ("benchmark", "rates", first[rate])),),
            )
        first.setdefault(rate, index)


RULE = Rule(
    code="R2B512",
    title="a rate that is listed twice",
    severity="warning",
    why="Results are kept by rate; the second time would have nowhere to go.",
    failing=example(benchmark="{rates: [30 Hz, 0.03 kHz]}"),
    passing=example(benchmark="{rates: [30 Hz, 60 Hz]}"),
    find=_find,
)
