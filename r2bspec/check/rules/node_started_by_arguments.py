"""Python nodes that receive their names as ROS arguments of their own processes."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, NodeWiring, Rule


def _find(context: Context) -> Findings:
    for _, node in context.nodes:
        if node.start.needs_own_process and not node.start.required and not node.node.container:
            yield Finding(
                message=_message(node, context.spec.graph.placement),
                path=(*node.path, "python"),
                help=""
                if node.start.style == "main"
                else "to let it share a process, give its constructor **kwargs and pass them to "
                "Node",
            )


def _message(node: NodeWiring, placement: str) -> str:
    reason = (
        "initialises ROS itself"
        if node.start.style == "main"
        else "has a constructor without **kwargs"
    )
    shared = node.path[0] == "graph" and placement != "separate"
    process = (
        f"a process of its own, not one with 'placement: {placement}',"
        if shared
        else ("a process of its own")
    )
    return (
        f"{node.key} {reason}: it starts in {process} with its name, namespace, remappings and "
        "parameters as ROS arguments"
    )


RULE = Rule(code="R2B230", find=_find)
