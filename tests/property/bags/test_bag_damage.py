"""Whatever happens to the bytes of a bag: a clear error, or the messages that were recorded.

Promises, each for every format: a file that was cut short at any byte is refused; damage anywhere
is a `DataError` with a code and a way out, or leaves at least the stated number of messages in
order of time.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from data_bags import START_NS, chatter, split_bag, storage_file, write_bag, write_mcap
from nightly import size
from r2bspec.bags.bag_index import index_bag
from r2bspec.bags.bag_reader import read_messages
from r2bspec.bags.integrity import hash_files, verify
from r2bspec.bags.recording import DataError

MESSAGES = chatter(12)
CHANGES = size(40, 80)
CODES = {f"R2B{number}" for number in (301, 302, 303, 304, 305, 306, 310, 313)}

Made = tuple[Path, Path]


def _folder(bag: Path) -> Made:
    return bag, storage_file(bag)


def _metadata(bag: Path) -> Made:
    return bag, bag / "metadata.yaml"


def _alone(file: Path) -> Made:
    return file, file


# What is opened, and which of its files is damaged.
VICTIMS: dict[str, Callable[[Path], Made]] = {
    "sqlite3": lambda at: _folder(write_bag(at / "bag", MESSAGES)),
    "sqlite3, by message": lambda at: _folder(
        write_bag(at / "bag", MESSAGES, compression="message")
    ),
    "sqlite3, by file": lambda at: _folder(write_bag(at / "bag", MESSAGES, compression="file")),
    "sqlite3, alone": lambda at: _alone(storage_file(write_bag(at / "bag", MESSAGES))),
    "mcap": lambda at: _folder(write_bag(at / "bag", MESSAGES, storage="mcap")),
    "mcap, by chunk": lambda at: _alone(write_mcap(at / "bag.mcap", MESSAGES, chunk_size=100)),
    "mcap, no chunks": lambda at: _alone(write_mcap(at / "bag.mcap", MESSAGES, use_chunking=False)),
    "metadata": lambda at: _metadata(write_bag(at / "bag", MESSAGES, compression="message")),
    "metadata of files": lambda at: _metadata(
        split_bag(at / "bag", [MESSAGES[:5], MESSAGES[5:]], compression="file")
    ),
}


@pytest.fixture(params=VICTIMS)
def form(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture
def made(form: str, tmp_path: Path) -> Made:
    return VICTIMS[form](tmp_path)


def use(bag: Path) -> list[tuple[str, int, bytes]]:
    """Everything that is ever done with a bag; returns its messages."""
    index = index_bag(bag)
    found = [
        (message.topic, message.time_ns - START_NS, message.data)
        for message in read_messages(bag, list(index.topics))
    ]
    assert len(found) == index.message_count
    times = [time_ns for _, time_ns, _ in found]
    assert times == sorted(times)
    hash_files(bag)
    return found


def outcome(bag: Path) -> list[tuple[str, int, bytes]] | None:
    """The messages, or None after an error that a person can use."""
    try:
        return use(bag)
    except DataError as caught:
        error = caught
    assert error.code in CODES
    assert error.hint
    assert len(str(error).splitlines()) == 1
    # What is not CDR is only wrong for who wants to play it.
    assert verify(bag) or error.code == "R2B306"
    return None


def places(length: int) -> Iterator[int]:
    """Where to cut: every byte of both ends, and a dense sample of what is between."""
    ends, between = size(25, 150), size(20, 100)
    yield from range(min(ends, length))
    yield from range(ends, length - ends, max(1, (length - 2 * ends) // between) | 1)
    yield from range(max(ends, length - ends), length)


def test_a_file_cut_at_any_byte_is_refused(form: str, made: Made) -> None:
    bag, file = made
    whole = file.read_bytes()
    assert use(bag) == MESSAGES
    for place in places(len(whole)):
        file.write_bytes(whole[:place])
        found = outcome(bag)
        if form.startswith("metadata"):
            # What its last lines say is not needed to read the messages.
            assert found in (None, MESSAGES)
        else:
            assert found is None, f"cut at byte {place} of {len(whole)}"


def test_damage_is_an_error_or_leaves_every_message(form: str, made: Made) -> None:
    bag, file = made
    whole = file.read_bytes()
    choose = random.Random(11)  # noqa: S311
    refused = 0
    for number in range(CHANGES):
        file.write_bytes(_damaged(whole, number, choose))
        found = outcome(bag)
        refused += found is None
    assert refused > CHANGES // 4


def _damaged(whole: bytes, number: int, choose: random.Random) -> bytes:
    content = bytearray(whole)
    place = choose.randrange(len(content))
    match number % 4:
        case 0:
            content[place] ^= 1 << choose.randrange(8)
        case 1:
            length = choose.randrange(1, 64)
            content[place : place + length] = bytes(len(content[place : place + length]))
        case 2:
            del content[place : place + choose.randrange(1, 64)]
        case _:
            content[place:place] = choose.randbytes(choose.randrange(1, 64))
    return bytes(content)
