"""zstd, of single messages and of whole storage files."""

from __future__ import annotations

import shutil
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

_MAGIC = b"\x28\xb5\x2f\xfd"
_BLOCK_BYTES = 1 << 20


def uncompressed(data: bytes) -> bytes:
    """The CDR of a stored message.

    No flag is needed to tell compressed messages: CDR begins with a zero byte, a zstd frame
    with its magic number.

    Raises:
        ValueError: the bytes are neither.
    """
    if data[:4] == _MAGIC:
        data = zstd.decompress(data)
    if data[:1] != b"\x00":
        msg = f"a message begins with {data[:4].hex(' ') or 'nothing'}, which is no CDR"
        raise ValueError(msg)
    return data


def uncompressed_size(head: bytes, stored_bytes: int) -> int | None:
    """Size of a stored message in bytes, from its first bytes; None if they do not tell."""
    if head[:4] != _MAGIC:
        return stored_bytes
    return zstd.get_frame_info(head).decompressed_size


@contextmanager
def unpack(path: Path) -> Iterator[Path]:
    """A file that is one zstd stream, unpacked for as long as the block lasts.

    Yields:
        A file in a temporary folder, named like `path` without its last suffix.

    Raises:
        OSError: there is no room in $TMPDIR.
        EOFError, zstd.ZstdError: the file is damaged.
    """
    with tempfile.TemporaryDirectory(prefix="r2bspec-") as folder:
        plain = Path(folder) / path.stem
        with zstd.open(path, "rb") as packed, plain.open("wb") as unpacked:
            shutil.copyfileobj(packed, unpacked, _BLOCK_BYTES)
        yield plain
