"""Requirements on a search that the spec does not ask for."""

from __future__ import annotations

from collections.abc import Iterator

from r2bspec.check.check_context import Context
from r2bspec.check.example_spec import example
from r2bspec.check.finding import Finding
from r2bspec.check.requirement_metrics import known_metrics
from r2bspec.check.rule import Rule
from r2bspec.diagnostics.diagnostic import Severity
from r2bspec.diagnostics.quote import quote


def _find(context: Context) -> Iterator[Finding]:
    if context.spec.benchmark.search is not None:
        return
    for name, objective in context.spec.slos.items():
        if objective.at_peak:
            yield Finding(
                message=f"{quote(name)} is to hold at the peak, but no search is asked for",
                path=("slos", name, "at"),
                help="add one under 'benchmark': 'search: {min: 5 Hz, max: 200 Hz}'",
            )
    for each in known_metrics(context):
        if each.info.statistic == "search":
            yield Finding(
                message=f"{quote(each.info.name)} is required, but no search is asked for",
                path=each.located.path,
                part=each.located.metric_part,
                help="add one under 'benchmark': 'search: {min: 5 Hz, max: 200 Hz}'",
                suppresses=frozenset({each.located.subject}),
            )


RULE = Rule(
    code="R2B506",
    title="a requirement on the peak without a search",
    severity=Severity.ERROR,
    why="The peak is what the search finds.",
    failing=example(slos="{headroom: {require: [peak.rate >= 45 Hz]}}"),
    passing=example(
        benchmark="{rates: [30 Hz], search: {min: 5 Hz, max: 200 Hz}}",
        slos="{headroom: {require: [peak.rate >= 45 Hz]}}",
    ),
    find=_find,
)
