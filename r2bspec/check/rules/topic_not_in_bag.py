"""Loaded topics that the bag does not contain."""

from __future__ import annotations

from r2bspec.check.rule_api import (
    Context,
    Finding,
    Findings,
    Rule,
    example,
    quote,
    suggestion,
    value_key,
)


def _find(context: Context) -> Findings:
    bag = context.bag
    if bag is None:
        return
    for name in context.spec.data_loader.topics:
        if bag.find(name) is None:
            yield Finding(
                message=f"bag {quote(bag.name)} has no topic {quote(name)}",
                path=("data_loader", "topics", name),
                key=True,
                help=suggestion(name, bag.topics, "its topics"),
                suppresses={value_key(("data_loader", "topics", name))},
            )


RULE = Rule(
    code="R2B308",
    title="topic not in the bag",
    severity="error",
    why="No message of the topic can be loaded, and every node that depends on it waits forever.",
    failing=example(data_loader="{bag: r2b_storage, topics: {/d455_1_rgb_imgae: image_raw}}"),
    passing=example(data_loader="{bag: r2b_storage, topics: {/d455_1_rgb_image: image_raw}}"),
    find=_find,
)
