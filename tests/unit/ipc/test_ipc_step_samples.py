"""Steps have their rows in the order in which they begin, also where one ends after the next."""

from __future__ import annotations

from pathlib import Path

from r2bspec.ipc.sample_files import RowReader, RowWriter
from r2bspec.ipc.schedule import TimelineMessage, TimelineSchedule, TimelineStep
from r2bspec.ipc.step_samples import StepRows
from r2bspec.record.run_record import PLAYBACK_FIELDS

TIMELINE = TimelineSchedule(
    steps=(TimelineStep(100, 0b11), TimelineStep(105, 0b10), TimelineStep(120, 0b01)),
    messages=(
        TimelineMessage(0, 0, 0, 0),
        TimelineMessage(5, 1, 1, 0),
        TimelineMessage(7, 0, 1, 1),
        TimelineMessage(20, 2, 0, 1),
    ),
    origin_ns=100,
    period_ns=30,
    stamp_period_ns=30,
    inputs=2,
)


def test_a_row_has_the_beginning_and_the_end_of_its_step(tmp_path: Path) -> None:
    writer = RowWriter(tmp_path / "rows", width=5)
    reader = RowReader(tmp_path / "rows", PLAYBACK_FIELDS)
    rows = StepRows(writer)
    counts = []
    for event in TIMELINE.events(0.0, 3):
        at = event.offset_ns
        rows.add_event(event, 1000 + (event.stamp_ns or 0), at, at + 1, at + 2)
        counts.append(reader.count())
    writer.close()
    # The second step is over first, and waits for the row of the first one.
    assert counts == [0, 0, 2, 3]
    assert rows.count == 3
    assert [tuple(row) for row in reader.read().tolist()] == [
        (1000, 0, 1, 9, 0b11),
        (1005, 5, 6, 7, 0b10),
        (1020, 20, 21, 22, 0b01),
    ]


def test_a_step_that_was_cut_short_has_no_row(tmp_path: Path) -> None:
    writer = RowWriter(tmp_path / "rows", width=5)
    rows = StepRows(writer)
    for event in list(TIMELINE.events(0.0, 3))[:2]:
        rows.add_event(event, 0, 0, 0, 0)
    writer.close()
    assert rows.count == 0
    assert RowReader(tmp_path / "rows", PLAYBACK_FIELDS).count() == 0
