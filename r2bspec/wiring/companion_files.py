"""Companion files of a spec: recorded interfaces, parameter files, and Python files of nodes.

They are read as data, once, so that wiring and plan are pure functions of values. Except for
parameter files that the spec names by their paths, nothing outside of the folder of the spec is
read, and links out of a folder are not followed.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from r2bspec.language.spec import Node, Spec
from r2bspec.untrusted import safe_file
from r2bspec.untrusted.safe_yaml import load_values
from r2bspec.wiring.ast_reader import read_node_class, read_python_file
from r2bspec.wiring.node_interface import InterfaceEntry, parse_interface_entry
from r2bspec.wiring.node_start import NodeStart, read_node_start
from r2bspec.wiring.parameter_files import ParameterFile, limited, read_parameter_file
from r2bspec.wiring.record_origin import difference

INTERFACES_FOLDER = "interfaces"
"""The folder next to a spec with recorded interfaces, one file for each node."""

_MAX_FILE_BYTES = 1_000_000
_MAX_DEPTH = 50


@dataclass(frozen=True, slots=True)
class CompanionFiles:
    """The content of the companion files.

    Attributes:
        interfaces: recorded interfaces by the key of the node.
        interface_errors: why an interface file cannot be used, by the key of the node.
        parameter_files: by their paths in the spec.
        sources: interfaces read from Python files, by the text of ``python:``.
        starts: how the nodes in Python files are started, likewise.
    """

    interfaces: Mapping[str, InterfaceEntry] = field(default_factory=dict)
    interface_errors: Mapping[str, str] = field(default_factory=dict)
    parameter_files: Mapping[str, ParameterFile] = field(default_factory=dict)
    sources: Mapping[str, InterfaceEntry] = field(default_factory=dict)
    starts: Mapping[str, NodeStart] = field(default_factory=dict)


NO_COMPANION_FILES = CompanionFiles()


def interface_file(base_dir: Path, node: str) -> Path:
    """The path of the recorded interface of a node."""
    return base_dir / INTERFACES_FOLDER / f"{node}.yaml"


def read_companion_files(spec: Spec, base_dir: Path) -> CompanionFiles:
    """Read the companion files of a spec.

    Args:
        spec: the spec.
        base_dir: its folder.
    """
    interfaces: dict[str, InterfaceEntry] = {}
    interface_errors: dict[str, str] = {}
    sources: dict[str, InterfaceEntry] = {}
    starts: dict[str, NodeStart] = {}
    files: dict[str, ParameterFile] = {}
    named: Counter[str] = Counter()
    recorded = safe_file.is_folder(base_dir / INTERFACES_FOLDER)
    for key, node in _nodes(spec):
        if recorded:
            _read_interface(base_dir, key, node, interfaces, interface_errors)
        if ":" in node.python and node.python not in starts:
            _read_source(base_dir, node.python, sources, starts)
        named.update(set(node.parameter_files))
    for path, number_of_nodes in named.items():
        files[path] = limited(read_parameter_file(base_dir / path, base_dir), number_of_nodes)
    return CompanionFiles(interfaces, interface_errors, files, sources, starts)


def _nodes(spec: Spec) -> Iterator[tuple[str, Node]]:
    yield from spec.preprocessors.items()
    yield from spec.graph.nodes.items()


def _read_interface(
    base_dir: Path,
    key: str,
    node: Node,
    found: dict[str, InterfaceEntry],
    interface_errors: dict[str, str],
) -> None:
    file = interface_file(base_dir, key)
    try:
        text = safe_file.read_text(file, max_bytes=_MAX_FILE_BYTES, folders=(base_dir,))
    except FileNotFoundError:
        return
    except OSError as error:
        interface_errors[key] = error.strerror or str(error)
        return
    try:
        row = load_values(text, max_depth=_MAX_DEPTH)
        entry = parse_interface_entry(row, "file", f"{INTERFACES_FOLDER}/{file.name}")
    except Exception as error:
        interface_errors[key] = str(error).partition("\n")[0] or type(error).__name__
        return
    problem = "" if entry.recorded_from is None else difference(entry.recorded_from, node, base_dir)
    if problem:
        interface_errors[key] = problem
    else:
        found[key] = entry


def _read_source(
    base_dir: Path,
    target: str,
    sources: dict[str, InterfaceEntry],
    starts: dict[str, NodeStart],
) -> None:
    """Read what the source of ``./file.py:Class`` says of its interface and its start."""
    place, _, name = target.rpartition(":")
    tree = read_python_file(base_dir / place, base_dir)
    if tree is None:
        return
    interface = read_node_class(tree, name)
    if interface is not None:
        sources[target] = interface
    start = read_node_start(tree, name)
    if start is not None:
        starts[target] = start
