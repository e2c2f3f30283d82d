"""Specs and nodes for tests of the wiring, with defaults for what a test does not look at."""

from __future__ import annotations

from typing import Any

import msgspec

from r2bspec.language.declaration import decode_text
from r2bspec.language.spec import Node, Spec

IMAGE = "sensor_msgs/msg/Image"
INFO = "sensor_msgs/msg/CameraInfo"


def node(**fields: Any) -> Node:
    return msgspec.convert(fields, Node, dec_hook=decode_text)


def spec(nodes: dict[str, Any], **sections: Any) -> Spec:
    document = {
        "r2bspec": 1,
        "name": "test",
        "data_loader": {"bag": {"dataset": "d"}, "topics": {"/camera": "raw"}},
        "playback": {"inputs": {"image": {"from": "raw", "format": IMAGE}}},
        "graph": {"nodes": nodes},
        "monitors": {"result": {"topic": "out", "format": IMAGE}},
        **sections,
    }
    return msgspec.convert(document, Spec, dec_hook=decode_text)
