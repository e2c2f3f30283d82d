"""Real-time loading without preprocessors."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, Rule


def _find(context: Context) -> Findings:
    if context.spec.data_loader.real_time and not context.spec.preprocessors:
        yield Finding(
            message="'real_time' has no effect without preprocessors",
            path=("data_loader", "real_time"),
            key=True,
            help="to play at the recorded times, set 'mode: timeline' under 'playback'",
        )


RULE = Rule(code="R2B326", find=_find)
