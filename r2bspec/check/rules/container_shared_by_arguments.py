"""Nodes in a container with others, although their ROS arguments need a process of their own."""

from __future__ import annotations

from collections import Counter

from r2bspec.check.rule_api import Context, Finding, Findings, Rule, quote


def _find(context: Context) -> Findings:
    sizes = Counter((phase, node.node.container) for phase, node in context.nodes)
    for phase, node in context.nodes:
        container = node.node.container
        if container not in context.spec.containers or not node.start.needs_own_process:
            continue
        program = node.start.style == "main"
        if program or sizes[phase, container] > 1:
            yield Finding(
                message=f"{node.key} cannot run in {quote(container)}"
                + (
                    ": it initialises ROS itself, and is a process of its own"
                    if program
                    else " with other nodes: its constructor takes no **kwargs, so that its name "
                    "would be that of every node in the process"
                ),
                path=(*node.path, "container"),
                help="leave out 'container'"
                if program
                else "leave out 'container', or let the constructor pass **kwargs to Node",
            )


RULE = Rule(code="R2B232", find=_find)
