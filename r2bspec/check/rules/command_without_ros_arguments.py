"""Commands that get no ROS arguments, because the spec says nothing of ROS about them."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, Rule


def _find(context: Context) -> Findings:
    for _, node in context.nodes:
        if not node.is_ros_process:
            yield Finding(
                message=f"{node.key} is run exactly as written, without ROS arguments: its nodes "
                f"keep their own names, and are not in the namespace {node.namespace}",
                path=(*node.path, "command"),
                help="if it is a ROS node, state its topics with 'subscribes:' and 'publishes:'",
            )


RULE = Rule(code="R2B234", find=_find)
