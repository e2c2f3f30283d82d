"""Runs of programs, and of pytest, are in the queue of the host, too."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from queue_members import Member, leave, other_members
from r2bspec import api
from r2bspec.execute.host_queue import HostBusyError, queue_folder
from r2bspec.execute.states import Progress

ROOT = Path(__file__).parents[3]
RELAY = ROOT / "specs" / "relay.r2b.yaml"


class Notes(Progress):
    """What a run says."""

    def __init__(self, on_note: Callable[[], object] = lambda: None) -> None:
        self.texts: list[str] = []
        self._on_note = on_note

    def note(self, text: str) -> None:
        self.texts.append(text)
        self._on_note()


@pytest.fixture
def holder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Member]:
    """Another process that has the host."""
    with other_members(tmp_path, monkeypatch) as join:
        yield join()


@pytest.fixture
def played(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What the tickets say while runs are made, of which none is: this is about the queue."""
    found: list[str] = []

    def make(*_: Any, **__: Any) -> None:
        found.extend(sorted(ticket.read_text() for ticket in queue_folder().iterdir()))

    monkeypatch.setattr(api, "_run_in_folder", make)
    monkeypatch.setattr("r2bspec.compare.interleaved_runs.compare", make)
    return found


@pytest.fixture(scope="module")
def prepared() -> api.PreparedBenchmark:
    return api.prepare(RELAY)


def run(prepared: api.PreparedBenchmark, folder: Path, notes: Notes, **ways: Any) -> None:
    api.run(prepared, folder / "run", notes, **ways)


def run_pairs(prepared: api.PreparedBenchmark, folder: Path, notes: Notes, **ways: Any) -> None:
    api.run_pairs(prepared, (), folder / "pairs", notes, control=True, pairs=2, **ways)


@pytest.mark.parametrize("make", [run, run_pairs])
def test_a_run_waits_and_says_for_whom(
    make: Callable[..., None],
    prepared: api.PreparedBenchmark,
    holder: Member,
    played: list[str],
    tmp_path: Path,
) -> None:
    notes = Notes(lambda: leave(holder))
    make(prepared, tmp_path, notes)
    assert notes.texts == [
        (
            "waiting in place 2 of the queue of this host, behind the other one "
            f"(process {holder.pid}): for an unknown time"
        )
    ]
    (ticket,) = played
    assert f'"process":{os.getpid()}' in ticket
    assert '"seconds":null' not in ticket


@pytest.mark.parametrize("make", [run, run_pairs])
def test_a_run_that_is_not_to_wait_is_refused(
    make: Callable[..., None],
    prepared: api.PreparedBenchmark,
    holder: Member,
    played: list[str],
    tmp_path: Path,
) -> None:
    with pytest.raises(HostBusyError, match=f"the other one \\(process {holder.pid}\\)"):
        make(prepared, tmp_path, Notes(), wait_s=0)
    assert played == []
    assert {each.name for each in tmp_path.iterdir()} == {queue_folder().name}


def test_a_run_outside_of_the_queue_is_made_at_once(
    prepared: api.PreparedBenchmark,
    holder: Member,
    played: list[str],
    tmp_path: Path,
) -> None:
    notes = Notes()
    run(prepared, tmp_path, notes, wait_s=None)
    (ticket,) = played
    assert f'"process":{holder.pid}' in ticket
    assert notes.texts == []
