"""Transforms that are to be played but were not recorded."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, Rule, example, quote


def _find(context: Context) -> Findings:
    loader, bag = context.spec.data_loader, context.bag
    if bag is None:
        return
    for name, asked in (("/tf", loader.publish_tf), ("/tf_static", loader.publish_tf_static)):
        if asked and bag.find(name) is None:
            yield Finding(
                message=f"the bag {quote(bag.name)} holds no {quote(name)}",
                path=("data_loader", f"publish_{name[1:]}"),
                help="remove it, or publish the transforms by a node of the graph",
            )


RULE = Rule(
    code="R2B325",
    title="transforms that the bag does not hold",
    severity="error",
    why="Nothing would be published, and whoever looks transforms up waits for ever.",
    failing=example(
        data_loader="""
            bag: r2b_storage
            publish_tf_static: true
            topics: {/d455_1_rgb_image: image_raw}
        """
    ),
    passing=example(
        data_loader="""
            bag: r2b_storage
            topics: {/d455_1_rgb_image: image_raw}
        """
    ),
    find=_find,
)
