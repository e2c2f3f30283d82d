"""Of a live run is known what arrived, and when its source stamped it; nothing else has a value."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from r2bspec.judge.measure.metric_catalogue import listed
from r2bspec.judge.measure.metric_values import metric_value
from r2bspec.judge.measure.metrics import summarise
from r2bspec.judge.measure.run_samples import match_segment, read_samples
from r2bspec.judge.pipeline import judge
from r2bspec.plan.canonical_json import canonical_json, plan_hash
from r2bspec.record.run_folder import Run, RunFolder, open_run
from r2bspec.record.sample_arrays import MONITOR_DTYPE, PLAYBACK_DTYPE
from run_simulation import EPOCH_NS, STAMP_NS, Simulation, objective, segment_of

MS = 1_000_000
SECOND = 1_000 * MS
OFFSET_NS = STAMP_NS - EPOCH_NS


def arrived(at_ms: Any, age_ms: Any = 5.0, stamps: bool = True) -> Any:
    """Messages received at times after the beginning, stamped so long before."""
    at_ns = np.asarray(at_ms, dtype=np.float64) * MS
    rows = np.zeros(at_ns.size, MONITOR_DTYPE)
    rows["received_ns"] = EPOCH_NS + at_ns.astype(np.int64)
    if stamps:
        age_ns = np.broadcast_to(np.asarray(age_ms) * MS, at_ns.shape).astype(np.int64)
        rows["stamp_ns"] = rows["received_ns"] + OFFSET_NS - age_ns
    return rows


STEADY = arrived(range(50, 1000, 100))


def live_run(
    path: Path, rows: Any, *required: str, offset_ns: int | None = OFFSET_NS, count: int = 1
) -> Run:
    """A run of iterations of one second in which a monitor received these rows."""
    objectives = {"seen": objective(*required, at="")} if required else {}
    run = Simulation(objectives=objectives).write(path)
    plan = msgspec.structs.replace(run.plan, playback_mode="live")
    folder = RunFolder(path)
    segments = []
    for number in range(1, count + 1):
        name = f"iteration-{number:03d}"
        shifted = rows.copy()
        for field in ("received_ns", "stamp_ns") if rows["stamp_ns"].any() else ("received_ns",):
            shifted[field] += (number - 1) * 2 * SECOND
        folder.write_rows("playback", np.empty(0, PLAYBACK_DTYPE), name)
        folder.write_rows("monitor", shifted, name, "detections")
        began_ns = EPOCH_NS + (number - 1) * 2 * SECOND
        segments.append(
            msgspec.structs.replace(
                segment_of(0.0, 0, began_ns, length_ns=SECOND),
                id=name,
                index=number,
                live=True,
                clock_offset_ns=offset_ns,
            )
        )
    folder.write_plan(canonical_json(plan).decode())
    record = msgspec.structs.replace(
        run.record, plan_hash=plan_hash(plan), segments=tuple(segments)
    )
    folder.write_record(record)
    return open_run(path)


def outcomes(run: Run) -> list[str]:
    found = judge(run.plan.objectives, read_samples(run))
    return [requirement.outcome for requirement in found.requirements]


def test_latency_counts_from_the_stamp_of_the_source(tmp_path: Path) -> None:
    rows = arrived(range(50, 1000, 100), np.arange(1.0, 11.0))
    (rate,) = summarise(read_samples(live_run(tmp_path / "run", rows))).rates
    seen = rate.pooled.monitors["detections"]
    assert rate.pace == "source"
    assert seen.latency.n == seen.count("received") == 10
    assert seen.latency.min == pytest.approx(0.001)
    assert seen.latency.max == pytest.approx(0.010)
    assert seen.throughput_hz == pytest.approx(10.0)


@pytest.mark.parametrize(
    "rows",
    [
        arrived(range(50, 1000, 100), stamps=False),
        arrived(range(50, 1000, 100), -20.0),
        arrived(range(50, 1000, 100), 4e6),
    ],
    ids=["no stamp", "from the future", "of a recording"],
)
def test_stamps_that_are_no_times_of_this_clock_give_no_latency(tmp_path: Path, rows: Any) -> None:
    required = "latency.p50 < 100 s", "latency.max < 100 s", "latency.mean < 100 s"
    run = live_run(tmp_path / "run", rows, *required, count=3)
    (rate,) = summarise(read_samples(run)).rates
    assert rate.pooled.monitors["detections"].latency.p50 is None
    assert outcomes(run) == ["inconclusive"] * 3
    assert match_segment(run, run.record.segments[0], run.plan.monitors[0])[0].size == 0


def test_a_clock_that_was_set_gives_no_latency(tmp_path: Path) -> None:
    run = live_run(tmp_path / "run", STEADY, "latency.p50 < 100 s", offset_ns=None, count=3)
    assert outcomes(run) == ["inconclusive"]


def test_every_metric_has_a_value_or_is_said_to_be_unknown(tmp_path: Path) -> None:
    (samples,) = read_samples(live_run(tmp_path / "run", STEADY)).iterations[0.0]
    for name, info in listed().items():
        if info.statistic in {"search", "sequential", "truth"}:
            assert not info.metric.live, name
        elif "<" not in name and info.scope != "device":
            monitor = "detections" if info.scope == "monitor" else None
            known = info.metric.live
            assert (metric_value(info, monitor, samples) is not None) == known, name


UNKNOWN = (
    "drop_rate <= 100 %",
    "missed == 0",
    "duplicates == 0",
    "reordered == 0",
    "unmatched == 0",
    "sent >= 0",
    "latency_from_due.p50 < 100 s",
    "playback.lateness.p99 < 100 s",
    "throughput.mean >= 1 % of offered",
    "sustained",
    "peak.rate > 0 Hz",
)


def test_what_is_unknown_never_passes(tmp_path: Path) -> None:
    found = outcomes(live_run(tmp_path / "run", STEADY, *UNKNOWN, count=5))
    assert len(found) == len(UNKNOWN)
    assert "pass" not in found


def test_a_graph_that_falls_silent_is_seen(tmp_path: Path) -> None:
    rows = arrived(range(5, 300, 10))
    required = (
        "interval.max < 500 ms",
        "throughput.mean > 50 Hz",
    )
    run = live_run(tmp_path / "run", rows, *required, count=10)
    assert outcomes(run) == ["fail", "fail"]


def test_a_graph_that_sends_nothing_fails(tmp_path: Path) -> None:
    run = live_run(tmp_path / "run", STEADY[:0], "interval.max < 500 ms", "received >= 0", count=2)
    assert outcomes(run) == ["fail", "fail"]
    found = judge(run.plan.objectives, read_samples(run)).requirements[0]
    assert "received nothing in 2 iterations" in found.reason
