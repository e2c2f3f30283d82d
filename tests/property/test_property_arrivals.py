"""Arrivals are found on the monotonic clock, wherever the system clock is set to."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from r2bspec.ipc.sample_files import ARRIVAL_FIELDS, arrival_times

MS = 1_000_000
BEGIN_NS = 10**12
EPOCH_NS = 1_700_000_000 * 10**9
MAX_WAIT_NS = 20 * MS

STEPS = st.integers(10**9, 10**12).flatmap(lambda size: st.sampled_from([size, -size]))
ROUNDS = st.tuples(
    st.integers(MAX_WAIT_NS, 10**9),  # until the round
    st.lists(st.integers(0, MAX_WAIT_NS), min_size=1, max_size=4),  # how messages waited
    st.one_of(st.none(), st.tuples(st.integers(0, MAX_WAIT_NS), STEPS)),  # when the clock was set
)


@given(st.lists(ROUNDS, max_size=12))
def test_a_step_that_is_longer_than_messages_wait_moves_none(
    rounds: list[tuple[int, list[int], tuple[int, int] | None]],
) -> None:
    now, ahead = BEGIN_NS, EPOCH_NS
    rows, really = [(0, now + ahead, now, 0, ahead)], [now]
    for passed_ns, waits_ns, step in rounds:
        now += passed_ns
        before = ahead
        set_at = now
        if step is not None:
            set_at, ahead = now - step[0], ahead + step[1]
        for wait_ns in sorted(waits_ns, reverse=True):
            arrived = now - wait_ns
            rows.append((0, arrived + (before if arrived < set_at else ahead), now, 0, ahead))
            really.append(arrived)
    found = arrival_times(np.array(rows, list(ARRIVAL_FIELDS)))
    assert found.tolist() == really
