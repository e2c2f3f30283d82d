"""Setup steps that build something, without `creates`."""

from __future__ import annotations

import re

from r2bspec.check.rule_api import Context, Finding, Findings, Rule, quote

_BUILD_COMMAND = re.compile(
    r"(?:^|/)(?:colcon|cmake|make|ninja|bazel|cargo|pip|trtexec)$|build|compile|convert|download"
)


def _find(context: Context) -> Findings:
    for name, step in context.spec.setup.items():
        word = next((each for each in step.command if _BUILD_COMMAND.search(each)), "")
        if word and not step.creates:
            yield Finding(
                message=f"setup step {quote(name)} seems to build something, but has no 'creates'",
                path=("setup", name),
                key=True,
                help="name the built file under 'creates': the step is skipped if the file exists",
            )


RULE = Rule(code="R2B607", find=_find)
