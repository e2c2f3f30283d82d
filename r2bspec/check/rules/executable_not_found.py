"""Executables that are not in their installed ROS package."""

from __future__ import annotations

from r2bspec.check.installed_packages import package_executables
from r2bspec.check.rule_api import Context, Finding, Findings, Rule, quote, suggestion, value_key
from r2bspec.language.node_kinds import EXECUTABLE


def _find(context: Context) -> Findings:
    for _, node in context.nodes:
        if node.node.kind is not EXECUTABLE:
            continue
        package, executable = node.node.package, node.node.executable
        executables = package_executables(package)
        if executable not in executables:
            yield Finding(
                message=f"ROS package {quote(package)} has no executable {quote(executable)} on "
                "this machine",
                path=(*node.path, "executable"),
                help=suggestion(executable, executables, "its executables")
                or "the package has no executables",
                machine_dependent=True,
                suppressed_by={value_key((*node.path, "package"))},
            )


RULE = Rule(code="R2B623", find=_find)
