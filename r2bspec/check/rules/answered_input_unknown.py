"""Inputs in `answers` that do not exist, and `answers` without effect."""

from __future__ import annotations

from r2bspec.check.rule_api import (
    Context,
    Finding,
    Findings,
    Rule,
    did_you_mean,
    quote,
    quoted_list,
)


def _find(context: Context) -> Findings:
    spec = context.spec
    inputs = {context.harness_topic(name): name for name in spec.playback.inputs}
    for name, monitor in spec.monitors.items():
        path = ("monitors", name, "answers")
        if monitor.answers and spec.playback.mode != "timeline":
            yield Finding(
                message=f"'answers' has no effect with 'mode: {spec.playback.mode}'",
                path=path,
                key=True,
                help="remove it: each step has messages of all inputs",
                severity="warning",
            )
            continue
        for index, answered in enumerate(monitor.answers):
            if context.harness_topic(answered) not in inputs:
                close = did_you_mean(answered, tuple(inputs.values()))
                yield Finding(
                    message=f"'answers' of monitor {name} lists {quote(answered)}, which is not a "
                    "playback input",
                    path=(*path, index),
                    help=f"did you mean {quote(close)}?"
                    if close
                    else f"playback inputs: {quoted_list(inputs.values())}",
                )


RULE = Rule(code="R2B414", find=_find)
