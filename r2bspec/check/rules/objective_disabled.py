"""Disabled objectives."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, Rule, quote


def _find(context: Context) -> Findings:
    for name, objective in context.spec.slos.items():
        if objective.level == "off":
            yield Finding(
                message=f"objective {quote(name)} is disabled and is not judged",
                path=("slos", name, "level"),
                help="use 'level: info' to judge it without effect on the verdict, or remove it",
            )


RULE = Rule(code="R2B519", find=_find)
