"""Windows that extend beyond the bag."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, Rule, quote, value_key
from r2bspec.language.quantities import Duration

_WINDOW = ("data_loader", "window")


def _find(context: Context) -> Findings:
    bag, window = context.bag, context.spec.data_loader.window
    if bag is None or (window.end is not None and window.end.ns <= window.start.ns):
        return
    lasts_ns = _duration_ns(context)
    lasts = f"bag {quote(bag.name)} lasts {lasts_ns / 1e9:g} s"
    rendered = context.bag_location is not None and context.bag_location.path is None
    if window.start.ns > lasts_ns:
        yield Finding(
            message=f"the window starts at {window.start}, but {lasts}",
            path=(*_WINDOW, "start"),
            help="window times count from the beginning of the bag",
            suppresses={value_key(_WINDOW)},
        )
    elif window.end is not None and window.end.ns > lasts_ns:
        yield Finding(
            message=f"the window ends at {window.end}, but {lasts}",
            path=(*_WINDOW, "end"),
            help=f"write {Duration(lasts_ns)}"
            if rendered
            else "remove 'end' to use the bag to its end",
            severity=None if rendered else "warning",
            suppresses={value_key(_WINDOW)} if rendered else set(),
        )


def _duration_ns(context: Context) -> int:
    """The latest end of a window: a rendered sequence lasts longer than its last message."""
    from r2bspec.datasets.catalogue import DURATION_NS

    if context.bag_location is not None and context.bag_location.path is None:
        return DURATION_NS
    return context.bag.duration_ns if context.bag is not None else 0


RULE = Rule(code="R2B309", find=_find)
