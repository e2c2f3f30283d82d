"""When an output counts as fallen silent, by what was recorded of it."""

from __future__ import annotations

import numpy as np
import pytest

from r2bspec.execute.measurement.segment_observation import output_stopped
from r2bspec.judge.measure.matching import Ratio, match
from r2bspec.record.sample_arrays import MONITOR_DTYPE
from run_simulation import EPOCH_NS, Played, monitor_rows, playback_rows

NAN = float("nan")


@pytest.mark.parametrize(
    ("latency", "silent"),
    [
        ([0.01] * 20, False),
        ([0.01] * 10 + [NAN] * 10, True),
        ([NAN] * 20, True),
        ([0.01] * 16 + [NAN] * 4, False),  # so few may be lost by chance
        ([NAN] * 4, False),
        ([0.01, *[NAN] * 7] * 3, False),  # one of eight, as before
        ([0.01] + [NAN] * 19, True),
        ([], False),
        # Overloaded: each answer later than the one before, and all of them after the end.
        (list(np.linspace(0.1, 9.0, 20)), False),
    ],
)
def test_an_output_is_silent_if_much_is_waited_for_in_vain(
    latency: list[float], silent: bool
) -> None:
    played = Played(20, latency)
    playback = playback_rows(played)
    rows = monitor_rows(played, playback)
    assert output_stopped(playback, rows, match(playback, rows, "stamp")) is silent


def test_messages_of_no_step_are_no_silence() -> None:
    played = Played(20, [0.01] * 20)
    playback = playback_rows(played)
    rows = monitor_rows(played, playback)
    rows["stamp_ns"] += 1
    assert not output_stopped(playback, rows, match(playback, rows, "stamp"))


def test_a_graph_that_answers_every_tenth_step_is_not_silent_between() -> None:
    playback = playback_rows(Played(20, [0.0] * 30))
    rows = np.zeros(2, MONITOR_DTYPE)
    rows["received_ns"] = EPOCH_NS + np.array([460_000_000, 960_000_000])
    ratio = Ratio(inputs=10)
    assert not output_stopped(playback, rows, match(playback, rows, "order", ratio))
