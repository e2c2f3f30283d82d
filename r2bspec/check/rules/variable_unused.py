"""Variables that nothing refers to."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, Rule, example, quote, value_key


def _find(context: Context) -> Findings:
    for name in context.spec.variables:
        if name not in context.loaded.used_variables:
            yield Finding(
                message=f"nothing uses the variable {quote(name)}",
                path=("variables", name),
                key=True,
                help=f"write {quote(f'$(var {name})')} where its value belongs, or remove it",
                suppressed_by={value_key(("variables", name))},
            )


RULE = Rule(
    code="R2B616",
    title="a variable that nothing uses",
    severity="warning",
    why="Whoever sets it with --var expects that something changes.",
    failing=example(variables="{rate: 30 Hz}"),
    passing=example(variables="{rate: 30 Hz}", benchmark="{rates: [$(var rate)]}"),
    find=_find,
)
