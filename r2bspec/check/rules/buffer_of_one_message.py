"""Buffers of one message."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, Rule


def _find(context: Context) -> Findings:
    playback = context.spec.playback
    if playback.buffer == 1 and playback.mode in {"looping", "sweeping"}:
        yield Finding(
            message="a buffer of one message repeats the same message",
            path=("playback", "buffer"),
            help="set 'buffer' to 10 or more, unless every message costs the same",
        )


RULE = Rule(code="R2B323", find=_find)
