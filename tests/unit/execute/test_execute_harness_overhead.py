"""The floor of a transport: how it is measured, when not, and until its median is known."""

from __future__ import annotations

import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import msgspec
import numpy as np
import pytest

from r2bspec.execute.measurement.harness_overhead import (
    HarnessOverhead,
    median_is_known,
    overhead_length,
    overhead_record,
)
from r2bspec.ipc import protocol
from r2bspec.ipc.schedule import CyclicSchedule
from r2bspec.language.spec import QoS
from r2bspec.plan.plan import InputPlan
from r2bspec.record.run_record import HarnessOverheadRecord
from r2bspec.record.sample_arrays import MONITOR_DTYPE, PLAYBACK_DTYPE
from run_simulation import Simulation

MS = 1_000_000


def playback(count: int, late_ns: int = 0) -> Any:
    rows = np.zeros(count, PLAYBACK_DTYPE)
    rows["stamp_ns"] = np.arange(1, count + 1)
    rows["due_ns"] = np.arange(count) * 100 * MS
    rows["published_ns"] = rows["due_ns"] + late_ns
    return rows


def received(sent: Any, latency_ns: Any, *, stamped: bool = True) -> Any:
    rows = np.zeros(sent.size, MONITOR_DTYPE)
    rows["stamp_ns"] = sent["stamp_ns"] if stamped else 0
    rows["received_ns"] = sent["published_ns"] + latency_ns
    rows["bytes"] = 240
    return rows


@pytest.mark.parametrize("stamped", [True, False])
def test_the_floor_is_what_lies_between_publication_and_arrival(stamped: bool) -> None:
    sent = playback(100, late_ns=7)
    rows = received(sent, np.arange(1, 101) * 1000, stamped=stamped)
    assert overhead_record("/image", 10.0, sent, rows) == HarnessOverheadRecord(
        topic="/image",
        bytes=240,
        rate_hz=10.0,
        sent=100,
        received=100,
        latency_p50_ns=50_000,
        latency_p99_ns=99_000,
        lateness_p50_ns=7,
        lateness_p99_ns=7,
    )


def test_what_is_lost_is_counted_and_shifts_no_pair() -> None:
    sent = playback(10)
    rows = received(sent, 5_000)[[0, 1, 2, 4, 5, 7, 8, 9]]
    record = overhead_record("/image", 10.0, sent, rows)
    assert (record.sent, record.received) == (10, 8)
    assert (record.latency_p50_ns, record.latency_p99_ns) == (5_000, 5_000)


def test_messages_of_the_warm_up_that_come_late_are_not_counted() -> None:
    sent = playback(10)
    rows = received(sent, 5_000)
    late = rows[:2].copy()
    late["stamp_ns"] = [901, 902]
    record = overhead_record("/image", 10.0, sent, np.concatenate([late, rows]))
    assert (record.received, record.latency_p99_ns) == (10, 5_000)


def test_without_samples_there_is_no_time() -> None:
    record = overhead_record("/image", 10.0, playback(3), np.zeros(0, MONITOR_DTYPE))
    assert (record.sent, record.received, record.bytes) == (3, 0, 0)
    assert record.latency_p50_ns is None


class Asked:
    """Children that answer how many readers each topic has, and nothing else."""

    def __init__(self, readers: int) -> None:
        self._readers = readers
        self.commands: list[Any] = []

    def request(self, _child: Any, command: Any, _kind: Any) -> Any:
        self.commands.append(command)
        assert isinstance(command, protocol.CountMatches)
        return protocol.Matched(counts={"/image": self._readers})


@pytest.mark.parametrize(
    ("readers", "durability", "questions"),
    [(1, "volatile", 1), (0, "transient_local", 0)],
    ids=["read already", "kept for late joiners"],
)
def test_an_input_that_a_measurement_would_affect_is_not_played(
    tmp_path: Path, readers: int, durability: Any, questions: int
) -> None:
    children: Any = Asked(readers)
    source = InputPlan(
        topic="/image",
        type="sensor_msgs/msg/Image",
        source="/loaded",
        bag_topic="/camera",
        qos=QoS(durability=durability),
    )
    child: Any = None
    measurement = HarnessOverhead(
        msgspec.structs.replace(Simulation().plan(), inputs=(source,)),
        cast("Any", SimpleNamespace(supervisor=children)),
        child,
        child,
        tmp_path,
        CyclicSchedule(steps=((0,),)),
    )
    assert measurement.measure() == ()
    assert len(children.commands) == questions


@pytest.mark.parametrize(
    ("usual", "fewest", "most"),
    [
        # 1 Hz and 10 Hz: a second has too few messages.
        (1, 11, 20),
        (10, 11, 20),
        # From 20 Hz on a second, of which nothing is left out while it has less than a p99 needs.
        (20, 20, 20),
        (100, 100, 100),
        (1000, 299, 1000),
        (5000, 299, 2000),
    ],
)
def test_the_length_depends_on_the_messages_of_a_second(usual: int, fewest: int, most: int) -> None:
    assert overhead_length(usual) == (fewest, most)


def test_as_many_are_needed_as_bound_the_p99_with_95_percent() -> None:
    fewest = overhead_length(1000).fewest
    assert 1 - 0.99**fewest >= 0.95 > 1 - 0.99 ** (fewest - 1)


def test_a_median_is_known_if_its_interval_is_narrow() -> None:
    # Of 11 values the interval is from the second smallest to the second largest.
    narrow = np.array([1, 80, 90, 95, 99, 100, 101, 105, 110, 125, 900])
    assert median_is_known(narrow)
    wide = narrow.copy()
    wide[-2] = 126
    assert not median_is_known(wide)
    wide = narrow.copy()
    wide[1] = 74
    assert not median_is_known(wide)


def test_few_values_have_no_interval() -> None:
    # The smallest and the largest of six values miss the median in 2 / 2**6 of cases: 3 %.
    assert not median_is_known(np.full(6, 100))
    assert not median_is_known(np.zeros(0))
    # Of seven in 1.6 %.
    assert median_is_known(np.full(7, 100))


def test_an_interval_misses_the_median_as_rarely_as_it_says() -> None:
    random = np.random.default_rng(1)
    runs, count, rank = 4000, 11, 2
    draws = np.sort(random.lognormal(0.0, 1.0, (runs, count)), axis=1)
    missed = np.mean((draws[:, rank - 1] > 1.0) | (draws[:, -rank] < 1.0))
    stated = 2 * sum(math.comb(count, below) for below in range(rank)) / 2**count
    assert stated <= 0.02
    assert missed == pytest.approx(stated, abs=0.006)
