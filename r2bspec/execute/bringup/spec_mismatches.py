"""Differences between running nodes and the plan, with the codes of ``r2bspec validate``."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence

import msgspec

from r2bspec.diagnostics import did_you_mean
from r2bspec.execute.diagnosis.find_fault import Fault
from r2bspec.execute.errors import GraphMismatchError
from r2bspec.ipc import protocol
from r2bspec.record.run_record import Difference

_PARAMETER_UNKNOWN = "R2B211"
_REMAPPING_MATCHES_NOTHING = "R2B204"


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
