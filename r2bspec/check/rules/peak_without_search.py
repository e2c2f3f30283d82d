"""Requirements on the peak in specs without a search."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, Rule, known_metrics, quote


def _find(context: Context) -> Findings:
    if context.spec.benchmark.search is not None:
        return
    for name, objective in context.spec.slos.items():
        if objective.at_peak:
            yield Finding(
                message=f"objective {quote(name)} applies at the peak, but 'benchmark' has no "
                "search",
                path=("slos", name, "at"),
                help="add one under 'benchmark': 'search: {min: 5 Hz, max: 200 Hz}'",
            )
    for each in known_metrics(context):
        if each.info.statistic == "search":
            yield Finding(
                message=f"{quote(each.info.name)} is required, but 'benchmark' has no search",
                path=each.located.path,
                part=each.located.metric_part,
                help="add one under 'benchmark': 'search: {min: 5 Hz, max: 200 Hz}'",
                suppresses={each.located.subject},
            )


RULE = Rule(code="R2B506", find=_find)
