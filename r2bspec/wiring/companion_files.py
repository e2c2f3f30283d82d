"""What lies beside a spec: recorded interfaces, parameter files, and Python files of nodes.

All of it is read as data, once, before anything is worked out, so that wiring and plan stay pure
functions of values. Nothing outside the spec's folder is read, but for parameter files that the
spec names.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from r2bspec.language.spec import Node, Spec
from r2bspec.wiring.ast_reader import read_node_source
from r2bspec.wiring.node_interface import InterfaceEntry, parse_interface_entry, read_yaml
from r2bspec.wiring.parameter_files import ParameterFile, read_parameter_file

INTERFACES_FOLDER = "interfaces"
"""The folder beside a spec in which recorded interfaces lie, one file for each node."""

_MAX_FILE_BYTES = 1_000_000


@dataclass(frozen=True, slots=True)
class CompanionFiles:
    """What was found.

    Attributes:
        interfaces: recorded interfaces by the node's key.
        interface_errors: interface files that say nothing, by the node's key, and why.
        parameter_files: by the path that the spec writes.
        sources: what Python files say literally, by the text of ``python:``.
    """

    interfaces: Mapping[str, InterfaceEntry] = field(default_factory=dict)
    interface_errors: Mapping[str, str] = field(default_factory=dict)
    parameter_files: Mapping[str, ParameterFile] = field(default_factory=dict)
    sources: Mapping[str, InterfaceEntry] = field(default_factory=dict)


NO_COMPANION_FILES = CompanionFiles()


def interface_file(base_dir: Path, node: str) -> Path:
    """Where the recorded interface of a node lies."""
    return base_dir / INTERFACES_FOLDER / f"{node}.yaml"


def read_companion_files(spec: Spec, base_dir: Path) -> CompanionFiles:
    """Read all that is said beside a spec about its nodes.

    Args:
        spec: the spec.
        base_dir: its folder.
    """
    interfaces: dict[str, InterfaceEntry] = {}
    interface_errors: dict[str, str] = {}
    sources: dict[str, InterfaceEntry] = {}
    files: dict[str, ParameterFile] = {}
    recorded = (base_dir / INTERFACES_FOLDER).is_dir()
    for key, node in _nodes(spec):
        if recorded:
            _read_interface(base_dir, key, interfaces, interface_errors)
        if ":" in node.python and node.python not in sources:
            found = _source(base_dir, node.python)
            if found is not None:
                sources[node.python] = found
        for path in node.parameter_files:
            files.setdefault(path, read_parameter_file(base_dir / path))
    return CompanionFiles(interfaces, interface_errors, files, sources)


def _nodes(spec: Spec) -> Iterator[tuple[str, Node]]:
    yield from spec.preprocessors.items()
    yield from spec.graph.nodes.items()


def _read_interface(
    base_dir: Path, key: str, found: dict[str, InterfaceEntry], interface_errors: dict[str, str]
) -> None:
    file = interface_file(base_dir, key)
    try:
        if not file.is_file():
            return
        if file.stat().st_size > _MAX_FILE_BYTES:
            interface_errors[key] = f"it is larger than {_MAX_FILE_BYTES:,} bytes"
            return
        row = read_yaml(file.read_text(encoding="utf-8"))
        found[key] = parse_interface_entry(row, "file", f"{INTERFACES_FOLDER}/{file.name}")
    except Exception as error:
        interface_errors[key] = str(error).partition("\n")[0] or type(error).__name__


def _source(base_dir: Path, target: str) -> InterfaceEntry | None:
    place, _, name = target.rpartition(":")
    file = base_dir / place
    try:
        inside = file.resolve().is_relative_to(base_dir.resolve())
    except (OSError, ValueError, RuntimeError):
        return None
    return read_node_source(file, name) if inside else None
