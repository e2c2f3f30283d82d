"""Nodes whose process would have a name that is taken."""

from __future__ import annotations

from r2bspec.check.rule_api import (
    Context,
    Finding,
    Findings,
    Pointer,
    Rule,
    example,
    quote,
    quoted_list,
)
from r2bspec.plan.process_plans import reserved_names


def _find(context: Context) -> Findings:
    reserved = reserved_names(context.spec)
    for node in context.wiring.measure.nodes:
        if node.key in reserved:
            yield Finding(
                message=f"a node cannot be called {quote(node.key)}, which has a meaning of its "
                "own among processes",
                path=node.path,
                key=True,
                help=f"reserved: {quoted_list(reserved)}",
            )
        elif node.key in context.spec.containers:
            yield Finding(
                message=f"{quote(node.key)} is a container, too",
                path=node.path,
                key=True,
                help="call one of the two otherwise",
                related=(Pointer("the container", ("containers", node.key), key=True),),
            )
    for name in context.spec.containers:
        if name in reserved:
            yield Finding(
                message=f"a container cannot be called {quote(name)}, which has a meaning of its "
                "own among processes",
                path=("containers", name),
                key=True,
                help=f"reserved: {quoted_list(reserved)}",
            )


RULE = Rule(
    code="R2B203",
    title="a node with a name that is taken",
    severity="error",
    why="Each process has a log and metrics (cpu.NAME.mean) under its own name, and a node's "
    "process is called like the node. Processes of the harness have names, too, and 'system' is "
    "the whole machine.",
    failing=example(
        graph="""
            nodes:
              monitor: {python: r2bspec.nodes.RelayNode, remappings: {input: image}}
        """
    ),
    passing=example(
        graph="""
            nodes:
              relay: {python: r2bspec.nodes.RelayNode, remappings: {input: image}}
        """
    ),
    find=_find,
)
