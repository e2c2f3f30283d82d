"""The content hash sees what is said; the file hash sees the bytes on disk."""

from __future__ import annotations

from pathlib import Path

import pytest

from data_bags import chatter, text, write_bag
from r2bspec.bags.integrity import hash_content, hash_files
from r2bspec.bags.recording import DataError


def test_content_is_independent_of_the_date(tmp_path: Path) -> None:
    late = [(topic, offset_ns + 10**12, data) for topic, offset_ns, data in chatter()]
    assert hash_content(write_bag(tmp_path / "a", chatter())) == hash_content(
        write_bag(tmp_path / "b", late)
    )


def test_content_is_independent_of_the_order_of_simultaneous_messages(tmp_path: Path) -> None:
    pair = [("/left", 0, text("l")), ("/right", 0, text("r"))]
    assert hash_content(write_bag(tmp_path / "a", pair)) == hash_content(
        write_bag(tmp_path / "b", pair[::-1])
    )


@pytest.mark.parametrize(
    "change",
    [
        ("/ping", 40_000_000, text("yxxx")),
        ("/ping", 40_000_001, text("xxxx")),
        ("/pong", 40_000_000, text("xxxx")),
    ],
)
def test_content_sees_every_change(tmp_path: Path, change: tuple[str, int, bytes]) -> None:
    messages = chatter()
    assert messages[4] == ("/ping", 40_000_000, text("xxxx"))
    messages[4] = change
    assert hash_content(write_bag(tmp_path / "a", chatter())) != hash_content(
        write_bag(tmp_path / "b", messages)
    )


def test_files_hash_covers_every_file(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", chatter())
    before = hash_files(bag)
    assert hash_files(bag) == before
    (bag / "notes.txt").write_text("")
    assert hash_files(bag) != before


def test_files_hash_of_what_is_missing(tmp_path: Path) -> None:
    with pytest.raises(DataError) as caught:
        hash_files(tmp_path / "nothing")
    assert caught.value.code == "R2B301"
