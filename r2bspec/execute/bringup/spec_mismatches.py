"""Differences between running nodes and the plan, with the codes of ``r2bspec validate``.

A Python host compares the parameters of its nodes itself. Other processes are asked over their
parameter services, when the graph is ready: components, executables, and commands. ROS ignores a
parameter that is not declared, so that a graph with a misspelt one runs, with another value.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

import msgspec

from r2bspec.diagnostics import did_you_mean
from r2bspec.execute.bringup.find_fault import Fault
from r2bspec.execute.errors import GraphMismatchError
from r2bspec.execute.processes.supervisor import ManagedProcess, ProcessSupervisor
from r2bspec.ipc import protocol
from r2bspec.plan.plan import Plan
from r2bspec.record.run_record import Difference

_PARAMETER_UNKNOWN = "R2B211"
_REMAPPING_MATCHES_NOTHING = "R2B204"

_CALL_NS = 2_000_000_000
_REPLY_TIMEOUT_S = 20.0
_PATIENCE_S = 2.0
"""How long a parameter may be declared after the graph is ready."""

_POLL_S = 0.2
_COMMON_PARAMETERS = frozenset({"use_sim_time", "start_type_description_service"})


def require_declared_parameters(ready: protocol.Ready) -> None:
    """Check that every node declares the parameters that the plan sets; ROS ignores others.

    Raises:
        GraphMismatchError: a node does not declare one.
    """
    found = [
        undeclared_parameter(node, name, sorted(ready.parameters.get(node, ())))
        for node, name in ready.undeclared
    ]
    if found:
        raise GraphMismatchError(
            found, "; ".join(each.message for each in found), hint=found[0].help
        )


def undeclared_parameter(node: str, name: str, known: Sequence[str]) -> Difference:
    """A parameter that a node does not declare.

    Args:
        node: full name.
        name: of the parameter.
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


def unmatched_remappings(ready: protocol.Ready) -> Iterator[Difference]:
    """Remappings that changed no name.

    This need not be an error: a node may create a publisher or a subscription later.
    """
    for node, before, after in ready.unmatched:
        own = {topic for owner, topic, _, _ in ready.endpoints if owner == node}
        yield unmatched_remapping(node, before, after, own)


def unmatched_remapping(node: str, before: str, after: str, own: Iterable[str]) -> Difference:
    """A remapping that changed no name.

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


def graph_mismatches(
    faults: Iterable[Fault],
    launch_differences: Iterable[Difference],
    is_permanent: Callable[[Fault], bool] = lambda _: True,
) -> tuple[Difference, ...]:
    """The differences between the graph and the plan, causes before consequences.

    A remapping that changed no name is the cause of a fault on the topic that it names; that fault
    is then not reported separately.

    Args:
        faults: on the paths of messages. A node without output is not a difference.
        launch_differences: found when the nodes were created.
        is_permanent: whether a fault persists; only these are differences.
    """
    faults = [each for each in faults if each.kind != "no output"]
    missing = {each.topic for each in faults}
    causes = [
        msgspec.structs.replace(each, harmless=False)
        for each in launch_differences
        if each.topic and each.topic in missing
    ]
    explained = {each.topic for each in causes}
    return (
        *causes,
        *(
            Difference(
                code=each.code,
                message=each.sentence,
                part="endpoint",
                owner=each.owner,
                name=each.topic,
            )
            for each in faults
            if each.topic not in explained and is_permanent(each)
        ),
    )


def related_differences(faults: Iterable[Fault], launch_differences: Iterable[Difference]) -> str:
    """Other differences of the nodes with faults, as text to append to a sentence."""
    owners = {each.owner for each in faults}
    return "".join(f"; {each.message}" for each in launch_differences if each.owner in owners)


@dataclass(frozen=True)
class ExpectedParameters:
    """The parameters that a plan sets for a node.

    Attributes:
        node: its full name in the plan.
        names: of the parameters.
        own_node_name: whether the running node has this name; other processes may have nodes of
            any name.
    """

    node: str
    names: tuple[str, ...]
    own_node_name: bool


def expected_parameters(plan: Plan, phase: str) -> Iterator[ExpectedParameters]:
    """The parameters of nodes that run in processes other than Python hosts."""
    for process in plan.processes:
        if process.phase != phase or process.role not in {"container", "command"}:
            continue
        for node in process.nodes:
            names = tuple(each for each in node.parameters if not _is_common(each))
            own_name = process.role == "container" or f"__node:={node.node}" in process.argv
            if names:
                yield ExpectedParameters(node.name, names, own_name)


def _is_common(name: str) -> bool:
    return name in _COMMON_PARAMETERS or name.startswith("qos_overrides.")


def check_parameters(
    plan: Plan,
    phase: str,
    supervisor: ProcessSupervisor,
    observer: ManagedProcess,
    differences: list[Difference],
    note: Callable[[str], None],
) -> None:
    """Ask nodes that are not in Python hosts for their parameters.

    Args:
        plan: of the run.
        phase: ``preprocess`` or ``measure``.
        supervisor: all processes.
        observer: a monitor or a loader.
        differences: receives those that fail nothing.
        note: is told of them.

    Raises:
        GraphMismatchError: a node does not declare a parameter that is certainly misspelt.
        RunError: the observer does not respond.
    """
    found = find_undeclared(plan, phase, supervisor, observer)
    wrong = [each for each in found if not each.harmless]
    if wrong:
        message = "; ".join(each.message for each in wrong)
        raise GraphMismatchError(wrong, message, hint=wrong[0].help)
    for each in found:
        note(f"{each.message}; ROS ignores it")
    differences += found


def find_undeclared(
    plan: Plan, phase: str, supervisor: ProcessSupervisor, observer: ManagedProcess
) -> tuple[Difference, ...]:
    """The parameters that no node declares, although its process has responded.

    Only what is certainly a typing error is not harmless: a lifecycle node may declare parameters
    when it is configured, and a parameter file may be for several nodes.

    Args:
        plan: of the run.
        phase: ``preprocess`` or ``measure``.
        supervisor: all processes.
        observer: a monitor or a loader.

    Raises:
        RunError: the observer does not respond.
    """
    expected = tuple(expected_parameters(plan, phase))
    if not expected:
        return ()
    hosted = {
        node.name
        for process in plan.processes
        if process.role in {"host", "harness"}
        for node in process.nodes
    }
    command = protocol.ListParameters(exclude=tuple(sorted(hosted)), timeout_ns=_CALL_NS)
    deadline = time.monotonic() + _PATIENCE_S
    while True:
        found = supervisor.request(observer, command, protocol.ParameterLists, _REPLY_TIMEOUT_S)
        differences = tuple(undeclared(expected, found))
        if not differences or time.monotonic() > deadline:
            return differences
        supervisor.pump(_POLL_S)


def undeclared(
    expected: Iterable[ExpectedParameters], found: protocol.ParameterLists
) -> Iterator[Difference]:
    """The parameters that are not declared; none for a process of which no node has responded."""
    expected = tuple(expected)
    named = {each.node for each in expected if each.own_node_name}
    for each in expected:
        nodes = {each.node} if each.own_node_name else found.parameters.keys() - named
        answered = [name for name in sorted(nodes) if name in found.parameters]
        declared = {one for name in answered for one in found.parameters[name]}
        for name in each.names:
            if answered and name not in declared:
                known = [one for one in sorted(declared) if not _is_common(one)]
                difference = undeclared_parameter(each.node, name, known)
                certain = any(is_typing_error(name, one) for one in known)
                lifecycle = not {*answered}.isdisjoint(found.lifecycle)
                yield msgspec.structs.replace(difference, harmless=lifecycle or not certain)


def is_typing_error(written: str, meant: str) -> bool:
    """Whether two names differ by one letter more, less, replaced, or swapped with the next."""
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
