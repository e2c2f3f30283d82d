"""Which end of a process is one that the run has caused itself."""

from __future__ import annotations

import pytest

from r2bspec.record.run_record import ProcessRecord


@pytest.mark.parametrize(
    ("exit_code", "signals", "expected"),
    [
        (0, (), True),
        (None, (), True),
        (-2, (2,), True),
        (130, (2,), True),
        (-15, (2, 15), True),
        (-2, (), False),
        (-11, (2,), False),
        (1, (2,), False),
    ],
)
def test_a_process_that_ends_by_a_signal_of_the_run_ended_as_told(
    exit_code: int | None, signals: tuple[int, ...], *, expected: bool
) -> None:
    record = ProcessRecord(name="a", role="command", pid=1, exit_code=exit_code, signals=signals)
    assert record.ended_as_told == expected
