"""Specs for tests of plans, as documents that tests change, and an index of a bag."""

from __future__ import annotations

import copy
from typing import Any

import msgspec

from r2bspec.bags.recording import BagIndex, TopicInfo
from r2bspec.language.declaration import decode_text
from r2bspec.language.spec import Spec
from r2bspec.plan.compile_plan import compile_plan
from r2bspec.plan.plan import Plan

IMAGE = "sensor_msgs/msg/Image"
INFO = "sensor_msgs/msg/CameraInfo"

PREPROCESSED: dict[str, Any] = {
    "r2bspec": 1,
    "name": "detector",
    "title": 'A "detector"',
    "data_loader": {
        "bag": {"dataset": "kitchen"},
        "window": {"start": "0.5 s", "end": "1 s"},
        "topics": {"/camera/image": "loaded/image", "camera/info": "loaded/info"},
    },
    "preprocessors": {
        "resize": {
            "python": "r2bspec.nodes.ResizeNode",
            "parameters": {"width": 640, "height": 480},
            "remappings": {
                "image/image_raw": "loaded/image",
                "image/camera_info": "loaded/info",
                "resize/image_raw": "buffer/image",
                "resize/camera_info": "buffer/info",
            },
        }
    },
    "playback": {
        "buffer": 10,
        "inputs": {
            "image": {"from": "buffer/image", "format": IMAGE},
            "info": {"from": "loaded/info", "format": INFO},
        },
    },
    "graph": {
        "nodes": {
            "relay": {"python": "r2bspec.nodes.RelayNode", "remappings": {"input": "image"}},
            "driver": {
                "package": "drivers",
                "executable": "driver_node",
                "arguments": ["--fast"],
                "namespace": "left",
                "parameters": {"gain": 0.5, "id": "36h11", "on": True, "sizes": [1, 2]},
                "remappings": {"in": "image", "~/out": "result"},
                "env": {"THREADS": "2"},
            },
            "script": {"command": ["sh", "./run.sh"], "env": {"A": "1"}},
        }
    },
    "monitors": {
        "output": {"topic": "output", "format": IMAGE},
        "result": {"topic": "left/result", "format": IMAGE, "match": "order"},
    },
    "benchmark": {
        "duration": "4 s",
        "iterations": 3,
        "rates": ["10 Hz", "30 Hz", "10 Hz"],
        "search": {"min": "5 Hz", "max": "60 Hz", "holds": ["drop_rate <= 5 %"]},
    },
    "slos": {
        "fast": {"at": "30 Hz", "require": ["output.latency.p90 < 50 ms", "sustained"]},
        "headroom": {"require": ["peak.rate >= 40 Hz"]},
        "probe": {"at": "20 Hz", "require": ["sustained"]},
    },
}

STRAIGHT: dict[str, Any] = {
    "r2bspec": 1,
    "name": "straight",
    "data_loader": {
        "bag": {"path": "./bags/kitchen"},
        "topics": {"/camera/image": "loaded/image"},
    },
    "playback": {"inputs": {"image": {"from": "loaded/image", "format": IMAGE}}},
    "graph": {
        "nodes": {"relay": {"python": "r2bspec.nodes.RelayNode", "remappings": {"input": "image"}}}
    },
    "monitors": {"output": {"topic": "output", "format": IMAGE}},
    "benchmark": {"rates": ["30 Hz"], "warm_up": "0 s"},
}

BAG = BagIndex(
    name="kitchen",
    storage="mcap",
    start_ns=0,
    end_ns=10_000_000_000,
    message_count=600,
    topics={
        name: TopicInfo(name=name, type=kind, count=300, rate_hz=30.0, max_message_bytes=size)
        for name, kind, size in (("/camera/image", IMAGE, 900_000), ("/camera/info", INFO, 400))
    },
)


def spec(document: dict[str, Any], **sections: Any) -> Spec:
    """A spec of a document with some sections replaced."""
    return msgspec.convert({**copy.deepcopy(document), **sections}, Spec, dec_hook=decode_text)


def plan(document: dict[str, Any] = PREPROCESSED, **sections: Any) -> Plan:
    """The plan of such a spec."""
    return compile_plan(spec(document, **sections), BAG)
