"""Variables that are not used."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, Rule, quote, value_key


def _find(context: Context) -> Findings:
    for name in context.spec.variables:
        if name not in context.loaded.used_variables:
            yield Finding(
                message=f"variable {quote(name)} is not used",
                path=("variables", name),
                key=True,
                help=f"use it with {quote(f'$(var {name})')}, or remove it",
                suppressed_by={value_key(("variables", name))},
            )


RULE = Rule(code="R2B616", find=_find)
