"""Parameter files that do not exist or that ROS cannot load."""

from __future__ import annotations

from r2bspec.check.parameter_types import parameter_file_paths
from r2bspec.check.rule_api import Context, Finding, Findings, Rule, quote, value_key


def _find(context: Context) -> Findings:
    for _, node in context.nodes:
        for path, name in parameter_file_paths(context, node):
            file = context.companion_files.parameter_files.get(name)
            if file is None or not file.problem:
                continue
            yield Finding(
                message=f"parameter file {quote(name)} not found"
                if file.missing
                else f"parameter file {quote(name)} {file.problem}",
                path=path,
                help=f"paths are relative to the folder of the spec ({context.loaded.base_dir})"
                if file.missing
                else "the layout is the node name, 'ros__parameters', then the parameters",
                suppresses={value_key(path)},
            )


RULE = Rule(code="R2B614", find=_find)
