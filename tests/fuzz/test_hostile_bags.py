"""Bags and histories made to fill memory or to run without end.

As in `test_hostile_files`, every command runs in little address space.
"""

from __future__ import annotations

import bz2
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hostile_calls import LONGEST_S, answered, change_database, make_history, make_special
from hostile_inputs import SPEC, zeros
from mcap.writer import IndexType

from data_bags import text, write_bag, write_mcap, write_ros1
from nightly import size
from r2bspec.safe_io import limits

pytestmark = pytest.mark.timeout(4 * LONGEST_S)

BOMB_BYTES = 1_500 << 20
MESSAGES = [("/a", number, text("x")) for number in range(5)]


def refused(bag: Path, reason: str, *, code: str = "R2B30") -> None:
    """Every verb that reads a bag names the reason, and ends."""
    spec = bag.parent / "hostile.r2b.yaml"
    spec.write_text(SPEC.replace("./bag", f"./{bag.name}"), encoding="utf-8")
    for arguments in (("validate", spec), ("plan", spec), ("data", "info", bag)):
        said = answered(*arguments, cwd=bag.parent, status=(1, 2), says=reason)
        assert code in said
        assert len(said) < 20_000


def verify_refuses(bag: Path, reason: str) -> None:
    answered("data", "verify", bag, cwd=bag.parent, status=(1, 2), says=reason)


@pytest.fixture(scope="module", name="bomb")
def _bomb() -> bytes:
    return zeros(BOMB_BYTES >> 20)


# metadata.yaml


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        ("- " * 40_000 + "a", "nested more than 100 levels deep"),
        ("[" * 40_000, "nested more than 100 levels deep"),
        ("rosbag2_bagfile_information: {version: 5" + "0" * 400 + "}", "digits"),
        ("rosbag2_bagfile_information: {version: [5]}", "was not written by rosbag2"),
        ("a: &a [1]\n" + "".join(f"b{i}: [*a, *a]\n" for i in range(90_000)), "aliases expand"),
        (b"a: \xff", "not UTF-8"),
        ("x" * 17_000_000, "larger than"),
    ],
    ids=["dashes", "brackets", "digits", "types", "aliases", "not UTF-8", "large"],
)
def test_hostile_metadata_is_refused(content: str | bytes, reason: str, tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", MESSAGES)
    (bag / "metadata.yaml").write_bytes(content if isinstance(content, bytes) else content.encode())
    refused(bag, reason, code="R2B302")


@pytest.mark.parametrize("kind", ["pipe", "zeros"])
@pytest.mark.parametrize("name", ["metadata.yaml", "bag.db3", "dataset.json"])
def test_a_file_of_a_bag_without_an_end_is_refused_or_ignored(
    name: str, kind: str, tmp_path: Path
) -> None:
    bag = write_bag(tmp_path / "bag", MESSAGES)
    (bag / name).unlink(missing_ok=True)
    make_special(bag / name, kind)
    answered("data", "info", bag, cwd=tmp_path, status=0 if name == "dataset.json" else 2)


def test_deep_json_next_to_a_bag_is_answered(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", MESSAGES)
    (bag / "dataset.json").write_text('{"a":' * 100_000, encoding="utf-8")
    answered("data", "info", bag, cwd=tmp_path, status=0)


# sqlite3

ENDLESS = "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n)"


def test_a_database_with_programs_is_refused(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", MESSAGES)
    view = """DROP TABLE message_definitions; CREATE VIEW message_definitions AS
        ENDLESS SELECT i AS id, i AS topic_type, i AS encoding,
        i AS encoded_message_definition, i AS type_description_hash FROM n"""
    change_database(bag / "bag.db3", view.replace("ENDLESS", ENDLESS))
    refused(bag, "it contains a view", code="R2B304")
    verify_refuses(bag, "it contains a view")


def test_a_history_with_programs_is_refused(tmp_path: Path) -> None:
    file = make_history(tmp_path)
    view = "DROP TABLE runs; CREATE VIEW runs AS ENDLESS SELECT i AS run_id FROM n"
    change_database(file, view.replace("ENDLESS", ENDLESS))
    why = "was not written by r2bspec: it contains a"
    answered("history", "list", "--file", file, cwd=tmp_path, status=(1, 2, 3, 4), says=why)


def test_a_history_whose_columns_have_other_types_is_refused(tmp_path: Path) -> None:
    file = make_history(tmp_path)
    columns = (
        "run_id, name, started_at, host, machine, plan, dataset, version, outcome, accepted, "
        "identity"
    )
    change_database(file, f"DROP TABLE runs; CREATE TABLE runs ({columns})")
    marks = ", ".join("?" * 11)
    change_database(file, f"INSERT INTO runs VALUES ({marks})", *[b"x"] * 11)  # noqa: S608
    why = "is damaged, or no history"
    answered("history", "list", "--file", file, cwd=tmp_path, status=(1, 2, 3, 4), says=why)


# Compressed data


def test_a_compressed_message_that_is_a_bomb_is_refused(bomb: bytes, tmp_path: Path) -> None:
    for number, frame in enumerate(
        (bomb, zeros(BOMB_BYTES >> 20, stated=False), bomb[:0] + bomb * 2)
    ):
        bag = write_bag(tmp_path / f"bag{number}", MESSAGES, compression="message")
        change_database(bag / f"{bag.name}.db3", "UPDATE messages SET data = ?", frame)
        verify_refuses(bag, "a message or chunk unpacks to")


def test_a_file_that_is_a_bomb_is_not_unpacked(bomb: bytes, tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", MESSAGES, compression="file")
    (packed,) = bag.glob("*.zstd")
    for frame in (bomb, zeros(BOMB_BYTES >> 20, stated=False)):
        packed.write_bytes(frame)
        verify_refuses(bag, "it unpacks to more than 1,000 times its size")


def _records(data: bytes) -> Iterator[tuple[int, int, bytes]]:
    """Position, opcode and content of the records of an MCAP file."""
    position = 8
    while position < len(data) - 8:
        opcode, length = struct.unpack_from("<BQ", data, position)
        yield position, opcode, data[position + 9 : position + 9 + length]
        position += 9 + length


def _mcap_bomb(file: Path, frame: bytes, stated: int) -> None:
    """A file without summary and index, whose one chunk is the frame."""
    write_mcap(file, MESSAGES)
    records = list(_records(file.read_bytes()))
    header = next(content for _, opcode, content in records if opcode == 1)
    chunk = struct.pack("<QQQI", 0, 1, stated, 0) + struct.pack("<I", 4) + b"zstd"
    chunk += struct.pack("<Q", len(frame)) + frame
    footer = struct.pack("<QQI", 0, 0, 0)
    parts = [b"\x89MCAP0\r\n"]
    for opcode, content in ((1, header), (6, chunk), (2, footer)):
        parts.append(struct.pack("<BQ", opcode, len(content)) + content)
    file.write_bytes(b"".join([*parts, b"\x89MCAP0\r\n"]))


@pytest.mark.parametrize("stated", [BOMB_BYTES, 1000])
def test_a_chunk_that_is_a_bomb_is_refused(stated: int, bomb: bytes, tmp_path: Path) -> None:
    file = tmp_path / "bag.mcap"
    _mcap_bomb(file, bomb, stated)
    refused(file, "a message or chunk unpacks to more than", code="R2B304")


def test_a_chunk_of_ros1_that_is_a_bomb_is_refused(tmp_path: Path) -> None:
    file = write_ros1(tmp_path / "bag.bag", MESSAGES, compression="bz2")
    data = file.read_bytes()
    start = data.index(b"BZh")
    (length,) = struct.unpack_from("<I", data, start - 4)
    frame = bz2.compress(bytes(64 << 20)) * 24
    grown = len(frame) - length
    data = data[: start - 4] + struct.pack("<I", len(frame)) + frame + data[start + length :]
    place = data.index(b"index_pos=") + len("index_pos=")
    (index,) = struct.unpack_from("<Q", data, place)
    file.write_bytes(data[:place] + struct.pack("<Q", index + grown) + data[place + 8 :])
    verify_refuses(file, "a message or chunk unpacks to too much")


def test_what_packs_well_is_still_read(tmp_path: Path) -> None:
    """Black images have a ratio of thousands."""
    messages = [("/a", number, text("\x01" * (4 << 20))) for number in range(8)]
    for bag in (
        write_bag(tmp_path / "a", messages, compression="message"),
        write_bag(tmp_path / "b", messages, storage="mcap", compression="storage"),
        write_bag(tmp_path / "c", messages, compression="file"),
        write_ros1(tmp_path / "d.bag", messages, compression="bz2"),
        write_ros1(tmp_path / "e.bag", messages, compression="lz4"),
    ):
        answered("data", "verify", bag, cwd=tmp_path, status=0)


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"use_chunking": False},
        {"index_types": IndexType.NONE},
        {"index_types": IndexType.NONE, "use_statistics": False},
    ],
)
def test_many_small_messages_are_refused_however_they_are_stored(
    options: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each takes its time, in a chunk of a few kilobytes, too."""
    monkeypatch.setattr(limits, "FREE_MESSAGES", 500)
    messages = [("/a", number, text("")) for number in range(501)]
    file = write_mcap(tmp_path / "x.mcap", messages[:-1], chunk_size=1 << 30, **options)
    allowed = ("--max-bytes", "1 MB")
    for verb in ("info", "verify"):
        answered("data", verb, file.name, cwd=tmp_path, status=0)
    monkeypatch.setattr(limits, "MIN_BYTES_OF_MESSAGE", 100)
    file = write_mcap(tmp_path / "y.mcap", messages, chunk_size=1 << 30, **options)
    for verb, status in (("info", 2), ("verify", 1)):
        said = answered("data", verb, file.name, cwd=tmp_path, status=status)
        assert "has more than 500 messages" in said
        assert "--max-bytes" in said
        answered("data", verb, file.name, *allowed, cwd=tmp_path, status=0)


def test_messages_do_not_count_as_other_records(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(limits, "FREE_RECORDS", 20)
    monkeypatch.setattr(limits, "MIN_BYTES_OF_RECORD", 1 << 30)
    messages = [("/a", number, text("")) for number in range(500)]
    file = write_mcap(tmp_path / "x.mcap", messages)
    answered("data", "verify", file.name, cwd=tmp_path, status=0)


def test_a_hole_in_a_recording_is_refused_and_not_searched(tmp_path: Path) -> None:
    bag = write_mcap(tmp_path / "hole.mcap", [("/a", 0, text("x"))])
    (header,) = struct.unpack_from("<Q", bag.read_bytes(), 9)
    with bag.open("r+b") as stream:
        stream.truncate(17 + header)
        stream.seek(10**12)
        stream.write(struct.pack("<BQQQI", 2, 20, 0, 0, 0) + b"\x89MCAP0\r\n")
    refused(bag, "without an opcode")


@pytest.mark.parametrize("number", [2, size(10_000, 100_000)])
def test_a_chunk_that_is_listed_more_than_once_is_refused(number: int, tmp_path: Path) -> None:
    bag = write_ros1(tmp_path / "twice.bag", [("/a", 0, text("x"))])
    data = bag.read_bytes()
    place = len(data) - _chunk_info_bytes(data)
    bag.write_bytes(
        data.replace(b"chunk_count=\x01\0\0\0", b"chunk_count=" + struct.pack("<I", number))
        + data[place:] * (number - 1)
    )
    refused(bag, "a chunk more than once")


def _chunk_info_bytes(data: bytes) -> int:
    """The length of the record at the end, whose header and content begin with their lengths."""
    return next(
        length
        for length in range(8, 1_000)
        if 8 + sum(_lengths(data[-length:])) == length and b"chunk_pos=" in data[-length:]
    )


def _lengths(record: bytes) -> tuple[int, int]:
    (header,) = struct.unpack_from("<I", record)
    if header + 8 > len(record):
        return (0, 0)
    return header, struct.unpack_from("<I", record, 4 + header)[0]
