"""Ready probes of a process that does not exist."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, Rule, example, quote, suggestion


def _find(context: Context) -> Findings:
    for name, probe in context.spec.ready.items():
        if probe.log is None or probe.log.process in context.processes:
            continue
        yield Finding(
            message=f"unknown process {quote(probe.log.process)}",
            path=("ready", name, "log", "process"),
            help=suggestion(probe.log.process, context.processes, "processes"),
        )


RULE = Rule(
    code="R2B608",
    title="ready probe of an unknown process",
    severity="error",
    why="The expected line never appears. A process has the name of its node or of its container.",
    failing=example(ready="{up: {log: {process: rely, pattern: started}}}"),
    passing=example(ready="{up: {log: {process: relay, pattern: started}}}"),
    find=_find,
)
