"""`graph` and `monitors`: what is under test, and what is watched."""

from __future__ import annotations

from r2bspec.spec.schema import names
from r2bspec.spec.schema.build import Schema, choice, named, record, text
from r2bspec.spec.schema.node import nodes
from r2bspec.spec.schema.playback import qos

GRAPH: Schema = record(
    "The graph under test.",
    {
        "placement": choice(
            "separate gives each Python node a process of its own; shared puts all of them into "
            "one.",
            ["separate", "shared"],
            "separate",
        ),
        "nodes": nodes("The nodes under test, by name."),
    },
    required=["nodes"],
    examples=[{"nodes": {"apriltag": {"python": "r2bspec.nodes.AprilTagNode"}}}],
)

MONITORS: Schema = named(
    "The topics that are watched, by a name that requirements use.",
    names.MONITOR_NAME,
    record(
        "A watched topic.",
        {
            "topic": text(
                "The topic to watch.", form=names.TOPIC, examples=["tag_detections", "/tf"]
            ),
            "format": text(
                "The type of its messages.",
                form=names.MESSAGE_TYPE,
                examples=["geometry_msgs/msg/PoseArray"],
            ),
            "match": choice(
                "How a message finds the input that it answers: by the stamp of its header, or "
                "by order for types that have none.",
                ["stamp", "order"],
                "stamp",
            ),
            "qos": qos("The profile with which the monitor reads; else what the writer offers."),
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
