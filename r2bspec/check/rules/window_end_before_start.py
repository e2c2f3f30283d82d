"""Windows that end before they begin."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, Pointer, Rule, example, value_key

_WINDOW = ("data_loader", "window")


def _find(context: Context) -> Findings:
    window = context.spec.data_loader.window
    if window.end is not None and window.end.ns <= window.start.ns:
        yield Finding(
            message=f"the window ends at {window.end}, not after its start at {window.start}",
            path=(*_WINDOW, "end"),
            help="both count from the beginning of the bag; 'end' is not a length",
            related=(Pointer("it starts here", (*_WINDOW, "start")),),
            suppresses={value_key(_WINDOW)},
        )


RULE = Rule(
    code="R2B320",
    title="a window that ends before it begins",
    severity="error",
    why="It holds no message.",
    failing=example(
        data_loader="""
            bag: r2b_storage
            window: {start: 2 s, end: 0.5 s}
            topics: {/d455_1_rgb_image: image_raw}
        """
    ),
    passing=example(
        data_loader="""
            bag: r2b_storage
            window: {start: 2 s, end: 2.5 s}
            topics: {/d455_1_rgb_image: image_raw}
        """
    ),
    find=_find,
)
