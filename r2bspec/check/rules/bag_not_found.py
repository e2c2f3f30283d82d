"""Bags that do not exist or cannot be read; each finding has the code of its error."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, Rule


def _find(context: Context) -> Findings:
    for recording in context.recordings:
        error = recording.error
        if error is not None:
            yield Finding(message=str(error), path=recording.path, help=error.hint, code=error.code)


RULE = Rule(code="R2B301", find=_find)
