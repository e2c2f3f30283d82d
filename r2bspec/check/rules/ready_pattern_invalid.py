"""Probes for a line that no regular expression describes."""

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
                message=f"{quote(probe.log.pattern)} is no regular expression: "
                f"{getattr(error, 'msg', '') or error}",
                path=("ready", name, "log", "pattern"),
                part=(min(position, len(probe.log.pattern) - 1), 1),
                help="a character that means itself is written with a backslash before it",
            )


RULE = Rule(
    code="R2B609",
    title="a pattern that is no regular expression",
    severity="error",
    why="A probe looks for a line of output by a regular expression, as Python's 're' reads it.",
    failing=example(ready="{up: {log: {process: relay, pattern: 'started ('}}}"),
    passing=example(ready="{up: {log: {process: relay, pattern: 'started \\('}}}"),
    find=_find,
)
