"""A calibration that cannot be used."""

from __future__ import annotations

from collections.abc import Iterator

from r2bspec.check.check_context import Context
from r2bspec.check.finding import Finding
from r2bspec.check.rule import Rule
from r2bspec.diagnostics.diagnostic import Severity


def _find(context: Context) -> Iterator[Finding]:
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
    severity=Severity.WARNING,
    why="The file of that name beside the spec says by how much runs of the unchanged graph "
    "differ; without it, margins below that are not warned of.",
    find=_find,
)
