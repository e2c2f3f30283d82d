"""`verify` finds what `index` cannot: bodies that are gone or were changed."""

from __future__ import annotations

import shutil
import sqlite3
from contextlib import closing
from pathlib import Path

import pytest

from data_bags import chatter, storage_file, write_bag
from r2bspec.bags.bag_index import index_bag
from r2bspec.bags.integrity import verify
from r2bspec.bags.recording import SyntheticDataset


@pytest.fixture
def copy(storage_room: SyntheticDataset, tmp_path: Path) -> Path:
    return Path(shutil.copytree(storage_room.path, tmp_path / "copy"))


def test_a_made_dataset_is_what_it_says(storage_room: SyntheticDataset) -> None:
    assert verify(storage_room.path) == []


def test_a_recorded_bag_is_what_it_says(tmp_path: Path) -> None:
    assert verify(write_bag(tmp_path / "bag", chatter())) == []


def test_a_changed_message_is_found(copy: Path) -> None:
    with closing(sqlite3.connect(storage_file(copy))) as database, database:
        (topic,) = database.execute("SELECT id FROM topics WHERE name = '/d455_1_imu'").fetchone()
        rows = database.execute(
            "SELECT id, data FROM messages WHERE topic_id = ? LIMIT 2", (topic,)
        ).fetchall()
        database.execute("UPDATE messages SET data = ? WHERE id = ?", (rows[1][1], rows[0][0]))
    (problem,) = verify(copy)
    assert problem.startswith("the content hash is ")


def test_a_changed_file_is_found(copy: Path) -> None:
    (copy / "ground_truth.json").write_text("{}")
    (problem,) = verify(copy)
    assert "ground_truth.json has 2 bytes" in problem


def test_a_missing_file_is_found(copy: Path) -> None:
    (copy / "disparity.npz").unlink()
    (problem,) = verify(copy)
    assert "disparity.npz has 0 bytes" in problem


def test_a_foreign_record_is_found(copy: Path) -> None:
    (copy / "dataset.json").write_text('{"format": "other"}')
    assert verify(copy) == ["dataset.json was not written by 'r2bspec data make'"]


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
