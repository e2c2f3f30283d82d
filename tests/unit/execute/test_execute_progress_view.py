"""What is told of a stretch while it is being played."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Literal

import msgspec
import numpy as np
import pytest

from r2bspec.execute.measurement import segment_observation
from r2bspec.execute.measurement.segment_observation import ProgressView
from r2bspec.ipc.arrivals import ARRIVAL_FIELDS, ArrivalReader
from r2bspec.ipc.playback_file import PlaybackReader
from r2bspec.ipc.sample_files import RowWriter
from r2bspec.record.sample_arrays import MONITOR_FIELDS, PLAYBACK_FIELDS
from run_simulation import MONITOR_PLAN
from scripted_playback import ScriptedPlayback

MS = 1_000_000


class Writers:
    """The player and one monitor, as far as their files go."""

    def __init__(self, folder: Path) -> None:
        folder.mkdir(exist_ok=True)
        self.player = ScriptedPlayback(folder / "player")
        self.monitor = RowWriter(folder / "monitor", len(ARRIVAL_FIELDS))
        self.folder = folder
        self.steps = 0

    def play(self, latency_ms: float | None, stamp: int | None = None) -> None:
        """One step, answered after a while or not at all."""
        self.steps += 1
        now_ns = self.steps * 10 * MS
        self.player.append(self.steps, now_ns, now_ns, now_ns)
        if latency_ms is not None:
            received_ns = now_ns + round(latency_ms * MS)
            self.monitor.append(stamp or self.steps, received_ns, received_ns, 0, 0)

    def view(self, match: Literal["stamp", "order"] = "stamp") -> ProgressView:
        """A view of what is played from now on."""
        plan = msgspec.structs.replace(MONITOR_PLAN, match=match)
        player = PlaybackReader(self.folder / "player", PLAYBACK_FIELDS)
        monitor = ArrivalReader(self.folder / "monitor", MONITOR_FIELDS)
        first = {"": player.count(), "out": monitor.count()}
        return ProgressView(player, {"out": (plan, monitor)}, first, lambda: {"relay": 0.5})


@pytest.fixture
def writers(tmp_path: Path) -> Iterator[Writers]:
    found = Writers(tmp_path / "rows")
    yield found
    found.monitor.close()


def test_nothing_has_come_yet(writers: Writers) -> None:
    seen = writers.view()
    assert (seen.sent(), seen.received(), seen.p99_ns()) == (0, 0, None)
    assert seen.cores() == {"relay": 0.5}


@pytest.mark.parametrize("match", ["stamp", "order"])
@pytest.mark.parametrize("look", [lambda _: True, lambda n: n % 97 == 0, lambda n: n == 399])
def test_however_often_it_is_looked_at_it_is_exact(
    writers: Writers, match: Literal["stamp", "order"], look: Callable[[int], bool]
) -> None:
    writers.play(500.0)
    seen = writers.view(match)
    latencies = np.random.default_rng(1).lognormal(2.0, 0.5, 400)
    for number, latency in enumerate(latencies.tolist()):
        writers.play(latency)
        if look(number):
            so_far = np.sort(latencies[: number + 1])
            assert seen.p99_ns() == round(float(so_far[math.ceil(so_far.size * 0.99) - 1]) * MS)
    assert (seen.sent(), seen.received()) == (400, 400)


def test_what_is_lost_or_strange_is_left_out(writers: Writers) -> None:
    seen = writers.view()
    writers.play(None)
    writers.play(3.0, stamp=77)
    writers.play(5.0)
    assert (seen.sent(), seen.received()) == (3, 2)
    assert seen.p99_ns() == 5 * MS


@pytest.mark.parametrize("match", ["stamp", "order"])
def test_of_a_long_segment_only_the_latest_messages_count(
    writers: Writers, match: Literal["stamp", "order"], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(segment_observation, "MAX_ROWS", 200)
    seen = writers.view(match)
    for latency in (500.0, 3.0):
        for _ in range(200):
            writers.play(latency)
    writers.play(None)
    assert (seen.sent(), seen.received()) == (401, 400)
    assert seen.p99_ns() == 3 * MS
