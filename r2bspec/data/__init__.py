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
    from r2bspec.data.index import index_bag as index_bag
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

_HOMES = {
    "BagIndex": ("model", "BagIndex"),
    "BagLocation": ("model", "BagLocation"),
    "DataError": ("errors", "DataError"),
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
    "read_messages": ("reader", "read_messages"),
}

__all__ = [
    "BagIndex",
    "BagLocation",
    "DataError",
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
    "read_messages",
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
