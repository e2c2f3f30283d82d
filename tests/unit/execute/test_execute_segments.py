"""Segments of which outputs stop, come late, and go on; player and graph are scripted rows."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import msgspec
import pytest

from r2bspec.execute.processes.resources import ResourceSampler
from r2bspec.execute.start.segments import PLAYBACK_ROWS, SegmentHeading, SegmentPlayer
from r2bspec.ipc import protocol
from r2bspec.ipc.sample_files import RowWriter
from r2bspec.ipc.schedule import CyclicSchedule
from r2bspec.language.quantities import Duration
from r2bspec.record.run_folder import RunFolder
from r2bspec.record.run_record import ProcessRecord
from run_simulation import Simulation
from scripted_playback import ScriptedPlayback

STEPS = 20
PERIOD_NS = 10_000_000
ANSWER_NS = 1_000_000


class Scripted:
    """Writes what player and monitor would have written, as a script of each segment says."""

    def __init__(self, rows_dir: Path) -> None:
        self.inbox: deque[protocol.Played] = deque()
        self.segments: deque[Sequence[int]] = deque()
        self.late: dict[int, Callable[[], None]] = {}
        self._played = 0
        self._pumped = 0
        # What is waited for has come before now, however long the machine has been up.
        self._begin_ns = time.monotonic_ns() - 10**9
        self._playback = ScriptedPlayback(rows_dir / PLAYBACK_ROWS)
        self._monitor = RowWriter(rows_dir / "detections.rows", width=5)

    def send(self, command: object) -> None:
        """Play a segment at once, with the answers to the steps of its script."""
        assert isinstance(command, protocol.Play)
        first, answered = self._played, self.segments.popleft()
        for step in range(first, first + command.steps):
            due_ns = self._begin_ns + step * PERIOD_NS
            self._playback.append(step + 1, due_ns, due_ns, due_ns)
        self._played += command.steps
        for number in answered:
            self.answer(first + number)
        self._pumped = 0
        self.inbox.append(protocol.Played(steps=command.steps))

    def answer(self, step: int) -> None:
        """The graph answers a step of any segment."""
        received_ns = self._begin_ns + step * PERIOD_NS + ANSWER_NS
        self._monitor.append(step + 1, received_ns, received_ns + 1, 100, 0)

    def pump(self, timeout_s: float = 0.0) -> None:
        """What the controller does while it waits."""
        time.sleep(timeout_s)
        self._pumped += 1
        self.late.pop(self._pumped, lambda: None)()

    def __iter__(self) -> Iterator[object]:
        """It has no processes whose load could be shown."""
        return iter(())

    def records(self) -> tuple[ProcessRecord, ...]:
        """It has no processes whose processor time could be told."""
        return ()

    def close(self) -> None:
        """Close the files."""
        self._monitor.close()


@pytest.fixture
def scripted(tmp_path: Path) -> Iterator[Scripted]:
    found = Scripted(tmp_path)
    yield found
    found.close()


@pytest.fixture
def player(tmp_path: Path, scripted: Scripted) -> SegmentPlayer:
    def nothing(*_: object) -> None:
        """Progress is not shown."""

    context = SimpleNamespace(
        supervisor=scripted,
        folder=RunFolder.create(tmp_path / "run"),
        progress=SimpleNamespace(segment=nothing, playing=nothing),
        on_segment=nothing,
        resources=ResourceSampler(),
    )
    return SegmentPlayer(
        Simulation().plan(),
        cast("Any", context),
        cast("Any", scripted),
        tmp_path,
        schedule=CyclicSchedule(steps=((0,),)),
    )


def answered(player: SegmentPlayer, number: int) -> int:
    heading = SegmentHeading("iteration", f"iteration-{number:03d}", "", number)
    matched = player.play(heading, 1e9 / PERIOD_NS, STEPS).matched("detections")
    return int(matched.matching.answered.sum())


def test_an_output_that_stops_is_reported_once_and_waited_for_again_when_it_goes_on(
    player: SegmentPlayer, scripted: Scripted
) -> None:
    stopped: list[str] = []
    player.on_output_stopped = lambda segment, _: stopped.append(segment.id)
    everything, half = range(STEPS), range(STEPS // 2)
    scripted.segments.extend([everything, half, everything])
    cast("Any", player)._plan = player_plan(player, drain_ns=10**8)
    assert [answered(player, number) for number in (1, 2, 3)] == [STEPS, STEPS // 2, STEPS]
    assert stopped == ["iteration-002"]
    # It goes on: the rest of the next segment comes late, and is waited for.
    cast("Any", player)._plan = player_plan(player, drain_ns=30 * 10**9)
    scripted.segments.append(half)
    first = 3 * STEPS

    def the_rest() -> None:
        for step in range(STEPS // 2, STEPS):
            scripted.answer(first + step)

    scripted.late[60] = the_rest
    assert answered(player, 4) == STEPS
    assert stopped == ["iteration-002"]


def player_plan(player: SegmentPlayer, drain_ns: int) -> Any:
    """The plan with another drain timeout."""
    return msgspec.structs.replace(cast("Any", player)._plan, drain_timeout=Duration(drain_ns))


def test_late_outputs_that_are_discarded_are_counted(
    player: SegmentPlayer, scripted: Scripted
) -> None:
    cast("Any", player)._plan = player_plan(player, drain_ns=10**8)
    scripted.segments.append(range(STEPS // 2))
    assert answered(player, 1) == STEPS // 2
    for step in (12, 13, 13, 14, 500):
        scripted.answer(step)
    # Once each, and not what belongs to no step of a segment.
    assert player.discard_new_rows() == {"detections": 3}
    scripted.segments.append(range(STEPS))
    assert answered(player, 2) == STEPS
