"""Containers that are named but not declared."""

from __future__ import annotations

from collections.abc import Iterator

from r2bspec.check.check_context import Context
from r2bspec.check.example_spec import example
from r2bspec.check.finding import Finding, Pointer
from r2bspec.check.message_text import suggestion
from r2bspec.check.rule import Rule
from r2bspec.diagnostics import did_you_mean
from r2bspec.diagnostics.diagnostic import Severity
from r2bspec.diagnostics.quote import quote


def _find(context: Context) -> Iterator[Finding]:
    containers = context.spec.containers
    for _, node in context.nodes:
        name = node.node.container
        if name and name not in containers:
            close = did_you_mean(name, containers)
            yield Finding(
                message=f"there is no container {quote(name)}",
                path=(*node.path, "container"),
                help=suggestion(name, containers, "declared are")
                or f"declare it: {quote(f'containers: {{{name}: {{}}}}')}",
                related=(
                    Pointer(f"{quote(close)} is declared here", ("containers", close), key=True),
                )
                if close
                else (),
                suppresses=frozenset({"containers"}),
            )


RULE = Rule(
    code="R2B217",
    title="a container that is not declared",
    severity=Severity.ERROR,
    why="A node runs in a process that the plan starts; nobody starts this one.",
    failing=example(
        containers="{perception: {executable: python}}",
        graph="""
            nodes:
              relay:
                python: r2bspec.nodes.RelayNode
                container: percepton
                remappings: {input: image}
        """,
    ),
    passing=example(
        containers="{perception: {executable: python}}",
        graph="""
            nodes:
              relay:
                python: r2bspec.nodes.RelayNode
                container: perception
                remappings: {input: image}
        """,
    ),
    find=_find,
)
