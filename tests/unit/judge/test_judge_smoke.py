"""A smoke run shows that the graph works; nothing else of it counts."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np

from r2bspec.judge.decision_policy import decision_policy
from r2bspec.judge.pipeline import judge
from r2bspec.measure.run_samples import read_samples
from r2bspec.plan.smoke_plan import smoke_plan
from run_simulation import Played, Simulation, objective

SLOS = {"fast": objective("latency.p90 < 1 us")}


def test_its_slos_and_a_late_playback_do_not_matter(tmp_path: Path) -> None:
    late = Played(30, np.full(60, 0.02), late=np.full(60, 0.5))
    written = Simulation(segments=[late], objectives=SLOS).write(tmp_path / "run")
    samples = read_samples(written)
    plan = smoke_plan(msgspec.structs.replace(written.plan, objectives=SLOS))
    verdict = judge(plan.objectives, samples, decision_policy(plan))
    assert (verdict.outcome, verdict.requirements) == ("pass", ())
    assert verdict.reason == "The graph works; a smoke run does not judge the SLOs."
    # The same run, measured.
    assert judge(SLOS, samples, replace(decision_policy(plan), smoke=False)).outcome == "invalid"
    # A run that was cut short shows nothing.
    record = msgspec.structs.replace(samples.record, status="incomplete", reason="It was cut.")
    cut = judge(plan.objectives, replace(samples, record=record), decision_policy(plan))
    assert (cut.outcome, cut.reason) == ("incomplete", "It was cut.")


def test_without_slos_it_says_so(tmp_path: Path) -> None:
    written = Simulation(segments=[Played(30, np.full(60, 0.02))]).write(tmp_path / "run")
    plan = smoke_plan(written.plan)
    verdict = judge(plan.objectives, read_samples(written), decision_policy(plan))
    assert (verdict.outcome, verdict.reason) == ("pass", "The spec has no objective to judge.")
