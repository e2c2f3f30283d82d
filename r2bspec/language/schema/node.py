"""A node, of the graph or of the preprocessors.

The schema is flat: that the kinds of node exclude each other is checked separately
(`r2bspec.language.key_constraints.entry_keys`), because ``oneOf`` leads to poor messages and poor
completion.
"""

from __future__ import annotations

from r2bspec.language.schema import name_patterns
from r2bspec.language.schema.parameters import PARAMETERS
from r2bspec.language.schema.process_keys import ENV, RESOURCES
from r2bspec.language.schema.qos import qos
from r2bspec.language.schema.reuse import repeat, sibling
from r2bspec.language.schema.schema_builder import (
    Schema,
    array,
    boolean,
    name_map,
    record,
    scalar,
    text,
)

_TYPE = text(
    "The message type, as 'ros2 topic list -t' shows it.",
    form=name_patterns.MESSAGE_TYPE,
    examples=["sensor_msgs/msg/Image"],
)

_LAUNCH = record(
    "A launch file: 'package' and 'file', or 'path'. The remappings and the namespace of the node "
    "apply to everything that it starts.",
    {
        "package": text(
            "The ROS package of the launch file.",
            form=name_patterns.PACKAGE,
            examples=["image_proc"],
        ),
        "file": text(
            "The launch file, relative to the share folder of the package.",
            form=name_patterns.SOME_TEXT,
            examples=["launch/image_proc.launch.py"],
        ),
        "path": text(
            "The launch file, relative to this file.",
            form=name_patterns.NOT_EMPTY,
            examples=["./detector.launch.py"],
            path=True,
        ),
        "arguments": name_map(
            "The arguments of the launch file.",
            name_patterns.PARAMETER,
            scalar("The value of the argument.", examples=["false"]),
            examples=[{"use_sim_time": "false"}],
        ),
    },
    examples=[{"package": "image_proc", "file": "launch/image_proc.launch.py"}],
)

NODE: Schema = record(
    "A node: exactly one of 'python', 'package' with 'plugin', 'package' with 'executable', "
    "'command', 'launch', or 'external'.",
    {
        "extends": sibling("node"),
        "repeat": repeat("node"),
        "description": text("What the node does.", examples=["Finds tags in the left image."]),
        "python": text(
            "A Python node, as module.Class, or ./file.py:Class relative to this file: a subclass "
            "of rclpy's Node whose constructor passes **kwargs to Node, or a function that returns "
            "one.",
            form=name_patterns.PYTHON_NODE,
            examples=["r2bspec.nodes.ResizeNode", "./my_nodes.py:Detector"],
            path=True,
        ),
        "package": text(
            "The ROS package of the plugin or the executable.",
            form=name_patterns.PACKAGE,
            examples=["image_proc"],
        ),
        "plugin": text(
            "The C++ class of a composable node in the package.",
            form=name_patterns.PLUGIN,
            examples=["image_proc::ResizeNode"],
        ),
        "executable": text(
            "The executable of the package, as for 'ros2 run'.",
            form=name_patterns.FILE_NAME,
            examples=["rectify_node"],
        ),
        "command": array(
            "Any program with its arguments, one item each, run without a shell. Remappings, "
            "parameters and the namespace are appended after --ros-args.",
            text("An argument.", examples=["./build/detector"]),
            at_least=1,
            examples=[["./build/detector", "--fast"]],
        ),
        "launch": _LAUNCH,
        "external": boolean(
            "Whether the node is already running, started by other means. The run waits for it "
            "and does not stop it.",
            default=False,
        ),
        "container": text(
            "The container of the node; without one, graph.placement applies.",
            form=name_patterns.NODE_NAME,
            examples=["vision"],
        ),
        "arguments": array(
            "Arguments of an executable or a command.",
            text("An argument.", examples=["--fast"]),
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
        {
            "label": "Python node",
            "body": {"python": "${1:module.Class}", "remappings": {"${2:topic}": "${3:topic}"}},
        },
        {
            "label": "executable of a package",
            "body": {"package": "$1", "executable": "$2", "remappings": {"$3": "$4"}},
        },
        {
            "label": "composable C++ node",
            "body": {"package": "$1", "plugin": "$2", "remappings": {"$3": "$4"}},
        },
        {"label": "any command", "body": {"command": ["$1"]}},
        {"label": "launch file", "body": {"launch": {"package": "$1", "file": "$2"}}},
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
