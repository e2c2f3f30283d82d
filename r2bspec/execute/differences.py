"""What a node that has been made did not take of the plan, in the words of ``r2bspec validate``."""

from __future__ import annotations

from collections.abc import Iterator

from r2bspec.diagnostics import did_you_mean
from r2bspec.execute.errors import GraphDiffersError
from r2bspec.harness import protocol
from r2bspec.record.model import Difference

_PARAMETER_UNKNOWN = "R2B211"
_REMAPPING_MATCHES_NOTHING = "R2B204"


def refuse_undeclared(ready: protocol.Ready) -> None:
    """A parameter that no node declares is ignored by ROS, and so is the typing error in it.

    Raises:
        GraphDiffersError: there is one.
    """
    found = [_undeclared(ready, node, name) for node, name in ready.undeclared]
    if found:
        raise GraphDiffersError(
            found, "; ".join(each.message for each in found), hint=found[0].help
        )


def _undeclared(ready: protocol.Ready, node: str, name: str) -> Difference:
    known = sorted(ready.parameters.get(node, ()))
    close = did_you_mean(name, known)
    return Difference(
        code=_PARAMETER_UNKNOWN,
        message=f"node {node} declares no parameter '{name}'",
        part="parameter",
        owner=node,
        name=name,
        help=f"did you mean '{close}'?" if close else f"its parameters: {', '.join(known)}",
    )


def unmatched_remappings(ready: protocol.Ready) -> Iterator[Difference]:
    """Remappings that changed no name.

    That need not be wrong: a node may make a publisher or a subscription later.
    """
    for node, before, after in ready.unmatched:
        names = sorted({topic for owner, topic, _, _ in ready.endpoints if owner == node} - {after})
        yield Difference(
            code=_REMAPPING_MATCHES_NOTHING,
            message=f"node {node} has no topic '{before}' that could be remapped to '{after}'",
            part="remapping",
            owner=node,
            name=before,
            help=f"its topics: {', '.join(names)}" if names else "it has no topic at all",
            harmless=True,
        )
