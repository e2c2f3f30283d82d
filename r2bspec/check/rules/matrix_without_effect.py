"""Variables of a matrix that nothing uses."""

from __future__ import annotations

from collections.abc import Iterator

from r2bspec.check import suppression_keys
from r2bspec.check.check_context import Context
from r2bspec.check.example_spec import example
from r2bspec.check.finding import Finding
from r2bspec.check.rule import Rule
from r2bspec.diagnostics.diagnostic import Severity
from r2bspec.diagnostics.quote import quote


def _find(context: Context) -> Iterator[Finding]:
    matrix_case = context.loaded.matrix_case
    for name in matrix_case.values if matrix_case is not None else ():
        if name not in context.loaded.used_variables:
            yield Finding(
                message=f"the matrix varies {quote(name)}, but nothing uses it",
                path=("variables", name),
                help=f"write {quote(f'$(var {name})')} where its value belongs",
                suppresses=frozenset({suppression_keys.value(("variables", name))}),
            )


RULE = Rule(
    code="R2B606",
    title="a matrix that varies what nothing uses",
    severity=Severity.WARNING,
    why="Its cases are all the same, and each is a run of its own.",
    failing=example(
        variables="{threads: 1}",
        matrix="{cases: {many: {threads: 4}}}",
    ),
    passing=example(
        variables="{threads: 1}",
        matrix="{cases: {many: {threads: 4}}}",
        benchmark="{iterations: $(var threads), rates: [30 Hz]}",
    ),
    find=_find,
)
