"""Requirements on what is played at a rate, without a rate."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, Rule, example, known_metrics, quote


def _find(context: Context) -> Findings:
    if context.has_own_rate:
        return
    rates = ", ".join(str(rate) for rate in context.spec.benchmark.rates)
    for each in known_metrics(context):
        located = each.located
        if located.needs_rate and each.info.statistic != "search":
            yield Finding(
                message=f"{quote(each.info.name)} is required, but not at which rate",
                path=located.path,
                part=located.metric_part,
                help=f"give the objective {quote(located.objective)} a rate"
                + (f": 'at:' and one of {rates}" if rates else " with 'at:'"),
                suppresses={located.subject},
            )


RULE = Rule(
    code="R2B505",
    title="a requirement at no rate",
    severity="error",
    why="A latency at 10 Hz says little about one at 60 Hz. Only the outcome of the search "
    "(peak.rate) belongs to no rate.",
    failing=example(slos="{fast: {require: [latency.p90 < 50 ms]}}"),
    passing=example(slos="{fast: {at: 30 Hz, require: [latency.p90 < 50 ms]}}"),
    find=_find,
)
