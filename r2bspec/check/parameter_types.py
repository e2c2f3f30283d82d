"""The ROS types of parameter values, and where the spec sets parameters."""

from __future__ import annotations

from collections.abc import Iterator

import msgspec

from r2bspec.check.check_context import Context
from r2bspec.diagnostics.diagnostic import Path
from r2bspec.language.located_tree import ListNode
from r2bspec.language.spec import ParameterValue
from r2bspec.wiring.node_interface import ParameterType
from r2bspec.wiring.parameter_files import ParameterFile
from r2bspec.wiring.wiring import NodeWiring

# bool comes before int, because it is a subclass of int.
_TYPES: tuple[tuple[type, ParameterType, ParameterType], ...] = (
    (bool, "bool", "bool_array"),
    (int, "integer", "integer_array"),
    (float, "double", "double_array"),
    (str, "string", "string_array"),
)


def parameter_type(value: ParameterValue) -> ParameterType | None:
    """The ROS type of a value; None for a list that is empty or of different types."""
    if not isinstance(value, list):
        return next(name for kind, name, _ in _TYPES if isinstance(value, kind))
    types = {parameter_type(item) if not isinstance(item, list) else None for item in value}
    only = next(iter(types)) if len(types) == 1 else None
    return next((array for _, name, array in _TYPES if name == only), None)


class ParameterOverride(msgspec.Struct, frozen=True):
    """A parameter that the spec or a parameter file sets.

    Attributes:
        path: the value in the spec, or the reference to the parameter file.
        file: the parameter file; empty if the spec sets the parameter.
    """

    name: str
    value: ParameterValue
    path: Path
    file: str = ""


def parameter_overrides(context: Context, node: NodeWiring) -> Iterator[ParameterOverride]:
    """The effective parameters of a node, each with the place that sets it."""
    files = [
        context.companion_files.parameter_files.get(source.file, ParameterFile()).names
        for source in node.node.parameter_sources
    ]
    for name, value in node.parameters.items():
        path = context.parameter_path(node, name)
        if path is not None and name in node.node.parameters:
            yield ParameterOverride(name, value, path)
            continue
        for index, source in enumerate(node.node.parameter_sources):
            if name in files[index]:
                place: Path = (*node.path, "parameters")
                listed = isinstance(context.value_at(place), ListNode)
                path = (*place, index) if listed else place
                yield ParameterOverride(name, value, path, source.file)
                break


def parameter_file_paths(context: Context, node: NodeWiring) -> Iterator[tuple[Path, str]]:
    """The parameter files of a node, each with its path in the spec."""
    place: Path = (*node.path, "parameters")
    listed = isinstance(context.value_at(place), ListNode)
    for index, source in enumerate(node.node.parameter_sources):
        if source.file:
            yield ((*place, index) if listed else place), source.file
