"""The ROS type that a value of the language has as a parameter."""

from __future__ import annotations

from r2bspec.spec.model import ParameterValue
from r2bspec.wiring.interfaces import ParameterType

# bool comes before int, of which it is a kind in Python.
_TYPES: tuple[tuple[type, ParameterType, ParameterType], ...] = (
    (bool, "bool", "bool_array"),
    (int, "integer", "integer_array"),
    (float, "double", "double_array"),
    (str, "string", "string_array"),
)


def parameter_type(value: ParameterValue) -> ParameterType | None:
    """The type of a parameter, or None for a list that is empty or of different types."""
    if not isinstance(value, list):
        return next(name for kind, name, _ in _TYPES if isinstance(value, kind))
    types = {parameter_type(item) if not isinstance(item, list) else None for item in value}
    only = next(iter(types)) if len(types) == 1 else None
    return next((array for _, name, array in _TYPES if name == only), None)
