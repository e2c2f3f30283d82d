"""Parameter files without parameters of the node."""

from __future__ import annotations

from r2bspec.check.parameter_types import parameter_file_paths
from r2bspec.check.rule_api import Context, Finding, Findings, NodeWiring, Rule, quote, quoted_list


def _find(context: Context) -> Findings:
    for _, node in context.nodes:
        if node.node.kind.any_program:
            # It may contain several nodes with any names.
            continue
        for path, name in parameter_file_paths(context, node):
            file = context.companion_files.parameter_files.get(name)
            keys = [] if file is None or file.problem else [key for key, _ in file.nodes]
            if file is not None and keys and not file.matching(node.name):
                yield Finding(
                    message=f"parameter file {quote(name)} has no parameters of {quote(node.name)}",
                    path=path,
                    help=_advice(keys, node),
                )


def _advice(keys: list[str], node: NodeWiring) -> str:
    if any(key.rpartition("/")[2] == node.key for key in keys):
        return (
            f"ROS reads {quote(node.key)} as a node without a namespace: write {quote(node.name)}, "
            "or '/**' for any node"
        )
    return f"it has parameters of {quoted_list(keys)}; '/**' matches any node"


RULE = Rule(code="R2B618", find=_find)
