"""Message types that the messages of this machine's ROS do not contain."""

from __future__ import annotations

from pathlib import Path as FilePath

from r2bspec.check.installation_advice import ros_package_advice
from r2bspec.check.installed_packages import find_module, top_level_names
from r2bspec.check.rule_api import Context, Finding, Findings, Path, Rule, quote, value_key


def _find(context: Context) -> Findings:
    stated: dict[str, Path] = {}
    for phase in context.wiring.phases:
        for each in phase.endpoints:
            # The harness publishes and subscribes itself, and must have the types.
            if not each.is_node and each.type_path and each.type:
                stated.setdefault(each.type, each.type_path)
    if not stated or find_module("rclpy") is None:
        return
    for name, path in stated.items():
        package, _, message = name.partition("/msg/")
        messages = _messages(package)
        if messages is None or message in messages:
            continue
        yield Finding(
            message=f"message type {quote(name)} is not installed on this machine"
            + ("" if not messages else f": its package {package} has no such message"),
            path=path,
            help=f"build the version of {package} that has it, and source its workspace"
            if messages
            else ros_package_advice(package),
            machine_dependent=True,
            suppressed_by={value_key(path)},
        )


def _messages(package: str) -> frozenset[str] | None:
    """The messages of a package: none if it is not installed, None if they are unknown."""
    if find_module(package) is None:
        return frozenset()
    found = find_module(f"{package}.msg")
    if found is None or not found.origin or not found.origin.endswith("__init__.py"):
        return None
    try:
        return top_level_names(FilePath(found.origin))
    except SyntaxError:
        return None


RULE = Rule(code="R2B681", find=_find)
