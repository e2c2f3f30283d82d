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


@rule("R2B221")
def process_setting_without_effect(context: Context) -> Findings:
    """Process settings of nodes without their own process."""
    for _, node in context.nodes:
        shared = _why_shared(context, node)
        for name in PROCESS_KEYS if shared else ():
            if getattr(node.node, name):
                yield Finding(
                    message=f"{quote(name)} of {node.key} has no effect: {shared}",
                    path=(*node.path, name),
                    key=True,
                    help="set it for the container"
                    if node.node.container
                    else "give the node its own container or process",
                )


def _why_shared(context: Context, node: NodeWiring) -> str:
    """Why a node does not have its own process; empty if it has."""
    if node.node.kind.role is None:
        return "a run does not start external nodes"
    if node.node.container:
        return f"the node runs in container {node.node.container}"
    placement = context.spec.graph.placement
    shares = node.path[0] == "graph" and node.shares_process
    if placement == "separate" or not shares:
        return ""
    return f"with 'placement: {placement}' the node shares a process"


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
        process = _shared_process(context, node)
        for name, value in node.node.env.items() if process else ():
            path = (*node.path, "env", name)
            other_value, other_path = first.setdefault((process, name), (value, path))
            if other_value != value:
                yield Finding(
                    message=f"nodes of one process set different values of {name}",
                    path=path,
                    help="use the same value, or run the nodes in separate processes",
                    related=(Pointer("the other value", other_path),),
                )


def _shared_process(context: Context, node: NodeWiring) -> str:
    """The process that a node shares with others; empty if it has its own."""
    if node.node.container:
        return f"{node.path[0]}.{node.node.container}"
    shared = context.spec.graph.placement != "separate" and node.path[0] == "graph"
    kind = node.node.kind
    return f" {kind.name}" if shared and node.shares_process else ""
