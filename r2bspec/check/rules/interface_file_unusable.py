"""Recorded interfaces that cannot be used."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, Rule, quote


def _find(context: Context) -> Findings:
    for _, node in context.nodes:
        problem = context.companion_files.interface_errors.get(node.key)
        if problem:
            yield Finding(
                message=f"{quote(f'interfaces/{node.key}.yaml')} is not used: {problem}",
                path=node.path,
                key=True,
                help="write it anew with 'r2bspec interfaces'",
            )


RULE = Rule(
    code="R2B223",
    title="a recorded interface that cannot be used",
    severity="warning",
    why="What a file in the folder 'interfaces' says of a node is known before anything starts; "
    "without it, less is checked.",
    find=_find,
)
