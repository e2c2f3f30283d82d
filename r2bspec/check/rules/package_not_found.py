"""ROS packages that are not installed on this machine."""

from __future__ import annotations

from collections.abc import Iterator

from r2bspec.check.installation_advice import ros_package_advice
from r2bspec.check.installed_packages import ament_packages, ament_prefixes
from r2bspec.check.rule_api import (
    Context,
    Finding,
    Findings,
    Path,
    Pointer,
    Rule,
    did_you_mean,
    pluralize,
    quote,
    value_key,
)
from r2bspec.wiring.node_interface import catalogue_packages

_MAX_RELATED = 5
"""How many further places of a package a finding shows."""


def _find(context: Context) -> Findings:
    requested: dict[str, list[Path]] = {}
    for path, package in _packages(context):
        requested.setdefault(package, []).append(path)
    installed = ament_packages() if requested else frozenset()
    for package, (first, *others) in requested.items():
        if package not in installed:
            yield Finding(
                message=f"ROS package {quote(package)} not found on this machine",
                path=first,
                help=_help(package, installed),
                related=tuple(Pointer("also used here", path) for path in others[:_MAX_RELATED]),
                machine_dependent=True,
                suppresses={value_key(path) for path in (first, *others)},
            )


def _help(package: str, installed: frozenset[str]) -> str:
    known = catalogue_packages()
    close = "" if package in known else did_you_mean(package, installed | known)
    if close:
        return f"did you mean {quote(close)}?"
    prefixes = pluralize(len(ament_prefixes()), "folder")
    return f"{ros_package_advice(package)} (AMENT_PREFIX_PATH has {prefixes})"


def _packages(context: Context) -> Iterator[tuple[Path, str]]:
    """Every ROS package of the spec: its location and its name."""
    for _, node in context.nodes:
        if node.node.package:
            yield (*node.path, "package"), node.node.package
        elif node.node.launch is not None and node.node.launch.package:
            yield (*node.path, "launch", "package"), node.node.launch.package


RULE = Rule(code="R2B622", find=_find)
