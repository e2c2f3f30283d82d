"""Promise: an output belongs to its step, whichever input's stamp it carries."""

from __future__ import annotations

import numpy as np

from r2bspec.ipc.schedule import CyclicSchedule, TimelineMessage, TimelineSchedule, TimelineStep
from r2bspec.judge.measure.matching import StepStamps
from r2bspec.record.sample_arrays import MONITOR_DTYPE, PLAYBACK_DTYPE, Rows

OFFSETS = ((0, -3), (-5, 0))


def played(*stamps_ns: int) -> Rows:
    rows = np.zeros(len(stamps_ns), PLAYBACK_DTYPE)
    rows["stamp_ns"] = stamps_ns
    return rows


def received(*stamps_ns: int) -> Rows:
    rows = np.zeros(len(stamps_ns), MONITOR_DTYPE)
    rows["stamp_ns"] = stamps_ns
    return rows


def cyclic() -> StepStamps:
    return StepStamps(CyclicSchedule(steps=((0, 0), (1, 1)), stamp_offsets_ns=OFFSETS))


def test_the_stamp_of_each_input_is_that_of_the_step() -> None:
    found = cyclic().replace(received(100, 97, 200, 195, 150), played(100, 200), 0)
    assert found["stamp_ns"].tolist() == [100, 100, 200, 200, 150]


def test_a_round_goes_on_where_the_last_playback_ended() -> None:
    found = cyclic().replace(received(95, 197, 97), played(100, 200), 7)
    assert found["stamp_ns"].tolist() == [100, 200, 97]


def test_a_timeline_begins_anew_with_each_playback() -> None:
    schedule = TimelineSchedule(
        steps=(TimelineStep(0, 3), TimelineStep(9, 3)),
        messages=(TimelineMessage(0, 0, 0, 0),),
        origin_ns=0,
        period_ns=1,
        stamp_period_ns=1,
        inputs=2,
        stamp_offsets_ns=OFFSETS,
    )
    found = StepStamps(schedule).replace(received(97, 195), played(100, 200), 7)
    assert found["stamp_ns"].tolist() == [100, 200]


def test_late_outputs_of_earlier_playbacks_are_known() -> None:
    stamps = cyclic()
    stamps.remember(played(100, 200), 0)
    found = stamps.replace(received(97, 195, 297), played(300, 400), 2)
    assert found["stamp_ns"].tolist() == [100, 200, 300]


def test_nothing_changes_where_the_stamps_of_a_step_are_equal() -> None:
    rows = received(1, 2, 3)
    assert StepStamps(CyclicSchedule(steps=((0,),))).replace(rows, played(1, 2), 0) is rows


def test_earlier_steps_are_known_in_whatever_order_their_stamps_came() -> None:
    stamps = cyclic()
    stamps.remember(played(500, 600), 0)
    stamps.remember(played(100, 200), 2)
    stamps.remember(played(300), 4)
    found = stamps.replace(received(597, 197, 97, 595, 297, 195), played(900), 5)
    assert found["stamp_ns"].tolist() == [597, 197, 100, 600, 300, 200]
