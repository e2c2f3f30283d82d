"""Executables that an installed ROS package does not have."""

from __future__ import annotations

from r2bspec.check.installed_packages import package_executables
from r2bspec.check.rule_api import (
    Certainty,
    Context,
    Finding,
    Iterator,
    Rule,
    Severity,
    quote,
    suggestion,
    suppression_keys,
)
from r2bspec.language.node_kinds import EXECUTABLE


def _find(context: Context) -> Iterator[Finding]:
    for _, node in context.nodes:
        if node.node.kind is not EXECUTABLE:
            continue
        package, executable = node.node.package, node.node.executable
        executables = package_executables(package)
        if executable not in executables:
            yield Finding(
                message=f"the ROS package {quote(package)} has no executable {quote(executable)} "
                "on this machine",
                path=(*node.path, "executable"),
                help=suggestion(executable, executables, "it has") or "it has none at all",
                certainty=Certainty.ENVIRONMENT,
                suppressed_by=frozenset({suppression_keys.value((*node.path, "package"))}),
            )


RULE = Rule(
    code="R2B623",
    title="an executable that its ROS package does not have",
    severity=Severity.WARNING,
    why="A run on this machine would fail as it starts. It is a warning, because another version "
    "of the package may have it.",
    find=_find,
)
