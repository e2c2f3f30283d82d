"""`requires`: what the machine of a run must be."""

from __future__ import annotations

from r2bspec.language.schema import name_patterns
from r2bspec.language.schema.schema_builder import (
    Schema,
    boolean,
    integer,
    name_map,
    record,
    scalar,
    text,
)

REQUIRES: Schema = record(
    "What the machine of a run must be. A run is refused on any other one.",
    {
        "arch": text("The architecture, as uname -m prints it.", examples=["aarch64"]),
        "gpu": boolean("Whether the machine must have a GPU.", default=False),
        "cores": integer("The fewest CPUs.", minimum=0, default=0, examples=[4]),
        "ros_distro": text("The ROS distribution.", examples=["jazzy"]),
        "labels": name_map(
            "Labels that its owner gave the machine; values may be patterns.",
            name_patterns.LABEL_KEY,
            scalar("The value of the label.", examples=["carter"]),
            examples=[{"robot": "carter"}],
        ),
    },
    examples=[{"arch": "aarch64", "gpu": True}],
)
