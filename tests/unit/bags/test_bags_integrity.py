"""Hashes see what is said or the bytes on disk; `verify` finds bodies that were changed."""

from __future__ import annotations

import shutil
import sqlite3
from contextlib import closing
from pathlib import Path

import pytest

from data_bags import chatter, refusal_of, storage_file, text, write_bag
from r2bspec.bags.bag_index import index_bag
from r2bspec.bags.integrity import hash_content, hash_files, verify
from r2bspec.bags.recording import TimeWindow
from r2bspec.datasets.synthesis import make


def test_content_is_independent_of_the_date_and_of_the_order_at_one_time(tmp_path: Path) -> None:
    pair = [("/left", 0, text("l")), ("/right", 0, text("r"))]
    late = [(topic, offset_ns + 10**12, data) for topic, offset_ns, data in pair]
    hashes = {
        hash_content(write_bag(tmp_path / f"{number}", messages))
        for number, messages in enumerate((pair, pair[::-1], late))
    }
    assert len(hashes) == 1


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


def test_files_hash_covers_every_file(bag: Path) -> None:
    before = hash_files(bag)
    assert hash_files(bag) == before
    (bag / "notes.txt").write_text("")
    assert hash_files(bag) != before
    assert refusal_of(hash_files, bag / "nothing").code == "R2B301"


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    topics = ["/d455_1_imu", "/d455_1_left_ir_image"]
    window = TimeWindow(end_ns=20_000_000)
    return make("r2b_storage", topics, window, cache_dir=tmp_path_factory.mktemp("made")).path


@pytest.fixture
def copy(made: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(made, tmp_path / "copy"))


def test_a_changed_message_is_found(copy: Path) -> None:
    assert verify(copy) == []
    with closing(sqlite3.connect(storage_file(copy))) as database, database:
        (topic,) = database.execute("SELECT id FROM topics WHERE name = '/d455_1_imu'").fetchone()
        rows = database.execute(
            "SELECT id, data FROM messages WHERE topic_id = ? LIMIT 2", (topic,)
        ).fetchall()
        database.execute("UPDATE messages SET data = ? WHERE id = ?", (rows[1][1], rows[0][0]))
    (problem,) = verify(copy)
    assert problem.startswith("the content hash is ")


@pytest.mark.parametrize(
    ("file", "content", "problem"),
    [
        ("metadata.yaml", None, "R2B302"),
        ("dataset.json", '{"format": "other"}', "dataset.json was not written by"),
    ],
)
def test_another_file_is_found(copy: Path, file: str, content: str | None, problem: str) -> None:
    (copy / file).unlink()
    if content is not None:
        (copy / file).write_text(content)
    (found,) = verify(copy)
    assert problem in found


def test_an_unreadable_bag_is_a_problem_and_no_exception(tmp_path: Path) -> None:
    (problem,) = verify(tmp_path)
    assert "R2B302" in problem


@pytest.mark.parametrize(
    ("name", "messages"),
    [
        ("wbag", 6074),
        ("convert_b_mcap", 75),
        ("cdr_test", 7),
        ("service_events_mcap", 10),
        ("wrong_rmw_test", 7),
        ("talker", 20),
        ("seek_mcap", 5),
        ("empty_bag", 0),
    ],
)
def test_recordings_of_others_are_what_they_say(real_bags: Path, name: str, messages: int) -> None:
    index = index_bag(real_bags / name)
    assert index.message_count == sum(info.count for info in index.topics.values()) == messages
    assert all(info.type.count("/") == 2 for info in index.topics.values())
    assert verify(real_bags / name) == []
