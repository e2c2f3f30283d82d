"""Benchmarks that play nothing."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, Rule, example, value_key


def _find(context: Context) -> Findings:
    benchmark = context.spec.benchmark
    sustained = any(each.requirement.metric == "sustained" for each in context.requirements)
    own = context.has_own_rate
    if not own and not benchmark.rates and benchmark.search is None and not sustained:
        at = {value_key(("slos", name, "at")) for name in context.spec.slos}
        yield Finding(
            message="nothing is played: there are neither rates nor a search",
            path=("benchmark",),
            key=True,
            help="add 'rates: [30 Hz]' or 'search: {min: 5 Hz, max: 200 Hz}' under 'benchmark'",
            suppresses=frozenset(at),
        )


RULE = Rule(
    code="R2B500",
    title="a benchmark that plays nothing",
    severity="error",
    why="Without a rate or a search nothing would be measured.",
    failing=example(benchmark="{duration: 5 s}"),
    passing=example(benchmark="{duration: 5 s, rates: [30 Hz]}"),
    find=_find,
)
