"""`graph` and `monitors`: the nodes under test, and the monitored topics."""

from __future__ import annotations

from r2bspec.language.schema import name_patterns
from r2bspec.language.schema.node import nodes
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
            "The processes of nodes without a container: separate runs each node in its own "
            "process, shared runs nodes of the same kind in one process, harness runs them in the "
            "process of the harness.",
            ["separate", "shared", "harness"],
            "separate",
        ),
        "nodes": nodes("The nodes under test, by name."),
    },
    required=["nodes"],
    examples=[{"nodes": {"apriltag": {"python": "r2bspec.nodes.AprilTagNode"}}}],
)

MONITORS: Schema = name_map(
    "The monitored topics, by the names that requirements use.",
    name_patterns.MONITOR_NAME,
    record(
        "A monitored topic.",
        {
            "extends": sibling("monitor"),
            "repeat": repeat("monitor"),
            "topic": text(
                "The topic to monitor.",
                form=name_patterns.TOPIC,
                examples=["tag_detections", "/tf"],
            ),
            "format": text(
                "The type of its messages.",
                form=name_patterns.MESSAGE_TYPE,
                examples=["geometry_msgs/msg/PoseArray"],
            ),
            "match": choice(
                "How outputs are matched to inputs: by the stamp in the header, or by order for "
                "types without a header.",
                ["stamp", "order"],
                "stamp",
            ),
            "answers": array(
                "With mode timeline and inputs of different rates: the inputs that its messages "
                "answer. Only steps with messages of all these inputs count for it. Default: all "
                "inputs with a path to the topic.",
                text("A playback input.", form=name_patterns.TOPIC, examples=["image"]),
                examples=[["image"]],
            ),
            "ratio": record(
                "How many outputs answer how many inputs.",
                {
                    "inputs": integer("The number of inputs.", minimum=1, default=1, examples=[2]),
                    "outputs": integer(
                        "The number of outputs.", minimum=1, default=1, examples=[3]
                    ),
                },
                examples=[{"inputs": 2}],
                default={},
            ),
            "qos": qos(
                "The profile of the monitor's subscription; default: the profile that is offered."
            ),
            "label": text("What reports call it.", examples=["Tag detections"]),
            "taps": boolean(
                "Whether the topics on the path to it are monitored, too, so that reports show the "
                "latency of each hop. The additional subscriptions cost some time.",
                default=False,
            ),
            "in": text(
                "With 'harness: {placement: graph}': the node or the process that gets the "
                "monitor; default: the one that publishes the topic.",
                form=name_patterns.PLACE,
                examples=["detector"],
            ),
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
