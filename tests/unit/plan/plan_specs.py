"""Specs for tests of plans, as documents that tests change, and an index of a bag."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import msgspec
import yaml

from r2bspec.bags.recording import BagIndex, TopicInfo
from r2bspec.language.declaration import decode_text
from r2bspec.language.spec import Spec
from r2bspec.plan.compile_plan import compile_plan
from r2bspec.plan.plan import Plan

IMAGE = "sensor_msgs/msg/Image"
INFO = "sensor_msgs/msg/CameraInfo"

PREPROCESSED, STRAIGHT = (
    yaml.safe_load(Path(__file__).with_name(f"{name}.yaml").read_text(encoding="utf-8"))
    for name in ("preprocessed", "straight")
)

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
