"""`playback`: how the buffered messages are played; and quality of service."""

from __future__ import annotations

from r2bspec.spec.schema import names
from r2bspec.spec.schema.build import Schema, choice, integer, named, record, text


def qos(description: str, *, default: object = None) -> Schema:
    """A quality-of-service profile."""
    return record(
        description,
        {
            "reliability": choice(
                "Whether lost messages are sent again. A reliable reader gets nothing from a "
                "best-effort writer.",
                ["reliable", "best_effort"],
                "reliable",
            ),
            "durability": choice(
                "Whether a late reader gets the last messages, too.",
                ["volatile", "transient_local"],
                "volatile",
            ),
            "history": choice(
                "Whether only the last 'depth' messages are kept.",
                ["keep_last", "keep_all"],
                "keep_last",
            ),
            "depth": integer(
                "How many messages are kept with keep_last.", minimum=1, default=10, examples=[10]
            ),
        },
        examples=[{"reliability": "best_effort", "depth": 5}],
        default=default,
        snippets=[{"label": "sensor data", "body": {"reliability": "best_effort", "depth": 5}}],
    )


_INPUT = record(
    "A topic that the graph reads.",
    {
        "from": text(
            "The topic on which its messages were loaded or preprocessed.",
            form=names.TOPIC,
            examples=["buffer/image"],
        ),
        "format": text(
            "The type of its messages.", form=names.MESSAGE_TYPE, examples=["sensor_msgs/msg/Image"]
        ),
        "qos": qos("The profile with which the player offers the topic.", default={}),
    },
    required=["from", "format"],
    examples=[{"from": "buffer/image", "format": "sensor_msgs/msg/Image"}],
)

PLAYBACK: Schema = record(
    "How the buffered messages are played to the graph.",
    {
        "mode": choice(
            "looping plays the buffered messages again and again at the asked rate.",
            ["looping"],
            "looping",
        ),
        "buffer": integer(
            "How many messages of each input are kept; 0 keeps all that the window holds.",
            minimum=0,
            default=0,
            examples=[30, 0],
        ),
        "inputs": named(
            "The topics that the graph reads. All inputs of one step are played together, with "
            "the same stamp.",
            names.TOPIC,
            _INPUT,
            topics=True,
            at_least=1,
            examples=[{"image": {"from": "buffer/image", "format": "sensor_msgs/msg/Image"}}],
            snippets=[
                {
                    "label": "an input",
                    "body": {
                        "${1:topic}": {
                            "from": "buffer/${1:topic}",
                            "format": "${2:sensor_msgs/msg/Image}",
                        }
                    },
                }
            ],
        ),
    },
    required=["inputs"],
    examples=[
        {
            "mode": "looping",
            "buffer": 30,
            "inputs": {"image": {"from": "buffer/image", "format": "sensor_msgs/msg/Image"}},
        }
    ],
)
