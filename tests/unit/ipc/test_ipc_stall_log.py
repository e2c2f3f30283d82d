"""Promise: a monitor that had no processor says so, and for how long."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path

from r2bspec.ipc.sample_files import STALL_FILE, RowWriter, StallLogReader

MS = 1_000_000


def test_what_lies_outside_a_stretch_of_time_does_not_count(tmp_path: Path) -> None:
    reader = StallLogReader(tmp_path)
    with closing(RowWriter(tmp_path / STALL_FILE, width=2)) as rows:
        for began, ended in ((1000, 2000), (5000, 6000), (9000, 9500)):
            rows.append(began * MS, ended * MS)
    assert reader.between(2000 * MS, 5000 * MS) == 0
    assert reader.between(1500 * MS, 5500 * MS) == 1000 * MS
    assert reader.between(0, 20_000 * MS) == 2500 * MS
    assert reader.between(9100 * MS, 9200 * MS) == 100 * MS


def test_a_monitor_that_has_not_begun_was_not_held_up(tmp_path: Path) -> None:
    assert StallLogReader(tmp_path).between(0, 10**12) == 0
