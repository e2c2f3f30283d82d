"""External nodes without declared topics."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, Rule, quote


def _find(context: Context) -> Findings:
    for _, node in context.nodes:
        interface = node.interface
        if (
            node.node.kind.role is None
            and interface.publishes is None
            and interface.subscribes is None
        ):
            yield Finding(
                message=f"the topics of external node {quote(node.name)} are unknown",
                path=node.path,
                key=True,
                help="list its topics under 'publishes:' or 'subscribes:'",
            )


RULE = Rule(code="R2B220", find=_find)
