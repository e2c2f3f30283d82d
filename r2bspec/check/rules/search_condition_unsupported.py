"""Conditions of a search that a probe does not measure."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, Rule, known_metrics, quote

_PROBE_SCOPES = ("monitor", "playback")


def _find(context: Context) -> Findings:
    for each in known_metrics(context):
        if each.located.role == "holds" and each.info.scope not in _PROBE_SCOPES:
            yield Finding(
                message=f"probes of a search do not measure {quote(each.info.name)}",
                path=each.located.path,
                part=each.located.metric_part,
                help="remove it: every probe checks that the backlog does not grow"
                if each.info.scope == "probe"
                else "use a metric of a monitor, such as 'drop_rate <= 5 %'",
                suppresses={each.located.subject},
            )


RULE = Rule(code="R2B509", find=_find)
