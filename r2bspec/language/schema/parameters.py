"""ROS parameters: values, parameter files, or a list of both."""

from __future__ import annotations

from r2bspec.language.schema import name_patterns
from r2bspec.language.schema.schema_builder import (
    DEFERRABLE,
    PATH,
    SCALAR_TYPES,
    Schema,
    deferrable,
    name_map,
    scalar,
)


def values(description: str) -> Schema:
    """Parameters by name."""
    return name_map(
        description,
        name_patterns.PARAMETER,
        {
            "type": [*SCALAR_TYPES, "array"],
            "description": "A string, a number, a boolean, or a list of one of these.",
            "items": deferrable(scalar("An item of the list.", examples=[0.5, "left"])),
            DEFERRABLE: True,
            "examples": [1280, "36h11", [0.1, 0.2]],
        },
        examples=[{"width": 1280, "height": 720}],
    )


_VALUES = values("Parameters by name. Nested names are written with dots: camera.fx.")

PARAMETERS: Schema = {
    **_VALUES,
    "type": ["object", "string", "array"],
    "description": "ROS parameters of the node: a map, the path of a parameter file relative to "
    "this file, or a list of both, in which later items have precedence. Nested names are written "
    "with dots: camera.fx.",
    "minLength": 1,
    PATH: True,
    "items": {
        **{key: value for key, value in _VALUES.items() if key != "default"},
        "type": ["object", "string"],
        "description": "Parameters by name, or the path of a parameter file.",
        "minLength": 1,
        PATH: True,
        "examples": ["./camera.yaml", {"width": 1280}],
    },
    "examples": [
        {"width": 1280, "height": 720},
        "./camera.yaml",
        ["./camera.yaml", {"width": 1280}],
    ],
    "defaultSnippets": [
        {"label": "values", "body": {"${1:name}": "$2"}},
        {"label": "a file and values", "body": ["./${1:parameters}.yaml", {"${2:name}": "$3"}]},
    ],
}
