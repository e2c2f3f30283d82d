"""Python nodes whose constructor needs arguments that a run cannot give."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, Rule, quoted_list, value_key


def _find(context: Context) -> Findings:
    for _, node in context.nodes:
        names = node.start.required
        if names:
            several = len(names) > 1
            yield Finding(
                message=f"{node.node.python.rpartition(':')[2]} cannot be called without "
                f"{quoted_list(names)}, for which a run has no value{'s' if several else ''}",
                path=(*node.path, "python"),
                help=f"give the parameter{'s' if several else ''} a default, or name a function "
                "that returns the node",
                suppressed_by={value_key(node.path)},
                suppresses={value_key(node.path)},
            )


RULE = Rule(code="R2B231", find=_find)
