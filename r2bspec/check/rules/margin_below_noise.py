"""Margins of the baseline below the noise that was calibrated."""

from __future__ import annotations

from r2bspec.check.calibrated_margins import narrow_margins
from r2bspec.check.rule_api import Context, Finding, Findings, Rule, quote
from r2bspec.measure.units import show


def _find(context: Context) -> Findings:
    for each in narrow_margins(context):
        noise = each.calibration
        yield Finding(
            message=f"the margin of {quote(each.known_metric.located.requirement.text)} is "
            f"{show(each.margin, 'share')}, and {each.detectable_text} on {noise.machine} "
            "(calibrated "
            f"{noise.started_at[:10]})",
            path=each.known_metric.located.path,
            part=each.part,
            help=f"{f'write {each.proposed!r}, ' if each.proposed else ''}set "
            "'benchmark.iterations' higher, or find out what makes runs differ",
            machine_dependent=True,
        )


RULE = Rule(
    code="R2B523",
    title="a margin below the noise of the machine",
    severity="warning",
    why="'r2bspec calibrate' has measured by how much runs of the unchanged graph differ. With a "
    "narrower margin that graph itself is often left open, and regressions of that size are "
    "missed more often than once in ten times.",
    find=_find,
)
