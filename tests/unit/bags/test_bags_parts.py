"""Recordings with a gap: the part that is meant is found."""

from __future__ import annotations

from pathlib import Path

import pytest

from data_bags import START_NS, text, write_bag
from r2bspec.bags.bag_index import index_bag
from r2bspec.bags.recorded_parts import RecordedParts, find_parts
from r2bspec.bags.recorded_times import read_times
from r2bspec.bags.recording import TimeWindow
from r2bspec.cli.main import main

S_NS = 1_000_000_000


def recorded_at(folder: Path, *times_ns: int) -> Path:
    return write_bag(folder / "bag", [("/scan", time_ns, text("x")) for time_ns in times_ns])


def parts_of(bag: Path, window: TimeWindow | None = None) -> RecordedParts | None:
    index = index_bag(bag)
    times = read_times(bag, index, index.topics, window)
    assert times is not None
    return find_parts(index, times, window)


EARLY = range(1, 6)
LATE = range(1000 * S_NS, 1003 * S_NS, S_NS // 10)


def test_the_part_with_more_messages_is_proposed(tmp_path: Path) -> None:
    parts = parts_of(recorded_at(tmp_path, *EARLY, *LATE))
    assert parts is not None
    assert (parts.count, parts.total) == (30, 35)
    assert parts.window_text == "window: {start: 999.999 s}"
    assert parts.larger.topics["/scan"].rate_hz == pytest.approx(10)
    assert parts.larger.start_ns == START_NS + LATE[0]


def test_static_transforms_before_the_gap_are_of_the_larger_part(tmp_path: Path) -> None:
    early = [("/tf_static", time_ns, text("x")) for time_ns in EARLY]
    late = [("/scan", time_ns, text("x")) for time_ns in LATE]
    parts = parts_of(write_bag(tmp_path / "bag", [*early, *late]))
    assert parts is not None
    counts = {name: topic.count for name, topic in parts.larger.topics.items()}
    assert counts == {"/scan": 30, "/tf_static": 5}


def test_a_part_before_the_gap_has_an_end(tmp_path: Path) -> None:
    late = [time_ns - LATE[0] for time_ns in LATE]
    parts = parts_of(recorded_at(tmp_path, *late, LATE[0]))
    assert parts is not None
    assert parts.window_text == "window: {start: 0 s, end: 2.901 s}"


def test_a_part_with_another_gap_is_split_again(tmp_path: Path) -> None:
    later = [time_ns + 50 * S_NS for time_ns in LATE[:8]]
    parts = parts_of(recorded_at(tmp_path, *EARLY, *LATE, *later))
    assert parts is not None
    assert parts.text == "gaps of 1000 s and 47.1 s, and 30 of its 43 messages in one piece"
    assert parts.window_text == "window: {start: 999.999 s, end: 1002.9 s}"


@pytest.mark.parametrize(
    "times_ns",
    [
        (0,),
        LATE,
        range(0, 300 * S_NS, 5 * S_NS),
        (*range(0, 60 * S_NS, S_NS), *range(100 * S_NS, 160 * S_NS, S_NS)),
    ],
    ids=["one message", "no gap", "slow", "a pause that is shorter than the rest"],
)
def test_what_is_no_gap(tmp_path: Path, times_ns: tuple[int, ...]) -> None:
    assert parts_of(recorded_at(tmp_path, *times_ns)) is None


def test_within_the_proposed_window_there_is_no_gap(tmp_path: Path) -> None:
    bag = recorded_at(tmp_path, *EARLY, *LATE)
    parts = parts_of(bag)
    assert parts is not None
    assert parts_of(bag, parts.window) is None


def test_data_info_proposes_the_window(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bag = recorded_at(tmp_path, *EARLY, *LATE)
    assert main(["data", "info", str(bag)]) == 0
    shown = capsys.readouterr().out
    assert "It has a gap of 1000 s, and 30 of its 35 messages after it" in shown
    assert "use 'window: {start: 999.999 s}'" in shown
