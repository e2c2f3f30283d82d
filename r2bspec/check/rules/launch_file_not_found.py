"""Launch files that do not exist."""

from __future__ import annotations

from pathlib import Path as FilePath

from r2bspec.check.installed_packages import package_share
from r2bspec.check.rule_api import Context, Finding, Findings, Rule, quote, suggestion
from r2bspec.safe_io.safe_file import is_regular, names_in


def _find(context: Context) -> Findings:
    for _, node in context.nodes:
        launch = node.node.launch
        if launch is None:
            continue
        if launch.path and not is_regular(context.loaded.base_dir / launch.path):
            yield Finding(
                message=f"launch file {quote(launch.path)} not found",
                path=(*node.path, "launch", "path"),
                help=f"paths are relative to the folder of the spec ({context.loaded.base_dir}); "
                "for a launch file of a package use 'package' and 'file'",
            )
        elif launch.package:
            share = package_share(launch.package)
            if share is not None and not _has_launch_file(share, launch.file):
                yield Finding(
                    message=f"ROS package {quote(launch.package)} has no launch file "
                    f"{quote(launch.file)} on this machine",
                    path=(*node.path, "launch", "file"),
                    help=suggestion(launch.file, _launch_files(share), "its launch files"),
                    severity="warning",
                    machine_dependent=True,
                )


def _has_launch_file(share: FilePath, file: str) -> bool:
    return is_regular(share / file) or file in _launch_files(share)


def _launch_files(share: FilePath) -> list[str]:
    folder = share / "launch"
    try:
        return [each for each in names_in(folder) if is_regular(folder / each)]
    except OSError:
        return []


RULE = Rule(code="R2B613", find=_find)
