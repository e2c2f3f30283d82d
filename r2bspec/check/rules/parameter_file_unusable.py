"""Parameter files that are not there, or that ROS could not read."""

from __future__ import annotations

from r2bspec.check.parameter_types import parameter_file_paths
from r2bspec.check.rule_api import Context, Finding, Findings, Rule, example, quote, value_key


def _find(context: Context) -> Findings:
    for _, node in context.nodes:
        for path, name in parameter_file_paths(context, node):
            file = context.companion_files.parameter_files.get(name)
            if file is None or not file.problem:
                continue
            yield Finding(
                message=f"there is no parameter file {quote(name)}"
                if file.missing
                else f"the parameter file {quote(name)} {file.problem}",
                path=path,
                help=f"it is looked for in the folder of the spec, {context.loaded.base_dir}"
                if file.missing
                else "parameters stand below the name of their node and 'ros__parameters'",
                suppresses={value_key(path)},
            )


RULE = Rule(
    code="R2B614",
    title="a parameter file that cannot be used",
    severity="error",
    why="The node would not start, or start with its defaults.",
    failing=example(
        graph="""
            nodes:
              relay:
                python: r2bspec.nodes.RelayNode
                parameters: ./relay.yaml
                remappings: {input: image}
        """
    ),
    passing=example(
        graph="""
            nodes:
              relay:
                python: r2bspec.nodes.RelayNode
                parameters: {service_time_ms: 1.0}
                remappings: {input: image}
        """
    ),
    find=_find,
)
