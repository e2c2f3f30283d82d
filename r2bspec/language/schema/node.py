"""A node, of the graph or of the preprocessors.

The schema is flat: that the kinds of node exclude each other is checked separately
(`r2bspec.language.key_constraints.entry_keys`), because ``oneOf`` leads to poor messages and poor
completion.
"""

from __future__ import annotations

from r2bspec.language.node_kinds import NODE_KIND_KEYS, NODE_KINDS, kinds_text
from r2bspec.language.schema import name_patterns
from r2bspec.language.schema.parameters import PARAMETERS
from r2bspec.language.schema.process_keys import ENV, RESOURCES
from r2bspec.language.schema.qos import qos
from r2bspec.language.schema.reuse import repeat, sibling
from r2bspec.language.schema.schema_builder import (
    Schema,
    array,
    deferrable,
    name_map,
    record,
    text,
)

_TYPE = text(
    "The message type, as 'ros2 topic list -t' shows it.",
    form=name_patterns.MESSAGE_TYPE,
    examples=["sensor_msgs/msg/Image"],
)

NODE: Schema = record(
    f"A node: exactly one of {kinds_text()}.",
    {
        "extends": sibling("node"),
        "repeat": repeat("node"),
        "description": text("What the node does.", examples=["Finds tags in the left image."]),
        **NODE_KIND_KEYS,
        "container": text(
            "The container of the node; without one, graph.placement applies.",
            form=name_patterns.NODE_NAME,
            examples=["vision"],
        ),
        "arguments": array(
            "Arguments of an executable or a command.",
            deferrable(text("An argument.", examples=["--fast"])),
            examples=[["--fast"]],
        ),
        "namespace": text(
            "The namespace of the node; a relative one is in the namespace of the benchmark.",
            form=name_patterns.NAMESPACE,
            examples=["left"],
        ),
        "parameters": PARAMETERS,
        "remappings": name_map(
            "Remappings: the name in the code of the node, and the topic to use instead.",
            name_patterns.TOPIC,
            text("The topic to use.", form=name_patterns.TOPIC, examples=["tag_detections"]),
            topics=True,
            examples=[{"image": "camera/image_raw"}],
        ),
        "publishes": name_map(
            "The topics that the node publishes, by their names in its code, with their types. "
            "This lets 'validate' check the wiring of a node whose topics it does not know.",
            name_patterns.TOPIC,
            _TYPE,
            topics=True,
            examples=[{"detections": "geometry_msgs/msg/PoseArray"}],
        ),
        "subscribes": name_map(
            "The topics to which the node subscribes, by their names in its code, with their "
            "types.",
            name_patterns.TOPIC,
            _TYPE,
            topics=True,
            examples=[{"image": "sensor_msgs/msg/Image"}],
        ),
        "qos": name_map(
            "The QoS profiles of its topics, by their names in its code.",
            name_patterns.TOPIC,
            qos("The QoS profile of the topic."),
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
