"""Variables of a matrix that are not used."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, Rule, quote, value_key


def _find(context: Context) -> Findings:
    matrix_case = context.loaded.matrix_case
    for name in matrix_case.values if matrix_case is not None else ():
        if name not in context.loaded.used_variables:
            yield Finding(
                message=f"matrix variable {quote(name)} is not used",
                path=("variables", name),
                help=f"use it with {quote(f'$(var {name})')}, or remove it from the matrix",
                suppresses={value_key(("variables", name))},
            )


RULE = Rule(code="R2B606", find=_find)
