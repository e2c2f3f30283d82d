"""How much may be unpacked, in pieces and in all."""

from __future__ import annotations

import bz2
import sys
from collections.abc import Callable, Iterator

import lz4.frame  # type: ignore[import-untyped]
import pytest

from r2bspec.safe_io.decompression_budget import (
    DecompressionBudget,
    check_piece,
    max_unpacked,
    spend_for_each,
    unpack_bz2,
    unpack_lz4,
    unpack_zstd,
)
from r2bspec.safe_io.limits import FREE_PIECE_BYTES, FREE_TOTAL_BYTES, MAX_PIECE_BYTES, MAX_RATIO
from r2bspec.safe_io.safe_file import RefusedDataError

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

Pack = Callable[[bytes], bytes]
Unpack = Callable[..., bytes]

FORMATS: list[tuple[Pack, Unpack]] = [
    (zstd.compress, unpack_zstd),
    (bz2.compress, unpack_bz2),
    (lz4.frame.compress, unpack_lz4),
]


def test_a_piece_has_limits_of_bytes_and_of_ratio() -> None:
    check_piece(1, FREE_PIECE_BYTES)
    with pytest.raises(RefusedDataError, match="1,000 times its size"):
        check_piece(1, FREE_PIECE_BYTES + 1)
    enough = FREE_PIECE_BYTES // MAX_RATIO + 1
    check_piece(enough, FREE_PIECE_BYTES + 1)
    check_piece(MAX_PIECE_BYTES, MAX_PIECE_BYTES)
    with pytest.raises(RefusedDataError, match="256 MiB"):
        check_piece(MAX_PIECE_BYTES + 1, MAX_PIECE_BYTES + 1)


def test_a_file_has_a_limit_over_all_of_its_pieces() -> None:
    small, large = DecompressionBudget(1), DecompressionBudget(FREE_TOTAL_BYTES)
    for _ in range(8):
        small.spend(FREE_PIECE_BYTES)
        large.spend(FREE_PIECE_BYTES)
    with pytest.raises(RefusedDataError, match="1,000 times its size"):
        small.spend(1)
    large.spend(1)


def test_what_is_unpacked_for_an_iterator_counts_and_nothing_else() -> None:
    def pieces() -> Iterator[int]:
        for number in range(20):
            check_piece(1, FREE_PIECE_BYTES)
            yield number

    seen = []
    with pytest.raises(RefusedDataError):
        for number in spend_for_each(pieces(), DecompressionBudget(1)):
            seen.append(number)
            check_piece(1, FREE_PIECE_BYTES)
    assert seen == list(range(FREE_TOTAL_BYTES // FREE_PIECE_BYTES))


@pytest.mark.parametrize(("pack", "unpack"), FORMATS)
@pytest.mark.parametrize("size", [0, 1, 100_000])
def test_frames_are_unpacked_one_after_another(pack: Pack, unpack: Unpack, size: int) -> None:
    content = bytes(range(256)) * (size // 256) + b"x" * (size % 256)
    assert unpack(pack(content)) == content
    assert unpack(pack(content), size) == content
    assert unpack(pack(content) + pack(b"more"), size + 4) == content + b"more"


@pytest.mark.parametrize(("pack", "unpack"), FORMATS)
def test_what_states_too_little_or_is_cut_off_is_an_error(pack: Pack, unpack: Unpack) -> None:
    packed = pack(b"x" * 1000)
    with pytest.raises(RefusedDataError, match="more than it states"):
        unpack(packed, 999)
    with pytest.raises(RefusedDataError, match="more than it states"):
        unpack(packed + packed, 1000)
    with pytest.raises(ValueError, match="ends before its end marker"):
        unpack(packed[:-6])


@pytest.mark.parametrize(("pack", "unpack"), FORMATS)
def test_unpacking_stops_at_the_limit_where_no_size_is_stated(pack: Pack, unpack: Unpack) -> None:
    packed = pack(bytes(8 << 20)) * 40
    assert max_unpacked(len(packed)) < 320 << 20
    with pytest.raises(RefusedDataError):
        unpack(packed)
