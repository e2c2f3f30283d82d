"""Counts that need stamps, required of a monitor that matches by order."""

from __future__ import annotations

from r2bspec.check.rule_api import (
    Context,
    Finding,
    Findings,
    Pointer,
    Rule,
    known_metrics,
    quote,
)

_NEED_STAMPS = frozenset({"duplicates", "reordered"})


def _find(context: Context) -> Findings:
    monitors = context.spec.monitors
    for each in known_metrics(context):
        if each.info.name not in _NEED_STAMPS:
            continue
        for name in [each.monitor] if each.monitor else monitors:
            if monitors[name].match == "order":
                yield Finding(
                    message=f"monitor {name} matches by order, which cannot count "
                    f"{quote(each.info.name)}",
                    path=each.located.path,
                    part=each.located.metric_part,
                    help="require it of a monitor that matches by stamp, or require 'missed' and "
                    "'unmatched' instead",
                    related=(Pointer("matched by order here", ("monitors", name, "match")),),
                    suppressed_by={each.located.subject},
                )


RULE = Rule(code="R2B525", find=_find)
