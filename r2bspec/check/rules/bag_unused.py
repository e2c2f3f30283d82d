"""Bags of which no topic is loaded."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, Rule, quote, quoted_list


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


RULE = Rule(code="R2B324", find=_find)
