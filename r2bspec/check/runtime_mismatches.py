"""Differences between the spec and the real graph of a run, as diagnostics of the document.

``r2bspec validate`` knows the interface of a node only if it is described; a run observes the node
itself. Both report the same error with the same code at the same place.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from r2bspec.check.check_context import Context
from r2bspec.check.finding import Finding
from r2bspec.check.finding_location import to_diagnostic
from r2bspec.diagnostics.diagnostic import Diagnostic, Path, Severity
from r2bspec.record.run_record import Difference
from r2bspec.wiring.wiring import NodeWiring

if TYPE_CHECKING:
    from r2bspec.language.load_spec import LoadedSpec


def differences_to_diagnostics(
    differences: Iterable[Difference], loaded: LoadedSpec
) -> tuple[Diagnostic, ...]:
    """The diagnostics of differences between a spec and the real graph, sorted by place.

    Args:
        differences: from the run.
        loaded: the document of the plan.
    """
    if loaded.spec is None:
        return ()
    context = Context(loaded, loaded.spec, offline=True)
    found = [
        to_diagnostic(
            Finding(message=each.message, path=path, key=key, help=each.help),
            each.code,
            Severity.WARNING if each.harmless else Severity.ERROR,
            loaded,
        )
        for each in differences
        for path, key in [_path(each, context)]
    ]
    return tuple(sorted(found, key=lambda each: each.sort_key))


def _path(difference: Difference, context: Context) -> tuple[Path, bool]:
    """The path of a difference, and whether it is about the key there."""
    node = next((node for _, node in context.nodes if node.name == difference.owner), None)
    if difference.part == "endpoint" or node is None:
        return _endpoint(difference, context, node)
    if difference.part == "remapping":
        return (*node.path, "remappings", difference.name), True
    path = context.parameter_path(node, difference.name)
    return (path, True) if path is not None else ((*node.path, "parameters"), False)


def _endpoint(
    difference: Difference, context: Context, node: NodeWiring | None
) -> tuple[Path, bool]:
    """The place of the spec from which a node, the player or a monitor has this topic."""
    ends = [
        each
        for phase in context.wiring.phases
        for each in phase.endpoints
        if each.topic == difference.name
    ]
    own = [each for each in ends if each.owner == difference.owner]
    for each in own or ends:
        return each.path, each.topic_is_key
    return (node.path, True) if node is not None else ((), False)
