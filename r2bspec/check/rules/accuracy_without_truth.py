"""Requirements on accuracy where no monitor names what its messages are compared with."""

from __future__ import annotations

from r2bspec.check.rule_api import (
    Context,
    Finding,
    Findings,
    Rule,
    known_metrics,
    quote,
)
from r2bspec.measure.metric_catalogue import TRUTHS, kind_of


def _find(context: Context) -> Findings:
    monitors = context.spec.monitors
    for each in known_metrics(context):
        kind = kind_of(each.info.name)
        if kind is None:
            continue
        names = [*monitors] if each.monitor is None else [each.monitor]
        if any((truth := monitors[name].truth) and truth.kind == kind for name in names):
            continue
        whose = f"monitor {each.monitor} names" if each.monitor else "no monitor names"
        lack = "no truth of that kind" if each.monitor else "a truth of that kind"
        yield Finding(
            message=f"{quote(each.info.name)} has no value: {whose} {lack}",
            path=each.located.path,
            part=each.located.metric_part,
            help=f"add 'truth: {{kind: {kind}, name: ...}}' to a monitor of type "
            f"{TRUTHS[kind].format}",
            suppressed_by={each.located.subject},
        )


RULE = Rule(code="R2B533", find=_find)
