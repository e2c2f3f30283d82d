"""What was not measured never passes, whatever is asked of it."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from nightly import sampled
from r2bspec.judge.measure.metric_catalogue import names
from r2bspec.judge.pipeline import judge
from run_simulation import objective
from simulated_runs import judged, run_of

pytestmark = pytest.mark.simulation

BOUNDS = {"time": "1000 s", "rate": "0.001 Hz", "share": "100 %", "size": "9000 GiB", "count": "0"}
METRICS = [name for name in names() if name not in {"sustained", "peak.rate", "sent"}]
OF_PROCESSES = ("playback", "cpu", "memory", "work", "gpu", "power", "energy")
OF_MONITOR = [name for name in METRICS if not name.startswith(OF_PROCESSES)]


def bounds(metric: str) -> list[str]:
    from r2bspec.judge.measure.metric_catalogue import listed

    bound = BOUNDS[listed()[metric].dimension]
    return [f"{metric} {op} {bound}" for op in ("<", "<=", ">", ">=", "==", "!=")]


@pytest.mark.parametrize("metric", sampled(OF_MONITOR, 3))
def test_a_graph_that_answers_nothing(metric: str) -> None:
    for requirement in bounds(metric):
        assert judged(np.full((2, 60), np.nan), requirement).outcome == "fail"


@pytest.mark.parametrize("metric", sampled(OF_MONITOR, 3))
def test_a_run_without_iterations(metric: str) -> None:
    for requirement in bounds(metric):
        assert judged(np.empty((0, 60)), requirement).outcome == "inconclusive"


@pytest.mark.parametrize("metric", sampled(OF_MONITOR, 3))
def test_a_monitor_that_never_existed_and_a_misspelt_metric(metric: str) -> None:
    latency = np.full((2, 60), 0.01)
    for requirement in bounds(metric):
        name, _, rest = requirement.partition(" ")
        assert judged(latency, f"nobody.{requirement}").outcome == "fail"
        assert judged(latency, f"{name}x {rest}").outcome == "fail"


@pytest.mark.parametrize("share", [0.5, 0.8, 0.95])
def test_a_node_that_crashes_halfway(share: float) -> None:
    latency = np.random.default_rng(1).normal(0.02, 0.001, (10, 300))
    crashed = latency.copy()
    crashed.ravel()[round(share * latency.size) :] = np.nan
    for requirement in (
        "latency.p99 < 60 ms",
        "drop_rate <= 1 %",
        "missed == 0",
        "latency.max < 1 s",
    ):
        assert judged(latency, requirement).outcome != "fail"
        assert judged(crashed, requirement).outcome != "pass"


def test_an_objective_of_another_rate() -> None:
    samples = run_of(np.full((2, 60), 0.01))
    for metric, at in itertools.product(OF_MONITOR, ("60 Hz", "")):
        for requirement in bounds(metric):
            found = judge({"slo": objective(requirement, at=at)}, samples)
            assert found.outcome == "inconclusive"
