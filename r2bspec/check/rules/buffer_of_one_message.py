"""Buffers that hold a single message."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, Rule, example


def _find(context: Context) -> Findings:
    playback = context.spec.playback
    if playback.buffer == 1 and playback.mode in {"looping", "sweeping"}:
        yield Finding(
            message="a buffer of one message plays the same one again and again",
            path=("playback", "buffer"),
            help="a node that remembers what it has seen is faster than it would be; 10 or more "
            "messages show more",
        )


RULE = Rule(
    code="R2B323",
    title="a buffer of a single message",
    severity="info",
    why="Caches, trackers and branch predictors get used to one message. That may be meant, where "
    "every message costs the same.",
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
