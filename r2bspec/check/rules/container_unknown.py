"""References to containers that are not declared."""

from __future__ import annotations

from r2bspec.check.rule_api import (
    Context,
    Finding,
    Findings,
    Pointer,
    Rule,
    did_you_mean,
    quote,
    suggestion,
)


def _find(context: Context) -> Findings:
    containers = context.spec.containers
    for _, node in context.nodes:
        name = node.node.container
        if name and name not in containers:
            close = did_you_mean(name, containers)
            yield Finding(
                message=f"unknown container {quote(name)}",
                path=(*node.path, "container"),
                help=suggestion(name, containers, "declared containers")
                or f"declare it: {quote(f'containers: {{{name}: {{}}}}')}",
                related=(
                    Pointer(f"{quote(close)} is declared here", ("containers", close), key=True),
                )
                if close
                else (),
                suppresses={"containers"},
            )


RULE = Rule(code="R2B217", find=_find)
