"""Nodes: their names, what is known of their topics, and interface files."""

from __future__ import annotations

from collections.abc import Iterator

from r2bspec.check.check_context import Context
from r2bspec.check.rule import Finding, Findings, Pointer, quoted_list, rule
from r2bspec.diagnostics.diagnostic import Path
from r2bspec.diagnostics.quote import quote
from r2bspec.plan.process_plans import reserved_names
from r2bspec.wiring.wiring import PhaseWiring


@rule("R2B203")
def node_name_reserved(context: Context) -> Findings:
    """Nodes and containers whose process name is reserved or already in use."""
    reserved = reserved_names(context.spec)
    for node in context.wiring.measure.nodes:
        if node.key in reserved:
            yield Finding(
                message=f"node name {quote(node.key)} is reserved",
                path=node.path,
                key=True,
                help=f"reserved names: {quoted_list(reserved)}",
            )
        elif node.key in context.spec.containers:
            yield Finding(
                message=f"{quote(node.key)} is also the name of a container",
                path=node.path,
                key=True,
                help="rename one of them",
                related=(Pointer("the container", ("containers", node.key), key=True),),
            )
    for name in context.spec.containers:
        if name in reserved:
            yield Finding(
                message=f"container name {quote(name)} is reserved",
                path=("containers", name),
                key=True,
                help=f"reserved names: {quoted_list(reserved)}",
            )


@rule("R2B215")
def node_name_duplicate(context: Context) -> Findings:
    """Nodes of one phase with the same name."""
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


@rule("R2B220")
def external_node_without_topics(context: Context) -> Findings:
    """External nodes without declared topics."""
    for _, node in context.nodes:
        interface = node.interface
        if (
            node.node.kind.role is None
            and interface.publishes is None
            and interface.subscribes is None
        ):
            yield Finding(
                message=f"the topics of external node {quote(node.name)} are unknown",
                path=node.path,
                key=True,
                help="list its topics under 'publishes:' or 'subscribes:'",
            )


@rule("R2B223")
def interface_file_unusable(context: Context) -> Findings:
    """Interface files that cannot be used."""
    for _, node in context.nodes:
        name = quote(f"interfaces/{node.key}.yaml")
        problem = context.companion_files.interface_errors.get(node.key)
        if problem:
            yield Finding(
                message=f"{name} is ignored: {problem}",
                path=node.path,
                key=True,
                help="recreate it with 'r2bspec interfaces'; if it is that of a node of another "
                "spec, give one of the two another key",
            )
        versions = context.record_versions(node)
        if versions is not None:
            recorded, installed = versions
            yield Finding(
                message=f"{name} was recorded with version {recorded} of {node.node.package}, and "
                f"{installed} is installed",
                path=node.path,
                key=True,
                help="recreate it with 'r2bspec interfaces'; until then, what follows from it is "
                "not certain",
                machine_dependent=True,
            )


@rule("R2B234")
def command_without_ros_arguments(context: Context) -> Findings:
    """Commands that get no ROS arguments, because the spec says nothing of ROS about them."""
    for _, node in context.nodes:
        if not node.is_ros_process:
            yield Finding(
                message=f"{node.key} is run exactly as written, without ROS arguments: its nodes "
                f"keep their own names, and are not in the namespace {node.namespace}",
                path=(*node.path, "command"),
                help="if it is a ROS node, state its topics with 'subscribes:' and 'publishes:'",
            )
