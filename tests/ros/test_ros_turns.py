"""Base and head by turns on real ROS 2: both up at once, and played step by step."""

from __future__ import annotations

import json
import os
from typing import Final, get_args

import numpy as np
import pytest

from nightly import only_nightly

pytest.importorskip("rclpy")

from r2bspec.compare.interleaved_comparison import STEPS
from r2bspec.judge.measure.run_samples import read_samples
from r2bspec.record.comparison_folder import PairedComparison, Side, open_comparison
from r2bspec.record.run_record import Segment, TurnKind
from ros_runs import WORKER, Bench, Finished, relay_spec
from ros_runs import bench as bench

SIDES: Final[tuple[Side, ...]] = get_args(Side)

SPEC = relay_spec(
    variables={"steps": 120_000},
    graph={
        "nodes": {
            "worker": {"python": "./worker.py:Worker", "parameters": {"steps": "$(var steps)"}}
        }
    },
    slos={
        "cost": {
            "at": "20 Hz",
            "require": [
                "work.graph.p50 <= 105 % of baseline",
                "latency.p90 <= 110 % of baseline",
                "latency.p50 < 10 s",
            ],
        }
    },
)


@pytest.fixture(scope="module")
def compared(bench: Bench) -> Finished:
    """A worker against one that computes three times as much, two starts of both."""
    bench.write_node("worker.py", WORKER)
    base = bench.write(SPEC, "base")
    return bench.compare(
        SPEC | {"variables": {"steps": 40_000}}, "--against", str(base), "--pairs", "2"
    )


def turns_of(pairs: PairedComparison, number: int, side: Side, kind: TurnKind) -> Segment:
    run = pairs.run(pairs.record.pairs[number], side)
    return [segment for segment in run.record.segments if segment.kind == kind][-1]


@pytest.mark.parametrize("kind", get_args(TurnKind))
def test_steps_of_both_sides_take_turns(compared: Finished, kind: TurnKind) -> None:
    pairs = open_comparison(compared.folder)
    assert pairs.record.by_turns
    for number, pair in enumerate(pairs.record.pairs):
        due = []
        for side in SIDES:
            rows = pairs.run(pair, side).playback(turns_of(pairs, number, side, kind))
            assert rows.size == STEPS
            due += [(int(due_ns), side) for due_ns in rows["due_ns"]]
        due.sort()
        gaps = np.diff([due_ns for due_ns, _ in due])
        assert gaps.min() == pytest.approx(gaps.max(), abs=10)
        sides = [side for _, side in due]
        assert all(set(sides[at : at + 2]) == {"base", "head"} for at in range(0, 2 * STEPS, 2))


def test_work_is_measured_on_one_core_for_both_sides_and_on_another_in_the_next_start(
    compared: Finished,
) -> None:
    pairs = open_comparison(compared.folder)
    cores = [
        {turns_of(pairs, number, side, "work_turns").core for side in SIDES}
        for number in range(len(pairs.record.pairs))
    ]
    assert [len(of_start) for of_start in cores] == [1, 1]
    assert len(set.union(*cores)) == min(2, len(os.sched_getaffinity(0)))
    free = {turns_of(pairs, 0, side, "turns").core for side in SIDES}
    assert free == {None}


def test_both_sides_play_the_same_messages_and_are_up_at_once(compared: Finished) -> None:
    pairs = open_comparison(compared.folder)
    for pair in pairs.record.pairs:
        base, head = (pairs.run(pair, "base").record, pairs.run(pair, "head").record)
        assert base.dataset == head.dataset
        assert {process.pid for process in base.processes}.isdisjoint(
            process.pid for process in head.processes
        )
        ends = [segment.ended_ns for segment in base.segments if segment.kind == "turns"]
        begins = [segment.began_ns for segment in head.segments if segment.kind == "turns"]
        assert begins < ends
    assert not (compared.folder / ".buffers").exists()


def test_work_is_that_of_the_steps(compared: Finished) -> None:
    pairs = open_comparison(compared.folder)
    for pair in pairs.record.pairs:
        base, head = (
            read_samples(pairs.run(pair, side)).turns["work_turns", 20.0] for side in SIDES
        )
        ratio = np.nanmedian(base.work["graph"] / head.work["graph"])
        # The loop alone is three times as long; what else a step costs is the same, and a clock
        # that runs slower beside other programs is the same for both.
        assert 1.5 < ratio < 3.5
        assert np.isnan(head.work["graph"][-1])
        assert head.work["graph"] == pytest.approx(head.work["worker"], nan_ok=True)


def test_the_verdict_rests_on_turns(compared: Finished) -> None:
    result = json.loads((compared.folder / "result.json").read_text())
    work, latency, absolute = result["verdict"]["requirements"]
    assert work["method"] == latency["method"] == "trimmed t by turns"
    assert len(work["compared"]["head_values"]) == 2
    assert absolute["method"] != "trimmed t by turns"
    assert "starts of both sides, played by turns" in compared.words


@only_nightly()
def test_what_cannot_be_up_twice_is_played_one_after_the_other(bench: Bench) -> None:
    bench.write_node(
        "worker.py",
        WORKER.replace(
            "        self.steps",
            "        import socket\n        self.port = socket.socket()\n"
            "        self.port.bind(('127.0.0.1', 47291))\n        self.steps",
            1,
        ),
    )
    base = bench.write(SPEC, "base")
    done = bench.compare(
        SPEC | {"variables": {"steps": 41_000}}, "--against", str(base), "--pairs", "1"
    )
    pairs = open_comparison(done.folder)
    assert not pairs.record.by_turns
    assert len(pairs.usable_pairs()) == 1
    assert "the sides are played one after the other" in done.stderr
