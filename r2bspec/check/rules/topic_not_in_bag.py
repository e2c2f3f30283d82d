"""Loaded topics that the bag does not contain."""

from __future__ import annotations

from r2bspec.check.rule_api import (
    Context,
    Finding,
    Findings,
    Rule,
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


RULE = Rule(code="R2B308", find=_find)
