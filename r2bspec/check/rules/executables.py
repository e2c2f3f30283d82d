"""Whether what a spec starts exists on this machine: packages, executables, programs, launch files.

Everything is looked up in folders and indexes. Nothing is imported or started.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path as FilePath

from r2bspec.check.check_context import Context
from r2bspec.check.installation_advice import ros_package_advice
from r2bspec.check.rule import Finding, Findings, Pointer, rule, value_key
from r2bspec.diagnostics.diagnostic import Path
from r2bspec.diagnostics.quote import did_you_mean, pluralize, quote, suggestion
from r2bspec.language.node_kinds import EXECUTABLE, PLUGIN
from r2bspec.plan.installed_packages import (
    ament_packages,
    ament_prefixes,
    is_on_path,
    package_executables,
    package_share,
)
from r2bspec.safe_io.safe_file import is_regular, names_if_any
from r2bspec.wiring.node_interface import ROS_DISTRIBUTION, catalogue_nodes, catalogue_packages


@rule("R2B613")
def launch_file_not_found(context: Context) -> Findings:
    """Launch files that do not exist."""
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
            names = _launch_files(share) if share is not None else []
            if share is not None and not (is_regular(share / launch.file) or launch.file in names):
                yield Finding(
                    message=f"ROS package {quote(launch.package)} has no launch file "
                    f"{quote(launch.file)} on this machine",
                    path=(*node.path, "launch", "file"),
                    help=suggestion(launch.file, names, "its launch files"),
                    severity="warning",
                    machine_dependent=True,
                )


def _launch_files(share: FilePath) -> list[str]:
    folder = share / "launch"
    return [name for name in names_if_any(folder) if is_regular(folder / name)]


@rule("R2B621")
def program_not_found(context: Context) -> Findings:
    """Commands whose program does not exist on this machine."""
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
            yield Finding(message=message, path=path, help=advice, machine_dependent=True)


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


_MAX_RELATED = 5
"""How many further places of a package a finding shows."""


@rule("R2B622")
def package_not_found(context: Context) -> Findings:
    """ROS packages that are not installed on this machine."""
    requested: dict[str, list[Path]] = {}
    for path, package in _requested_packages(context):
        requested.setdefault(package, []).append(path)
    installed = ament_packages() if requested else frozenset()
    for package, (first, *others) in requested.items():
        if package not in installed:
            yield Finding(
                message=f"ROS package {quote(package)} not found on this machine",
                path=first,
                help=_package_help(package, installed),
                related=tuple(Pointer("also used here", path) for path in others[:_MAX_RELATED]),
                machine_dependent=True,
                suppresses={value_key(path) for path in (first, *others)},
            )


def _package_help(package: str, installed: frozenset[str]) -> str:
    catalogued = catalogue_packages()
    close = "" if package in catalogued else did_you_mean(package, installed | catalogued)
    if close:
        return f"did you mean {quote(close)}?"
    prefixes = pluralize(len(ament_prefixes()), "folder")
    return f"{ros_package_advice(package)} (AMENT_PREFIX_PATH has {prefixes})"


def _requested_packages(context: Context) -> Iterator[tuple[Path, str]]:
    """Every ROS package of the spec: its location and its name."""
    for _, node in context.nodes:
        if node.node.package:
            yield (*node.path, "package"), node.node.package
        elif node.node.launch is not None and node.node.launch.package:
            yield (*node.path, "launch", "package"), node.node.launch.package


@rule("R2B623")
def executable_not_found(context: Context) -> Findings:
    """Executables that are not in their installed ROS package."""
    for _, node in context.nodes:
        if node.node.kind is not EXECUTABLE:
            continue
        package, executable = node.node.package, node.node.executable
        executables = package_executables(package)
        if executable not in executables:
            yield Finding(
                message=f"ROS package {quote(package)} has no executable {quote(executable)} on "
                "this machine",
                path=(*node.path, "executable"),
                help=suggestion(executable, executables, "its executables")
                or "the package has no executables",
                machine_dependent=True,
                suppressed_by={value_key((*node.path, "package"))},
            )


@rule("R2B639", early=True)
def plugin_not_found(context: Context) -> Findings:
    """C++ components that are not in their well-known package."""
    for _, node in context.nodes:
        components = catalogue_nodes(node.node.package) if node.node.kind is PLUGIN else {}
        if components and node.node.plugin not in components:
            yield Finding(
                message=f"{node.node.package} of {ROS_DISTRIBUTION} has no component "
                f"{quote(node.node.plugin)}",
                path=(*node.path, "plugin"),
                help=suggestion(node.node.plugin, components, "its components"),
                machine_dependent=True,
                suppresses={value_key(node.path)},
            )
