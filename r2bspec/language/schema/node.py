"""A node, of the graph or of the preprocessors.

The schema is flat: which kinds of node exclude each other is a rule of its own
(`r2bspec.language.key_constraints.entry_keys`), because ``oneOf`` ruins both messages and
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
    deferrable,
    name_map,
    record,
    scalar,
    text,
)

_TYPE = text(
    "The message type, as ros2 topic list -t shows it.",
    form=name_patterns.MESSAGE_TYPE,
    examples=["sensor_msgs/msg/Image"],
)

_LAUNCH = record(
    "A launch file: 'package' and 'file', or 'path'. Remappings and the namespace of the node "
    "apply to all that it starts.",
    {
        "package": text(
            "The ROS package that holds the launch file.",
            form=name_patterns.PACKAGE,
            examples=["image_proc"],
        ),
        "file": text(
            "The launch file below the package's share folder.",
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
            deferrable(scalar("The argument's value.", examples=["false"])),
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
        "description": text("What it does.", examples=["Finds tags in the left image."]),
        "python": text(
            "A Python node: a class derived from rclpy's Node whose constructor takes **kwargs "
            "for Node, or a function that returns one. module.Class, or ./file.py:Class relative "
            "to this file.",
            form=name_patterns.PYTHON_NODE,
            examples=["r2bspec.nodes.ResizeNode", "./my_nodes.py:Detector"],
            path=True,
        ),
        "package": text(
            "The ROS package that holds the plugin or the executable.",
            form=name_patterns.PACKAGE,
            examples=["image_proc"],
        ),
        "plugin": text(
            "The C++ class of a composable node of the package.",
            form=name_patterns.PLUGIN,
            examples=["image_proc::ResizeNode"],
        ),
        "executable": text(
            "The executable of the package, as for ros2 run.",
            form=name_patterns.FILE_NAME,
            examples=["rectify_node"],
        ),
        "command": array(
            "Any program, with its arguments, one item each; no shell reads it. Remappings, "
            "parameters and the namespace are appended in ROS's own way (--ros-args).",
            deferrable(text("A word of the command line.", examples=["./build/detector"])),
            at_least=1,
            examples=[["./build/detector", "--fast"]],
        ),
        "launch": _LAUNCH,
        "external": boolean(
            "Whether the node runs already, started by somebody else; it is waited for, and left "
            "alone.",
            default=False,
        ),
        "container": text(
            "The container in which the node runs; else graph.placement says where.",
            form=name_patterns.NODE_NAME,
            examples=["vision"],
        ),
        "arguments": array(
            "Further words of the command line of an executable.",
            deferrable(text("A word of the command line.", examples=["--fast"])),
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
