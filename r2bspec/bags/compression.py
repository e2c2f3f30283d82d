"""zstd, of single messages and of whole storage files."""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
from collections import deque
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TypeVar

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

Key = TypeVar("Key")

_MAGIC = b"\x28\xb5\x2f\xfd"
_BLOCK_BYTES = 1 << 20
_MIN_THREADED_BYTES = 1 << 16
_MAX_THREADS = 4


def decompress_message(data: bytes) -> bytes:
    """The CDR of a stored message.

    Compressed messages are recognised without a flag: CDR begins with a zero byte, a zstd frame
    with its magic number.

    Raises:
        ValueError: the bytes are neither.
    """
    if data[:4] == _MAGIC:
        data = zstd.decompress(data)
    if data[:1] != b"\x00":
        msg = f"a message begins with {data[:4].hex(' ') or 'no bytes'}, which is not CDR"
        raise ValueError(msg)
    return data


def decompress_ahead(stored: Iterator[tuple[Key, bytes]]) -> Iterator[tuple[Key, bytes]]:
    """The CDR of stored messages, in their order; large ones are decompressed ahead in threads.

    zstd releases the interpreter lock, so that large messages are decompressed in parallel. Memory
    is bounded by one message per thread, and one more.

    Raises:
        ValueError: as `decompress_message`, at the position of the message.
    """
    workers = min(_MAX_THREADS, os.cpu_count() or 1)
    waiting: deque[tuple[Key, bytes | Future[bytes]]] = deque()
    with ExitStack() as stack:
        pool: ThreadPoolExecutor | None = None
        for what, data in stored:
            if len(data) >= _MIN_THREADED_BYTES and data[:4] == _MAGIC:
                pool = pool or stack.enter_context(ThreadPoolExecutor(workers))
                waiting.append((what, pool.submit(decompress_message, data)))
            else:
                waiting.append((what, data))
            while len(waiting) > (workers if pool else 0):
                yield _decompressed(*waiting.popleft())
        while waiting:
            yield _decompressed(*waiting.popleft())


def _decompressed(what: Key, data: bytes | Future[bytes]) -> tuple[Key, bytes]:
    return what, decompress_message(data) if isinstance(data, bytes) else data.result()


@contextmanager
def unpack(path: Path) -> Iterator[Path]:
    """A file that is one zstd stream, unpacked for as long as the block lasts.

    Yields:
        A file in a temporary folder, named like `path` without its last suffix.

    Raises:
        OSError: there is no space in $TMPDIR.
        EOFError, zstd.ZstdError: the file is damaged.
    """
    with tempfile.TemporaryDirectory(prefix="r2bspec-") as folder:
        plain = Path(folder) / path.stem
        with zstd.open(path, "rb") as packed, plain.open("wb") as unpacked:
            shutil.copyfileobj(packed, unpacked, _BLOCK_BYTES)
        yield plain
