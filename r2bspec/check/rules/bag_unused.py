"""Bags of which no topic is loaded."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, Rule, example, quote, quoted_list


def _find(context: Context) -> Findings:
    topics = context.spec.data_loader.topics
    if not context.spec.data_loader.bags or context.bag is None:
        return
    for recording in context.recordings:
        bag_index = recording.content
        if bag_index is not None and not any(bag_index.find(name) for name in topics):
            yield Finding(
                message=f"no topic of bag {quote(bag_index.name)} is loaded",
                path=recording.path,
                help=f"its topics: {quoted_list(bag_index.topics)}"
                if bag_index.topics
                else "the bag has no topics",
            )


RULE = Rule(
    code="R2B324",
    title="unused bag",
    severity="warning",
    why="The bag is located and hashed, but none of its messages is played.",
    failing=example(
        data_loader="""
            bags: [r2b_storage, r2b_hope]
            topics: {/d455_1_rgb_image: image_raw}
        """
    ),
    passing=example(
        data_loader="""
            bags: [r2b_storage]
            topics: {/d455_1_rgb_image: image_raw}
        """
    ),
    find=_find,
)
