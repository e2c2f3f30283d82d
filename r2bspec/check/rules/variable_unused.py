"""Variables that nothing refers to."""

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
    for name in context.spec.variables:
        if name not in context.loaded.used_variables:
            yield Finding(
                message=f"nothing uses the variable {quote(name)}",
                path=("variables", name),
                key=True,
                help=f"write {quote(f'$(var {name})')} where its value belongs, or remove it",
                suppressed_by=frozenset({suppression_keys.value(("variables", name))}),
            )


RULE = Rule(
    code="R2B616",
    title="a variable that nothing uses",
    severity=Severity.WARNING,
    why="Whoever sets it with --var expects that something changes.",
    failing=example(variables="{rate: 30 Hz}"),
    passing=example(variables="{rate: 30 Hz}", benchmark="{rates: [$(var rate)]}"),
    find=_find,
)
