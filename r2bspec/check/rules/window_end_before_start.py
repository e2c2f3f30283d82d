"""Windows that end before they start."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, Pointer, Rule, value_key

_WINDOW = ("data_loader", "window")


def _find(context: Context) -> Findings:
    window = context.spec.data_loader.window
    if window.end is not None and window.end.ns <= window.start.ns:
        yield Finding(
            message=f"window end {window.end} is not after window start {window.start}",
            path=(*_WINDOW, "end"),
            help="both times count from the beginning of the bag; 'end' is not a length",
            related=(Pointer("window start", (*_WINDOW, "start")),),
            suppresses={value_key(_WINDOW)},
        )


RULE = Rule(code="R2B320", find=_find)
