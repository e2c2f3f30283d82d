"""The floor of a transport: how it is measured, when not, and for how long."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import msgspec
import numpy as np
import pytest

from r2bspec.execute.start.harness_overhead import HarnessOverhead, overhead_record
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


def test_neither_what_is_lost_nor_what_comes_late_from_the_warm_up_shifts_a_pair() -> None:
    sent = playback(10)
    rows = received(sent, 5_000)
    late = rows[:2].copy()
    late["stamp_ns"] = [901, 902]
    found = np.concatenate([late, rows[[0, 1, 2, 4, 5, 7, 8, 9]]])
    record = overhead_record("/image", 10.0, sent, found)
    assert (record.sent, record.received) == (10, 8)
    assert (record.latency_p50_ns, record.latency_p99_ns) == (5_000, 5_000)


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
