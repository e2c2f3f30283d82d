"""Nodes and containers whose process name is reserved or already in use."""

from __future__ import annotations

from r2bspec.check.rule_api import (
    Context,
    Finding,
    Findings,
    Pointer,
    Rule,
    quote,
    quoted_list,
)
from r2bspec.plan.process_plans import reserved_names


def _find(context: Context) -> Findings:
    reserved = reserved_names(context.spec)
    for node in context.wiring.measure.nodes:
        if node.key in reserved:
            yield Finding(
                message=f"node name {quote(node.key)} is reserved",
                path=node.path,
                key=True,
                help=f"reserved names: {quoted_list(reserved)}",
            )
        elif node.key in context.spec.containers:
            yield Finding(
                message=f"{quote(node.key)} is also the name of a container",
                path=node.path,
                key=True,
                help="rename one of them",
                related=(Pointer("the container", ("containers", node.key), key=True),),
            )
    for name in context.spec.containers:
        if name in reserved:
            yield Finding(
                message=f"container name {quote(name)} is reserved",
                path=("containers", name),
                key=True,
                help=f"reserved names: {quoted_list(reserved)}",
            )


RULE = Rule(code="R2B203", find=_find)
