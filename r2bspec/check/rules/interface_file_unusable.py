"""Interface files that cannot be used."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, Rule, quote


def _find(context: Context) -> Findings:
    for _, node in context.nodes:
        problem = context.companion_files.interface_errors.get(node.key)
        if problem:
            yield Finding(
                message=f"{quote(f'interfaces/{node.key}.yaml')} is ignored: {problem}",
                path=node.path,
                key=True,
                help="recreate it with 'r2bspec interfaces'",
            )


RULE = Rule(
    code="R2B223",
    title="unusable interface file",
    severity="warning",
    why="A file in the folder 'interfaces' describes the topics and parameters of a node before it "
    "starts. Without the file, fewer errors are found.",
    find=_find,
)
