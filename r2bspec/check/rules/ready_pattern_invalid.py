"""Ready probes with an invalid regular expression."""

from __future__ import annotations

import re

from r2bspec.check.rule_api import Context, Finding, Findings, Rule, example, quote


def _find(context: Context) -> Findings:
    for name, probe in context.spec.ready.items():
        if probe.log is None:
            continue
        try:
            re.compile(probe.log.pattern)
        except (re.error, RecursionError, OverflowError) as error:
            position = getattr(error, "pos", None) or 0
            yield Finding(
                message=f"{quote(probe.log.pattern)} is not a valid regular expression: "
                f"{getattr(error, 'msg', '') or error}",
                path=("ready", name, "log", "pattern"),
                part=(min(position, len(probe.log.pattern) - 1), 1),
                help="escape special characters with a backslash",
            )


RULE = Rule(
    code="R2B609",
    title="pattern is not a valid regular expression",
    severity="error",
    why="A probe searches the output of a process with a regular expression in Python syntax.",
    failing=example(ready="{up: {log: {process: relay, pattern: 'started ('}}}"),
    passing=example(ready="{up: {log: {process: relay, pattern: 'started \\('}}}"),
    find=_find,
)
