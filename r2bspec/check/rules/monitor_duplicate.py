"""Monitors that measure the same topic."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, Pointer, Rule


def _find(context: Context) -> Findings:
    first: dict[tuple[str, str], str] = {}
    for name, monitor in context.spec.monitors.items():
        topic = context.harness_topic(monitor.topic)
        other = first.setdefault((topic, monitor.match), name)
        if other != name:
            yield Finding(
                message=f"monitors {other} and {name} have the same topic and the same 'match'",
                path=("monitors", name, "topic"),
                help="remove one of them",
                related=(Pointer("the other monitor", ("monitors", other, "topic")),),
            )


RULE = Rule(code="R2B411", find=_find)
