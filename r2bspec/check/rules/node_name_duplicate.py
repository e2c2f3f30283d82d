"""Nodes of one phase with the same name."""

from __future__ import annotations

from collections.abc import Iterator

from r2bspec.check.rule_api import (
    Context,
    Finding,
    Findings,
    Path,
    PhaseWiring,
    Pointer,
    Rule,
    quote,
)


def _find(context: Context) -> Findings:
    for phase in context.wiring.phases:
        first: dict[str, tuple[str, Path]] = dict(_generated_nodes(phase))
        for node in phase.nodes:
            if node.node.kind.names_own_nodes or not node.is_ros_process:
                continue
            what, path = first.setdefault(node.name, ("another node", node.path))
            if path != node.path or what != "another node":
                yield Finding(
                    message=f"node name {quote(node.name)} is already used by {what}",
                    path=node.path,
                    key=True,
                    help="rename the node, or change its namespace",
                    related=(Pointer("first use of the name", path, key=True),),
                )


def _generated_nodes(phase: PhaseWiring) -> Iterator[tuple[str, tuple[str, Path]]]:
    """The nodes that a plan adds to those of the spec: the containers."""
    for node in phase.nodes:
        if node.node.kind.role == "container" and not node.node.container:
            yield f"{node.name}_container", (f"the container of {node.key}", node.path)


RULE = Rule(code="R2B215", find=_find)
