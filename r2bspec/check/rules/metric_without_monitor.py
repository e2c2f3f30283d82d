"""Metrics without a monitor name, in specs with several monitors."""

from __future__ import annotations

from r2bspec.check.rule_api import (
    Context,
    Finding,
    Findings,
    Rule,
    known_metrics,
    quote,
    quoted_list,
)


def _find(context: Context) -> Findings:
    monitors = context.spec.monitors
    for each in known_metrics(context):
        if len(monitors) > 1 and each.info.scope == "monitor" and each.monitor is None:
            name = each.info.name
            first = next(iter(monitors))
            yield Finding(
                message=f"{quote(name)} is required of every monitor: {quoted_list(monitors)}",
                path=each.located.path,
                part=each.located.metric_part,
                help=f"to select one monitor, write for example {quote(f'{first}.{name}')}",
            )


RULE = Rule(code="R2B503", find=_find)
