"""Bag topics whose messages are not CDR."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, Rule, quote


def _find(context: Context) -> Findings:
    if context.bag is None:
        return
    for name in context.spec.data_loader.topics:
        info = context.bag.find(name)
        if info is not None and info.serialization != "cdr":
            yield Finding(
                message=f"messages of {quote(name)} are serialised as {quote(info.serialization)}; "
                "only 'cdr' can be played",
                path=("data_loader", "topics", name),
                key=True,
                help="convert the bag with 'ros2 bag convert', where that format is installed",
            )


RULE = Rule(code="R2B306", find=_find)
