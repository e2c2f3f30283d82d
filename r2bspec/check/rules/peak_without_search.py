"""Requirements on a search that the spec does not ask for."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, Rule, example, known_metrics, quote


def _find(context: Context) -> Findings:
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
                suppresses={each.located.subject},
            )


RULE = Rule(
    code="R2B506",
    title="a requirement on the peak without a search",
    severity="error",
    why="The peak is what the search finds.",
    failing=example(slos="{headroom: {require: [peak.rate >= 45 Hz]}}"),
    passing=example(
        benchmark="{rates: [30 Hz], search: {min: 5 Hz, max: 200 Hz}}",
        slos="{headroom: {require: [peak.rate >= 45 Hz]}}",
    ),
    find=_find,
)
