"""Launch files that are not there."""

from __future__ import annotations

from pathlib import Path as FilePath

from r2bspec.check.installed_packages import package_share
from r2bspec.check.rule_api import Context, Finding, Findings, Rule, example, quote, suggestion


def _find(context: Context) -> Findings:
    for _, node in context.nodes:
        launch = node.node.launch
        if launch is None:
            continue
        if launch.path and not (context.loaded.base_dir / launch.path).is_file():
            yield Finding(
                message=f"there is no launch file {quote(launch.path)}",
                path=(*node.path, "launch", "path"),
                help=f"it is looked for in the folder of the spec, {context.loaded.base_dir}; one "
                "of a package is named by 'package' and 'file'",
            )
        elif launch.package:
            share = package_share(launch.package)
            if share is not None and not _has_launch_file(share, launch.file):
                yield Finding(
                    message=f"the ROS package {quote(launch.package)} has no launch file "
                    f"{quote(launch.file)} on this machine",
                    path=(*node.path, "launch", "file"),
                    help=suggestion(launch.file, _launch_files(share), "it has"),
                    severity="warning",
                    machine_dependent=True,
                )


def _has_launch_file(share: FilePath, file: str) -> bool:
    return (share / file).is_file() or file in _launch_files(share)


def _launch_files(share: FilePath) -> list[str]:
    return sorted(each.name for each in (share / "launch").glob("*") if each.is_file())


RULE = Rule(
    code="R2B613",
    title="a launch file that is not there",
    severity="error",
    why="A run would fail as it starts. A file beside the spec belongs to it; one of a package may "
    "be missing on this machine only, which is a warning.",
    failing=example(
        graph="""
            nodes:
              camera:
                launch: {path: ./camera.launch.py}
                subscribes: {image: sensor_msgs/msg/Image}
                publishes: {output: sensor_msgs/msg/Image}
        """
    ),
    passing=example(),
    find=_find,
)
