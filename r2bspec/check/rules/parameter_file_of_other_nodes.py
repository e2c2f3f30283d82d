"""Parameter files of which no part is about the node."""

from __future__ import annotations

from r2bspec.check.parameter_types import parameter_file_paths
from r2bspec.check.rule_api import (
    Context,
    Finding,
    Iterator,
    NodeWiring,
    Rule,
    Severity,
    quote,
    quoted_list,
)
from r2bspec.wiring.parameter_files import node_key_matches


def _find(context: Context) -> Iterator[Finding]:
    for _, node in context.nodes:
        if node.node.kind.any_program:
            # It may hold several nodes, of any name.
            continue
        for path, name in parameter_file_paths(context, node):
            file = context.companion_files.parameter_files.get(name)
            keys = [] if file is None or file.problem else [key for key, _ in file.nodes]
            if keys and not any(node_key_matches(key, node.name) for key in keys):
                yield Finding(
                    message=f"{quote(name)} has no parameters of {node.name}",
                    path=path,
                    help=_advice(keys, node),
                )


def _advice(keys: list[str], node: NodeWiring) -> str:
    if any(key.rpartition("/")[2] == node.key for key in keys):
        return (
            f"ROS takes {quote(node.key)} for a node without namespace: write {quote(node.name)}, "
            "or '/**' for any node"
        )
    return f"it is about {quoted_list(keys)}; '/**' is about any node"


RULE = Rule(
    code="R2B618",
    title="a parameter file that is about other nodes",
    severity=Severity.ERROR,
    why="ROS compares the full name of a node with the keys of the file, and ignores what does not "
    "match without a word.",
    find=_find,
)
