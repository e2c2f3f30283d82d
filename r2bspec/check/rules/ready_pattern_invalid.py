"""Ready probes with an invalid regular expression."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, Rule, example, quote
from r2bspec.language.line_pattern import PatternError, compile_line_pattern


def _find(context: Context) -> Findings:
    for name, probe in context.spec.ready.items():
        if probe.log is None:
            continue
        try:
            compile_line_pattern(probe.log.pattern)
        except PatternError as error:
            yield Finding(
                message=f"{quote(probe.log.pattern)} is not a valid regular expression: {error}",
                path=("ready", name, "log", "pattern"),
                part=error.part,
                help="escape special characters with a backslash",
            )


RULE = Rule(
    code="R2B609",
    title="pattern is not a valid regular expression",
    severity="error",
    why="A probe searches the output of a process with a regular expression in the syntax of RE2. "
    "It is that of Python without lookaround and backreferences, which can take forever to match.",
    failing=example(ready="{up: {log: {process: relay, pattern: 'started ('}}}"),
    passing=example(ready="{up: {log: {process: relay, pattern: 'started \\('}}}"),
    find=_find,
)
