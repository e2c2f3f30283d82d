"""Recording the interfaces of nodes: each node is started once, alone, and inspected.

A node runs in its own namespace without remappings, so that its topics have the names from its
code. It receives the parameters of the spec, because its topics may depend on them.
"""

from __future__ import annotations

import json
import os
import secrets
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import msgspec

from r2bspec.errors import ExitStatus, R2bspecError
from r2bspec.execute.errors import NotReadyError
from r2bspec.execute.processes.environment import RunEnvironment, make_redactor, replaced_texts
from r2bspec.execute.processes.prerequisites import reserved_domain, resolve_argv, resolve_command
from r2bspec.execute.processes.supervisor import ProcessSupervisor
from r2bspec.execute.states import Interrupts
from r2bspec.ipc import protocol
from r2bspec.language.spec import Spec
from r2bspec.plan.command_lines import HARNESS_ARGV, node_argv
from r2bspec.plan.compile_plan import compile_plan
from r2bspec.plan.installed_packages import package_version
from r2bspec.plan.plan import NodePlan, Plan, ProcessPlan
from r2bspec.plan.wiring.build_wiring import build_wiring
from r2bspec.plan.wiring.companion_files import read_companion_files
from r2bspec.plan.wiring.node_interface import RecordOrigin, files_digest, node_target
from r2bspec.plan.wiring.wiring import NodeWiring
from r2bspec.safe_io.private_files import temporary_folder

NAMESPACE = "/r2bspec_interfaces"

_INSPECTED_NAME = "r2bspec_inspected"
"""The temporary name of the node. None of its topics begins with it, so that ``~/x`` and ``x`` can
be distinguished."""

_LISTS = ("subscribes", "publishes", "services", "qos")

_CREATE_TIMEOUT_S = 60.0
_REPLY_SLACK_S = 60.0


def record_interfaces(
    spec: Spec,
    base_dir: Path,
    *,
    only: tuple[str, ...] = (),
    timeout_s: float = 20.0,
    on_node: Callable[[str], None] = lambda _: None,
) -> Iterator[tuple[str, dict[str, Any] | R2bspecError]]:
    """Start and inspect each node once.

    Args:
        spec: the spec with the nodes.
        base_dir: its folder.
        only: the keys of the nodes to inspect; if empty, all that can be started.
        timeout_s: how long a node may take to appear.
        on_node: is called with the key of each node before it is started.

    Yields:
        The key of each node with its interface, as in the file, or why there is none;
        preprocessors first.

    Raises:
        InterruptedRunError: a signal has arrived.
        RunError: all ROS domains are in use.
    """
    companion_files = read_companion_files(spec, base_dir)
    plan = compile_plan(spec, None, companion_files=companion_files)
    wiring = build_wiring(spec, companion_files=companion_files)
    nodes = [node for phase in wiring.phases for node in phase.nodes]
    for node in nodes:
        if node.node.kind.by_others or (only and node.key not in only):
            continue
        on_node(node.key)
        with Interrupts() as interrupts, temporary_folder("node") as scratch:
            try:
                interfaces = _inspect(
                    plan, node, base_dir.absolute(), scratch, timeout_s, interrupts.check
                )
                yield node.key, _interface_entry(interfaces, node, base_dir)
            except R2bspecError as error:
                if error.exit_code == ExitStatus.INTERRUPTED:
                    raise
                yield node.key, _told(node.key, error, str(scratch))


def _told(node: str, error: R2bspecError, scratch: str) -> R2bspecError:
    """Return the error with the real name of the node, and without temporary files."""
    text = str(error).removeprefix(f"{node}: ").replace(f"{NAMESPACE}/{_INSPECTED_NAME}", node)
    return R2bspecError(text, hint="" if scratch in error.hint else error.hint)


def _inspect(
    plan: Plan,
    node: NodeWiring,
    base_dir: Path,
    scratch: Path,
    timeout_s: float,
    check: Callable[[], None],
) -> dict[str, Any]:
    """Run one node and an inspector, and end both."""
    run_id = secrets.token_hex(8)
    redact = make_redactor(os.environ)
    supervisor = ProcessSupervisor(run_id, scratch, check, redact=redact)
    try:
        with reserved_domain() as domain:
            environment = RunEnvironment(
                plan, run_id=run_id, domain=domain, scratch=scratch, largest_message_bytes=1 << 20
            )
            process = _isolated_process(node)
            running = supervisor.start(
                process.name,
                process.role,
                resolve_argv(process),
                environment.for_node(process.env),
                cwd=base_dir,
                log=scratch / "node.log",
            )
            if process.role == "host":
                host = protocol.ConfigureHost(nodes=process.nodes, base_dir=str(base_dir))
                supervisor.request(running, host, protocol.Ready, _CREATE_TIMEOUT_S)
            inspector = supervisor.start(
                "inspector",
                "monitor",
                resolve_command(HARNESS_ARGV, "inspector"),
                environment.for_node({}),
                cwd=base_dir,
                log=scratch / "inspector.log",
            )
            target = scratch / "interface.json"
            inspect = protocol.ConfigureInspector(
                namespace=NAMESPACE, timeout_s=timeout_s, file=str(target)
            )
            supervisor.request(inspector, inspect, protocol.Ready, timeout_s + _REPLY_SLACK_S)
            # A default value may come from the environment.
            interfaces = replaced_texts(json.loads(target.read_text("utf-8")), redact)
            if not interfaces:
                raise NotReadyError(
                    f"{node.key} did not appear within {timeout_s:g} s",
                    hint="It may not be a ROS node, or not ready yet; --timeout allows more time.",
                )
            supervisor.end(list(supervisor))
            return {
                key: {name: value for entry in interfaces for name, value in entry[key].items()}
                for key in (*_LISTS, "parameters")
            }
    finally:
        supervisor.close()


def _isolated_process(wired: NodeWiring) -> ProcessPlan:
    """Return the process of a node that runs alone."""
    node = wired.node
    process = ProcessPlan(
        name=wired.key, phase="measure", role="command", argv=HARNESS_ARGV, env=node.env
    )
    bare = msgspec.structs.replace(
        wired,
        key=_INSPECTED_NAME,
        namespace=NAMESPACE,
        name=f"{NAMESPACE}/{_INSPECTED_NAME}",
        node=msgspec.structs.replace(node, remappings={}, container="", namespace=NAMESPACE),
        is_ros_process=True,
    )
    if node.kind.role == "host":
        plan = NodePlan(
            name=bare.name,
            node=_INSPECTED_NAME,
            namespace=NAMESPACE,
            target=node.python,
            parameters=dict(wired.parameters),
            remappings={},
        )
        return msgspec.structs.replace(process, role="host", nodes=(plan,))
    argv = _standalone(bare) if node.kind.role == "container" else node_argv(bare)
    return msgspec.structs.replace(process, argv=argv)


def _standalone(wired: NodeWiring) -> tuple[str, ...]:
    """Return a component in its own container, as started by ``ros2 component standalone``."""
    node = wired.node
    words = ["ros2", "component", "standalone", node.package, node.plugin]
    words += ["--node-name", _INSPECTED_NAME, "--node-namespace", NAMESPACE]
    for name, value in wired.parameters.items():
        words += ["-p", f"{name}:={json.dumps(value)}"]
    return tuple(words)


def _interface_entry(found: dict[str, Any], node: NodeWiring, base_dir: Path) -> dict[str, Any]:
    """Return the entry of a node, without the defaults of parameters that the spec sets."""
    origin = RecordOrigin(
        target=node_target(node.node),
        sha256=files_digest(node.node, base_dir),
        version=package_version(node.node.package),
    )
    parameters = {
        name: {key: value for key, value in parameter.items() if key == "type"}
        if name in node.parameters
        else parameter
        for name, parameter in found["parameters"].items()
    }
    rows = {key: found[key] for key in _LISTS} | {"parameters": parameters}
    return {
        "recorded_from": msgspec.to_builtins(origin),
        **{key: dict(sorted(row.items())) for key, row in rows.items() if row},
    }
