"""Sample files: one process appends while another reads."""

from __future__ import annotations

import resource
import signal
from contextlib import closing
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from r2bspec.ipc.sample_files import STALL_FILE, RowReader, RowWriter, StallLogReader

FIELDS = (("a", "<i8"), ("b", "<i8"), ("c", "<i8"))

INT64 = st.integers(-(2**63), 2**63 - 1)


def test_a_row_that_is_not_whole_yet_is_none(tmp_path: Path) -> None:
    path = tmp_path / "rows"
    writer = RowWriter(path, width=3)
    writer.append(1, 2, 3)
    whole = path.read_bytes()
    for more in range(1, 24):
        path.write_bytes(whole + bytes(more))
        assert RowReader(path, FIELDS).count() == 1
        assert RowReader(path, FIELDS).read().tolist() == [(1, 2, 3)]
    writer.close()


def test_two_writers_never_share_a_file(tmp_path: Path) -> None:
    writer = RowWriter(tmp_path / "rows", width=3)
    with pytest.raises(FileExistsError):
        RowWriter(tmp_path / "rows", width=3)
    writer.close()


@settings(max_examples=40)
@given(
    rows=st.lists(st.tuples(INT64, INT64, INT64), max_size=70),
    start=st.integers(0, 80),
    stop=st.none() | st.integers(0, 80),
)
def test_every_row_is_read_and_never_changes(
    tmp_path_factory: pytest.TempPathFactory,
    rows: list[tuple[int, int, int]],
    start: int,
    stop: int | None,
) -> None:
    path = tmp_path_factory.mktemp("rows") / "rows"
    reader = RowReader(path, FIELDS)
    assert (reader.count(), reader.read().size) == (0, 0)
    writer = RowWriter(path, width=3)
    for number, row in enumerate(rows, 1):
        writer.append(*row)
        assert reader.count() == number
    before = reader.read(start, stop)
    writer.append(9, 9, 9)
    writer.close()
    assert before.tolist() == rows[start:stop]
    assert reader.read(start, stop).tolist() == [*rows, (9, 9, 9)][start:stop]


def test_a_file_that_may_not_grow_is_named(tmp_path: Path) -> None:
    writer = RowWriter(tmp_path / "rows", width=1)
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (16, before[1]))
    try:
        writer.append(1)
        writer.append(2)
        with pytest.raises(OSError, match="File too large") as raised:
            writer.append(3)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, handler)
        writer.close()
    assert raised.value.filename == str(tmp_path / "rows")
    assert RowReader(tmp_path / "rows", FIELDS[:1]).read()["a"].tolist() == [1, 2]


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
