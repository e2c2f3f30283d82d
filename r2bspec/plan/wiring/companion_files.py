"""Companion files of a spec: recorded interfaces, parameter files, and Python files of nodes.

They are read as data, once, so that wiring and plan are pure functions of values. Python files are
read in the work tree of git, or else in the colcon workspace, that holds the spec, such as
``src/package/node.py`` beside ``bench/``; modules where they are installed. Except for those, and
for parameter files that the spec names by their paths, nothing outside of the folder of the spec is
read, and links out of a folder are not followed.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache, partial
from pathlib import Path

import msgspec

from r2bspec.language.spec import Node, Spec
from r2bspec.plan.installed_packages import python_target
from r2bspec.plan.this_machine import module_file
from r2bspec.plan.wiring.console_scripts import installed_script
from r2bspec.plan.wiring.node_interface import (
    InterfaceEntry,
    node_target,
    origin_difference,
    parse_interface_entry,
    reference_node_interfaces,
)
from r2bspec.plan.wiring.parameter_files import ParameterFile, read_parameter_file
from r2bspec.plan.wiring.python_files import module_of, read_python_file, source_folder
from r2bspec.plan.wiring.source_interface import (
    StartStyle,
    read_node_class,
    read_start_style,
    unknown_interface,
)
from r2bspec.safe_io import limits, safe_file
from r2bspec.safe_io.safe_yaml import load_values

INTERFACES_FOLDER = "interfaces"
"""The folder next to a spec with recorded interfaces, one file for each node."""


class CompanionFiles(msgspec.Struct, frozen=True):
    """The content of the companion files.

    Attributes:
        interfaces: recorded interfaces by the key of the node.
        interface_errors: why an interface file cannot be used, by the key of the node.
        parameter_files: by their paths in the spec.
        sources: interfaces read from Python files, by the node as the spec names it.
        starts: how the nodes in Python files are started, likewise.
    """

    interfaces: Mapping[str, InterfaceEntry] = msgspec.field(default_factory=dict)
    interface_errors: Mapping[str, str] = msgspec.field(default_factory=dict)
    parameter_files: Mapping[str, ParameterFile] = msgspec.field(default_factory=dict)
    sources: Mapping[str, InterfaceEntry] = msgspec.field(default_factory=dict)
    starts: Mapping[str, StartStyle] = msgspec.field(default_factory=dict)


NO_COMPANION_FILES = CompanionFiles()


def interface_file(base_dir: Path, node: str) -> Path:
    """Return the path of the recorded interface of a node."""
    return base_dir / INTERFACES_FOLDER / f"{node}.yaml"


def read_companion_files(spec: Spec, base_dir: Path) -> CompanionFiles:
    """Read the companion files of a spec.

    Args:
        spec: the spec.
        base_dir: its folder.
    """
    return CompanionReader(base_dir).read(spec)


class CompanionReader:
    """Reads the companion files of all cases of a spec, each file once.

    Args:
        base_dir: the folder of the spec.
    """

    def __init__(self, base_dir: Path) -> None:
        self._base_dir = base_dir
        self._recorded = safe_file.is_folder(base_dir / INTERFACES_FOLDER)
        self._interface = cache(partial(_read_interface, base_dir))
        self._source = cache(partial(read_source, base_dir=base_dir))
        self._parameter_file = cache(lambda path: read_parameter_file(base_dir / path, base_dir))

    def read(self, spec: Spec) -> CompanionFiles:
        """Return the companion files of one case."""
        interfaces: dict[str, InterfaceEntry] = {}
        interface_errors: dict[str, str] = {}
        sources: dict[str, InterfaceEntry] = {}
        starts: dict[str, StartStyle] = {}
        files: dict[str, ParameterFile] = {}
        for key, node in (*spec.preprocessors.items(), *spec.graph.nodes.items()):
            recorded = self.usable_interface(key, node) if self._recorded else None
            if isinstance(recorded, str):
                interface_errors[key] = recorded
            elif recorded is not None:
                interfaces[key] = recorded
            # Reference nodes have a table.
            if node.python and node.python not in reference_node_interfaces():
                sources[node.python], start = self._source(node.python)
                if start is not None:
                    starts[node.python] = start
            elif node.executable and (script := installed_script(node.package, node.executable)):
                sources[node_target(node)], _ = self._source(script)
            files |= {path: self._parameter_file(path) for path in node.parameter_files}
        return CompanionFiles(interfaces, interface_errors, files, sources, starts)

    def usable_interface(self, key: str, node: Node) -> InterfaceEntry | str | None:
        """Return the recorded interface, or why it cannot be used, such as another target."""
        entry = self._interface(key)
        if not isinstance(entry, InterfaceEntry) or entry.recorded_from is None:
            return entry
        return origin_difference(entry.recorded_from, node, self._base_dir) or entry


def _read_interface(base_dir: Path, key: str) -> InterfaceEntry | str | None:
    """Return the recorded interface of a node, why it cannot be used, or None if there is none."""
    file = interface_file(base_dir, key)
    try:
        text = safe_file.read_text(file, max_bytes=limits.MAX_COMPANION_BYTES, folders=(base_dir,))
    except FileNotFoundError:
        return None
    except OSError as error:
        return error.strerror or str(error)
    try:
        row = load_values(
            text, max_depth=limits.MAX_COMPANION_DEPTH, max_values=limits.MAX_COMPANION_VALUES
        )
        return parse_interface_entry(row, "file", f"{INTERFACES_FOLDER}/{file.name}")
    except Exception as error:
        return str(error).partition("\n")[0] or type(error).__name__


def read_source(target: str, base_dir: Path) -> tuple[InterfaceEntry, StartStyle | None]:
    """Return the topics of a Python node from its source, or why they are unknown, and its start.

    Args:
        target: as the spec names it.
        base_dir: the folder of the spec.
    """
    python = python_target(target, base_dir)
    place = python.module or target.rpartition(":")[0]
    file = module_file(python.module) if python.module else python.file
    if file is None:
        return unknown_interface(f"no source of {place} is found on this machine"), None
    # A workspace that is built with links leads to its sources.
    path = safe_file.real_path(file)
    folder = module_of(path).folder if python.module else source_folder(base_dir)
    if not python.module and not python.readable:
        why = f"{place} is not read: it is in no git work tree or colcon workspace with the spec"
        return unknown_interface(why), None
    tree = read_python_file(path if python.module else file, folder)
    if tree is None:
        return unknown_interface(f"{place} cannot be read as Python"), None
    try:
        read = cache(partial(read_python_file, folder=folder))
        return read_node_class(tree, python.name, path, read), read_start_style(tree, python.name)
    except RecursionError:
        return unknown_interface("its source is nested too deeply"), None
