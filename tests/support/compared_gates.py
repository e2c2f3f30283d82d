"""Two versions of a spec as the sides of a comparison of gates."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from r2bspec.bags.recording import BagIndex, TopicInfo
from r2bspec.language.load_spec import load_spec
from r2bspec.plan.compile_plan import compile_plan
from r2bspec.plan.prepared_benchmark import PreparedBenchmark

IMAGE = "sensor_msgs/msg/Image"
INFO = "sensor_msgs/msg/CameraInfo"

BAG = BagIndex(
    name="kitchen",
    storage="mcap",
    start_ns=0,
    end_ns=10_000_000_000,
    message_count=600,
    topics={
        name: TopicInfo(name=name, type=kind, count=300, rate_hz=30.0, max_message_bytes=1000)
        for name, kind in (("/camera/image", IMAGE), ("/camera/info", INFO))
    },
)

GONE: Any = object()
"""The value of a key that a document does not have."""

DOCUMENT: dict[str, Any] = {
    "r2bspec": 1,
    "name": "relay",
    "variables": {"threads": 1},
    "data_loader": {
        "bag": {"path": "./kitchen"},
        "window": {"start": "0.5 s", "end": "8 s"},
        "topics": {"/camera/image": "image_raw", "/camera/info": "info_raw"},
    },
    "preprocessors": {
        "resize": {
            "python": "r2bspec.nodes.ResizeNode",
            "parameters": {"width": 640},
            "remappings": {
                "image/image_raw": "image_raw",
                "image/camera_info": "info_raw",
                "resize/image_raw": "small",
            },
        }
    },
    "playback": {
        "buffer": 10,
        "inputs": {
            "image": {"from": "small", "format": IMAGE},
            "info": {"from": "info_raw", "format": INFO},
        },
    },
    "graph": {
        "nodes": {
            "relay": {
                "python": "r2bspec.nodes.RelayNode",
                "remappings": {"input": "image"},
                "memory_limit": "200 MiB",
            },
            "second": {"package": "drivers", "executable": "driver", "remappings": {"a": "other"}},
        }
    },
    "monitors": {
        "out": {"topic": "output", "format": IMAGE},
        "other": {"topic": "other", "format": IMAGE, "match": "order"},
    },
    "benchmark": {
        "duration": "4 s",
        "iterations": 10,
        "max_iterations": 20,
        "starts": 5,
        "rates": ["10 Hz", "30 Hz"],
        "warm_up": "2 s",
        "start_timeout": "30 s",
        "drain_timeout": "5 s",
        "search": {
            "min": "5 Hz",
            "max": "60 Hz",
            "precision": "2 %",
            "probe": "5 s",
            "confirm": "20 s",
            "confidence": "95 %",
            "holds": ["out.drop_rate <= 5 %"],
        },
        "gate": {
            "confidence": "95 %",
            "inconclusive": "report",
            "confirm": False,
            "time_budget": "10 min",
            "interference": "note",
        },
    },
    "slos": {
        "fast": {"at": "30 Hz", "require": ["out.latency.p90 < 50 ms", "out.drop_rate <= 1 %"]},
        "headroom": {"require": ["peak.rate >= 40 Hz"]},
        "relative": {"at": "10 Hz", "require": ["out.latency.p50 <= 105 % of baseline"]},
        "steady": {"at": "10 Hz", "require": ["throughput.mean >= 97 % of offered"]},
    },
}
"""Every key that a gate has, with a value that can become weaker and stronger."""


def side(document: dict[str, Any] | str, file: str = "head.r2b.yaml") -> PreparedBenchmark:
    """The compiled document."""
    text = document if isinstance(document, str) else str(yaml.safe_dump(document, sort_keys=False))
    loaded = load_spec(text, file=file)
    assert loaded.spec is not None, [diagnostic.message for diagnostic in loaded.diagnostics]
    return PreparedBenchmark(compile_plan(loaded.spec, BAG), Path(), "", loaded=loaded)
