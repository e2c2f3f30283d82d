"""A transport that cannot be configured with the middleware (RMW) that is selected."""

from __future__ import annotations

import os

from r2bspec.check.rule_api import Context, Finding, Findings, Rule
from r2bspec.middleware.middleware import RMW_VARIABLE, refuse_transport, selected_rmw


def _find(context: Context) -> Findings:
    transport = context.spec.transport.kind
    selected = {RMW_VARIABLE: os.environ.get(RMW_VARIABLE) or ""}
    refusal = refuse_transport(transport, selected_rmw(selected))
    if refusal is not None:
        default = "the default " if context.value_at(("transport",)) is None else ""
        yield Finding(
            message=f"{default}{refusal.message}, which {RMW_VARIABLE} selects here",
            path=("transport",),
            help=refusal.help,
            machine_dependent=True,
        )
    for _, node in context.nodes:
        refusal = refuse_transport(transport, selected_rmw(node.node.env))
        if refusal is not None:
            yield Finding(
                message=f"{refusal.message}, which this node loads",
                path=(*node.path, "env", RMW_VARIABLE),
                help=refusal.help,
            )


RULE = Rule(code="R2B666", find=_find)
