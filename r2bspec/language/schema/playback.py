"""`playback`: how the buffered messages are played."""

from __future__ import annotations

from r2bspec.language.quantities import Duration, Share
from r2bspec.language.schema import name_patterns
from r2bspec.language.schema.qos import qos
from r2bspec.language.schema.schema_builder import (
    Schema,
    boolean,
    choice,
    integer,
    name_map,
    quantity,
    record,
    text,
)

_PAIRING_KEYS = {
    "slop": quantity(
        Duration,
        "The largest difference between stamps of messages of one step; 0 s for equal stamps.",
        default="0 s",
        examples=["10 ms"],
    )
}

_INPUT = record(
    "A topic that is played to the graph.",
    {
        "from": text(
            "The loaded or preprocessed topic that provides the messages.",
            form=name_patterns.TOPIC,
            examples=["buffer/image"],
        ),
        "format": text(
            "The type of its messages.",
            form=name_patterns.MESSAGE_TYPE,
            examples=["sensor_msgs/msg/Image"],
        ),
        "qos": qos("The QoS profile of the player's publisher.", default={}),
        "timestamp": choice(
            "header writes the time of playing into the header of each message; none leaves "
            "messages as recorded.",
            ["header", "none"],
            "header",
        ),
        "pairing": record(
            "Which messages of this input belong to a step; the default is 'playback.pairing'.",
            _PAIRING_KEYS,
            examples=[{"slop": "10 ms"}],
        ),
        "rate": choice(
            "step plays one message in each step; recorded plays what was recorded between two "
            "steps between them, for an input with another rate, such as an IMU.",
            ["step", "recorded"],
            "step",
        ),
    },
    required=["from", "format"],
    examples=[{"from": "buffer/image", "format": "sensor_msgs/msg/Image"}],
)

PLAYBACK: Schema = record(
    "How the buffered messages are played to the graph.",
    {
        "mode": choice(
            "looping repeats the buffered messages at the offered rate; sweeping plays them "
            "forwards and backwards in turn; timeline plays them at the recorded times; live plays "
            "nothing, for graphs with a source of their own.",
            ["timeline", "looping", "sweeping", "live"],
            "looping",
        ),
        "buffer": integer(
            "The number of messages to buffer for each input; 0 buffers all of the window.",
            minimum=0,
            default=0,
            examples=[30, 0],
        ),
        "inputs": name_map(
            "The topics that are played to the graph. All inputs of one step are played together, "
            "with the same stamp unless 'pairing' allows differences.",
            name_patterns.TOPIC,
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
        "unpaired": choice(
            "Messages without a partner of the same stamp in all other inputs are not played. With "
            "mode timeline, those whose stamp no recorded message has are not. "
            "refuse warns above 5 % of the messages of an input, and stops above 50 %; drop agrees "
            "to any number.",
            ["refuse", "drop"],
            "refuse",
        ),
        "timeline": record(
            "With mode timeline: how recorded times are converted to times of playing.",
            {
                "speed": quantity(
                    Share,
                    "The speed of playing relative to the recording.",
                    default="100 %",
                    examples=["50 %", "200 %"],
                    positive=True,
                ),
                "translations": name_map(
                    "Delays of inputs: how much later than recorded they are played and stamped.",
                    name_patterns.TOPIC,
                    quantity(Duration, "The delay of one input.", examples=["20 ms"]),
                    topics=True,
                    examples=[{"image": "20 ms"}],
                ),
            },
            examples=[{"speed": "50 %"}],
            default={},
        ),
        "record_timeline": boolean(
            "Whether the timeline follows the times at which the preprocessors published the "
            "messages, instead of the recorded times.",
            default=False,
        ),
        "tf": choice(
            "Whether stamps in /tf are shifted like those of other messages, or kept.",
            ["shift", "keep"],
            "shift",
        ),
        "pairing": record(
            "Which messages of several inputs are one step. Differences of stamps within a step "
            "stay as recorded.",
            _PAIRING_KEYS,
            default={},
            examples=[{"slop": "10 ms"}],
        ),
        "clock": boolean(
            "Whether the system time is published on /clock, 100 times per second, for nodes with "
            "'use_sim_time'. The stamps of played messages are of the same clock.",
            default=False,
        ),
    },
    unless_live=["inputs"],
    examples=[
        {
            "mode": "looping",
            "buffer": 30,
            "inputs": {"image": {"from": "buffer/image", "format": "sensor_msgs/msg/Image"}},
        }
    ],
)
