"""`harness` and `transport`: what plays and monitors, and how messages are transported."""

from __future__ import annotations

from r2bspec.language.quantities import Size
from r2bspec.language.schema import name_patterns
from r2bspec.language.schema.parameters import values
from r2bspec.language.schema.schema_builder import (
    Schema,
    choice,
    loader_key,
    or_words,
    quantity,
    record,
    text,
)

_KINDS = ["inherit", "shared_memory", "udp"]

TRANSPORT: Schema = or_words(
    record(
        "How messages are transported: shared_memory with segments for the largest message, udp, "
        "or inherit for the settings of the environment. A map can also set the size.",
        {
            "kind": choice("How messages are transported.", _KINDS, "shared_memory"),
            "segment": loader_key(
                quantity(
                    Size,
                    "The size of the shared memory segment of each process; default: computed from "
                    "the largest message.",
                    examples=["64 MiB"],
                    positive=True,
                )
            ),
        },
        examples=[{"kind": "shared_memory", "segment": "64 MiB"}],
        default="shared_memory",
    ),
    _KINDS,
    ["shared_memory"],
)


def _plugin(what: str, example: str) -> Schema:
    return record(
        f"With ros2_benchmark: the component that {what}, instead of its default.",
        {
            "package": text(
                "The ROS package of the component.",
                form=name_patterns.PACKAGE,
                examples=["ros2_benchmark"],
            ),
            "plugin": text(
                "The class of the component.", form=name_patterns.PLUGIN, examples=[example]
            ),
            "parameters": values("Parameters of the component."),
        },
        required=["package", "plugin"],
        examples=[{"package": "ros2_benchmark", "plugin": example}],
    )


HARNESS: Schema = or_words(
    record(
        "What plays and monitors: r2bspec itself, or the C++ nodes of ros2_benchmark if they are "
        "installed.",
        {
            "kind": choice("The harness.", ["r2bspec", "ros2_benchmark"], "r2bspec"),
            "placement": choice(
                "Whether the player and the monitors run in separate processes or share one.",
                ["separate", "shared"],
                "separate",
            ),
            "data_loader": _plugin("loads the data", "ros2_benchmark::DataLoaderNode"),
            "playback": _plugin("plays the messages", "ros2_benchmark::PlaybackNode"),
            "monitor": _plugin("monitors a topic", "ros2_benchmark::MonitorNode"),
        },
        examples=[{"kind": "ros2_benchmark"}],
        default={},
    ),
    ["r2bspec"],
    ["r2bspec"],
)
