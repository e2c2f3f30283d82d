"""Absolute topic names outside of the namespace of the benchmark."""

from __future__ import annotations

from collections.abc import Iterator

from r2bspec.check.rule_api import Context, Finding, Findings, Path, Rule, quote
from r2bspec.wiring.name_resolution import SHARED_TOPICS


def _find(context: Context) -> Findings:
    namespace = context.wiring.namespace
    if namespace == "/":
        return
    inside = f"{namespace}/"
    outside = {node.name for _, node in context.nodes if node.node.kind.by_others}
    for name, path, key in _absolute_names(context):
        if name.startswith(inside) or name in SHARED_TOPICS or outside:
            continue
        yield Finding(
            message=f"{quote(name)} is outside of the namespace {quote(namespace)}",
            path=path,
            key=key,
            help=f"write {quote(name.lstrip('/'))}, or {quote('namespace: /')} if the graph needs "
            "absolute names",
        )


def _absolute_names(context: Context) -> Iterator[tuple[str, Path, bool]]:
    """Every absolute name that receives messages: name, path, whether it is a key."""
    spec = context.spec
    for bag_topic, target in spec.data_loader.topics.items():
        if target.startswith("/"):
            yield target, ("data_loader", "topics", bag_topic), False
    for name in spec.playback.inputs:
        if name.startswith("/"):
            yield name, ("playback", "inputs", name), True
    for _, node in context.nodes:
        for left, right in node.node.remappings.items():
            if right.startswith("/"):
                yield right, (*node.path, "remappings", left), False


RULE = Rule(code="R2B214", find=_find)
