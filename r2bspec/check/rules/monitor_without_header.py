"""Monitors that match by stamp, of messages without a header."""

from __future__ import annotations

from r2bspec.check.message_types import begins_with_header
from r2bspec.check.rule_api import Context, Finding, Findings, Rule, value_key


def _find(context: Context) -> Findings:
    for name, monitor in context.spec.monitors.items():
        path = ("monitors", name)
        if monitor.match == "stamp" and begins_with_header(monitor.format) is False:
            yield Finding(
                message=f"monitor {name} matches by stamp, but {monitor.format} has no header",
                path=(*path, "format"),
                help="use 'match: order' if each input has one output",
                suppressed_by={value_key((*path, "format"))},
                suppresses={value_key((*path, "match"))},
            )


RULE = Rule(code="R2B406", find=_find)
