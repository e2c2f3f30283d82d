"""What else happened on the machine over exactly one stretch of time."""

from __future__ import annotations

import numpy as np
import pytest

from r2bspec.judge.measure.host_usage import (
    CONTROLLER_INDEX,
    MACHINE_INDEX,
    MIN_SPACING_NS,
    HostInterference,
    ProcessSamples,
    host_interference,
    spaced_indices,
)
from r2bspec.record.sample_arrays import INTERFERENCE_DTYPE, RESOURCE_DTYPE, Rows
from run_simulation import EPOCH_NS

S = 10**9
SUMS = ("busy_s", "stolen_s", "waited_s", "throttled_s")


def around(*samples: tuple[float, float, float, float, float]) -> Rows:
    """Rows of seconds since the epoch, and the four sums in seconds."""
    rows = np.zeros(len(samples), INTERFERENCE_DTYPE)
    for row, (seconds, *sums) in zip(rows, samples, strict=True):
        row["time_ns"] = EPOCH_NS + round(seconds * S)
        for name, value in zip(SUMS, sums, strict=True):
            row[name] = value
    return rows


def used(loads: dict[int, float]) -> ProcessSamples:
    """Processes that use so much of a core from two seconds before the epoch on."""
    rows = np.zeros(20 * len(loads), RESOURCE_DTYPE)
    rows["time_ns"] = np.repeat(EPOCH_NS + np.arange(-2 * S, 18 * S, S), len(loads))
    rows["process"] = np.tile(list(loads), 20)
    rows["cpu_s"] = np.tile([*loads.values()], 20) * ((rows["time_ns"] - EPOCH_NS) / S + 2)
    return ProcessSamples(rows)


def interference(
    rows: Rows, sampled: ProcessSamples, processes: int, began_ns: int, ended_ns: int
) -> HostInterference | None:
    """On two cores, on which the run has so many processes."""
    used = sampled.used(began_ns, ended_ns)
    return host_interference(rows, used, range(processes), {"cores": 2}, (began_ns, ended_ns))


def test_what_happened_outside_the_window_does_not_count() -> None:
    rows = around((0, 0, 0, 0, 0), (2, 1, 9, 9, 9), (6, 7, 9.4, 10, 9.5), (9, 20, 30, 30, 30))
    sampled = used({MACHINE_INDEX: 9.0, CONTROLLER_INDEX: 0.1, 0: 0.5, 1: 0.4})
    found = interference(rows, sampled, 2, EPOCH_NS + 2 * S, EPOCH_NS + 6 * S)
    assert found is not None
    assert found.seconds == 4.0
    assert found.steal == pytest.approx(0.4 / 8)
    assert found.pressure == pytest.approx(0.25)
    assert found.throttled_s == pytest.approx(0.5)
    # 1.5 cores in all, of which 0.9 are the run's and 0.1 the controller's.
    assert found.foreign_cores == pytest.approx(0.5)


def test_without_samples_nothing_is_known() -> None:
    none = around()
    assert interference(none, used({0: 1.0}), 1, EPOCH_NS, EPOCH_NS + S) is None
    short = around((0, 0, 0, 0, 0), (1, 0, 0, 0, 0))
    window = (EPOCH_NS, EPOCH_NS + 4 * S)
    assert interference(short, used({0: 1.0}), 1, *window) is None


@pytest.mark.parametrize(
    ("times", "kept"),
    [
        ([], []),
        ([5], [0]),
        ([0, 1, 2], [0, 2]),
        ([0, 1, MIN_SPACING_NS, MIN_SPACING_NS + 1], [0, 3]),
        ([0, MIN_SPACING_NS, 2 * MIN_SPACING_NS], [0, 1, 2]),
        # A forged file need not be in order.
        ([5 * MIN_SPACING_NS, 0, 9 * MIN_SPACING_NS, 3], [0, 3]),
    ],
)
def test_samples_that_are_too_close_have_no_rate(times: list[int], kept: list[int]) -> None:
    assert spaced_indices(np.array(times, dtype=np.int64)).tolist() == kept
