"""Python nodes whose file or module is not there."""

from __future__ import annotations

from dataclasses import replace

from r2bspec.check.installed_packages import find_module, top_level_names
from r2bspec.check.python_target import PythonTarget, python_target
from r2bspec.check.rule_api import Context, Finding, Findings, Path, Rule, example, quote, value_key


def _find(context: Context) -> Findings:
    for _, node in context.nodes:
        if node.node.python:
            target = python_target(node.node.python, context.loaded.base_dir)
            path = (*node.path, "python")
            finding = _module(path, target) if target.module else _file(context, path, target)
            if finding is not None:
                yield replace(
                    finding,
                    suppresses={value_key(path), value_key(node.path)},
                )


def _module(path: Path, target: PythonTarget) -> Finding | None:
    if find_module(target.module) is not None:
        return None
    return Finding(
        message=f"there is no Python module {quote(target.module)} on this machine",
        path=path,
        part=(0, len(target.module)),
        help="install it, or source the workspace that has it; a file is written ./file.py:Class",
        severity="warning",
        machine_dependent=True,
    )


def _file(context: Context, path: Path, target: PythonTarget) -> Finding | None:
    written = target.text.rpartition(":")[0]
    if not target.file.is_file():
        return Finding(
            message=f"there is no file {quote(written)}",
            path=path,
            part=(0, len(written)),
            help=f"it is looked for in the folder of the spec, {context.loaded.base_dir}",
        )
    try:
        if target.readable:
            top_level_names(target.file)
    except SyntaxError as error:
        return Finding(
            message=f"{quote(written)} is not Python: {error.msg}"
            + (f" in line {error.lineno}" if error.lineno else ""),
            path=path,
            part=(0, len(written)),
        )
    return None


RULE = Rule(
    code="R2B624",
    title="a Python node whose file or module is not there",
    severity="error",
    why="A run would fail as it starts. A file belongs to the spec, so its absence is an error; an "
    "installed module may be missing on this machine only, which is a warning.",
    failing=example(
        graph="""
            nodes:
              detector:
                python: ./my_nodes.py:Detector
                subscribes: {image: sensor_msgs/msg/Image}
                publishes: {output: sensor_msgs/msg/Image}
        """
    ),
    passing=example(),
    find=_find,
    early=True,
)
