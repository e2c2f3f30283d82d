"""Nodes and processes of plans, with defaults for what a test does not look at."""

from __future__ import annotations

from typing import Any

from r2bspec.plan.plan import NodePlan, ProcessPlan


def node_plan(node: str, *, namespace: str = "/r2b", **fields: Any) -> NodePlan:
    """A node in a namespace; `fields` are those of the plan."""
    defaults = {"target": "", "parameters": {}, "remappings": {}}
    name = f"{namespace.rstrip('/')}/{node}"
    return NodePlan(name=name, node=node, namespace=namespace, **(defaults | fields))


def process_plan(name: str, role: Any = "command", *nodes: str, **fields: Any) -> ProcessPlan:
    """A process with nodes in the namespace /r2b; `fields` are those of the plan."""
    defaults = {"phase": "measure", "argv": ("x",), "env": {}, "nodes": (*map(node_plan, nodes),)}
    return ProcessPlan(name=name, role=role, **(defaults | fields))
