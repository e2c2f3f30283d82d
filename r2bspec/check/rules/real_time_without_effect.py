"""Real-time loading without preprocessors."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, Rule, example


def _find(context: Context) -> Findings:
    if context.spec.data_loader.real_time and not context.spec.preprocessors:
        yield Finding(
            message="'real_time' has no effect without preprocessors",
            path=("data_loader", "real_time"),
            key=True,
            help="to play at the recorded times, set 'mode: timeline' under 'playback'",
        )


RULE = Rule(
    code="R2B326",
    title="real-time loading without preprocessors",
    severity="warning",
    why="'real_time' sets the speed at which preprocessors receive messages. Without "
    "preprocessors, messages go directly from the bag into the buffer.",
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
