"""A cache of bag indexes, by the identity of the bag's files.

Indexing a bag opens all of its files, which for a bag of many files takes longer than all rules
together. The key of an index has the size, times and inode of each file, so a changed bag is
indexed again. If the cache cannot be read or written, bags are indexed without it.
"""

from __future__ import annotations

import contextlib
import os
from pathlib import Path
from typing import TYPE_CHECKING

from r2bspec.private_files import private_files
from r2bspec.safe_io.safe_json import read_json

if TYPE_CHECKING:
    from r2bspec.bags.recording import BagIndex, BagLocation

_CACHE_VERSION = 2
"""Increase this with every change of the content of an index."""

_MAX_FILES = 10_000
_MAX_ENTRY_BYTES = 64_000_000
_MIN_CACHED_BYTES = 1_000_000
"""Smaller bags are indexed faster than a cache is read."""


def cached_index(location: BagLocation) -> BagIndex:
    """The index of a located bag.

    Raises:
        DataError: the bag cannot be used; errors are not cached.
    """
    from r2bspec.datasets.catalogue import index as index_location

    if location.path is None:
        return index_location(location)
    from r2bspec.safe_io.decompression_budget import chosen_max_bytes

    entry = _cache_file(location.path)
    # What was indexed under other limits may be more than the user allows now.
    if entry is None or chosen_max_bytes() is not None:
        return index_location(location)
    import msgspec

    from r2bspec.bags.recording import BagIndex

    with contextlib.suppress(OSError, msgspec.DecodeError):
        return read_json(entry, BagIndex, max_bytes=_MAX_ENTRY_BYTES)
    found = index_location(location)
    _store(entry, msgspec.json.encode(found))
    return found


def _cache_file(bag: Path) -> Path | None:
    """The cache file for the index of a bag; None if the bag is not worth caching."""
    import hashlib

    try:
        files = sorted(bag.iterdir()) if bag.is_dir() else [bag]
        stats = [(file, file.stat()) for file in files[:_MAX_FILES]]
    except OSError:
        return None
    if len(files) > _MAX_FILES or sum(each.st_size for _, each in stats) < _MIN_CACHED_BYTES:
        return None
    identity = hashlib.sha256(f"{_CACHE_VERSION}\0{bag.resolve()}\0".encode())
    for file, stat in stats:
        values = (file.name, stat.st_size, stat.st_mtime_ns, stat.st_ino, stat.st_ctime_ns)
        identity.update(repr(values).encode())
    base = os.environ.get("XDG_CACHE_HOME") or Path("~/.cache").expanduser()
    return Path(base) / "r2bspec" / "indexes" / f"{identity.hexdigest()}.json"


def _store(entry: Path, content: bytes) -> None:
    scratch = entry.with_name(f".{entry.name}.{os.getpid()}")
    try:
        # Names of topics are not for other users, and no other user may exchange an entry.
        with private_files():
            entry.parent.mkdir(parents=True, exist_ok=True)
            scratch.write_bytes(content)
        scratch.replace(entry)
    except OSError:
        scratch.unlink(missing_ok=True)
