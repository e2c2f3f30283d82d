"""Interface files that cannot be used."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, Rule, quote


def _find(context: Context) -> Findings:
    for _, node in context.nodes:
        name = quote(f"interfaces/{node.key}.yaml")
        problem = context.companion_files.interface_errors.get(node.key)
        if problem:
            yield Finding(
                message=f"{name} is ignored: {problem}",
                path=node.path,
                key=True,
                help="recreate it with 'r2bspec interfaces'; if it is that of a node of another "
                "spec, give one of the two another key",
            )
        versions = context.record_versions(node)
        if versions is not None:
            recorded, installed = versions
            yield Finding(
                message=f"{name} was recorded with version {recorded} of {node.node.package}, and "
                f"{installed} is installed",
                path=node.path,
                key=True,
                help="recreate it with 'r2bspec interfaces'; until then, what follows from it is "
                "not certain",
                machine_dependent=True,
            )


RULE = Rule(code="R2B223", find=_find)
