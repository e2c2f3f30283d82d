"""The programs of a spec: whether they exist on this machine, and how a run can start them.

Packages, executables, programs and launch files are looked up in folders and indexes. Sources of
Python nodes are read, never imported: a class or function is looked up among the names that its
file binds.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path as FilePath

from msgspec.structs import replace

from r2bspec.check.check_context import Context
from r2bspec.check.rule import Finding, Findings, Pointer, path_help, rule, value_key
from r2bspec.check.rules.node_settings import parameter_files
from r2bspec.diagnostics.diagnostic import Path
from r2bspec.diagnostics.quote import did_you_mean, pluralize, quote, suggestion
from r2bspec.language.node_kinds import EXECUTABLE, PLUGIN
from r2bspec.language.spec_graph import Launch
from r2bspec.plan import installed_packages, package_advice
from r2bspec.plan.this_machine import ament_prefixes, find_module, module_file
from r2bspec.plan.wiring import node_interface
from r2bspec.safe_io.file_search import near_path
from r2bspec.safe_io.safe_file import is_folder, is_regular, names_if_any


@rule("R2B613")
def launch_file_not_found(context: Context) -> Findings:
    """Find launch files that do not exist."""
    for _, node in context.nodes:
        launch = node.node.launch
        if launch is None:
            continue
        if _has_launch_file(launch, context.loaded.base_dir):
            continue
        if launch.path:
            yield Finding(
                message=f"launch file {quote(launch.path)} not found",
                path=(*node.path, "launch", "path"),
                help=f"{path_help(context, launch.path)}; "
                "for a launch file of a package use 'package' and 'file'",
            )
        elif (share := installed_packages.package_share(launch.package)) is not None:
            yield Finding(
                message=f"ROS package {quote(launch.package)} has no launch file "
                f"{quote(launch.file)} on this machine",
                path=(*node.path, "launch", "file"),
                help=suggestion(launch.file, _launch_files(share), "its launch files"),
                severity="warning",
                machine_dependent=True,
            )


def _has_launch_file(launch: Launch, base_dir: FilePath) -> bool:
    if launch.path:
        return is_regular(base_dir / launch.path)
    share = installed_packages.package_share(launch.package)
    return share is not None and (
        is_regular(share / launch.file) or launch.file in _launch_files(share)
    )


def _launch_files(share: FilePath) -> list[str]:
    folder = share / "launch"
    return [name for name in names_if_any(folder) if is_regular(folder / name)]


@rule("R2B621")
def program_not_found(context: Context) -> Findings:
    """Find commands whose program does not exist on this machine."""
    for path, program, folder in _programs(context):
        if "/" in program:
            exists = is_regular(folder / program)
            message = f"program {quote(program)} not found"
            advice = near_path(program, folder) or (
                f"the path is relative to its working folder ({folder}); build it before the run"
            )
        else:
            exists = installed_packages.is_on_path(program)
            message = f"program {quote(program)} not found on the PATH of this machine"
            advice = (
                "it starts launch files: source a ROS 2 that has the package ros2launch"
                if path[-1] == "launch"
                else "install it, or correct the command"
            )
        if not exists:
            yield Finding(message=message, path=path, help=advice, machine_dependent=True)


def _programs(context: Context) -> Iterator[tuple[Path, str, FilePath]]:
    """Yield every program of the spec: its location, its name, and its working directory."""
    spec, base_dir = context.spec, context.loaded.base_dir
    for _, node in context.nodes:
        for key, command in (("command", node.node.command), ("prefix", node.node.prefix)):
            if command:
                yield (*node.path, key, 0), command[0], base_dir
        launch = node.node.launch
        if launch is not None and _has_launch_file(launch, base_dir):
            yield (*node.path, "launch"), "ros2", base_dir
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


@rule("R2B622", early=True)
def package_not_found(context: Context) -> Findings:
    """Find ROS packages that are not installed on this machine."""
    requested: dict[str, list[Path]] = {}
    for path, package in _requested_packages(context):
        requested.setdefault(package, []).append(path)
    installed = installed_packages.ament_packages() if requested else frozenset()
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
    catalogued = node_interface.catalogue_packages()
    close = "" if package in catalogued else did_you_mean(package, installed | catalogued)
    if close:
        return f"did you mean {quote(close)}?"
    prefixes = pluralize(len(ament_prefixes()), "folder")
    return f"{package_advice.ros_package_advice(package)} (AMENT_PREFIX_PATH has {prefixes})"


def _requested_packages(context: Context) -> Iterator[tuple[Path, str]]:
    """Yield every ROS package of the spec: its location and its name."""
    for _, node in context.nodes:
        if node.node.package:
            yield (*node.path, "package"), node.node.package
        elif node.node.launch is not None and node.node.launch.package:
            yield (*node.path, "launch", "package"), node.node.launch.package
        yield from (
            (path, package)
            for path, name, file in parameter_files(context, node)
            if file.missing and (package := _missing_share(name))
        )
    yield from ((path, package) for path, package, _ in _ros2_runs(context))


def _missing_share(file: str) -> str:
    """Return the package in whose share folder an absolute path is, if there is no such folder."""
    before, _, after = file.partition("/share/")
    package, slash, _ = after.partition("/")
    is_missing = slash and not is_folder(FilePath(before, "share", package))
    return package if before.startswith("/") and is_missing else ""


def _ros2_runs(context: Context) -> Iterator[tuple[Path, str, str]]:
    """Commands ``ros2 run PACKAGE EXECUTABLE``: the location of the package, and both names."""
    for _, node in context.nodes:
        match node.node.command:
            case ("ros2", "run", package, executable, *_) if not package.startswith("-"):
                yield (*node.path, "command", 2), package, executable


@rule("R2B623")
def executable_not_found(context: Context) -> Findings:
    """Find executables that are not in their installed ROS package."""
    named = [
        (
            (*node.path, "package"),
            (*node.path, "executable"),
            node.node.package,
            node.node.executable,
        )
        for _, node in context.nodes
        if node.node.kind is EXECUTABLE
    ]
    named += [
        (path, (*path[:-1], 3), package, executable)
        for path, package, executable in _ros2_runs(context)
    ]
    for package_path, path, package, executable in named:
        executables = installed_packages.package_executables(package)
        if executable not in executables:
            yield Finding(
                message=f"ROS package {quote(package)} has no executable {quote(executable)} on "
                "this machine",
                path=path,
                help=suggestion(executable, executables, "its executables")
                or "the package has no executables",
                machine_dependent=True,
                suppressed_by={value_key(package_path)},
            )


@rule("R2B639", early=True)
def plugin_not_found(context: Context) -> Findings:
    """Find C++ components that neither their package, as installed here, nor the catalogue has."""
    for _, node in context.nodes:
        package, plugin = node.node.package, node.node.plugin
        if node.node.kind is not PLUGIN:
            continue
        if package in installed_packages.ament_packages():
            components, where = installed_packages.package_plugins(package), "on this machine"
            known = True
        else:
            components = {*node_interface.catalogue_nodes(package)}
            where = f"of {node_interface.ROS_DISTRIBUTION}"
            known = bool(components)
        if known and plugin not in components:
            yield Finding(
                message=f"{package} {where} has no component {quote(plugin)}",
                path=(*node.path, "plugin"),
                help=suggestion(plugin, components, "its components")
                or "it registers no components; see rclcpp_components_register_node",
                machine_dependent=True,
                suppresses={value_key(node.path)},
            )


@rule("R2B624", early=True)
def python_module_not_found(context: Context) -> Findings:
    """Find Python nodes whose file or module does not exist."""
    for path, target in _python_targets(context):
        finding = (
            _missing_module(context, path, target)
            if target.module
            else _unusable_file(context, path, target)
        )
        if finding is not None:
            yield replace(finding, suppresses={value_key(path), value_key(path[:-1])})


def _python_targets(context: Context) -> Iterator[tuple[Path, installed_packages.PythonTarget]]:
    """Yield the path of each Python node in the spec, and what it names."""
    for _, node in context.nodes:
        if node.node.python:
            target = installed_packages.python_target(node.node.python, context.loaded.base_dir)
            yield (*node.path, "python"), target


def _missing_module(
    context: Context, path: Path, target: installed_packages.PythonTarget
) -> Finding | None:
    if find_module(target.module) is not None:
        return None
    file = f"./{target.module.replace('.', '/')}.py"
    if is_regular(context.loaded.base_dir / file):
        file, advice = f"{file}:{target.name}", "for the file beside the spec"
    else:
        file, advice = "./file.py:Class", "install it, or source its workspace; for a file"
    return Finding(
        message=f"Python module {quote(target.module)} not found on this machine",
        path=path,
        part=(0, len(target.module)),
        help=f"{advice}, write {file}",
        severity="warning",
        machine_dependent=True,
    )


def _unusable_file(
    context: Context, path: Path, target: installed_packages.PythonTarget
) -> Finding | None:
    written = target.text.rpartition(":")[0]
    if not is_regular(target.file):
        return Finding(
            message=f"Python file {quote(written)} not found",
            path=path,
            part=(0, len(written)),
            help=path_help(context, written),
        )
    try:
        if target.readable:
            installed_packages.top_level_names(target.file)
    except SyntaxError as error:
        return Finding(
            message=f"{quote(written)} is not valid Python: {error.msg}"
            + (f" in line {error.lineno}" if error.lineno else ""),
            path=path,
            part=(0, len(written)),
        )
    return None


_REFERENCE_NODES = "r2bspec.nodes"


@rule("R2B625", early=True)
def python_name_not_found(context: Context) -> Findings:
    """Find Python nodes whose class or function is not in their file or module."""
    for path, target in _python_targets(context):
        names = _defined_names(target)
        if names is None or target.name in names:
            continue
        # Another version of an installed module may have the name; files and the reference nodes
        # are the same on every machine.
        certain = not target.module or target.module == _REFERENCE_NODES
        yield Finding(
            message=f"{quote(target.module or target.text.rpartition(':')[0])} has no class or "
            f"function {quote(target.name)}",
            path=path,
            part=(len(target.text) - len(target.name), len(target.name)),
            help=suggestion(target.name, _public(names), "its classes and functions"),
            severity=None if certain else "warning",
            machine_dependent=not certain,
            suppressed_by={value_key(path)},
            suppresses={value_key(path[:-1])},
        )


def _defined_names(target: installed_packages.PythonTarget) -> frozenset[str] | None:
    """Return the names of a file or module; None if they cannot be determined."""
    if target.module == _REFERENCE_NODES:
        return frozenset(
            name.rpartition(".")[2] for name in node_interface.reference_node_interfaces()
        )
    source = target.file if target.readable else None
    if target.module:
        source = module_file(target.module)
    if source is None or not is_regular(source):
        return None
    try:
        return installed_packages.top_level_names(source)
    except SyntaxError:
        return None


def _public(names: frozenset[str]) -> list[str]:
    """Return the names that are likely to be nodes."""
    return [name for name in names if name[:1].isupper()] or [
        name for name in names if not name.startswith("_")
    ]
