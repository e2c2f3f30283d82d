"""Loaded topics without messages in the window."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, Rule, quote, value_key
from r2bspec.check.window_counts import window_message_counts

_WINDOW = ("data_loader", "window")


def _find(context: Context) -> Findings:
    bag = context.bag
    window = context.spec.data_loader.window
    if bag is None or (window.end is not None and window.end.ns <= window.start.ns):
        return
    for name, message_count in window_message_counts(context).items():
        info = bag.find(name)
        if message_count.messages or info is None:
            continue
        empty = info.count == 0
        yield Finding(
            message=f"no messages of {quote(name)} in the bag"
            if empty
            else f"no messages of {quote(name)} in the window",
            path=("data_loader", "topics", name) if empty else _WINDOW,
            key=empty,
            help=""
            if empty
            else f"the bag has {info.count:,} of them, {info.rate_hz:.3g} per second",
            suppressed_by={value_key(_WINDOW)},
            suppresses={value_key(("data_loader", "topics", name))},
        )


RULE = Rule(code="R2B321", find=_find)
