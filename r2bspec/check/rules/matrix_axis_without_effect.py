"""Axes of a matrix that make no difference."""

from __future__ import annotations

from collections.abc import Iterator

from r2bspec.check import subjects
from r2bspec.check.context import Context
from r2bspec.check.example import example
from r2bspec.check.finding import Finding
from r2bspec.check.rule import Rule
from r2bspec.diagnostics.model import Path, Severity
from r2bspec.diagnostics.quote import quote
from r2bspec.spec.tree import MapNode, to_plain

_PATH: Path = ("matrix", "axes")


def _find(context: Context) -> Iterator[Finding]:
    axes = context.value_at(_PATH)
    for name, entry in axes.entries.items() if isinstance(axes, MapNode) else ():
        values = to_plain(entry.value)
        if not isinstance(values, list):
            continue
        asked = any(name in objective.when for objective in context.spec.slos.values())
        if name in context.spec.variables and name not in context.loaded.used_variables | (
            {name} if asked else set()
        ):
            yield Finding(
                message=f"nothing uses {quote(name)}, so its cases are all the same",
                path=(*_PATH, name),
                key=True,
                help=f"write {quote(f'$(var {name})')} where its value belongs",
                explains=frozenset({subjects.value(("variables", name))}),
            )
        elif len(values) == 1:
            yield Finding(
                message=f"the axis {quote(name)} has one value",
                path=(*_PATH, name),
                help="give it more, or make it a variable",
            )


RULE = Rule(
    code="R2B606",
    title="an axis that makes no difference",
    severity=Severity.WARNING,
    why="Each case of a matrix is a run of its own, and takes as long as any.",
    failing=example(
        variables="{threads: 1}",
        matrix="{axes: {threads: [1]}}",
        benchmark="{iterations: $(var threads), rates: [30 Hz]}",
    ),
    passing=example(
        variables="{threads: 1}",
        benchmark="{iterations: $(var threads), rates: [30 Hz]}",
    ),
    find=_find,
    early=True,
)
