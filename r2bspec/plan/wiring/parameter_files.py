"""ROS parameter files: the values that a node gets from them.

Grammar, as rcl reads it::

    file       = { node key : ( file | { "ros__parameters": parameters } ) }
    parameters = { name : ( value | parameters ) }

Nested node keys are joined by ``/`` and nested parameter names by ``.``. A key is the full name of
a node; without a leading ``/`` it is in the root namespace, so `relay` is not ``/r2b/relay``. ``*``
matches one token of a name, ``**`` any number. If several keys match a node, later ones have
precedence.

A file without any ``ros__parameters`` is flat: launch_ros gives all of it to a component.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

import msgspec
import yaml

from r2bspec.language.spec import Node, ParameterValue
from r2bspec.safe_io import limits
from r2bspec.safe_io.line_pattern import LinePattern, PatternError, compile_line_pattern
from r2bspec.safe_io.safe_file import OutsideFolderError, read_text, real_path
from r2bspec.safe_io.safe_yaml import RefusedYamlError, load_values

_PARAMETERS_KEY = "ros__parameters"
_OUTSIDE_PROBLEM = f"is no parameter file: each node needs a map '{_PARAMETERS_KEY}'"


class ParameterFile(msgspec.Struct, frozen=True):
    """The content of a parameter file, or why it cannot be used.

    Attributes:
        nodes: each full node key with its parameters, in the order of the file.
        flat: whether it names no node, so that only a component can have it.
        missing: whether the file does not exist.
        problem: why the file cannot be used; empty if it can.
    """

    nodes: tuple[tuple[str, Mapping[str, ParameterValue]], ...] = ()
    flat: bool = False
    missing: bool = False
    problem: str = ""

    def matching(self, full_name: str) -> list[Mapping[str, ParameterValue]]:
        """Return the parameters of every key that matches a full node name, in file order."""
        return [values for key, values in self.nodes if node_key_matches(key, full_name)]


def read_parameter_file(path: Path, base_dir: Path | None = None) -> ParameterFile:
    """Read a parameter file; problems are in the result.

    A path may lead anywhere, because it is visible in the spec, but a link may not lead out of its
    folder or that of the spec. No text of a file outside of the folder of the spec is shown: it may
    be any file of this machine.

    Args:
        path: the file.
        base_dir: the folder of the spec; by default that of the file.
    """
    home = path.parent if base_dir is None else base_dir
    try:
        text = read_text(path, max_bytes=limits.MAX_COMPANION_BYTES, folders=(path.parent, home))
    except FileNotFoundError:
        return ParameterFile(missing=True, problem="does not exist")
    except OutsideFolderError as error:
        problem = f"cannot be read: {error.strerror}; copy the file there instead"
        return ParameterFile(problem=problem)
    except OSError as error:
        return ParameterFile(problem=f"cannot be read: {error.strerror or error}")
    try:
        document = load_values(
            text,
            max_depth=limits.MAX_COMPANION_DEPTH,
            max_expanded=limits.MAX_PARAMETERS,
            max_values=limits.MAX_COMPANION_VALUES,
        )
    except RefusedYamlError as error:
        return ParameterFile(problem=f"cannot be used: {error}")
    except yaml.YAMLError as error:
        place = getattr(error, "problem_mark", None)
        where = f" in line {place.line + 1}" if place is not None else ""
        return ParameterFile(problem=f"is not YAML{where}")
    if not isinstance(document, dict):
        return ParameterFile(problem="is not a map of nodes")
    if document and not any(_has_nodes(value) for value in document.values()):
        return ParameterFile((("/**", dict(_flatten(document))),), flat=True)
    try:
        return ParameterFile(tuple(_nodes(document)))
    except ValueError as error:
        inside = real_path(path.parent).is_relative_to(real_path(home))
        return ParameterFile(problem=str(error) if inside else _OUTSIDE_PROBLEM)


def _nodes(
    document: Mapping[Any, Any], above: str = ""
) -> Iterator[tuple[str, Mapping[str, ParameterValue]]]:
    for key, value in document.items():
        name = f"{above}/{str(key).strip('/')}"
        if not isinstance(value, dict):
            raise ValueError(f"has no '{_PARAMETERS_KEY}' below {str(key)!r}")
        if _PARAMETERS_KEY in value:
            given = value[_PARAMETERS_KEY]
            if not isinstance(given, dict | None):
                raise ValueError(f"has a '{_PARAMETERS_KEY}' of {str(key)!r} that is not a map")
            yield name, dict(_flatten(given or {}))
        else:
            yield from _nodes(value, name)


def _has_nodes(value: Any) -> bool:
    return isinstance(value, dict) and (
        _PARAMETERS_KEY in value or any(map(_has_nodes, value.values()))
    )


def _flatten(given: Mapping[Any, Any], above: str = "") -> Iterator[tuple[str, Any]]:
    for key, value in given.items():
        if isinstance(value, dict):
            yield from _flatten(value, f"{above}{key}.")
        elif isinstance(value, bool | int | float | str | list):
            yield f"{above}{key}", value


@lru_cache(maxsize=1000)
def _key_pattern(key: str) -> LinePattern:
    """Return whether a full node name matches a key with wildcards, in time linear in the name."""
    tokens = (
        "(?:/[^/]*)*" if part == "**" else "/" + "[^/]+".join(map(re.escape, part.split("*")))
        for part in key.split("/")[1:]
    )
    try:
        return compile_line_pattern(f"^{''.join(tokens)}$")
    except PatternError:
        # What is too large to be compiled is no name.
        return lambda _: False


def node_key_matches(key: str, full_name: str) -> bool:
    """Return True if a node key of a `ParameterFile` matches a full node name.

    ``*`` is one character or more of a token, and ``**`` any number of tokens.
    """
    return _key_pattern(key)(full_name) if "*" in key else key == full_name


def merged_parameters(
    node: Node, full_name: str, files: Mapping[str, ParameterFile]
) -> dict[str, ParameterValue]:
    """Return the parameters of a node: files and values merged in the order in which they apply.

    Args:
        node: the node in the spec.
        full_name: its resolved name.
        files: the parameter files by their paths in the spec; missing files are skipped.
    """
    if not node.parameter_sources:
        return dict(node.parameters)
    merged: dict[str, ParameterValue] = {}
    for source in node.parameter_sources:
        if source.file and source.file in files:
            for values in files[source.file].matching(full_name):
                merged |= values
        merged |= source.values
    return merged
