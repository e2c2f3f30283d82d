"""Listed environment variables that are not set."""

from __future__ import annotations

import os

from r2bspec.check.rule_api import Context, Finding, Findings, Rule


def _find(context: Context) -> Findings:
    for index, name in enumerate(context.spec.environment):
        if os.environ.get(name) is None:
            yield Finding(
                message=f"environment variable {name} is not set",
                path=("environment", index),
                help=f"set it, for example: export {name}=...",
                machine_dependent=True,
            )


RULE = Rule(code="R2B617", find=_find)
