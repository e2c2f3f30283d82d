"""Benchmarks without a rate or a search."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, Rule, value_key


def _find(context: Context) -> Findings:
    benchmark = context.spec.benchmark
    sustained = any(each.requirement.metric == "sustained" for each in context.requirements)
    own = context.has_own_rate
    if not own and not benchmark.rates and benchmark.search is None and not sustained:
        at = {value_key(("slos", name, "at")) for name in context.spec.slos}
        yield Finding(
            message="no 'rates' and no 'search': nothing would be played",
            path=("benchmark",),
            key=True,
            help="add 'rates: [30 Hz]' or 'search: {min: 5 Hz, max: 200 Hz}' under 'benchmark'",
            suppresses=frozenset(at),
        )


RULE = Rule(code="R2B500", find=_find)
