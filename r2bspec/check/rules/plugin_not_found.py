"""C++ components that are not in their well-known package."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, Rule, quote, suggestion, value_key
from r2bspec.language.node_kinds import PLUGIN
from r2bspec.wiring.node_interface import ROS_DISTRIBUTION, catalogue_nodes


def _find(context: Context) -> Findings:
    for _, node in context.nodes:
        known = catalogue_nodes(node.node.package) if node.node.kind is PLUGIN else {}
        if known and node.node.plugin not in known:
            yield Finding(
                message=f"{node.node.package} of {ROS_DISTRIBUTION} has no component "
                f"{quote(node.node.plugin)}",
                path=(*node.path, "plugin"),
                help=suggestion(node.node.plugin, known, "its components"),
                machine_dependent=True,
                suppresses={value_key(node.path)},
            )


RULE = Rule(code="R2B639", find=_find, early=True)
