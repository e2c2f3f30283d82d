"""Disabled objectives."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, Rule, example, quote


def _find(context: Context) -> Findings:
    for name, objective in context.spec.slos.items():
        if objective.level == "off":
            yield Finding(
                message=f"objective {quote(name)} is disabled and is not judged",
                path=("slos", name, "level"),
                help="use 'level: info' to judge it without effect on the verdict, or remove it",
            )


RULE = Rule(
    code="R2B519",
    title="disabled objective",
    severity="info",
    why="It remains in the document but checks nothing, which is easily overlooked.",
    failing=example(slos="{fast: {at: 30 Hz, level: 'off', require: [latency.p90 < 50 ms]}}"),
    passing=example(slos="{fast: {at: 30 Hz, level: info, require: [latency.p90 < 50 ms]}}"),
    find=_find,
)
