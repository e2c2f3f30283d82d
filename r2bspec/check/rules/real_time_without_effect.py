"""Loading in real time where nobody would notice."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, Rule, example


def _find(context: Context) -> Findings:
    if context.spec.data_loader.real_time and not context.spec.preprocessors:
        yield Finding(
            message="'real_time' has no effect: there are no preprocessors",
            path=("data_loader", "real_time"),
            key=True,
            help="for recorded times while measuring, write 'mode: timeline' under 'playback'",
        )


RULE = Rule(
    code="R2B326",
    title="loading in real time without preprocessors",
    severity="warning",
    why="It says how fast preprocessors are fed. Without any, messages go straight from the bag "
    "into the buffer.",
    failing=example(
        data_loader="""
            bag: r2b_storage
            real_time: true
            topics: {/d455_1_rgb_image: image_raw}
        """
    ),
    passing=example(
        data_loader="""
            bag: r2b_storage
            topics: {/d455_1_rgb_image: image_raw}
        """
    ),
    find=_find,
)
