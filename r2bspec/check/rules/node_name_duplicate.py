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
from r2bspec.wiring.name_resolution import node_name


def _find(context: Context) -> Findings:
    for phase in context.wiring.phases:
        first: dict[str, tuple[str, Path]] = dict(_generated_nodes(context, phase))
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


def _generated_nodes(
    context: Context, phase: PhaseWiring
) -> Iterator[tuple[str, tuple[str, Path]]]:
    """The nodes that a plan adds to those of the spec: containers and the harness."""
    namespace = context.wiring.namespace
    for node in phase.nodes:
        if node.node.kind.role == "container" and not node.node.container:
            yield f"{node.name}_container", (f"the container of {node.key}", node.path)
    if context.spec.harness.kind == "ros2_benchmark" and phase.phase == "measure":
        monitors = (f"monitor_{name}" for name in context.spec.monitors)
        for part in ("data_loader", "playback", *monitors):
            yield node_name(part, namespace), ("a part of the harness", ("harness",))


RULE = Rule(
    code="R2B215",
    title="duplicate node name",
    severity="error",
    why="Nodes with the same name share services and parameters, and ROS does not define which of "
    "them answers.",
    find=_find,
)
