"""A node, of the graph or of the preprocessors.

The schema is flat: which kinds of node exclude each other is a rule of its own
(`r2bspec.spec.exclusive`), because ``oneOf`` ruins both messages and completion.
"""

from __future__ import annotations

from r2bspec.spec.schema import names
from r2bspec.spec.schema.build import SCALAR_TYPES, Schema, listing, named, record, scalar, text

_PARAMETERS = named(
    "ROS parameters of the node. Nested ones are written with dots: camera.fx.",
    names.PARAMETER,
    {
        "type": [*SCALAR_TYPES, "array"],
        "description": "Text, a number, a truth value, or a list of one of these.",
        "items": scalar("An item of the list.", examples=[0.5, "left"]),
        "examples": [1280, "36h11", [0.1, 0.2]],
    },
    examples=[{"width": 1280, "height": 720}],
)

_TYPE = text(
    "The message type, as ros2 topic list -t shows it.",
    form=names.MESSAGE_TYPE,
    examples=["sensor_msgs/msg/Image"],
)

NODE: Schema = record(
    "A node: exactly one of 'python', 'package' with 'executable', or 'command'.",
    {
        "python": text(
            "A Python node: a class derived from rclpy's Node whose constructor takes **kwargs "
            "for Node, or a function that returns one. module.Class, or ./file.py:Class relative "
            "to this file.",
            form=names.PYTHON_NODE,
            examples=["r2bspec.nodes.ResizeNode", "./my_nodes.py:Detector"],
        ),
        "package": text(
            "The ROS package that holds the executable.",
            form=names.PACKAGE,
            examples=["image_proc"],
        ),
        "executable": text(
            "The executable of the package, as for ros2 run.",
            form=names.FILE_NAME,
            examples=["rectify_node"],
        ),
        "command": listing(
            "Any program, with its arguments, one item each; no shell reads it. Remappings, "
            "parameters and the namespace are appended in ROS's own way (--ros-args).",
            text("A word of the command line.", examples=["./build/detector"]),
            at_least=1,
            examples=[["./build/detector", "--fast"]],
        ),
        "arguments": listing(
            "Further words of the command line of an executable.",
            text("A word of the command line.", examples=["--fast"]),
            examples=[["--fast"]],
        ),
        "namespace": text(
            "The node's namespace; a relative one lies in the namespace of the benchmark.",
            form=names.NAMESPACE,
            examples=["left"],
        ),
        "parameters": _PARAMETERS,
        "remappings": named(
            "Topics as the node's code names them, and the topics that are meant.",
            names.TOPIC,
            text("The topic that is meant.", form=names.TOPIC, examples=["tag_detections"]),
            topics=True,
            examples=[{"image": "camera/image_raw"}],
        ),
        "publishes": named(
            "What the node is known to publish: topic, as its code names it, and type. It lets "
            "validate check the wiring of a node that it cannot look into.",
            names.TOPIC,
            _TYPE,
            topics=True,
            examples=[{"detections": "geometry_msgs/msg/PoseArray"}],
        ),
        "subscribes": named(
            "What the node is known to read: topic, as its code names it, and type.",
            names.TOPIC,
            _TYPE,
            topics=True,
            examples=[{"image": "sensor_msgs/msg/Image"}],
        ),
        "env": named(
            "Environment variables of the node's process.",
            names.ENVIRONMENT,
            text("The variable's value.", examples=["4"]),
            examples=[{"OMP_NUM_THREADS": "4"}],
        ),
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
        {"label": "any command", "body": {"command": ["$1"]}},
    ],
)


def nodes(description: str) -> Schema:
    """A map of nodes by their names."""
    return named(
        description,
        names.NODE_NAME,
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
