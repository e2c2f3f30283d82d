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

_INPUT = record(
    "A topic that the graph reads.",
    {
        "from": text(
            "The topic on which its messages were loaded or preprocessed.",
            form=name_patterns.TOPIC,
            examples=["buffer/image"],
        ),
        "format": text(
            "The type of its messages.",
            form=name_patterns.MESSAGE_TYPE,
            examples=["sensor_msgs/msg/Image"],
        ),
        "qos": qos("The profile with which the player offers the topic.", default={}),
        "timestamp": choice(
            "header writes the time of play into the header of each message; none leaves the "
            "message as it was recorded.",
            ["header", "none"],
            "header",
        ),
    },
    required=["from", "format"],
    examples=[{"from": "buffer/image", "format": "sensor_msgs/msg/Image"}],
)

PLAYBACK: Schema = record(
    "How the buffered messages are played to the graph.",
    {
        "mode": choice(
            "looping plays the buffered messages again and again at the asked rate, sweeping "
            "forwards and backwards by turns, timeline in the time in which they were recorded; "
            "live plays nothing, for graphs that have a source of their own.",
            ["timeline", "looping", "sweeping", "live"],
            "looping",
        ),
        "buffer": integer(
            "How many messages of each input are kept; 0 keeps all that the window holds.",
            minimum=0,
            default=0,
            examples=[30, 0],
        ),
        "inputs": name_map(
            "The topics that the graph reads. All inputs of one step are played together, with "
            "the same stamp.",
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
        "timeline": record(
            "With mode timeline: how recorded time becomes time of play.",
            {
                "speed": quantity(
                    Share,
                    "The speed of play, relative to the recording.",
                    default="100 %",
                    examples=["50 %", "200 %"],
                    positive=True,
                ),
                "translations": name_map(
                    "By how much an input is played, and stamped, later than it was recorded.",
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
            "Whether the timeline is that of the messages as they came out of the preprocessors, "
            "instead of that of the recording.",
            default=False,
        ),
        "tf": choice(
            "Whether stamps inside /tf are shifted like all others, or kept.",
            ["shift", "keep"],
            "shift",
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
