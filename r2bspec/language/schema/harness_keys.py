"""`harness` and `transport`: where player and monitors run, and how messages are transported."""

from __future__ import annotations

from r2bspec.language.quantities import Size
from r2bspec.language.schema import name_patterns
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
_PLACEMENTS = ["separate", "shared", "graph"]

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


HARNESS: Schema = or_words(
    record(
        "Where the player and the monitors run.",
        {
            "placement": choice(
                "Whether the player and the monitors run in separate processes, share one, or run "
                "in the processes of the graph: the player in the one that reads the inputs, each "
                "monitor in the one that publishes its topic.",
                _PLACEMENTS,
                "separate",
            ),
            "in": text(
                "With placement graph, and if several processes read the inputs, or it is unknown "
                "which one does: the node or the process that gets the player. NODE/PROGRAM is the "
                "program or node of this name that a launch file starts.",
                form=name_patterns.PLACE,
                examples=["detector", "stack/detector"],
            ),
        },
        examples=[{"placement": "graph", "in": "detector"}],
        default={},
    ),
    _PLACEMENTS,
    ["graph"],
)
