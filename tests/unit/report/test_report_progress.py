"""What a user is told while a run goes on."""

from __future__ import annotations

from collections.abc import Mapping

import pytest

from r2bspec.plan.time_estimate import TimeEstimate
from r2bspec.report.progress import RemainingTime, load_text, progress_text, shown_progress


class Seen:
    """Half of a stretch, which counts how often its latencies are asked for."""

    looks = 0

    def sent(self) -> int:
        return 50

    def received(self) -> int:
        return 48

    def p99_ns(self) -> int | None:
        self.looks += 1
        return 12_300_000

    def cores(self) -> Mapping[str, float]:
        return {"monitor": 0.01, "relay": 0.53, "a\x1b[2J": 0.2, "b": 0.0, "c": 0.0}


def test_a_line_says_how_far_it_is() -> None:
    assert progress_text(Seen(), 100) == "50 of 100 sent · 48 received · p99 12.3 ms"


def test_the_busiest_processes_come_first_and_their_names_do_nothing() -> None:
    said = load_text(Seen().cores())
    assert said.startswith("CPU relay 53 % · a")
    assert "\x1b" not in said
    assert load_text({}) == ""


def test_without_a_terminal_a_stretch_is_one_line_unless_it_is_long(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    seen, now = Seen(), [100.0]
    monkeypatch.setattr("r2bspec.report.progress.time.monotonic", lambda: now[0])
    with shown_progress() as listener:
        listener.segment("20 Hz, iteration 1 of 2", 100)
        for _ in range(100):
            now[0] += 0.25
            listener.playing(seen)
    said = capsys.readouterr().err.splitlines()
    # A quarter of a minute and more, told every ten seconds.
    assert len(said) == 1 + 2
    assert said[1].endswith("p99 12.3 ms · " + load_text(seen.cores()))
    assert seen.looks == 2


def test_the_log_of_a_ci_job_has_a_line_a_minute_and_each_note_once(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    seen, now = Seen(), [100.0]
    monkeypatch.setattr("r2bspec.report.progress.time.monotonic", lambda: now[0])
    monkeypatch.setenv("CI", "true")
    estimate = TimeEstimate({"load": 1.0, "play": 200.0}, 201.0)
    remaining = RemainingTime(estimate, clock=lambda: now[0])
    with shown_progress(remaining=remaining) as listener:
        listener.phase("load", "reading a bag")
        listener.note("/image: 15 messages")
        listener.note("/image: 15 messages")
        listener.phase("play", "playing at fixed rates")
        for number in range(20):
            listener.segment(f"20 Hz, iteration {number}", 100)
            for _ in range(40):
                now[0] += 0.25
                listener.playing(seen)
    said = capsys.readouterr().err.splitlines()
    # 200 s, a note, and a line at the start.
    assert len(said) == 1 + 1 + 3
    assert said[0].endswith("reading a bag · about 4 min left")
    assert "playing at fixed rates · 20 Hz, iteration 5" in said[2]
    assert said[2].endswith("about 3 min left")


def test_the_remaining_time_counts_phases_and_runs() -> None:
    now = [0.0]
    estimate = TimeEstimate({"load": 10.0, "start": 5.0, "play": 100.0}, 230.0, runs=2)
    remaining = RemainingTime(estimate, after_s=7.0, clock=lambda: now[0])
    assert remaining.seconds() == 2 * 115 + 7
    remaining.begin("load")
    now[0] += 4
    assert remaining.seconds() == 2 * 115 + 7 - 4
    remaining.begin("a phase that nobody has planned")
    remaining.begin("play")
    assert remaining.seconds() == 100 + 115 + 7
    now[0] += 500
    assert remaining.seconds() == 115 + 7
    remaining.begin("load")
    assert remaining.seconds() == 115 + 7


def test_nobody_looks_where_nobody_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    seen = Seen()
    with shown_progress(quiet=True) as listener:
        listener.segment("20 Hz, iteration 1 of 2", 100)
        for _ in range(10):
            listener.playing(seen)
    assert (seen.looks, capsys.readouterr().err) == (0, "")
