"""ROS parameter files: the values that a node gets from them.

Grammar, as rcl reads it::

    file       = { node key : ( file | { "ros__parameters": parameters } ) }
    parameters = { name : ( value | parameters ) }

Nested node keys are joined by ``/`` and nested parameter names by ``.``. A key is the full name of
a node; without a leading ``/`` it is in the root namespace, so `relay` is not ``/r2b/relay``. ``*``
matches one token of a name, ``**`` any number. If several keys match a node, later ones have
precedence.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from r2bspec.language.spec import Node, ParameterValue
from r2bspec.untrusted.errors import OutsideFolderError
from r2bspec.untrusted.safe_file import read_text, real_path
from r2bspec.untrusted.safe_yaml import RefusedYamlError, load_values

_MAX_FILE_BYTES = 1_000_000
_MAX_DEPTH = 50
_MAX_VALUES = 10_000
"""The most keys of a file; aliases could expand a small file to very many."""

_PARAMETERS_KEY = "ros__parameters"
_OUTSIDE_PROBLEM = f"is no parameter file: each node needs a map '{_PARAMETERS_KEY}'"


@dataclass(frozen=True, slots=True)
class ParameterFile:
    """The content of a parameter file, or why it cannot be used.

    Attributes:
        nodes: each full node key with its parameters, in the order of the file.
        missing: whether the file does not exist.
        problem: why the file cannot be used; empty if it can.
    """

    nodes: tuple[tuple[str, Mapping[str, ParameterValue]], ...] = ()
    missing: bool = False
    problem: str = ""


def read_parameter_file(path: Path, base_dir: Path | None = None) -> ParameterFile:
    """Read a parameter file; problems are in the result.

    A path may lead anywhere, because it is there to be read in the spec, but a link may not lead
    out of its folder or that of the spec. No text of a file outside of the folder of the spec
    is shown: it may be any file of this machine.

    Args:
        path: the file.
        base_dir: the folder of the spec; by default that of the file.
    """
    home = path.parent if base_dir is None else base_dir
    try:
        text = read_text(path, max_bytes=_MAX_FILE_BYTES, folders=(path.parent, home))
    except FileNotFoundError:
        return ParameterFile(missing=True, problem="does not exist")
    except OutsideFolderError as error:
        problem = f"cannot be read: {error.strerror}; copy the file there instead"
        return ParameterFile(problem=problem)
    except OSError as error:
        return ParameterFile(problem=f"cannot be read: {error.strerror or error}")
    try:
        document = load_values(text, max_depth=_MAX_DEPTH, max_expanded=_MAX_VALUES)
    except RefusedYamlError as error:
        return ParameterFile(problem=f"cannot be used: {error}")
    except yaml.YAMLError as error:
        place = getattr(error, "problem_mark", None)
        where = f" in line {place.line + 1}" if place is not None else ""
        return ParameterFile(problem=f"is not YAML{where}")
    if not isinstance(document, dict):
        return ParameterFile(problem="is not a map of nodes")
    try:
        return ParameterFile(tuple(_nodes(document, "", 0, _Budget())))
    except ValueError as error:
        inside = real_path(path.parent).is_relative_to(real_path(home))
        return ParameterFile(problem=str(error) if inside else _OUTSIDE_PROBLEM)


class _Budget:
    """A limit on the number of values."""

    def __init__(self) -> None:
        self._left = _MAX_VALUES

    def spend(self) -> None:
        """Count one more value.

        Raises:
            ValueError: there are too many.
        """
        self._left -= 1
        if self._left < 0:
            raise ValueError(f"expands to more than {_MAX_VALUES:,} values")


def _nodes(
    document: Mapping[Any, Any], above: str, depth: int, budget: _Budget
) -> Iterator[tuple[str, Mapping[str, ParameterValue]]]:
    for key, value in document.items():
        budget.spend()
        name = f"{above}/{str(key).strip('/')}"
        if not isinstance(value, dict) or depth > _MAX_DEPTH:
            raise ValueError(f"has no '{_PARAMETERS_KEY}' below {str(key)!r}")
        if _PARAMETERS_KEY in value:
            given = value[_PARAMETERS_KEY]
            if not isinstance(given, dict | None):
                raise ValueError(f"has a '{_PARAMETERS_KEY}' of {str(key)!r} that is not a map")
            yield name, dict(_flatten(given or {}, "", 0, budget))
        elif value:
            yield from _nodes(value, name, depth + 1, budget)


def _flatten(
    given: Mapping[Any, Any], above: str, depth: int, budget: _Budget
) -> Iterator[tuple[str, Any]]:
    for key, value in given.items():
        budget.spend()
        name = f"{above}{key}"
        if isinstance(value, dict) and depth <= _MAX_DEPTH:
            yield from _flatten(value, f"{name}.", depth + 1, budget)
        elif isinstance(value, bool | int | float | str | list):
            yield name, value


def node_key_matches(key: str, full_name: str) -> bool:
    """Whether a node key of a `ParameterFile` matches a full node name."""
    pattern = re.escape(key).replace(r"/\*\*", "(/[^/]+)*").replace(r"\*", "[^/]+")
    return re.fullmatch(pattern, full_name) is not None


def merged_parameters(
    node: Node, full_name: str, files: Mapping[str, ParameterFile]
) -> dict[str, ParameterValue]:
    """The parameters of a node: files and values merged in the order in which they apply.

    Args:
        node: the node in the spec.
        full_name: its resolved name.
        files: the parameter files by their paths in the spec; missing files are skipped.
    """
    if not node.parameter_sources:
        return dict(node.parameters)
    found: dict[str, ParameterValue] = {}
    for source in node.parameter_sources:
        if source.file and source.file in files:
            for key, values in files[source.file].nodes:
                if node_key_matches(key, full_name):
                    found |= values
        found |= source.values
    return found
