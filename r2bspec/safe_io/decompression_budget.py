"""How much may be unpacked: by bytes, and in proportion to what is stored.

A few kilobytes can unpack to gigabytes. Formats state the size of what they have packed, so that
most bombs are refused before anything is unpacked; what states too little is cut off at its word.
Nothing in an .npz archive is executed.
"""

from __future__ import annotations

import bz2
import math
import sys
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypeVar, cast

from r2bspec.safe_io import limits
from r2bspec.safe_io.safe_file import RefusedDataError

if TYPE_CHECKING:
    from numpy.typing import NDArray


_MAX_FRAME_HEADER_BYTES: Final = 18
T = TypeVar("T")

_HINT: Final = (
    "copy or record it again; if it is meant, allow it with --max-bytes, or convert it without "
    "compression"
)


_chosen_bytes: int | None = None
"""What the user has chosen in place of the limits on files; None: nothing.

It is of the process, and not of a context: threads unpack, too.
"""


@contextmanager
def max_unpacked_bytes(max_bytes: int | None) -> Iterator[None]:
    """Let each file be unpacked to this many bytes, whatever its size, while the block lasts.

    A message or chunk may then have any ratio, and still no more than `MAX_PIECE_BYTES`.

    Args:
        max_bytes: the limit in bytes; None for the usual ones.
    """
    global _chosen_bytes
    before, _chosen_bytes = _chosen_bytes, max_bytes
    try:
        yield
    finally:
        _chosen_bytes = before


def chosen_max_bytes() -> int | None:
    """The limit of `max_unpacked_bytes` that applies; None for the usual ones."""
    return _chosen_bytes


class DecompressionBudget:
    """What a file may be unpacked to, over all of its pieces.

    Args:
        stored_bytes: the size of the file.
        messages: how many records of it are messages, as far as that is known.
    """

    def __init__(self, stored_bytes: int, messages: int = 0) -> None:
        if _chosen_bytes is None:
            self._left = max(limits.FREE_TOTAL_BYTES, stored_bytes * limits.MAX_RATIO)
            self._limit = f"{limits.MAX_RATIO:,} times its size"
        else:
            self._left = _chosen_bytes
            self._limit = _chosen_text(_chosen_bytes)
        self._max_records = messages + max(
            limits.FREE_RECORDS, stored_bytes // limits.MIN_BYTES_OF_RECORD
        )
        self._records = 0
        self._max_messages = max(limits.FREE_MESSAGES, stored_bytes // limits.MIN_BYTES_OF_MESSAGE)
        self._messages = 0

    def spend(self, unpacked_bytes: int) -> None:
        """Take in one more piece.

        Raises:
            RefusedDataError: this is more than the whole file may be unpacked to.
        """
        self._left -= unpacked_bytes
        if self._left < 0:
            raise RefusedDataError(f"it unpacks to more than {self._limit}", hint=_HINT)

    def spend_messages(self, number: int = 1) -> None:
        """Take in further messages; however small they are, each takes its time.

        Raises:
            RefusedDataError: a file of this size holds fewer, and the user has chosen no limit.
        """
        self._messages += number
        if self._messages > self._max_messages and _chosen_bytes is None:
            raise RefusedDataError(
                f"it has more than {self._max_messages:,} messages, of a few bytes each",
                hint="record fewer topics or split it; if it is meant, allow it with --max-bytes",
            )

    def spend_record(self) -> None:
        """Take in one more record that is no message.

        Raises:
            RefusedDataError: a file of this size needs fewer.
        """
        self._records += 1
        if self._records > self._max_records:
            raise RefusedDataError(
                f"it has more than {self._max_records:,} records that are no messages",
                hint="'mcap recover' or 'mcap filter' writes its messages to a new file",
            )

    @contextmanager
    def active(self) -> Iterator[None]:
        """Let every piece that is unpacked meanwhile count."""
        token = _ACTIVE.set(self)
        try:
            yield
        finally:
            _ACTIVE.reset(token)


def spend_for_each(pieces: Iterator[T], budget: DecompressionBudget) -> Iterator[T]:
    """Everything of an iterator; what is unpacked for it counts.

    Raises:
        RefusedDataError: as `DecompressionBudget.spend`.
    """
    end = object()
    while True:
        # Only until the next piece is there: what the caller does with it does not count.
        with budget.active():
            piece = next(pieces, end)
        if piece is end:
            return
        yield cast("T", piece)


_ACTIVE: ContextVar[DecompressionBudget | None] = ContextVar("_ACTIVE", default=None)


def check_piece(stored_bytes: int, unpacked_bytes: int) -> None:
    """Compare one message or chunk with the limits.

    Raises:
        RefusedDataError: it is too large, or unpacks to too much.
    """
    if unpacked_bytes > limits.MAX_PIECE_BYTES:
        raise RefusedDataError(
            f"a message or chunk unpacks to more than {limits.MAX_PIECE_BYTES >> 20} MiB",
            hint=_HINT,
        )
    if _chosen_bytes is None and unpacked_bytes > max(
        limits.FREE_PIECE_BYTES, stored_bytes * limits.MAX_RATIO
    ):
        raise RefusedDataError(
            f"a message or chunk unpacks to more than {limits.MAX_RATIO:,} times its size",
            hint=_HINT,
        )
    budget = _ACTIVE.get()
    if budget is not None:
        budget.spend(unpacked_bytes)


def spend_record() -> None:
    """Count one record in the budget that is active; see `DecompressionBudget.spend_record`."""
    budget = _ACTIVE.get()
    if budget is not None:
        budget.spend_record()


def spend_message() -> None:
    """Count one message in the budget that is active; see `DecompressionBudget.spend_messages`."""
    budget = _ACTIVE.get()
    if budget is not None:
        budget.spend_messages()


def max_unpacked(stored_bytes: int) -> int:
    """The most bytes that a piece of this size may unpack to."""
    usual = max(limits.FREE_PIECE_BYTES, stored_bytes * limits.MAX_RATIO)
    return min(limits.MAX_PIECE_BYTES, usual if _chosen_bytes is None else _chosen_bytes)


def unpack_zstd(data: bytes, stated_bytes: int | None = None) -> bytes:
    """Unpack zstd.

    Args:
        data: one or more frames.
        stated_bytes: the size that the format states; None to take that of the frame.

    Raises:
        RefusedDataError: it unpacks to too much.
        ValueError, zstd.ZstdError: it is damaged.
    """
    stated = zstd_size(data) if stated_bytes is None else stated_bytes
    return _unpack(_zstd().ZstdDecompressor, data, stated)


def zstd_size(head: bytes) -> int | None:
    """The size that the first frame states; None if it does not.

    Raises:
        zstd.ZstdError: this is no frame.
    """
    size: int | None = _zstd().get_frame_info(head[:_MAX_FRAME_HEADER_BYTES]).decompressed_size
    return size


def _zstd() -> Any:
    # What asks for the limits only need not wait for it.
    if sys.version_info >= (3, 14):
        from compression import zstd
    else:
        from backports import zstd
    return zstd


def unpack_bz2(data: bytes, stated_bytes: int | None = None) -> bytes:
    """Unpack bzip2; arguments and errors as for `unpack_zstd`."""
    return _unpack(bz2.BZ2Decompressor, data, stated_bytes)


def unpack_lz4(data: bytes, stated_bytes: int | None = None) -> bytes:
    """Unpack frames of LZ4; arguments and errors as for `unpack_zstd`."""
    from lz4.frame import LZ4FrameDecompressor  # type: ignore[import-untyped]

    return _unpack(LZ4FrameDecompressor, data, stated_bytes)


def _unpack(decompressor: Any, data: bytes, stated_bytes: int | None) -> bytes:
    """Unpack frames one after another, and stop where they give more than they may."""
    if stated_bytes is not None:
        check_piece(len(data), stated_bytes)
    limit = max_unpacked(len(data)) if stated_bytes is None else stated_bytes
    parts: list[bytes] = []
    total, rest = 0, data
    while rest:
        frame = decompressor()
        part = frame.decompress(rest, max_length=limit - total + 1)
        parts.append(part)
        total += len(part)
        if total > limit:
            _refuse(stated_bytes)
        if not frame.eof:
            raise ValueError("compressed data ends before its end marker")
        rest = frame.unused_data
    if stated_bytes is None:
        check_piece(len(data), total)
    return parts[0] if len(parts) == 1 else b"".join(parts)


def _refuse(stated_bytes: int | None) -> None:
    if stated_bytes is not None:
        raise RefusedDataError("a message or chunk unpacks to more than it states", hint=_HINT)
    limit = "too much" if _chosen_bytes is None else f"more than {_chosen_text(_chosen_bytes)}"
    raise RefusedDataError(f"a message or chunk unpacks to {limit}", hint=_HINT)


def _chosen_text(max_bytes: int) -> str:
    return f"the {max_bytes:,} bytes of --max-bytes"


def read_npz_array(path: Path, name: str) -> NDArray[Any]:
    """Read one array.

    Args:
        path: of the archive.
        name: of the array, without ``.npy``.

    Raises:
        KeyError: there is no such array.
        RefusedDataError: the archive is damaged, or the array is too large or has no plain numbers.
        OSError: the system refuses.
    """
    try:
        with zipfile.ZipFile(path) as archive, archive.open(f"{name}.npy") as stream:
            return _read_array(stream)
    except (zipfile.BadZipFile, zlib.error, ValueError, EOFError, NotImplementedError) as error:
        raise RefusedDataError(f"{path}: the array {name} is damaged: {error}") from error


def _read_array(stream: Any) -> NDArray[Any]:
    import numpy as np

    version = np.lib.format.read_magic(stream)
    if version != (1, 0):
        raise ValueError(f"version {version} of its header is not known")
    shape, is_fortran, dtype = np.lib.format.read_array_header_1_0(
        stream, max_header_size=limits.MAX_ARRAY_HEADER_BYTES
    )
    if dtype.hasobject or dtype.kind not in "biuf":
        raise ValueError(f"its type {dtype} is no number")
    size = math.prod(shape) * dtype.itemsize
    if not 0 < size <= limits.MAX_ARRAY_BYTES:
        raise ValueError(f"it states {size:,} bytes; {limits.MAX_ARRAY_BYTES:,} are allowed")
    content = stream.read(size)
    if len(content) != size:
        raise ValueError(f"it has {len(content):,} of {size:,} bytes")
    flat = np.frombuffer(content, dtype)
    return flat.reshape(shape[::-1]).T if is_fortran else flat.reshape(shape)
