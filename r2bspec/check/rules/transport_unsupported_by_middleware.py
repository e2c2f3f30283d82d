"""A transport that cannot be configured with the middleware (RMW) that is selected."""

from __future__ import annotations

import os

from r2bspec.check.rule_api import Certainty, Context, Finding, Iterator, Rule, Severity, example
from r2bspec.middleware.registry import RMW_VARIABLE, refuse_transport, selected_rmw


def _find(context: Context) -> Iterator[Finding]:
    transport = context.spec.transport
    refusal = refuse_transport(transport, selected_rmw(os.environ))
    if refusal is not None:
        default = "the default " if context.value_at(("transport",)) is None else ""
        yield Finding(
            message=f"{default}{refusal.message}, which {RMW_VARIABLE} selects here",
            path=("transport",),
            help=refusal.help,
            certainty=Certainty.ENVIRONMENT,
        )
    for _, node in context.nodes:
        refusal = refuse_transport(transport, selected_rmw(node.node.env))
        if refusal is not None:
            yield Finding(
                message=f"{refusal.message}, which this node loads",
                path=(*node.path, "env", RMW_VARIABLE),
                help=refusal.help,
            )


RULE = Rule(
    code="R2B666",
    title="a transport that cannot be configured with the selected middleware",
    severity=Severity.ERROR,
    why="'shared_memory' and 'udp' are configured in a way that one middleware understands; with "
    "another one messages would travel in some other way than the spec says.",
    failing=example(
        transport="udp",
        graph="""
            nodes:
              relay:
                python: r2bspec.nodes.RelayNode
                remappings: {input: image}
                env: {RMW_IMPLEMENTATION: rmw_cyclonedds_cpp}
        """,
    ),
    passing=example(
        transport="inherit",
        graph="""
            nodes:
              relay:
                python: r2bspec.nodes.RelayNode
                remappings: {input: image}
                env: {RMW_IMPLEMENTATION: rmw_cyclonedds_cpp}
        """,
    ),
    find=_find,
)
