"""Commands that this machine does not have."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path as FilePath

from r2bspec.check.rule_api import Context, Finding, Findings, Path, Rule, example, quote


def _find(context: Context) -> Findings:
    for path, program, folder in _programs(context):
        if "/" in program:
            exists = (folder / program).is_file()
            message = f"there is no file {quote(program)}"
            advice = f"it is looked for in {folder}; build it before running"
        else:
            exists = shutil.which(program) is not None
            message = f"there is no program {quote(program)} on this machine's PATH"
            advice = "install it, or correct the command"
        if not exists:
            yield Finding(
                message=message,
                path=path,
                help=advice,
                machine_dependent=True,
            )


def _programs(context: Context) -> Iterator[tuple[Path, str, FilePath]]:
    """Every program that the spec names, with its place, and the folder in which it is run."""
    spec, base_dir = context.spec, context.loaded.base_dir
    for _, node in context.nodes:
        for key, words in (("command", node.node.command), ("prefix", node.node.prefix)):
            if words:
                yield (*node.path, key, 0), words[0], base_dir
    for name, container in spec.containers.items():
        if container.prefix:
            yield ("containers", name, "prefix", 0), container.prefix[0], base_dir
    for name, setup in spec.setup.items():
        yield ("setup", name, "command", 0), setup.command[0], base_dir / setup.directory
    for name, step in spec.after_ready.items():
        if step.command:
            yield ("after_ready", name, "command", 0), step.command[0], base_dir


RULE = Rule(
    code="R2B621",
    title="a program that is not installed",
    severity="warning",
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
