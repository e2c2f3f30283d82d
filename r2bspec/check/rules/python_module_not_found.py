"""Python nodes whose file or module does not exist."""

from __future__ import annotations

from msgspec.structs import replace

from r2bspec.check.installed_packages import find_module, top_level_names
from r2bspec.check.python_target import PythonTarget, python_target
from r2bspec.check.rule_api import Context, Finding, Findings, Path, Rule, quote, value_key
from r2bspec.safe_io.safe_file import is_regular


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
        message=f"Python module {quote(target.module)} not found on this machine",
        path=path,
        part=(0, len(target.module)),
        help="install it, or source its workspace; for a file, write ./file.py:Class",
        severity="warning",
        machine_dependent=True,
    )


def _file(context: Context, path: Path, target: PythonTarget) -> Finding | None:
    written = target.text.rpartition(":")[0]
    if not is_regular(target.file):
        return Finding(
            message=f"Python file {quote(written)} not found",
            path=path,
            part=(0, len(written)),
            help=f"paths are relative to the folder of the spec ({context.loaded.base_dir})",
        )
    try:
        if target.readable:
            top_level_names(target.file)
    except SyntaxError as error:
        return Finding(
            message=f"{quote(written)} is not valid Python: {error.msg}"
            + (f" in line {error.lineno}" if error.lineno else ""),
            path=path,
            part=(0, len(written)),
        )
    return None


RULE = Rule(code="R2B624", find=_find, early=True)
