"""Baseline margins below the calibrated noise."""

from __future__ import annotations

from r2bspec.check.calibrated_margins import narrow_margins
from r2bspec.check.rule_api import Context, Finding, Findings, Rule, quote
from r2bspec.measure.units import show


def _find(context: Context) -> Findings:
    for each in narrow_margins(context):
        noise = each.calibration
        yield Finding(
            message=f"margin of {quote(each.known_metric.located.requirement.text)} is "
            f"{show(each.margin, 'share')}, but {each.detectable_text} on {noise.machine} "
            f"(calibrated {noise.started_at[:10]})",
            path=each.known_metric.located.path,
            part=each.part,
            help=f"{f'write {each.proposed!r}, ' if each.proposed else ''}increase "
            "'benchmark.iterations', or find the cause of the noise",
            machine_dependent=True,
        )


RULE = Rule(code="R2B523", find=_find)
