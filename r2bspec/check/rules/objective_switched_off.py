"""Objectives that are switched off."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, Rule, example, quote


def _find(context: Context) -> Findings:
    for name, objective in context.spec.slos.items():
        if objective.level == "off":
            yield Finding(
                message=f"{quote(name)} is not judged",
                path=("slos", name, "level"),
                help="'info' judges it without consequence; or remove it",
            )


RULE = Rule(
    code="R2B519",
    title="an objective that is switched off",
    severity="info",
    why="It stays in the document and guards nothing, which is easily forgotten.",
    failing=example(slos="{fast: {at: 30 Hz, level: 'off', require: [latency.p90 < 50 ms]}}"),
    passing=example(slos="{fast: {at: 30 Hz, level: info, require: [latency.p90 < 50 ms]}}"),
    find=_find,
)
