"""Containers in which no node runs."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, Rule, example, quote


def _find(context: Context) -> Findings:
    used = {node.node.container for _, node in context.nodes}
    for name in context.spec.containers:
        if name not in used:
            yield Finding(
                message=f"no node runs in the container {quote(name)}",
                path=("containers", name),
                key=True,
                help=f"write {quote(f'container: {name}')} in a node, or remove it",
                suppressed_by={"containers"},
            )


RULE = Rule(
    code="R2B218",
    title="a container that no node uses",
    severity="warning",
    why="It is not started; what is set for it has no effect.",
    failing=example(containers="{perception: {executable: python}}"),
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
