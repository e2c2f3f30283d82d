"""A history of runs whose objectives require accuracy: it has no value in an iteration."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from r2bspec.compare.history_gate import history_entry
from r2bspec.judge.judge_run import result_of
from run_simulation import Played, Simulation, objective


def test_accuracy_is_left_out_of_a_history(tmp_path: Path) -> None:
    run = Simulation(
        segments=(Played(30, np.full(300, 0.02)),),
        objectives={"slo": objective("accuracy.tag_missed == 0 %", "latency.p90 < 1 s")},
    ).write(tmp_path)
    entry = history_entry(run, result_of(run))
    assert entry.run_id == run.record.run_id
    assert "accuracy" not in str(entry)
    assert "latency.p90" in str(entry)
