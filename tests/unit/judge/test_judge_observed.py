"""Verdicts on what was observed from inside, where something is missing."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from r2bspec.judge.judge_run import result_of
from r2bspec.judge.verdict import RequirementVerdict
from r2bspec.record.run_record import AnatomyKind
from r2bspec.record.sample_arrays import Rows
from run_simulation import objective
from simulated_anatomies import CHAIN, START_NS, Graph, Observed, ObservedSimulation

GRAPH = replace(CHAIN, rate_hz=60.0, steps=600)
SHORT_QUEUE = GRAPH.with_stage("blur", service_s=0.027, depth=1)
"""It answers about six of ten messages."""


def judged(
    folder: Path,
    *requirements: str,
    graph: Graph = GRAPH,
    lost: int = 0,
    left: Callable[[Observed], Rows] | None = None,
) -> list[RequirementVerdict]:
    simulation = ObservedSimulation.of(
        graph, objectives={"slo": objective(*requirements, at="60 Hz")}, lost=lost
    )
    if left is not None:
        simulation = replace(simulation, left=left)
    return [*result_of(simulation.write(folder / "run")).verdict.requirements]


def test_an_output_that_never_came_is_the_slowest_on_its_path(tmp_path: Path) -> None:
    path, latency, mean, longest = judged(
        tmp_path,
        "out.path.p99 < 80 ms",
        "latency.p99 < 80 ms",
        "out.path.mean < 80 ms",
        "out.path.max < 80 ms",
        graph=SHORT_QUEUE,
    )
    assert path.outcome == latency.outcome == longest.outcome == "fail"
    assert path.share is not None
    assert latency.share is not None
    assert (path.share.lost, path.share.n) == (latency.share.lost, 600)
    assert mean.outcome == "inconclusive"


def test_what_is_not_whole_decides_nothing(tmp_path: Path) -> None:
    def half(found: Observed) -> Rows:
        rows: Rows = found.rows[np.random.default_rng(0).random(found.rows.size) > 0.3]
        return rows

    metrics = ("out.path.p99 < 4 ms", "blur.callback.p99 < 8 ms", "path.blur.share < 20 %")
    for one in judged(tmp_path, *metrics, left=half, lost=9):
        assert one.outcome == "inconclusive"
        assert "There was no room for 45 events of the graph" in one.reason


def hangs(found: Observed, name: str) -> Rows:
    """A process that does not return from the callback of half of its messages on."""
    names = [process.name for process in found.record.processes]
    rows = found.rows
    own = rows["process"] == names.index(name)
    taken = rows["began_ns"][own & (rows["kind"] == AnatomyKind.TAKE)]
    since = taken[taken < START_NS + 5_000_000_000].max()
    # rclpy triggers before the callback and after it.
    first = (rows["kind"] == AnatomyKind.TRIGGER) & (rows["began_ns"] < since + 50_000)
    left: Rows = rows[~own | (rows["began_ns"] <= since) | first]
    return left


@pytest.mark.parametrize("name", ["decode", "blur"])
def test_a_callback_that_hangs_lasts_to_the_end(name: str, tmp_path: Path) -> None:
    left = partial(hangs, name=name)
    (longest,) = judged(tmp_path, f"{name}.callback.max < 50 ms", left=left)
    assert longest.outcome == "fail"
    assert longest.estimate == pytest.approx(5.0, abs=0.1)


def test_messages_that_nobody_takes_any_more_are_overtaken(tmp_path: Path) -> None:
    (share,) = judged(tmp_path, "blur.overtaken < 1 %", left=partial(hangs, name="blur"))
    # Those of the last second may be on their way.
    assert share.estimate == pytest.approx(0.44, abs=0.02)
