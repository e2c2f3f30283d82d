"""A calibration that cannot be used."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, Rule


def _find(context: Context) -> Findings:
    if context.noise_problem:
        yield Finding(
            message=context.noise_problem,
            path=("slos",),
            key=True,
            help="put it aside and write it anew with 'r2bspec calibrate'",
        )


RULE = Rule(
    code="R2B524",
    title="a calibration that cannot be used",
    severity="warning",
    why="The file of that name beside the spec says by how much runs of the unchanged graph "
    "differ; without it, margins below that are not warned of.",
    find=_find,
)
