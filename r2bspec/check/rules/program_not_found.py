"""Commands that this machine does not have."""

from __future__ import annotations

import shutil
from collections.abc import Iterator

from r2bspec.check.context import Context
from r2bspec.check.example import example
from r2bspec.check.finding import Finding
from r2bspec.check.rule import Rule
from r2bspec.diagnostics.model import Certainty, Severity
from r2bspec.diagnostics.quote import quote


def _find(context: Context) -> Iterator[Finding]:
    for _, node in context.nodes:
        if node.node.kind != "command" or not node.node.command:
            continue
        program = node.node.command[0]
        if "/" in program:
            there = (context.loaded.base_dir / program).is_file()
            message = f"there is no file {quote(program)}"
            advice = f"it is looked for in {context.loaded.base_dir}; build it before running"
        else:
            there = shutil.which(program) is not None
            message = f"there is no program {quote(program)} on this machine's PATH"
            advice = "install it, or correct the command"
        if not there:
            yield Finding(
                message=message,
                path=(*node.path, "command", 0),
                help=advice,
                certainty=Certainty.ENVIRONMENT,
            )


RULE = Rule(
    code="R2B621",
    title="a program that is not installed",
    severity=Severity.WARNING,
    why="A run on this machine would fail as it starts. It is a warning, because the run may well "
    "happen on another one.",
    failing=example(
        graph="""
            nodes:
              detector:
                command: [r2bspec-example-detector, --fast]
                subscribes: {image: sensor_msgs/msg/Image}
                publishes: {output: sensor_msgs/msg/Image}
        """
    ),
    passing=example(
        graph="""
            nodes:
              detector:
                command: [sh, ./detector.sh]
                subscribes: {image: sensor_msgs/msg/Image}
                publishes: {output: sensor_msgs/msg/Image}
        """
    ),
    find=_find,
)
