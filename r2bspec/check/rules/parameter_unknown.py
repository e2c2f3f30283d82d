"""Parameters that the node does not declare."""

from __future__ import annotations

from collections.abc import Iterator

from r2bspec.check.context import Context
from r2bspec.check.example import example
from r2bspec.check.finding import Finding
from r2bspec.check.rule import Rule
from r2bspec.check.words import suggestion
from r2bspec.diagnostics.model import Severity
from r2bspec.diagnostics.quote import quote

# Every node declares the first; the others are read by the middleware's side of a node.
_OF_EVERY_NODE = ("use_sim_time", "start_type_description_service")


def _find(context: Context) -> Iterator[Finding]:
    for _, node in context.nodes:
        declared = node.interface.parameters
        if declared is None:
            continue
        for name in node.node.parameters:
            if (
                name not in declared
                and name not in _OF_EVERY_NODE
                and not name.startswith("qos_overrides.")
            ):
                yield Finding(
                    message=f"{node.key} declares no parameter {quote(name)}",
                    path=(*node.path, "parameters", name),
                    key=True,
                    help=suggestion(name, declared, "its parameters"),
                )


RULE = Rule(
    code="R2B211",
    title="a parameter that the node does not declare",
    severity=Severity.ERROR,
    why="ROS ignores the value without a word, and the node runs with its default.",
    failing=example(
        graph="""
            nodes:
              relay:
                python: r2bspec.nodes.RelayNode
                parameters: {service_time: 10.0}
                remappings: {input: image}
        """
    ),
    passing=example(
        graph="""
            nodes:
              relay:
                python: r2bspec.nodes.RelayNode
                parameters: {service_time_ms: 10.0}
                remappings: {input: image}
        """
    ),
    find=_find,
)
