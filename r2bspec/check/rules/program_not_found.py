"""Commands whose program does not exist on this machine."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path as FilePath

from r2bspec.check.installed_packages import is_on_path
from r2bspec.check.rule_api import Context, Finding, Findings, Path, Rule, quote
from r2bspec.safe_io.safe_file import is_regular


def _find(context: Context) -> Findings:
    for path, program, folder in _programs(context):
        if "/" in program:
            exists = is_regular(folder / program)
            message = f"program {quote(program)} not found"
            advice = (
                f"the path is relative to its working folder ({folder}); build it before the run"
            )
        else:
            exists = is_on_path(program)
            message = f"program {quote(program)} not found on the PATH of this machine"
            advice = "install it, or correct the command"
        if not exists:
            yield Finding(
                message=message,
                path=path,
                help=advice,
                machine_dependent=True,
            )


def _programs(context: Context) -> Iterator[tuple[Path, str, FilePath]]:
    """Every program of the spec: its location, its name, and its working directory."""
    spec, base_dir = context.spec, context.loaded.base_dir
    for _, node in context.nodes:
        for key, command in (("command", node.node.command), ("prefix", node.node.prefix)):
            if command:
                yield (*node.path, key, 0), command[0], base_dir
    for name, container in spec.containers.items():
        if container.prefix:
            yield ("containers", name, "prefix", 0), container.prefix[0], base_dir
    for name, setup in spec.setup.items():
        yield ("setup", name, "command", 0), setup.command[0], base_dir / setup.directory
    for name, step in spec.after_ready.items():
        if step.command:
            yield ("after_ready", name, "command", 0), step.command[0], base_dir


RULE = Rule(code="R2B621", find=_find)
