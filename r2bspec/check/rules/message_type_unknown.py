"""Message types that the common interfaces do not contain."""

from __future__ import annotations

from r2bspec.check import message_types
from r2bspec.check.rule_api import (
    Context,
    Finding,
    Findings,
    Path,
    Rule,
    did_you_mean,
    quote,
    value_key,
)


def _find(context: Context) -> Findings:
    for path, name in _stated_types(context).items():
        about = {value_key(path)}
        siblings = message_types.types_of_same_package(name)
        if name in siblings:
            continue
        package = name.partition("/")[0]
        close = did_you_mean(name, siblings or message_types.common_types())
        if siblings and not close:
            yield Finding(
                message=f"package {package} of ROS 2 Jazzy has no message type {quote(name)}",
                path=path,
                severity="warning",
                machine_dependent=True,
                suppresses=about,
            )
        elif siblings or close.partition("/")[2] == name.partition("/")[2]:
            # The user may have a package of this name, but cannot add messages to a common package.
            yield Finding(
                message=f"unknown message type {quote(name)}"
                if siblings
                else f"{quote(name)} resembles {quote(close)} of the common interfaces",
                path=path,
                help=f"did you mean {quote(close)}?",
                severity=None if siblings else "warning",
                suppresses=about,
            )


def _stated_types(context: Context) -> dict[Path, str]:
    """Every message type that the spec states, by its path."""
    endpoints = (each for phase in context.wiring.phases for each in phase.endpoints)
    return {each.type_path: each.type for each in endpoints if each.type_path and each.type}


RULE = Rule(code="R2B202", find=_find)
