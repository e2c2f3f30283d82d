"""Nodes of a kind that their container cannot load."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, Pointer, Rule, quote


def _find(context: Context) -> Findings:
    for _, node in context.nodes:
        container = context.spec.containers.get(node.node.container)
        if container is None:
            continue
        kind = node.node.kind
        contained_role = "host" if container.executable == "python" else "container"
        if kind.role == contained_role:
            continue
        placed = f"{node.key} cannot run in {quote(node.node.container)}"
        contents = "Python nodes" if contained_role == "host" else "C++ components"
        yield Finding(
            message=f"{placed}, which loads {contents}"
            if kind.shares_process
            else f"{placed}: it runs in its own process",
            path=(*node.path, "container"),
            help="use another container, or none"
            if kind.shares_process
            else "only Python nodes and C++ components run in containers",
            related=(
                Pointer(
                    f"container executable: {container.executable}",
                    ("containers", node.node.container, "executable"),
                ),
            ),
        )


RULE = Rule(code="R2B219", find=_find)
