"""Requirements that need a rate but have none."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, Rule, known_metrics, quote


def _find(context: Context) -> Findings:
    if context.has_own_rate:
        return
    rates = ", ".join(str(rate) for rate in context.spec.benchmark.rates)
    for each in known_metrics(context):
        located = each.located
        if located.needs_rate and each.info.statistic not in {"search", "truth"}:
            yield Finding(
                message=f"requirement on {quote(each.info.name)} has no rate",
                path=located.path,
                part=located.metric_part,
                help=f"add 'at:' to the objective {quote(located.objective)}"
                + (f"; played rates: {rates}" if rates else ""),
                suppresses={located.subject},
            )


RULE = Rule(code="R2B505", find=_find)
