"""Python nodes: whether their class exists, and how a run can start it.

Sources are read, never imported: a class or function is looked up among the names that its file
binds, and its constructor tells whether it can share a process.
"""

from __future__ import annotations

from collections import Counter
from pathlib import Path

from msgspec.structs import replace

from r2bspec.check.check_context import Context
from r2bspec.check.installation_advice import python_module_advice
from r2bspec.check.rule import Finding, Findings, rule, value_key
from r2bspec.diagnostics.diagnostic import Path as DocumentPath
from r2bspec.diagnostics.quote import quote, quoted_list, suggestion
from r2bspec.plan.installed_packages import (
    PythonTarget,
    missing_imports,
    python_target,
    top_level_names,
)
from r2bspec.plan.this_machine import find_module
from r2bspec.safe_io.safe_file import is_regular
from r2bspec.wiring.companion_files import source_folder
from r2bspec.wiring.node_interface import reference_node_interfaces
from r2bspec.wiring.wiring import NodeWiring


@rule("R2B624", early=True)
def python_module_not_found(context: Context) -> Findings:
    """Python nodes whose file or module does not exist."""
    for _, node in context.nodes:
        if node.node.python:
            target = python_target(node.node.python, context.loaded.base_dir)
            path = (*node.path, "python")
            finding = (
                _missing_module(path, target)
                if target.module
                else _unusable_file(context, path, target)
            )
            if finding is not None:
                yield replace(
                    finding,
                    suppresses={value_key(path), value_key(node.path)},
                )


def _missing_module(path: DocumentPath, target: PythonTarget) -> Finding | None:
    if find_module(target.module) is not None:
        return None
    return Finding(
        message=f"Python module {quote(target.module)} not found on this machine",
        path=path,
        part=(0, len(target.module)),
        help="install it, or source its workspace; for a file, write ./file.py:Class",
        severity="warning",
        machine_dependent=True,
    )


def _unusable_file(context: Context, path: DocumentPath, target: PythonTarget) -> Finding | None:
    written = target.text.rpartition(":")[0]
    if not is_regular(target.file):
        return Finding(
            message=f"Python file {quote(written)} not found",
            path=path,
            part=(0, len(written)),
            help=f"paths are relative to the folder of the spec ({context.loaded.base_dir})",
        )
    try:
        if target.readable:
            top_level_names(target.file)
    except SyntaxError as error:
        return Finding(
            message=f"{quote(written)} is not valid Python: {error.msg}"
            + (f" in line {error.lineno}" if error.lineno else ""),
            path=path,
            part=(0, len(written)),
        )
    return None


_REFERENCE_NODES = "r2bspec.nodes"


@rule("R2B625", early=True)
def python_name_not_found(context: Context) -> Findings:
    """Python nodes whose class or function is not in their file or module."""
    for _, node in context.nodes:
        if not node.node.python:
            continue
        target = python_target(node.node.python, context.loaded.base_dir)
        names = _defined_names(target)
        if names is None or target.name in names:
            continue
        path = (*node.path, "python")
        # Another version of an installed module may have the name; files and the reference nodes
        # are the same on every machine.
        certain = not target.module or target.module == _REFERENCE_NODES
        yield Finding(
            message=f"{quote(target.module or target.text.rpartition(':')[0])} has no class or "
            f"function {quote(target.name)}",
            path=path,
            part=(len(target.text) - len(target.name), len(target.name)),
            help=suggestion(target.name, _public(names), "its classes and functions"),
            severity=None if certain else "warning",
            machine_dependent=not certain,
            suppressed_by={value_key(path)},
            suppresses={value_key(node.path)},
        )


def _defined_names(target: PythonTarget) -> frozenset[str] | None:
    """The names of a file or module; None if they cannot be determined."""
    if target.module == _REFERENCE_NODES:
        return frozenset(name.rpartition(".")[2] for name in reference_node_interfaces())
    source = target.file if target.readable else None
    if target.module:
        module = find_module(target.module)
        origin = module.origin if module is not None else None
        source = Path(origin) if origin is not None and origin.endswith(".py") else None
    if source is None or not is_regular(source):
        return None
    try:
        return top_level_names(source)
    except SyntaxError:
        return None


def _public(names: frozenset[str]) -> list[str]:
    """The names that are likely to be nodes."""
    return [name for name in names if name[:1].isupper()] or [
        name for name in names if not name.startswith("_")
    ]


@rule("R2B680")
def python_import_not_found(context: Context) -> Findings:
    """Python nodes whose file imports a module that is not on this machine."""
    base_dir = context.loaded.base_dir
    targets = {
        (*node.path, "python"): python_target(node.node.python, base_dir)
        for _, node in context.nodes
        if ":" in node.node.python
    }
    # Without ROS no node can run here, and what is missing says nothing.
    if not targets or find_module("rclpy") is None:
        return
    sources = source_folder(base_dir)
    reported: set[tuple[str, str]] = set()
    for path, target in targets.items():
        for missing in missing_imports(target.file, sources) if target.readable else ():
            written = target.text.rpartition(":")[0]
            if (written, missing.module) not in reported:
                reported.add((written, missing.module))
                yield Finding(
                    message=f"{quote(written)} imports {quote(missing.module)} in line "
                    f"{missing.line}, which is not found on this machine",
                    path=path,
                    part=(0, len(written)),
                    help=python_module_advice(missing.module),
                    machine_dependent=True,
                    suppressed_by={value_key(path)},
                )


@rule("R2B230")
def node_started_by_arguments(context: Context) -> Findings:
    """Python nodes that receive their names as ROS arguments of their own processes."""
    for _, node in context.nodes:
        if node.start.needs_own_process and not node.start.required and not node.node.container:
            yield Finding(
                message=_start_message(node, context.spec.graph.placement),
                path=(*node.path, "python"),
                help=""
                if node.start.style == "main"
                else "to let it share a process, give its constructor **kwargs and pass them to "
                "Node",
            )


def _start_message(node: NodeWiring, placement: str) -> str:
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


@rule("R2B231")
def constructor_argument_missing(context: Context) -> Findings:
    """Python nodes whose constructor needs arguments that a run cannot give."""
    for _, node in context.nodes:
        names = node.start.required
        if names:
            several = len(names) > 1
            yield Finding(
                message=f"{node.node.python.rpartition(':')[2]} cannot be called without "
                f"{quoted_list(names)}, for which a run has no value{'s' if several else ''}",
                path=(*node.path, "python"),
                help=f"give the parameter{'s' if several else ''} a default, or name a function "
                "that returns the node",
                suppressed_by={value_key(node.path)},
                suppresses={value_key(node.path)},
            )


@rule("R2B232")
def container_shared_by_arguments(context: Context) -> Findings:
    """Nodes in a container with others, although their arguments need a process of their own."""
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
