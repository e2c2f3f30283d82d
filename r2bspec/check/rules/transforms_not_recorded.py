"""Transforms to publish that the bag does not contain."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, Rule, quote


def _find(context: Context) -> Findings:
    loader, bag = context.spec.data_loader, context.bag
    if bag is None:
        return
    for name, is_published in (
        ("/tf", loader.publish_tf),
        ("/tf_static", loader.publish_tf_static),
    ):
        key = f"publish_{name[1:]}"
        if is_published and bag.find(name) is None:
            yield Finding(
                message=f"bag {quote(bag.name)} has no topic {quote(name)}",
                path=("data_loader", key),
                help=f"remove {quote(key)}, or publish the transforms from a node of the graph",
            )


RULE = Rule(code="R2B325", find=_find)
