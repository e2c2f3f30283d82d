"""A node, of the graph or of the preprocessors.

The schema is flat: which kinds of node exclude each other is a rule of its own
(`r2bspec.language.key_constraints.entry_keys`), because ``oneOf`` ruins both messages and
completion.
"""

from __future__ import annotations

from r2bspec.language.node_kinds import NODE_KIND_KEYS, NODE_KINDS, kinds_text
from r2bspec.language.schema import name_patterns
from r2bspec.language.schema.parameters import PARAMETERS
from r2bspec.language.schema.process import ENV, RESOURCES
from r2bspec.language.schema.qos import qos
from r2bspec.language.schema.reuse import repeat, sibling
from r2bspec.language.schema.schema_builder import (
    Schema,
    array,
    name_map,
    record,
    text,
)

_TYPE = text(
    "The message type, as ros2 topic list -t shows it.",
    form=name_patterns.MESSAGE_TYPE,
    examples=["sensor_msgs/msg/Image"],
)

NODE: Schema = record(
    f"A node: exactly one of {kinds_text()}.",
    {
        "extends": sibling("node"),
        "repeat": repeat("node"),
        "description": text("What it does.", examples=["Finds tags in the left image."]),
        **NODE_KIND_KEYS,
        "container": text(
            "The container in which the node runs; else graph.placement says where.",
            form=name_patterns.NODE_NAME,
            examples=["vision"],
        ),
        "arguments": array(
            "Further words of the command line of an executable.",
            text("A word of the command line.", examples=["--fast"]),
            examples=[["--fast"]],
        ),
        "namespace": text(
            "The node's namespace; a relative one lies in the namespace of the benchmark.",
            form=name_patterns.NAMESPACE,
            examples=["left"],
        ),
        "parameters": PARAMETERS,
        "remappings": name_map(
            "Topics as the node's code names them, and the topics that are meant.",
            name_patterns.TOPIC,
            text("The topic that is meant.", form=name_patterns.TOPIC, examples=["tag_detections"]),
            topics=True,
            examples=[{"image": "camera/image_raw"}],
        ),
        "publishes": name_map(
            "What the node is known to publish: topic, as its code names it, and type. It lets "
            "validate check the wiring of a node that it cannot look into.",
            name_patterns.TOPIC,
            _TYPE,
            topics=True,
            examples=[{"detections": "geometry_msgs/msg/PoseArray"}],
        ),
        "subscribes": name_map(
            "What the node is known to read: topic, as its code names it, and type.",
            name_patterns.TOPIC,
            _TYPE,
            topics=True,
            examples=[{"image": "sensor_msgs/msg/Image"}],
        ),
        "qos": name_map(
            "What is known of the profiles of its topics, as its code names them.",
            name_patterns.TOPIC,
            qos("The profile of the topic."),
            topics=True,
            examples=[{"image": "sensor_data"}],
        ),
        "env": ENV,
        **RESOURCES,
    },
    examples=[{"python": "r2bspec.nodes.RelayNode", "remappings": {"input": "image"}}],
    snippets=[
        dict(each.snippet)
        for each in sorted(NODE_KINDS, key=lambda kind: kind.suggested)
        if each.snippet
    ],
)


def nodes(description: str) -> Schema:
    """A map of nodes by their names."""
    return name_map(
        description,
        name_patterns.NODE_NAME,
        NODE,
        examples=[{"resize": {"python": "r2bspec.nodes.ResizeNode"}}],
        snippets=[
            {
                "label": "a node",
                "body": {
                    "${1:name}": {
                        "python": "${2:module.Class}",
                        "remappings": {"${3:topic}": "${4:topic}"},
                    }
                },
            }
        ],
    )
