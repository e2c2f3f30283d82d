"""Variables of a matrix that nothing uses."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, Rule, example, quote, value_key


def _find(context: Context) -> Findings:
    matrix_case = context.loaded.matrix_case
    for name in matrix_case.values if matrix_case is not None else ():
        if name not in context.loaded.used_variables:
            yield Finding(
                message=f"the matrix varies {quote(name)}, but nothing uses it",
                path=("variables", name),
                help=f"write {quote(f'$(var {name})')} where its value belongs",
                suppresses={value_key(("variables", name))},
            )


RULE = Rule(
    code="R2B606",
    title="a matrix that varies what nothing uses",
    severity="warning",
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
