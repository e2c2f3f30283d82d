"""Ready probes with an invalid regular expression."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, Rule, quote
from r2bspec.safe_io.line_pattern import PatternError, compile_line_pattern


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


RULE = Rule(code="R2B609", find=_find)
