"""zstd, of single messages and of whole storage files."""

from __future__ import annotations

import errno
import os
import shutil
import sys
import tempfile
from collections import deque
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import BinaryIO, TypeVar

from r2bspec.untrusted.decompression_budget import (
    DecompressionBudget,
    unpack_zstd,
    zstd_size,
)
from r2bspec.untrusted.safe_file import open_regular

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

Key = TypeVar("Key")

_MAGIC = b"\x28\xb5\x2f\xfd"
_BLOCK_BYTES = 1 << 20
_HEADER_BYTES = 18
_MIN_THREADED_BYTES = 1 << 16
_MAX_THREADS = 4


def decompress_message(data: bytes) -> bytes:
    """The CDR of a stored message.

    Compressed messages are recognised without a flag: CDR begins with a zero byte, a zstd frame
    with its magic number.

    Raises:
        ValueError: the bytes are neither, or unpack to too much.
    """
    if data[:4] == _MAGIC:
        data = unpack_zstd(data)
    if data[:1] != b"\x00":
        msg = f"a message begins with {data[:4].hex(' ') or 'no bytes'}, which is not CDR"
        raise ValueError(msg)
    return data


def decompress_ahead(
    stored: Iterator[tuple[Key, bytes]], budget: DecompressionBudget
) -> Iterator[tuple[Key, bytes]]:
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
                yield _decompressed(*waiting.popleft(), budget)
        while waiting:
            yield _decompressed(*waiting.popleft(), budget)


def _decompressed(
    what: Key, data: bytes | Future[bytes], budget: DecompressionBudget
) -> tuple[Key, bytes]:
    if isinstance(data, Future):
        content = data.result()
        budget.spend(len(content))
        return what, content
    with budget.active():
        return what, decompress_message(data)


@contextmanager
def unpack(path: Path) -> Iterator[Path]:
    """A file that is one zstd stream, unpacked for as long as the block lasts.

    Yields:
        A file in a temporary folder, named like `path` without its last suffix.

    Raises:
        RefusedDataError: it unpacks to too much.
        OSError: there is no space in $TMPDIR.
        EOFError, zstd.ZstdError: the file is damaged.
    """
    with tempfile.TemporaryDirectory(prefix="r2bspec-") as folder:
        plain = Path(folder) / path.stem
        with open_regular(path) as stored, plain.open("wb") as unpacked:
            _unpack_file(stored, unpacked, Path(folder))
        yield plain


def _unpack_file(stored: BinaryIO, unpacked: BinaryIO, folder: Path) -> None:
    """Unpack a whole file; what it states is compared with the limits and the room first."""
    stored_bytes = os.fstat(stored.fileno()).st_size
    stated = zstd_size(stored.read(_HEADER_BYTES)) or 0
    DecompressionBudget(stored_bytes).spend(stated)
    if stated > shutil.disk_usage(folder).free:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    stored.seek(0)
    budget = DecompressionBudget(stored_bytes)
    with zstd.open(stored, "rb") as packed:
        while block := packed.read(_BLOCK_BYTES):
            budget.spend(len(block))
            unpacked.write(block)
