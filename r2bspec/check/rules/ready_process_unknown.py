"""Ready probes of a process that does not exist."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, Rule, quote, suggestion


def _find(context: Context) -> Findings:
    for name, probe in context.spec.ready.items():
        if probe.log is None or probe.log.process in context.processes:
            continue
        yield Finding(
            message=f"unknown process {quote(probe.log.process)}",
            path=("ready", name, "log", "process"),
            help=suggestion(probe.log.process, context.processes, "processes"),
        )


RULE = Rule(code="R2B608", find=_find)
