"""Promise: `--max-bytes` is the most that each file of a bag unpacks to, in every verb."""

from __future__ import annotations

import contextlib
import io
from pathlib import Path

import pytest

from data_bags import text, write_bag, write_mcap, write_ros1
from r2bspec.cli.main import main
from r2bspec.safe_io.decompression_budget import chosen_max_bytes, max_unpacked, max_unpacked_bytes
from r2bspec.safe_io.limits import MAX_PIECE_BYTES

# Every frame is 64 KiB of one letter, which packs very well.
MESSAGES = [("/a", number, text("x" * 65_536)) for number in range(10)]
ALL_BYTES = 10 * 65_536

SPEC = """\
r2bspec: 1
name: packed
data_loader: {bag: PLACE, topics: {/a: a}}
playback: {inputs: {image: {from: a, format: std_msgs/msg/String}}}
graph: {nodes: {n: {command: [x], subscribes: {a: std_msgs/msg/String}}}}
monitors: {output: {topic: output, format: std_msgs/msg/String}}
benchmark: {rates: [30 Hz]}
"""


def every_bag(folder: Path) -> list[Path]:
    return [
        write_bag(folder / "messages", MESSAGES, compression="message"),
        write_bag(folder / "files", MESSAGES, compression="file"),
        write_bag(folder / "chunks", MESSAGES, storage="mcap", compression="storage"),
        write_mcap(folder / "lone.mcap", MESSAGES),
        write_ros1(folder / "old.bag", MESSAGES, compression="bz2"),
    ]


def invoke(*arguments: str | Path) -> tuple[int, str]:
    """The exit status and all output."""
    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        status = main([str(each) for each in arguments])
    return status, said.getvalue()


def test_a_bag_that_unpacks_to_more_is_refused(tmp_path: Path) -> None:
    for bag in every_bag(tmp_path):
        status, said = invoke("data", "verify", bag, "--max-bytes", str(ALL_BYTES // 2))
        assert status == 1, (bag, said)
        assert "--max-bytes" in said, bag
        status, said = invoke("data", "verify", bag, "--max-bytes", "2 MiB")
        assert status == 0, (bag, said)
        assert chosen_max_bytes() is None, "the limit ends with the verb"


@pytest.mark.parametrize("verb", ["validate", "plan"])
def test_the_index_of_a_bag_is_enough_to_refuse_it(verb: str, tmp_path: Path) -> None:
    write_bag(tmp_path / "bag", MESSAGES, storage="mcap", compression="storage")
    spec = tmp_path / "packed.r2b.yaml"
    spec.write_text(SPEC.replace("PLACE", "./bag"), encoding="utf-8")
    status, said = invoke(verb, spec, "--max-bytes", "100 kB")
    assert status in (1, 2)
    if verb == "validate":
        assert "the 100,000 bytes of --max-bytes" in said
    status, said = invoke(verb, spec, "--max-bytes", "1 MB")
    assert "--max-bytes" not in said


def test_info_refuses_it_too(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", MESSAGES, storage="mcap", compression="storage")
    status, said = invoke("data", "info", bag, "--max-bytes", "100 kB")
    assert status == 2
    assert "the 100,000 bytes of --max-bytes" in said
    assert invoke("data", "info", bag, "--max-bytes", "1 MB")[0] == 0


def test_the_limit_takes_the_place_of_the_ratio() -> None:
    with max_unpacked_bytes(1 << 40):
        assert max_unpacked(1) == MAX_PIECE_BYTES
    with max_unpacked_bytes(1000):
        assert max_unpacked(1 << 30) == 1000


def test_an_index_in_the_cache_does_not_stand_in_for_the_check(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr("r2bspec.check.bag_facts._MIN_CACHED_BYTES", 1)
    write_bag(tmp_path / "bag", MESSAGES, storage="mcap", compression="storage")
    spec = tmp_path / "packed.r2b.yaml"
    spec.write_text(SPEC.replace("PLACE", "./bag"), encoding="utf-8")
    invoke("validate", spec)
    entries = list((tmp_path / "cache").rglob("*.json"))
    assert entries
    assert "--max-bytes" in invoke("validate", spec, "--max-bytes", "100 kB")[1]
    # No other user may read the names of topics, or put an index of theirs there.
    for each in entries:
        assert each.stat().st_mode & 0o077 == 0
        assert each.parent.stat().st_mode & 0o077 == 0


@pytest.mark.parametrize("size", ["0", "-1", "many", "1 s", "9" * 30, "1e999 GiB"])
def test_what_is_no_size_is_refused(size: str, tmp_path: Path) -> None:
    status, said = invoke("data", "info", tmp_path, f"--max-bytes={size}")
    assert status == 2
    assert "max-bytes" in said
