"""`harness` and `transport`: where player and monitors run, and how messages are transported."""

from __future__ import annotations

from r2bspec.language.quantities import Size
from r2bspec.language.schema.schema_builder import (
    Schema,
    choice,
    loader_key,
    or_words,
    quantity,
    record,
)

_KINDS = ["inherit", "shared_memory", "udp"]
_PLACEMENTS = ["separate", "shared"]

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
                "Whether the player and the monitors run in separate processes or share one.",
                _PLACEMENTS,
                "separate",
            ),
        },
        examples=[{"placement": "shared"}],
        default={},
    ),
    _PLACEMENTS,
    ["shared"],
)
