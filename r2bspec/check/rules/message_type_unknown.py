"""Message types that the common interfaces do not have."""

from __future__ import annotations

from r2bspec.check import message_types
from r2bspec.check.rule_api import (
    Context,
    Finding,
    Findings,
    Path,
    Rule,
    did_you_mean,
    example,
    quote,
    value_key,
)


def _find(context: Context) -> Findings:
    for path, name in _stated_types(context).items():
        about = frozenset({value_key(path)})
        siblings = message_types.types_of_same_package(name)
        if name in siblings:
            continue
        package = name.partition("/")[0]
        close = did_you_mean(name, siblings or message_types.common_types())
        if siblings and not close:
            yield Finding(
                message=f"the package {package} of ROS 2 Jazzy has no message {quote(name)}",
                path=path,
                severity="warning",
                machine_dependent=True,
                suppresses=about,
            )
        elif siblings or close.partition("/")[2] == name.partition("/")[2]:
            # A package of one's own may well be called like this, a message in a common one not.
            yield Finding(
                message=f"there is no message type {quote(name)}"
                if siblings
                else f"{quote(name)} is much like the type {quote(close)} of the common interfaces",
                path=path,
                help=f"did you mean {quote(close)}?",
                severity=None if siblings else "warning",
                suppresses=about,
            )


def _stated_types(context: Context) -> dict[Path, str]:
    """Every message type that the spec itself writes, by its place."""
    endpoints = (each for phase in context.wiring.phases for each in phase.endpoints)
    return {each.type_path: each.type for each in endpoints if each.type_path and each.type}


RULE = Rule(
    code="R2B202",
    title="a message type that does not exist",
    severity="error",
    why="A topic of a type that is not installed can be neither played nor watched.",
    failing=example(monitors="{output: {topic: output, format: sensor_msgs/msg/Imgae}}"),
    passing=example(monitors="{output: {topic: output, format: sensor_msgs/msg/Image}}"),
    find=_find,
)
