"""Promise: a recording that cannot be used is named, with what is wrong and a way out.

Every verb that opens it says so, with exit status 2 (1 where a verdict on the recording is what was
asked for), without a stack trace, and `run` starts nothing.
"""

from __future__ import annotations

import os
import shutil
import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest
import yaml

from command_line import Call
from data_bags import STRING, chatter, edit_metadata, split_bag, storage_file, text, write_bag
from r2bspec.report.findings_text import code_with_slug
from ros_runs import quick_input, relay_node, relay_spec

MESSAGES = chatter(30)
LFS_POINTER = "version https://git-lfs.github.com/spec/v1\noid sha256:00\nsize 14\n"


def spec_of(bag: Path, topic: str = "/ping", kind: str = STRING, window: str = "{}") -> Path:
    """A spec that plays a topic of the bag through a relay."""
    spec = relay_spec(
        data_loader={
            "bag": str(bag),
            "topics": {topic: "loaded"},
            "window": yaml.safe_load(window),
        },
        playback={"buffer": 0, "inputs": {"input": quick_input("loaded", kind)}},
        graph={"nodes": {"relay": relay_node(parameters={"format": kind})}},
        monitors={"out": {"topic": "output", "format": kind, "match": "order"}},
    )
    path = bag.parent / "spec.r2b.yaml"
    path.write_text(yaml.safe_dump(spec))
    return path


def _cut(bag: Path) -> Path:
    file = bag if bag.is_file() else storage_file(bag)
    file.write_bytes(file.read_bytes()[: file.stat().st_size * 2 // 3])
    return bag


def _stored(at: Path, make: Callable[[Path], object]) -> Path:
    """A bag with something else in place of its storage."""
    bag = write_bag(at, MESSAGES)
    file = storage_file(bag)
    file.unlink()
    make(file)
    return bag


def _made(path: Path, make: Callable[[Path], object]) -> Path:
    make(path)
    return path


def _without_a_part(at: Path) -> Path:
    bag = split_bag(at, [MESSAGES[:10], MESSAGES[10:]])
    (bag / "bag_1.db3").unlink()
    return bag


def _recorder_killed(at: Path) -> Path:
    """A database whose last messages are in its write-ahead log only."""
    bag = write_bag(at, MESSAGES)
    file = storage_file(bag)
    with closing(sqlite3.connect(file, isolation_level=None)) as database:
        database.execute("PRAGMA journal_mode=WAL")
        database.execute("PRAGMA wal_autocheckpoint=0")
        database.execute("DELETE FROM messages WHERE id > 20")
        copy = bag.with_name("killed")
        shutil.copytree(bag, copy)
    (copy / "bag.db3-shm").unlink()
    return copy


def _recorder_killed_on_a_read_only_disk(at: Path) -> Path:
    bag = _recorder_killed(at)
    for each in (*bag.iterdir(), bag):
        each.chmod(0o555 if each.is_dir() else 0o444)
    return bag


def _lie(at: Path) -> Path:
    bag = write_bag(at, MESSAGES)
    edit_metadata(bag, "message_count: 15", "message_count: 14", count=1)
    return bag


def _loop(at: Path) -> Path:
    at.symlink_to(at.with_name("other"))
    at.with_name("other").symlink_to(at)
    return at


def _unreadable(at: Path) -> Path:
    if os.geteuid() == 0:
        pytest.skip("root reads everything")
    bag = write_bag(at, MESSAGES)
    storage_file(bag).chmod(0)
    return bag


FAULTS: dict[str, tuple[Callable[[Path], Path], str, str]] = {
    "sqlite3 cut short": (lambda at: _cut(write_bag(at, MESSAGES)), "R2B304", "bytes of"),
    "MCAP cut short": (
        lambda at: _cut(write_bag(at, MESSAGES, storage="mcap")),
        "R2B304",
        "ends before its footer",
    ),
    "a part of a split recording is missing": (_without_a_part, "R2B303", "has no bag_1.db3"),
    "the recorder was killed": (_recorder_killed, "R2B313", "bag.db3-wal"),
    "the same on a read-only disk": (
        _recorder_killed_on_a_read_only_disk,
        "R2B313",
        "wal_checkpoint",
    ),
    "a Git LFS pointer": (
        lambda at: _stored(at, lambda file: file.write_text(LFS_POINTER)),
        "R2B305",
        "git lfs pull",
    ),
    "metadata that lies": (_lie, "R2B310", "/ping: 14 stated, 15 stored"),
    "a folder named like a file": (
        lambda at: _made(at.with_suffix(".mcap"), Path.mkdir),
        "R2B302",
        "no metadata.yaml",
    ),
    "a file that is a folder": (lambda at: _stored(at, Path.mkdir), "R2B303", "bag.db3"),
    "links in a circle": (_loop, "R2B301", "does not exist"),
    "a link to nothing": (
        lambda at: _stored(at, lambda file: file.symlink_to("gone.db3")),
        "R2B303",
        "bag.db3",
    ),
    "no permission": (_unreadable, "R2B304", "permissions"),
    "an empty file": (
        lambda at: _made(at.with_suffix(".mcap"), Path.touch),
        "R2B304",
        "it is empty, as after a crash of the recorder",
    ),
    "a device": (lambda _: Path("/dev/null"), "R2B304", "neither a bag folder nor"),
    "nothing there": (lambda at: at, "R2B301", "does not exist"),
    "a name that is too long": (lambda at: at.with_name("x" * 300), "R2B301", "does not exist"),
    "a home of nobody": (lambda _: Path("~nobody-knows-me/bag"), "R2B301", "nobody-knows-me"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_every_verb_names_what_is_wrong(fault: str, tmp_path: Path, call: Call) -> None:
    make, code, words = FAULTS[fault]
    bag = make(tmp_path / "bag")
    spec = tmp_path / "spec.r2b.yaml"
    spec_of(bag if bag.is_absolute() and bag.parent == tmp_path else tmp_path / "x").rename(spec)
    if bag.parent != tmp_path:
        spec.write_text(spec.read_text().replace(str(tmp_path / "x"), str(bag)))
    output = tmp_path / "run"
    for arguments, status in (
        (("validate", spec), 1),
        (("plan", spec), 2),
        (("run", spec, "--output", output), 2),
        (("data", "info", bag), 2),
    ):
        said = call(*arguments, status=status)
        told = said.out + said.err
        assert f"error[{code_with_slug(code)}]" in told, arguments[0]
        assert words in told
        assert "help: " in told
        assert "Traceback" not in told
    assert not output.exists()
    verified = call("data", "verify", bag)
    assert verified.status in (1, 2)
    assert words in verified.out + verified.err


# What can be planned but not played


def test_a_topic_without_messages_is_an_error_before_anything_starts(
    tmp_path: Path, call: Call
) -> None:
    bag = write_bag(tmp_path / "bag", MESSAGES, topics=["/quiet"])
    output = tmp_path / "run"
    for spec in (
        spec_of(bag, "/quiet"),
        spec_of(bag, window="{start: 11 ms, end: 12 ms}"),
        spec_of(write_bag(tmp_path / "empty", [], topics=["/ping"])),
    ):
        assert "error[R2B3" in call("run", spec, "--output", output, status=2).err
        assert not output.exists()


def test_damage_that_only_playing_meets_ends_the_run_and_is_named(
    tmp_path: Path, call: Call
) -> None:
    """Bodies are not read before a run: what is wrong with them is told then, and kept."""
    bag = write_bag(tmp_path / "bag", MESSAGES, compression="message")
    with closing(sqlite3.connect(storage_file(bag))) as database, database:
        database.execute("UPDATE messages SET data = substr(data, 1, 9) WHERE id = 7")
    said = call("run", spec_of(bag), "--output", tmp_path / "run")
    assert said.status in (2, 4)
    assert "error[R2B304 bag-file-unreadable]" in said.err
    assert "bag.db3" in said.err
    call("data", "verify", bag, status=1)


def test_a_type_that_is_not_installed_is_named(tmp_path: Path, call: Call) -> None:
    pytest.importorskip("rclpy")
    kind = "nowhere_msgs/msg/Nothing"
    bag = write_bag(tmp_path / "bag", [("/ping", 0, text("x")), ("/ping", 10, text("y"))])
    with closing(sqlite3.connect(storage_file(bag))) as database, database:
        database.execute("UPDATE topics SET type = ?", (kind,))
    edit_metadata(bag, STRING, kind)
    said = call("run", spec_of(bag, kind=kind), "--output", tmp_path / "run", status=2).err
    assert kind in said
    assert "error[R2B681 message-type-not-installed]" in said
    assert "Traceback" not in said
