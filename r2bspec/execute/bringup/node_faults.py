"""Faults of a node: it cannot be created, or its names differ from the spec.

A container answers with one sentence, and an executable ends with an uncaught exception. Both
contain the message of rclcpp about a parameter, so that the same mistake is the same error whatever
the node runs in.

Of names, the codes are those of ``r2bspec validate``. A Python host compares the parameters of its
nodes itself. Other processes are asked over their parameter services, when the graph is ready:
components, executables, and commands. ROS ignores a parameter that is not declared, so that a graph
with a misspelt one runs, with another value.
"""

from __future__ import annotations

import contextlib
import re
import time
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

import msgspec

from r2bspec.diagnostics import did_you_mean
from r2bspec.execute.errors import GraphDifferencesError, ProcessDiedError, ProcessFailedError
from r2bspec.execute.processes.supervisor import ProcessSupervisor
from r2bspec.ipc import protocol
from r2bspec.plan.command_lines import has_planned_name
from r2bspec.plan.installed_packages import ament_packages, package_plugins
from r2bspec.plan.package_advice import ros_package_advice
from r2bspec.plan.plan import NodePlan, Plan, ProcessPlan
from r2bspec.plan.wiring.name_resolution import is_node_parameter
from r2bspec.record.run_record import Difference

Part = Literal["node", "plugin", "package", "parameter"]

NOT_LOADED: Final = "R2B665"
NOT_CREATED: Final = "R2B633"

_CONSTRUCTOR = re.compile(r"Component constructor threw an exception(?:: (.*))?", re.DOTALL)
_ENTRY = ("Could not find requested resource in ament index", "Invalid resource entry")
_CLASS = "Failed to find class with the requested plugin name"

_UNCAUGHT_CPP = re.compile(
    r"terminate called after throwing an instance of '([^']+)'\s+what\(\): +(.*?)\s*\Z", re.DOTALL
)
_PLACE = re.compile(r'^  File "([^"]+)", line (\d+)', re.MULTILINE)
_UNCAUGHT_PYTHON = re.compile(r"^Traceback \(most recent call last\):$", re.MULTILINE)

_TYPES = "parameter '{name}' is of type {declared}, and cannot be of type {given}"
_TYPES_HELP = "write a value of its type: ROS does not convert integers, so write 1.0 for a double"
_UNSET = "parameter '{name}' is required, and is not set"
_RANGE = "parameter '{name}' is out of its range"
_RANGE_HELP = "'ros2 param describe' shows the range"
_REFUSED = "parameter '{name}' was refused: {why}"

_EXCEPTIONS: Final = (
    (
        r"parameter '(?P<name>[^']+)' has inval.*\{(?P<declared>.+?)\}, .*\{(?P<given>.+?)\}",
        _TYPES,
        _TYPES_HELP,
    ),
    (
        r"parameter '(?P<name>[^']+)' to .* of type '(?P<given>\w+)', .* '(?P<declared>\w+)'",
        _TYPES,
        _TYPES_HELP,
    ),
    (
        r"tatically typed parameter '(?P<name>[^']+)' must be initialized",
        _UNSET,
        "set it under 'parameters'",
    ),
    (r"parameter '(?P<name>[^']+)' is not initialized", _UNSET, "set it under 'parameters'"),
    (
        r"parameter '(?P<name>[^']+)' could not be set: .*(doesn't comply with|out of range)",
        _RANGE,
        _RANGE_HELP,
    ),
    (r"parameter '(?P<name>[^']+)' could not be set: (?P<why>.*)", _REFUSED, ""),
    (
        r"Invalid parameter value \(.*\) for parameter\. Reason: .*out of range.*: (?P<name>\S+)\Z",
        _RANGE,
        _RANGE_HELP,
    ),
    (
        r"Invalid parameter value \(.*\) for parameter\. Reason: (?P<why>.*): (?P<name>\S+)\Z",
        _REFUSED,
        "",
    ),
)
"""What rclcpp and rclpy say of a parameter in an exception, in words of the spec, with a remedy."""

_ANSWERS: Final[tuple[tuple[str, str, str, Part], ...]] = (
    (
        r"Failed to load library.*?(?P<why>\S+): cannot open shared object file",
        "library {why} is missing",
        "install the package of that library, and source its workspace",
        "plugin",
    ),
    (
        r"Failed to load library:? ?(?P<why>.*)",
        "its library: {why}",
        "build the package against the libraries that are installed",
        "plugin",
    ),
    (
        r"(?P<why>Extra component argument '(?P<name>[^']*)'.*)",
        "{why}",
        "correct 'extra_arguments'",
        "node",
    ),
)
"""Likewise what a container answers, with the part of the node that it concerns."""


class Fault(msgspec.Struct, frozen=True):
    """A fault: a description, the part of the node that it concerns, and a remedy."""

    why: str
    part: Part = "node"
    name: str = ""
    help: str = ""


def component_fault(node: NodePlan, reason: str) -> Fault:
    """Return the fault that the answer of a container describes, as rclcpp_components writes it.

    Args:
        node: a component.
        reason: the ``error_message`` of its answer.
    """
    if reason.startswith(_ENTRY):
        return _unknown_package(node.package)
    if reason.startswith(_CLASS):
        known = sorted(package_plugins(node.package))
        close = did_you_mean(node.plugin, known)
        return Fault(
            f"package {node.package} has no component {node.plugin!r}",
            "plugin",
            help=f"did you mean {close!r}?" if close else f"its components: {', '.join(known)}",
        )
    if (constructor := _CONSTRUCTOR.match(reason)) is not None:
        return exception_fault(constructor[1] or "", "its constructor threw an exception")
    for pattern, why, remedy, part in _ANSWERS:
        if (matched := re.match(pattern, reason, re.DOTALL)) is not None:
            name = matched.groupdict().get("name", "")
            return Fault(why.format(**matched.groupdict()), part, name, remedy)
    return Fault(reason or "the container gave no reason", help="read the output of the container")


def _unknown_package(package: str) -> Fault:
    if package in ament_packages():
        return Fault(f"package {package} has no components", "package", help="write 'executable'")
    why = f"package {package} is not installed"
    return Fault(why, "package", help=ros_package_advice(package))


def exception_fault(what: str, otherwise: str) -> Fault:
    """Return the fault that the text of an exception in a constructor describes.

    Args:
        what: the text.
        otherwise: what to say before it, if it is not about a parameter.
    """
    for pattern, why, remedy in _EXCEPTIONS:
        if (matched := re.search(pattern, what, re.DOTALL)) is not None:
            words = {
                key: text.lower() if key in {"declared", "given"} else text.strip()
                for key, text in matched.groupdict().items()
            }
            return Fault(why.format(**words), "parameter", words["name"], remedy)
    return Fault(f"{otherwise}: {what.strip()}" if what.strip() else otherwise)


def not_loaded(node: NodePlan, container: str, reason: str, output: str) -> GraphDifferencesError:
    """Return the error for a component that its container has refused to load.

    Args:
        node: the component.
        container: the name of the container's process.
        reason: what the container answered.
        output: the last output of the container, as the end of a sentence.
    """
    fault = component_fault(node, reason)
    message = f"{node.name} ({node.plugin}) was not loaded into container {container}: {fault.why}"
    return _error(NOT_LOADED, node, fault, message, output)


def not_created(died: ProcessDiedError, nodes: Iterable[NodePlan]) -> GraphDifferencesError | None:
    """Return the error for a process that an exception has ended before its node was complete.

    None if it ended for another reason, or has several nodes.

    Args:
        died: the process, with its output.
        nodes: the nodes of the process.
    """
    only = [*nodes]
    if len(only) != 1:
        return None
    uncaught = _UNCAUGHT_CPP.search(died.output)
    if uncaught is not None:
        fault = exception_fault(uncaught[2], f"it threw {uncaught[1]}")
    elif _UNCAUGHT_PYTHON.search(died.output):
        file, line = [("", ""), *_PLACE.findall(died.output)][-1]
        what = died.output.rstrip().splitlines()[-1]
        fault = Fault(f"it raised {what} ({file.rpartition('/')[2]}, line {line})")
    else:
        return None
    message = f"node {only[0].name} cannot be created: {fault.why}"
    return _error(NOT_CREATED, only[0], fault, message, "" if uncaught is None else str(died))


def not_made(failed: ProcessFailedError, nodes: Iterable[NodePlan]) -> GraphDifferencesError | None:
    """Return the error for a Python node that its host could not create; None if there is none.

    Args:
        failed: what the host says.
        nodes: the nodes of its process.
    """
    begins = {f"node {node.name} cannot be created: ": node for node in nodes}
    for begin, node in begins.items():
        _, found, what = str(failed).partition(begin)
        if found and failed.code == NOT_CREATED:
            fault = exception_fault(what, "")
            fault = msgspec.structs.replace(fault, help=fault.help or failed.hint)
            message = f"node {node.name} cannot be created: {fault.why.removeprefix(': ')}"
            return _error(NOT_CREATED, node, fault, message, "")
    return None


def _error(
    code: str, node: NodePlan, fault: Fault, message: str, output: str
) -> GraphDifferencesError:
    difference = Difference(
        code=code,
        message=message,
        part=fault.part,
        owner=node.name,
        name=fault.name,
        help=fault.help,
    )
    return GraphDifferencesError([difference], details=output)


_PARAMETER_UNKNOWN = "R2B211"
_REMAPPING_MATCHES_NOTHING = "R2B204"
_NODES_WITH_ONE_NAME = "R2B245"
_ONE_NAME = b"Publisher already registered for node name"
_MAX_LOG_BYTES = 1 << 20

_CALL_NS = 2_000_000_000
_REPLY_TIMEOUT_S = 20.0
_PATIENCE_S = 2.0
"""How long a parameter may be declared after the graph is ready."""

_POLL_S = 0.2


@dataclass(frozen=True)
class RemappedTopic:
    """A topic to which the plan remaps a name of a node.

    Attributes:
        node: the full name of the node in the plan.
        before: the name before remapping, as in the spec.
        topic: the full name after it.
        own_node_name: whether the running node has the name of the plan; other processes may have
            nodes of any name.
    """

    node: str
    before: str
    topic: str
    own_node_name: bool


def require_declared_parameters(ready: protocol.Ready) -> None:
    """Check that every node declares the parameters that the plan sets; ROS ignores others.

    Raises:
        GraphDifferencesError: a node does not declare one.
    """
    differences = [
        undeclared_parameter(node, name, sorted(ready.parameters.get(node, ())))
        for node, name in ready.undeclared
    ]
    if differences:
        raise GraphDifferencesError(differences)


def undeclared_parameter(node: str, name: str, known: Sequence[str]) -> Difference:
    """Return a parameter that a node does not declare.

    Args:
        node: full name.
        name: the name of the parameter.
        known: the parameters that it declares.
    """
    close = did_you_mean(name, known)
    return Difference(
        code=_PARAMETER_UNKNOWN,
        message=f"{node} declares no parameter '{name}'",
        part="parameter",
        owner=node,
        name=name,
        help=f"did you mean '{close}'?" if close else f"its parameters: {', '.join(known)}",
    )


def nodes_with_one_name(plan: ProcessPlan, log: Path) -> Iterator[Difference]:
    """Return the error for an executable whose nodes all got the name given to its process.

    Args:
        plan: the plan of the process.
        log: its output, in which rcl says it.
    """
    named = [node for node in plan.nodes if plan.role == "command" and has_planned_name(plan, node)]
    for node in named:
        with contextlib.suppress(OSError), log.open("rb") as output:
            if _ONE_NAME in output.read(_MAX_LOG_BYTES):
                yield Difference(
                    code=_NODES_WITH_ONE_NAME,
                    message=f"the executable of {node.name} has several nodes, all of which got "
                    "this name: their topics and their load cannot be told apart",
                    part="node",
                    owner=node.name,
                    name="",
                    help="keep the name of each with 'arguments: [--ros-args, -r, "
                    "NAME:__node:=NAME]', or write 'command' in place of 'executable'",
                    harmless=True,
                )


def unmatched_remappings(ready: protocol.Ready) -> Iterator[Difference]:
    """Return remappings that changed no name.

    This need not be an error: a node may create a publisher or a subscription later.
    """
    for node, before, after in ready.unmatched:
        own = {topic for owner, topic, _, _ in ready.endpoints if owner == node}
        yield unmatched_remapping(node, before, after, own)


def unmatched_remapping(node: str, before: str, after: str, own: Iterable[str]) -> Difference:
    """Return a remapping that changed no name.

    Args:
        node: full name.
        before: as in the spec.
        after: full name of the topic.
        own: the topics of the node.
    """
    names = sorted({*own} - {after})
    return Difference(
        code=_REMAPPING_MATCHES_NOTHING,
        message=f"{node} has no topic '{before}' to remap to {after}",
        part="remapping",
        owner=node,
        name=before,
        topic=after,
        help=f"its topics: {', '.join(names)}" if names else "it has no topics",
        harmless=True,
    )


def spins_nodes(process: ProcessPlan, programs: Collection[str]) -> bool:
    """Return True if a process of r2bspec spins its nodes, and queries them itself."""
    return process.role not in {"container", "command"} and process.name not in programs


def find_undeclared(
    plan: Plan,
    phase: str,
    programs: Collection[str],
    supervisor: ProcessSupervisor,
) -> tuple[Difference, ...]:
    """Return the parameters that no node declares, although its process has responded.

    Only a certain typing error is reported: a lifecycle node may declare parameters when it is
    configured, and a parameter file may be for several nodes.

    Args:
        plan: the plan of the run.
        phase: ``preprocess`` or ``measure``.
        programs: names of processes of Python nodes that spin them themselves.
        supervisor: all processes.

    Raises:
        GraphDifferencesError: a node does not declare a parameter that is certainly misspelt.
        RunError: the observer does not respond.
    """
    expected = [
        (node, has_planned_name(process, node))
        for process in plan.processes_in(phase)
        if not spins_nodes(process, programs)
        for node in process.nodes
        if any(_own_parameters(node))
    ]
    if not expected:
        return ()
    hosts = (process for process in plan.processes if spins_nodes(process, programs))
    hosted = sorted({node.name for process in hosts for node in process.nodes})
    command = protocol.ListParameters(exclude=tuple(hosted), timeout_ns=_CALL_NS)
    deadline = time.monotonic() + _PATIENCE_S
    while True:
        lists = supervisor.ask_observer(command, protocol.ParameterLists, _REPLY_TIMEOUT_S)
        differences = tuple(undeclared(expected, lists))
        if not differences or time.monotonic() > deadline:
            break
        supervisor.pump(_POLL_S)
    if wrong := [difference for difference in differences if not difference.harmless]:
        raise GraphDifferencesError(wrong)
    return differences


def _own_parameters(node: NodePlan) -> Iterator[str]:
    """Return the parameters that the plan sets, without those that every node declares."""
    return (name for name in node.parameters if not is_node_parameter(name))


def undeclared(
    expected: Iterable[tuple[NodePlan, bool]], found: protocol.ParameterLists
) -> Iterator[Difference]:
    """Yield the parameters that are not declared.

    Until a node of a process has responded, no parameter of that process is yielded.

    Args:
        expected: nodes, and whether each runs by its name in the plan; other processes may have
            nodes of any name.
        found: what the nodes have answered.
    """
    expected = tuple(expected)
    named = {node.name for node, own_name in expected if own_name}
    for node, own_name in expected:
        nodes = {node.name} if own_name else found.parameters.keys() - named
        answered = nodes & found.parameters.keys()
        declared = {name for other in answered for name in found.parameters[other]}
        for name in _own_parameters(node):
            if answered and name not in declared:
                known = [other for other in sorted(declared) if not is_node_parameter(other)]
                difference = undeclared_parameter(node.name, name, known)
                certain = any(is_typing_error(name, other) for other in known)
                lifecycle = not answered.isdisjoint(found.lifecycle)
                yield msgspec.structs.replace(difference, harmless=lifecycle or not certain)


def is_typing_error(written: str, meant: str) -> bool:
    """Return True if two names differ by one letter: added, missing, replaced, or swapped."""
    if len(written) > len(meant):
        written, meant = meant, written
    if len(meant) - len(written) > 1 or len(written) < 3:
        return False
    same = next(
        (at for at, (a, b) in enumerate(zip(written, meant, strict=False)) if a != b), len(written)
    )
    if len(written) < len(meant):
        return written[same:] == meant[same + 1 :]
    swapped = written[same + 1 : same + 2] + written[same : same + 1] + written[same + 2 :]
    return written != meant and (
        written[same + 1 :] == meant[same + 1 :] or swapped == meant[same:]
    )
