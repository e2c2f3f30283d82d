"""A calibration file that cannot be used."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, Rule


def _find(context: Context) -> Findings:
    if context.noise_problem:
        yield Finding(
            message=context.noise_problem,
            path=("slos",),
            key=True,
            help="move it away, then run 'r2bspec calibrate' again",
        )


RULE = Rule(code="R2B524", find=_find)
