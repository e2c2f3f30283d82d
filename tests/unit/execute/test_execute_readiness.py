"""What a start waits for: probes of logs in time proportional to the log, and one deadline."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from r2bspec.execute.bringup.readiness import LogSearch, StartDeadline
from r2bspec.safe_io.line_pattern import PatternError, compile_line_pattern

FOREVER = float("inf")


def search(log: Path, pattern: str) -> LogSearch:
    return LogSearch(log, compile_line_pattern(pattern))


@pytest.mark.parametrize(
    "pattern", ["(a+)+$", "^(a|a)*$", "(a|aa)+$", "(.*a){20}$", "^a*a*a*a*a*a*$"]
)
def test_a_pattern_that_could_match_in_many_ways_takes_no_longer(
    pattern: str, tmp_path: Path
) -> None:
    log = tmp_path / "log"
    costs = []
    for length in (20_000, 40_000):
        log.write_text("a" * length + "b")
        started = time.process_time()
        assert not search(log, pattern).finds(FOREVER)
        costs.append(time.process_time() - started)
    # With a matcher that tries combinations not even the first would end.
    assert costs[1] <= 4 * costs[0] + 0.1


def test_a_line_is_found_as_soon_as_it_is_written_in_whole_or_in_part(tmp_path: Path) -> None:
    log = tmp_path / "log"
    probe = search(log, "model (un)?loaded")
    assert not probe.finds(FOREVER)
    log.write_text("starting\nmodel lo")
    assert not probe.finds(FOREVER)
    with log.open("a") as stream:
        stream.write("aded")
    assert probe.finds(FOREVER)


def test_only_what_was_added_is_read_again(tmp_path: Path) -> None:
    log = tmp_path / "log"
    log.write_text("ready\n")
    probe = search(log, "^ready$")
    assert probe.finds(FOREVER)
    assert not probe.finds(FOREVER)


def test_a_log_that_was_cut_is_read_from_its_beginning(tmp_path: Path) -> None:
    log = tmp_path / "log"
    probe = search(log, "ready")
    log.write_text("x" * 100)
    assert not probe.finds(FOREVER)
    log.write_text("ready")
    assert probe.finds(FOREVER)


def test_a_long_log_is_not_read_beyond_the_deadline(tmp_path: Path) -> None:
    log = tmp_path / "log"
    log.write_text(("x" * 99 + "\n") * 2_000 + "ready\n")
    probe = search(log, "ready")
    assert not probe.finds(0.0)
    assert probe.finds(FOREVER)


@pytest.mark.parametrize("pattern", ["started (", "(?=a)", r"(a)\1", "(a{1000}){1000}", "[b-a]"])
def test_what_is_no_pattern_is_named_with_its_wrong_part(pattern: str) -> None:
    with pytest.raises(PatternError) as caught:
        compile_line_pattern(pattern)
    offset, length = caught.value.part
    assert 0 <= offset < len(pattern)
    assert 0 < length <= len(pattern) - offset
    assert str(caught.value)


def test_what_an_earlier_process_wrote_is_not_read(tmp_path: Path) -> None:
    log = tmp_path / "log"
    log.write_text("model loaded\n")
    pattern = compile_line_pattern("model loaded")
    probe = LogSearch(log, pattern, log.stat().st_size)
    assert not probe.finds(FOREVER)
    with log.open("a") as more:
        more.write("model loaded\n")
    assert probe.finds(FOREVER)


class Clock:
    now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


def test_every_step_of_a_start_has_what_the_earlier_ones_left() -> None:
    clock = Clock()
    deadline = StartDeadline(30 * 10**9, clock)
    assert deadline.left_s == 30.0
    clock.now_s += 20
    assert deadline.left_s == 10.0
    clock.now_s += 9
    assert (deadline.left_s, deadline.over) == (1.0, False)
    clock.now_s += 2
    assert (deadline.left_s, deadline.over) == (0.0, True)
    assert deadline.timeout_s == 30.0


def test_what_has_a_timeout_of_its_own_is_left_out() -> None:
    clock = Clock()
    deadline = StartDeadline(30 * 10**9, clock)
    clock.now_s += 10
    with deadline.paused():
        clock.now_s += 60
    assert deadline.left_s == 20.0
