"""C++ components that a well-known package does not have."""

from __future__ import annotations

from r2bspec.check.rule_api import (
    Certainty,
    Context,
    Finding,
    Iterator,
    Rule,
    Severity,
    quote,
    suggestion,
    suppression_keys,
)
from r2bspec.language.node_kinds import PLUGIN
from r2bspec.wiring.known_packages import ROS_DISTRIBUTION, catalogue_nodes


def _find(context: Context) -> Iterator[Finding]:
    for _, node in context.nodes:
        known = catalogue_nodes(node.node.package) if node.node.kind is PLUGIN else {}
        if known and node.node.plugin not in known:
            yield Finding(
                message=f"{node.node.package} of {ROS_DISTRIBUTION} has no component "
                f"{quote(node.node.plugin)}",
                path=(*node.path, "plugin"),
                help=suggestion(node.node.plugin, known, "it has"),
                certainty=Certainty.ENVIRONMENT,
                suppresses=frozenset({suppression_keys.value(node.path)}),
            )


RULE = Rule(
    code="R2B639",
    title="a component that its package does not have",
    severity=Severity.WARNING,
    why="The container could not load it. It is a warning, because another version of the package "
    "may have it.",
    find=_find,
    early=True,
)
