"""Setup steps that make something anew before every run."""

from __future__ import annotations

import re

from r2bspec.check.rule_api import Context, Finding, Findings, Rule, example, quote

_BUILD_COMMAND = re.compile(
    r"(?:^|/)(?:colcon|cmake|make|ninja|bazel|cargo|pip|trtexec)$|build|compile|convert|download"
)


def _find(context: Context) -> Findings:
    for name, step in context.spec.setup.items():
        word = next((each for each in step.command if _BUILD_COMMAND.search(each)), "")
        if word and not step.creates:
            yield Finding(
                message=f"{quote(name)} seems to make something, and runs before every run",
                path=("setup", name),
                key=True,
                help="name the file that it makes under 'creates', and it is skipped once that is "
                "there",
            )


RULE = Rule(
    code="R2B607",
    title="a setup step that builds before every run",
    severity="info",
    why="A step with 'creates' runs once, and a lock keeps runs from making the same file at once.",
    failing=example(setup="{model: {command: [sh, ./build_model.sh]}}"),
    passing=example(setup="{model: {command: [sh, ./build_model.sh], creates: model.plan}}"),
    find=_find,
)
