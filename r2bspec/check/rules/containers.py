"""Containers and the processes that nodes share: who may be in one, and which settings apply."""

from __future__ import annotations

from r2bspec.check.check_context import Context
from r2bspec.check.rule import Finding, Findings, Pointer, rule, suggestion
from r2bspec.diagnostics import did_you_mean
from r2bspec.diagnostics.diagnostic import Path
from r2bspec.diagnostics.quote import quote
from r2bspec.language.node_kinds import PROCESS_KEYS
from r2bspec.language.spec import Container
from r2bspec.wiring.wiring import NodeWiring


@rule("R2B217")
def container_unknown(context: Context) -> Findings:
    """References to containers that are not declared."""
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


@rule("R2B218")
def container_unused(context: Context) -> Findings:
    """Containers without nodes."""
    used = {node.node.container for _, node in context.nodes}
    for name in context.spec.containers:
        if name not in used:
            yield Finding(
                message=f"container {quote(name)} has no nodes",
                path=("containers", name),
                key=True,
                help=f"set {quote(f'container: {name}')} for a node, or remove the container",
                suppressed_by={"containers"},
            )


@rule("R2B219")
def container_kind_mismatch(context: Context) -> Findings:
    """Nodes of a kind that their container cannot load."""
    for _, node in context.nodes:
        container = context.spec.containers.get(node.node.container)
        if container is None:
            continue
        is_python = container.executable == "python"
        if node.node.kind.role == ("host" if is_python else "container"):
            continue
        contents = "Python nodes" if is_python else "C++ components"
        yield Finding(
            message=f"{node.key} cannot run in {quote(node.node.container)}, which loads "
            f"{contents}",
            path=(*node.path, "container"),
            help="use another container, or none",
            related=(
                Pointer(
                    f"container executable: {container.executable}",
                    ("containers", node.node.container, "executable"),
                ),
            ),
        )


@rule("R2B221")
def process_setting_without_effect(context: Context) -> Findings:
    """Process settings of nodes that share a process by their placement."""
    for _, node in context.nodes:
        for name in PROCESS_KEYS if _is_placed_with_others(context, node) else ():
            if getattr(node.node, name):
                yield Finding(
                    message=f"{quote(name)} of {node.key} has no effect: with 'placement: "
                    f"{context.spec.graph.placement}' the node shares a process",
                    path=(*node.path, name),
                    key=True,
                    help="give the node its own container or process",
                )


def _is_placed_with_others(context: Context, node: NodeWiring) -> bool:
    """Whether a node shares a process by its placement.

    The language refuses settings of a process, and `env`, for a node in a container.
    """
    in_graph = node.path[0] == "graph" and context.spec.graph.placement != "separate"
    return in_graph and node.shares_process


@rule("R2B222")
def threads_without_effect(context: Context) -> Findings:
    """Thread counts of containers whose executor does not use them."""
    for name, container in context.spec.containers.items():
        why = _why_unused_threads(container) if container.threads > 1 else ""
        if why:
            yield Finding(
                message=f"{quote(f'threads: {container.threads}')} of {quote(name)} has no effect: "
                f"{why}",
                path=("containers", name, "threads"),
                help="set 'executor: multi_threaded'"
                if container.executable == "python"
                else "set 'executable: component_container_mt'",
            )


def _why_unused_threads(container: Container) -> str:
    if container.executable == "component_container_mt":
        return ""
    if container.executable == "python":
        return "" if container.executor == "multi_threaded" else "its executor is single-threaded"
    return f"{container.executable} has no such setting"


@rule("R2B615")
def environment_conflict(context: Context) -> Findings:
    """Nodes of one process that set an environment variable to different values."""
    first: dict[tuple[str, str], tuple[str, Path]] = {}
    for _, node in context.nodes:
        for name, value in node.node.env.items() if _is_placed_with_others(context, node) else ():
            path = (*node.path, "env", name)
            process = node.node.kind.name
            other_value, other_path = first.setdefault((process, name), (value, path))
            if other_value != value:
                yield Finding(
                    message=f"nodes of one process set different values of {name}",
                    path=path,
                    help="use the same value, or run the nodes in separate processes",
                    related=(Pointer("the other value", other_path),),
                )
