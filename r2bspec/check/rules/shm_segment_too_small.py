"""Shared memory segments that are too small for the largest message."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, Pointer, Rule, quote
from r2bspec.language.quantities import Size


def _find(context: Context) -> Findings:
    segment, bag = context.spec.transport.segment, context.bag
    if segment is None or bag is None:
        return
    for name in context.spec.data_loader.topics:
        info = bag.find(name)
        if info is None or not info.max_message_bytes:
            continue
        size = Size(info.max_message_bytes)
        # The transport accepts messages up to half the size of its segment.
        if segment.bytes < 2 * size.bytes:
            yield Finding(
                message=f"a segment of {segment} is too small for messages of {size} on "
                f"{quote(name)}",
                path=("transport", "segment"),
                help="remove 'segment': the default, 24 times the largest message, leaves room for "
                "the queues of the publishers",
                related=(Pointer("loaded here", ("data_loader", "topics", name)),),
            )
            return


RULE = Rule(code="R2B628", find=_find)
