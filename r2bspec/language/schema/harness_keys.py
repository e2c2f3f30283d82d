"""`harness` and `transport`: who plays and watches, and how messages travel."""

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
        "How messages travel: shared_memory sized to the largest message, udp, or inherit for "
        "what the environment says. As a map it can also set the size.",
        {
            "kind": choice("How messages travel.", _KINDS, "shared_memory"),
            "segment": loader_key(
                quantity(
                    Size,
                    "The size of each writer's shared memory; without it, it follows from the "
                    "largest message.",
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
        f"With ros2_benchmark: the component that {what}, in place of its own.",
        {
            "package": text(
                "The ROS package that holds the component.",
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
        "Who plays and watches: r2bspec itself, or the C++ nodes of ros2_benchmark where they are "
        "installed.",
        {
            "kind": choice("Whose harness it is.", ["r2bspec", "ros2_benchmark"], "r2bspec"),
            "placement": choice(
                "Whether player and monitors have a process each, or share one.",
                ["separate", "shared"],
                "separate",
            ),
            "data_loader": _plugin("loads the data", "ros2_benchmark::DataLoaderNode"),
            "playback": _plugin("plays the messages", "ros2_benchmark::PlaybackNode"),
            "monitor": _plugin("watches a topic", "ros2_benchmark::MonitorNode"),
        },
        examples=[{"kind": "ros2_benchmark"}],
        default={},
    ),
    ["r2bspec"],
    ["r2bspec"],
)
