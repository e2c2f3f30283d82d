"""Buffers of one message."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, Rule, example


def _find(context: Context) -> Findings:
    playback = context.spec.playback
    if playback.buffer == 1 and playback.mode in {"looping", "sweeping"}:
        yield Finding(
            message="a buffer of one message repeats the same message",
            path=("playback", "buffer"),
            help="set 'buffer' to 10 or more, unless every message costs the same",
        )


RULE = Rule(
    code="R2B323",
    title="buffer of one message",
    severity="info",
    why="Caches, trackers and branch predictors adapt to a repeated message, so nodes appear "
    "faster than they are. It may be intended where every message costs the same.",
    failing=example(
        playback="""
            buffer: 1
            inputs:
              image: {from: image_raw, format: sensor_msgs/msg/Image}
        """
    ),
    passing=example(
        playback="""
            buffer: 10
            inputs:
              image: {from: image_raw, format: sensor_msgs/msg/Image}
        """
    ),
    find=_find,
)
