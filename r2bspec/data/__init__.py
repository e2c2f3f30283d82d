"""Recorded data: indexing, reading and hashing rosbags, and rendering the synthetic datasets.

The names below are loaded on first use, so that importing this package costs nothing.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from r2bspec.data.digest import hash_content as hash_content
    from r2bspec.data.digest import hash_files as hash_files
    from r2bspec.data.errors import DataError as DataError
    from r2bspec.data.ground_truth import GroundTruth as GroundTruth
    from r2bspec.data.ground_truth import read_disparity as read_disparity
    from r2bspec.data.ground_truth import read_ground_truth as read_ground_truth
    from r2bspec.data.index import index_bag as index_bag
    from r2bspec.data.largest import measure_largest as measure_largest
    from r2bspec.data.largest import measure_topics as measure_topics
    from r2bspec.data.locate import index as index_location
    from r2bspec.data.locate import locate as locate_bag
    from r2bspec.data.model import BagIndex as BagIndex
    from r2bspec.data.model import BagLocation as BagLocation
    from r2bspec.data.model import MadeDataset as MadeDataset
    from r2bspec.data.model import Message as Message
    from r2bspec.data.model import TopicInfo as TopicInfo
    from r2bspec.data.model import Window as Window
    from r2bspec.data.reader import read_messages as read_messages
    from r2bspec.data.sequences import describe as describe
    from r2bspec.data.synthesis import make as make
    from r2bspec.data.verification import verify as verify

_HOMES = {
    "BagIndex": ("model", "BagIndex"),
    "BagLocation": ("model", "BagLocation"),
    "DataError": ("errors", "DataError"),
    "GroundTruth": ("ground_truth", "GroundTruth"),
    "MadeDataset": ("model", "MadeDataset"),
    "Message": ("model", "Message"),
    "TopicInfo": ("model", "TopicInfo"),
    "Window": ("model", "Window"),
    "describe": ("sequences", "describe"),
    "hash_content": ("digest", "hash_content"),
    "hash_files": ("digest", "hash_files"),
    "index_bag": ("index", "index_bag"),
    "index_location": ("locate", "index"),
    "locate_bag": ("locate", "locate"),
    "make": ("synthesis", "make"),
    "measure_largest": ("largest", "measure_largest"),
    "measure_topics": ("largest", "measure_topics"),
    "read_disparity": ("ground_truth", "read_disparity"),
    "read_ground_truth": ("ground_truth", "read_ground_truth"),
    "read_messages": ("reader", "read_messages"),
    "verify": ("verification", "verify"),
}

__all__ = [
    "BagIndex",
    "BagLocation",
    "DataError",
    "GroundTruth",
    "MadeDataset",
    "Message",
    "TopicInfo",
    "Window",
    "describe",
    "hash_content",
    "hash_files",
    "index_bag",
    "index_location",
    "locate_bag",
    "make",
    "measure_largest",
    "measure_topics",
    "read_disparity",
    "read_ground_truth",
    "read_messages",
    "verify",
]


def __getattr__(name: str) -> Any:
    """Load a public name from its module."""
    if name not in _HOMES:
        msg = f"module {__name__!r} has no attribute {name!r}"
        raise AttributeError(msg)
    module, attribute = _HOMES[name]
    value = getattr(import_module(f"{__name__}.{module}"), attribute)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """Names that completion shows."""
    return list(__all__)
