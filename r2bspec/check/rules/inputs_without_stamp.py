"""Monitors that match by stamp, where no playback input has one."""

from __future__ import annotations

from r2bspec.check.message_types import begins_with_header
from r2bspec.check.rule_api import Context, Finding, Findings, Pointer, Rule, value_key


def _find(context: Context) -> Findings:
    inputs = context.spec.playback.inputs
    if not inputs or any(
        each.timestamp == "header" and begins_with_header(each.format) is not False
        for each in inputs.values()
    ):
        return
    first = next(iter(inputs))
    for name, monitor in context.spec.monitors.items():
        if monitor.match == "stamp":
            yield Finding(
                message=f"monitor {name} matches by stamp, but the player stamps no playback input",
                path=("monitors", name),
                key=True,
                help="use 'match: order' if each input has one output",
                related=(
                    Pointer(
                        f"{inputs[first].format} has no header"
                        if inputs[first].timestamp == "header"
                        else "its recorded stamp is kept",
                        (
                            *("playback", "inputs", first),
                            "format" if inputs[first].timestamp == "header" else "timestamp",
                        ),
                    ),
                ),
                suppressed_by={value_key(("monitors", name, "match"))},
            )


RULE = Rule(code="R2B407", find=_find)
