"""Python nodes whose file imports a module that is not on this machine."""

from __future__ import annotations

from r2bspec.check.installation_advice import python_module_advice
from r2bspec.check.installed_packages import find_module
from r2bspec.check.module_imports import missing_imports
from r2bspec.check.python_target import python_target
from r2bspec.check.rule_api import Context, Finding, Findings, Rule, quote, value_key


def _find(context: Context) -> Findings:
    base_dir = context.loaded.base_dir
    targets = {
        (*node.path, "python"): python_target(node.node.python, base_dir)
        for _, node in context.nodes
        if ":" in node.node.python
    }
    # Without ROS no node can run here, and what is missing says nothing.
    if not targets or find_module("rclpy") is None:
        return
    reported: set[tuple[str, str]] = set()
    for path, target in targets.items():
        for each in missing_imports(target.file, base_dir) if target.readable else ():
            written = target.text.rpartition(":")[0]
            if (written, each.module) not in reported:
                reported.add((written, each.module))
                yield Finding(
                    message=f"{quote(written)} imports {quote(each.module)} in line {each.line}, "
                    "which is not found on this machine",
                    path=path,
                    part=(0, len(written)),
                    help=python_module_advice(each.module),
                    machine_dependent=True,
                    suppressed_by={value_key(path)},
                )


RULE = Rule(code="R2B680", find=_find)
