"""The whole document: every section under its key."""

from __future__ import annotations

from r2bspec.language.schema import name_patterns
from r2bspec.language.schema.benchmark import BENCHMARK, SLOS
from r2bspec.language.schema.data_loader import DATA_LOADER
from r2bspec.language.schema.graph import GRAPH, MONITORS
from r2bspec.language.schema.harness_keys import HARNESS, TRANSPORT
from r2bspec.language.schema.node import nodes
from r2bspec.language.schema.playback import PLAYBACK
from r2bspec.language.schema.process_keys import CONTAINERS
from r2bspec.language.schema.requires import REQUIRES
from r2bspec.language.schema.reuse import EXTENDS, MATRIX, VARIABLES
from r2bspec.language.schema.schema_builder import (
    Schema,
    array,
    deferrable,
    name_map,
    record,
    scalar,
    text,
)
from r2bspec.language.schema.steps import AFTER_READY, READY, SETUP

_VERSION: Schema = {
    "type": "integer",
    "description": "The version of the language.",
    "const": 1,
    "examples": [1],
}

DOCUMENT: Schema = record(
    "A benchmark of a ROS 2 graph, for r2bspec.",
    {
        "r2bspec": _VERSION,
        "name": text(
            "The name of the benchmark; it identifies results and baselines.",
            form=name_patterns.NAME,
            examples=["apriltag_node"],
        ),
        "title": deferrable(
            text(
                "A title of one line, shown in reports.",
                examples=["AprilTag detection, 720p colour"],
            )
        ),
        "description": deferrable(
            text("What is measured, and why.", examples=["Detection on a colour camera at 720p."])
        ),
        "extends": EXTENDS,
        "labels": name_map(
            "Labels that reports show.",
            name_patterns.LABEL_KEY,
            deferrable(scalar("The value of the label.", examples=["720p"])),
            examples=[{"resolution": "720p", "robot": "carter"}],
        ),
        "requires": REQUIRES,
        "environment": array(
            "The environment variables that $(env NAME) may read.",
            text("The name of a variable.", form=name_patterns.ENVIRONMENT, examples=["DATA_DIR"]),
            examples=[["DATA_DIR"]],
        ),
        "variables": VARIABLES,
        "matrix": MATRIX,
        "namespace": text(
            "The namespace of nodes and of relative topics.",
            form=name_patterns.NAMESPACE,
            examples=["r2b"],
            default="r2b",
        ),
        "transport": TRANSPORT,
        "harness": HARNESS,
        "data_loader": DATA_LOADER,
        "preprocessors": nodes(
            "Nodes that prepare the recorded messages. They run before measuring, and are stopped "
            "before it starts."
        ),
        "containers": CONTAINERS,
        "setup": SETUP,
        "playback": PLAYBACK,
        "graph": GRAPH,
        "ready": READY,
        "after_ready": AFTER_READY,
        "monitors": MONITORS,
        "benchmark": BENCHMARK,
        "slos": SLOS,
    },
    required=["r2bspec", "name", "playback", "graph", "monitors"],
    unless_live=["data_loader"],
    examples=[],
    snippets=[
        {
            "label": "r2bspec",
            "description": "A new benchmark",
            "body": {
                "r2bspec": 1,
                "name": "${1:name}",
                "data_loader": {
                    "bag": "${2:r2b_storage}",
                    "topics": {"/${3:d455_1_rgb_image}": "data_loader/${4:image}"},
                },
                "playback": {
                    "inputs": {
                        "${4:image}": {
                            "from": "data_loader/${4:image}",
                            "format": "${5:sensor_msgs/msg/Image}",
                        }
                    }
                },
                "graph": {"nodes": {"${6:node}": {"python": "${7:module.Class}"}}},
                "monitors": {
                    "${8:output}": {"topic": "${9:output}", "format": "${5:sensor_msgs/msg/Image}"}
                },
                "benchmark": {"rates": ["${10:30 Hz}"]},
            },
        }
    ],
)
