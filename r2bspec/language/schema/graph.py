"""`graph` and `monitors`: what is under test, and what is watched."""

from __future__ import annotations

from r2bspec.language.schema import name_patterns
from r2bspec.language.schema.node import nodes
from r2bspec.language.schema.parameters import values
from r2bspec.language.schema.qos import qos
from r2bspec.language.schema.reuse import repeat, sibling
from r2bspec.language.schema.schema_builder import (
    Schema,
    array,
    boolean,
    choice,
    integer,
    name_map,
    record,
    text,
)

GRAPH: Schema = record(
    "The graph under test.",
    {
        "placement": choice(
            "Where nodes run that name no container: separate gives each a process of its own; "
            "shared puts those of one kind into one; harness puts them beside the harness.",
            ["separate", "shared", "harness"],
            "separate",
        ),
        "nodes": nodes("The nodes under test, by name."),
    },
    required=["nodes"],
    examples=[{"nodes": {"apriltag": {"python": "r2bspec.nodes.AprilTagNode"}}}],
)

MONITORS: Schema = name_map(
    "The topics that are watched, by a name that requirements use.",
    name_patterns.MONITOR_NAME,
    record(
        "A watched topic.",
        {
            "extends": sibling("monitor"),
            "repeat": repeat("monitor"),
            "topic": text(
                "The topic to watch.", form=name_patterns.TOPIC, examples=["tag_detections", "/tf"]
            ),
            "format": text(
                "The type of its messages.",
                form=name_patterns.MESSAGE_TYPE,
                examples=["geometry_msgs/msg/PoseArray"],
            ),
            "match": choice(
                "How a message finds the input that it answers: by the stamp of its header, or "
                "by order for types that have none.",
                ["stamp", "order"],
                "stamp",
            ),
            "answers": array(
                "With mode timeline and inputs of different rates: the inputs that its messages "
                "answer. Only steps that have messages of all of them count for it; without this, "
                "all inputs from which a way leads to it.",
                text("A playback input.", form=name_patterns.TOPIC, examples=["image"]),
                examples=[["image"]],
            ),
            "ratio": record(
                "How many outputs answer how many inputs.",
                {
                    "inputs": integer("So many inputs.", minimum=1, default=1, examples=[2]),
                    "outputs": integer("So many outputs.", minimum=1, default=1, examples=[3]),
                },
                examples=[{"inputs": 2}],
                default={},
            ),
            "qos": qos("The profile with which the monitor reads; else what the writer offers."),
            "label": text("What reports call it.", examples=["Tag detections"]),
            "taps": boolean(
                "Whether the topics on the way to it are watched, too, so that the report shows "
                "where time goes. It costs some of it.",
                default=False,
            ),
            "parameters": values("Parameters of the component that watches, where there is one."),
        },
        required=["topic", "format"],
        examples=[{"topic": "tag_detections", "format": "geometry_msgs/msg/PoseArray"}],
    ),
    at_least=1,
    examples=[{"detections": {"topic": "tag_detections", "format": "geometry_msgs/msg/PoseArray"}}],
    snippets=[
        {
            "label": "a monitor",
            "body": {"${1:name}": {"topic": "${2:topic}", "format": "${3:sensor_msgs/msg/Image}"}},
        }
    ],
)
