"""Predictions from the anatomy of a graph that another simulation ran, against what that does."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from statistics import NormalDist
from typing import Any

import msgspec
import numpy as np
import pytest

from nightly import sampled
from plans import node_plan
from r2bspec.cli.main import main
from r2bspec.errors import UsageError
from r2bspec.judge.measure.times import percentile
from r2bspec.language.spec import Objective, QoS
from r2bspec.plan.plan import ExternalPlan, Plan
from r2bspec.record.run_folder import Run, open_run, write_loaded_files
from r2bspec.safe_io.limits import MAX_PREDICTED_RATES
from r2bspec.tune import predict
from r2bspec.tune.predict import Measured, Predictor, predict_deployment
from r2bspec.tune.prediction import Estimate, LatencyPrediction, Prediction, requirement_answers
from run_simulation import Played, Simulation, objective, renew_digests
from simulated_anatomies import CHAIN, FORK, TIMER, Graph, ObservedSimulation, observed
from simulated_anatomies import plan_of as plan_of_graph

STEPS = 300


def varied(graph: Graph, **changes: object) -> Graph:
    """A graph whose callbacks take longer or shorter, as those of real nodes do."""
    stages = tuple(replace(stage, spread=0.4) for stage in graph.stages)
    return replace(graph, stages=stages, steps=STEPS, **changes)  # type: ignore[arg-type]


CHAIN_GRAPH = varied(CHAIN, rate_hz=40.0)


@pytest.fixture(scope="module")
def predictor(chain_run: Run) -> Predictor:
    """Of that run."""
    return Predictor(chain_run)


@pytest.fixture(scope="module")
def chain_run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """A run that the tests only read."""
    return ObservedSimulation.of(CHAIN_GRAPH).write(tmp_path_factory.mktemp("chain") / "run")


def plan_of(graph: Graph, run: Run, **changes: object) -> Plan:
    """The plan of the run with the processes of another deployment of its graph."""
    other = plan_of_graph(graph)
    return msgspec.structs.replace(run.plan, processes=other.processes, **changes)


def shared(graph: Graph) -> Graph:
    """All nodes in one process, called by one thread."""
    return replace(graph, stages=tuple(replace(stage, process="all") for stage in graph.stages))


def truth_s(graph: Graph, share: float) -> float:
    latency_ns = observed(graph).latency_ns
    return float(np.quantile(np.array([*latency_ns.values()]) / 1e9, share))


def latency(found: Prediction, metric: str, rate_hz: float) -> tuple[float, float, float]:
    (one,) = (
        each.estimate
        for each in found.latencies
        if each.metric == metric and each.rate_hz == rate_hz
    )
    assert one.value is not None, one.reason
    assert one.low is not None
    assert one.high is not None
    return one.low, one.value, one.high


GRAPHS = {"fork": FORK, "chain": CHAIN, "timer": TIMER}


@pytest.mark.parametrize("name", sampled(GRAPHS, 2))
def test_other_rates_and_placements_are_within_the_interval(name: str, tmp_path: Path) -> None:
    graph = varied(GRAPHS[name], rate_hz=40.0)
    run = ObservedSimulation.of(graph).write(tmp_path / "run")
    inside = []
    # No multiples of the timer's 50 Hz: with them each message would wait as long as the first.
    rates = (23.0, 43.0) if name == "timer" else (23.0, 70.0)
    predictor = Predictor(run)
    for deployed in (graph, shared(graph)):
        found = predictor.predict(plan_of(deployed, run), rates_hz=rates)
        assert not found.reason
        for rate_hz in rates:
            other = replace(deployed, rate_hz=rate_hz, seed=7)
            for metric, share in (("latency.p50", 0.5), ("latency.p99", 0.99)):
                low, _, high = latency(found, metric, rate_hz)
                assert high < 3 * low
                inside.append(low <= truth_s(other, share) <= high)
    assert sum(inside) >= 0.85 * len(inside)


def test_the_peak_is_that_of_the_busiest_thread(chain_run: Run, predictor: Predictor) -> None:
    # Callbacks of 4 ms in a process of their own, and of 9 ms together; the mean of what is
    # log-normal is larger than its median.
    grown = np.exp(0.4**2 / 2)
    for deployed, busiest_s in ((CHAIN_GRAPH, 0.004), (shared(CHAIN_GRAPH), 0.009)):
        plan = plan_of(deployed, chain_run)
        peak = predictor.predict(plan, rates_hz=(20.0,), cores=8).peak
        assert peak.low is not None
        assert peak.high is not None
        assert peak.low < 1 / (busiest_s * grown) < peak.high < 1.6 * peak.low


def test_a_short_queue_may_keep_the_median_where_the_graph_does_not_keep_up() -> None:
    required = {"one": objective("latency.p50 < 40 ms", "latency.p99 < 40 ms", at="120 Hz")}
    plan = msgspec.structs.replace(Simulation().plan(), objectives=required)
    unknown = [
        LatencyPrediction(
            monitor="detections", metric=f"latency.{name}", rate_hz=rate_hz, estimate=Estimate()
        )
        for name in ("p50", "p99")
        for rate_hz in (120.0, 300.0)
    ]

    def answers(rate_hz: float) -> list[str]:
        at = {"one": replace_at(required["one"], rate_hz)}
        asked = msgspec.structs.replace(plan, objectives=at)
        peak = Estimate(value=100.0, low=94.0, high=106.0)
        return [each.answer for each in requirement_answers(asked, [rate_hz], unknown, peak)]

    # Of 120 Hz, 12 % are lost or late at least, and of 300 Hz 65 %.
    assert answers(120.0) == ["not known", "would not"]
    assert answers(300.0) == ["would not", "would not"]


def replace_at(one: Objective, rate_hz: float) -> Objective:
    return objective(*(each.text for each in one.require), at=f"{rate_hz:g} Hz")


@pytest.mark.parametrize("messages", [60, 200, 400, 2000])
@pytest.mark.parametrize("q", [0.5, 0.99])
@pytest.mark.parametrize("spread", [0.1, 1.0])
def test_what_a_run_leaves_open_of_a_percentile_has_the_true_one(
    messages: int, q: float, spread: float
) -> None:
    random, inside = np.random.default_rng(3), []
    truth = math.exp(spread * NormalDist().inv_cdf(q))
    for _ in range(400):
        times = np.exp(spread * random.standard_normal(messages))
        found, seen = Measured.of(0.0, times, q), percentile(times, q)
        assert seen is not None
        off = math.log(truth / seen)
        inside.append(-found.below <= off <= found.above)
    # The tail of a normal distribution is lighter than the assumed one; 90 % are promised.
    assert sum(inside) >= 0.86 * len(inside)


def test_a_rate_above_the_peak_is_ruled_out_and_one_near_it_is_not_known(
    chain_run: Run, predictor: Predictor
) -> None:
    required = {
        "fast": objective("latency.p99 < 40 ms", at="400 Hz"),
        "slow": objective("latency.p99 < 200 ms", "latency.p50 < 2 ms", "sustained", at="40 Hz"),
        # Between those that are predicted, below and beyond them.
        "others": objective(
            "latency.p90 < 200 ms",
            "latency.p95 < 2 ms",
            "latency.p10 < 200 ms",
            "latency.p99_9 < 2 ms",
            "latency.p99_9 < 200 ms",
            at="40 Hz",
        ),
        "whole": objective("peak.rate >= 100 Hz", "cpu.mean < 50 %"),
    }
    found = predictor.predict(plan_of(CHAIN_GRAPH, chain_run, objectives=required))
    answers = {(each.objective, each.text): each.answer for each in found.requirements}
    assert answers == {
        ("fast", "latency.p99 < 40 ms"): "would not",
        ("slow", "latency.p99 < 200 ms"): "would hold",
        ("slow", "latency.p50 < 2 ms"): "would not",
        ("slow", "sustained"): "would hold",
        ("others", "latency.p90 < 200 ms"): "would hold",
        ("others", "latency.p95 < 2 ms"): "would not",
        ("others", "latency.p10 < 200 ms"): "would hold",
        ("others", "latency.p99_9 < 2 ms"): "would not",
        ("others", "latency.p99_9 < 200 ms"): "not known",
        ("whole", "peak.rate >= 100 Hz"): "would hold",
        ("whole", "cpu.mean < 50 %"): "not known",
    }
    assert found.rules_out.startswith("latency.p99 < 40 ms: the graph keeps up to ")
    assert found.peak.value is not None
    near = predictor.predict(chain_run.plan, rates_hz=(found.peak.value,))
    for each in near.latencies:
        assert each.estimate.value is None
        assert each.estimate.reason.startswith("it is near the peak, ")


@pytest.mark.parametrize("most", [1, 2, 10**9])
@pytest.mark.parametrize("field", ["object", "process", "thread", "kind", "began_ns", "ended_ns"])
def test_an_anatomy_that_no_run_has_says_nothing(field: str, most: int, tmp_path: Path) -> None:
    run = ObservedSimulation.of(replace(CHAIN_GRAPH, steps=20)).write(tmp_path / "run")
    rng = np.random.default_rng(1)
    for file in run.folder.rglob("anatomy.npy"):
        rows = np.load(file)
        most = min(most, np.iinfo(rows.dtype[field]).max)
        rows[field] = rng.integers(0, most, rows.size, rows.dtype[field])
        np.save(file, rows)
    renew_digests(run.folder)
    assert predict_deployment(open_run(run.folder), run.plan).reason


@pytest.mark.parametrize("rows", [0, 1, 5])
def test_a_few_events_say_nothing(rows: int, tmp_path: Path) -> None:
    run = ObservedSimulation.of(replace(CHAIN_GRAPH, steps=20)).write(tmp_path / "run")
    for file in run.folder.rglob("anatomy.npy"):
        np.save(file, np.load(file)[:rows])
    renew_digests(run.folder)
    assert predict_deployment(open_run(run.folder), run.plan).reason


def test_fewer_cores_make_a_graph_slower_and_more_do_not(
    chain_run: Run, predictor: Predictor
) -> None:
    peaks = [
        predictor.predict(chain_run.plan, rates_hz=(20.0,), cores=cores).peak.value
        for cores in (1, 8, 16)
    ]
    one, eight, sixteen = (peak or 0.0 for peak in peaks)
    assert one == pytest.approx(eight * 4 / 9, rel=0.15)
    assert eight == pytest.approx(sixteen)


def refused(predictor: Predictor, plan: Plan) -> str:
    found = predictor.predict(plan)
    assert not found.latencies
    assert found.peak.value is None
    assert {each.answer for each in found.requirements} <= {"not known"}
    return found.reason


def changed_process(run: Run, name: str, **changes: Any) -> Plan:
    processes = tuple(
        msgspec.structs.replace(process, **changes) if process.name == name else process
        for process in run.plan.processes
    )
    return msgspec.structs.replace(run.plan, processes=processes)


def test_what_the_model_does_not_know_it_does_not_say(chain_run: Run, predictor: Predictor) -> None:
    for changes, reason in (
        ({"nice": -5}, "the model does not know what nice of blur changes"),
        ({"env": {"A": "1"}}, "the model does not know what env of blur changes"),
        ({"role": "command"}, "blur becomes another kind of program"),
        ({"executor": "multi_threaded"}, "a multi-threaded executor of Python"),
        ({"nodes": (node_plan("other"),)}, "other was not observed"),
        ({"nodes": ()}, "/r2b/blur is no longer part of the graph"),
    ):
        assert reason in refused(predictor, changed_process(chain_run, "blur", **changes))
    (blur,) = next(each.nodes for each in chain_run.plan.processes if each.name == "blur")
    slower = msgspec.structs.replace(blur, parameters={"work": 2})
    plan = changed_process(chain_run, "blur", nodes=(slower,))
    assert refused(predictor, plan) == "the model does not know what other parameters of blur do"
    best_effort = {"/r2b/blur": QoS(reliability="best_effort")}
    topics = tuple(
        msgspec.structs.replace(topic, qos=best_effort) if topic.name == "/image" else topic
        for topic in chain_run.plan.topics
    )
    plan = msgspec.structs.replace(chain_run.plan, topics=topics)
    assert refused(predictor, plan) == "the model knows of the QoS of /image the depth only"
    external = (ExternalPlan(name="/driver", phase="measure"),)
    plan = msgspec.structs.replace(chain_run.plan, external=external)
    assert refused(predictor, plan) == "the model does not know what another external changes"


def test_a_run_without_an_anatomy_says_nothing(tmp_path: Path) -> None:
    run = Simulation(segments=[Played(30.0, [0.01] * 300)]).write(tmp_path / "run")
    assert "--anatomy" in refused(Predictor(run), run.plan)


def test_more_rates_than_take_a_few_seconds_are_not_known(chain_run: Run) -> None:
    rates = [1.0 + at for at in range(MAX_PREDICTED_RATES + 1)]
    found = predict_deployment(chain_run, chain_run.plan, rates_hz=rates)
    assert found.reason == "33 rates take too long; choose up to 32 with --rate"
    assert not found.latencies


def test_a_node_that_takes_what_nobody_plays_is_not_known(tmp_path: Path) -> None:
    run = ObservedSimulation.of(varied(CHAIN, rate_hz=40.0)).write(tmp_path / "run")
    plan = msgspec.structs.replace(run.plan, inputs=())
    assert "another inputs" in refused(Predictor(run), plan)
    unplayed = Run(folder=run.folder, record=run.record, plan=plan)
    assert refused(Predictor(unplayed), plan) == "decode takes /in, which the model does not play"


def test_a_process_with_a_gpu_is_not_known(tmp_path: Path) -> None:
    run = ObservedSimulation.of(varied(CHAIN, rate_hz=40.0)).write(tmp_path / "run")
    write_loaded_files(run.folder, {"blur": ["/usr/lib/libcuda.so.1", "/lib/libc.so.6"]})
    assert refused(Predictor(run), run.plan) == "blur uses a GPU, which the model does not know"


def test_a_run_that_the_model_does_not_reproduce_is_not_believed(tmp_path: Path) -> None:
    # The monitor saw twice the latency that the events of the nodes add up to.
    simulated = ObservedSimulation.of(varied(CHAIN, rate_hz=40.0))
    (played,) = simulated.segments
    slower = replace(played, latency=[2 * each for each in played.latency])
    run = replace(simulated, segments=[slower]).write(tmp_path / "run")
    assert refused(Predictor(run), run.plan).startswith(
        "the model does not reproduce the run: at 40 Hz out.latency.p50 is "
    )


@pytest.mark.parametrize("factor", [0.8, 0.3])
def test_the_observed_iteration_checks_the_model_and_the_others_are_predicted(
    tmp_path: Path, factor: float
) -> None:
    """It begins a start, so the others may be faster; by how much widens the interval."""
    simulated = ObservedSimulation.of(CHAIN_GRAPH)
    (played,) = simulated.segments
    others = replace(played, latency=[factor * each for each in played.latency])
    run = replace(simulated, segments=[played, others]).write(tmp_path / "run")
    observed, counting = run.record.segments
    segments = (
        msgspec.structs.replace(observed, kind="anatomy"),
        msgspec.structs.replace(counting, start=observed.start + 1),
    )
    run = replace(run, record=msgspec.structs.replace(run.record, segments=segments))
    if factor == 0.3:
        reason = refused(Predictor(run), run.plan)
        assert reason.startswith("the observed iteration is unlike the others: at 40 Hz out")
        return
    found = Predictor(run).predict(run.plan, rates_hz=(40.0,))
    low, value, high = latency(found, "latency.p50", 40.0)
    median_s = float(np.median(played.latency))
    assert low < factor * median_s < value < median_s < high


def test_the_same_run_gives_the_same_prediction(chain_run: Run, predictor: Predictor) -> None:
    plan = chain_run.plan
    again = predict_deployment(chain_run, plan, rates_hz=(50.0,))
    assert predictor.predict(plan, rates_hz=(50.0,)) == again


def test_the_verb_shows_and_prints_json(chain_run: Run, capsys: pytest.CaptureFixture[str]) -> None:
    plan = str(chain_run.folder / "plan.json")
    assert main(["predict", plan, str(chain_run.folder), "--rate", "60 Hz", "--cores", "4"]) == 0
    first, header, p50, *_ = capsys.readouterr().out.splitlines()
    assert first == f"simulated on 4 cores, predicted from {chain_run.folder}"
    assert header.split()[:3] == ["offered", "busiest", "thread"]
    assert p50.split()[:6] == ["60", "Hz", "blur", p50.split()[3], "%", "out.latency.p50"]
    assert main(["predict", plan, str(chain_run.folder), "--format", "json"]) == 0
    assert json.loads(capsys.readouterr().out)["cores"] == 2


def test_a_run_of_another_graph_is_refused_before_anything_is_said_of_it(chain_run: Run) -> None:
    other = changed_process(chain_run, "blur", nodes=(node_plan("other"),))
    with pytest.raises(UsageError, match="the run is of another graph: it has .*blur") as refused:
        predict_deployment(chain_run, other)
    assert "--anatomy" in refused.value.hint


class Beating(ObservedSimulation):
    """A run that has a monitor of what has a pace of its own, too, or of nothing else."""

    def plan(self) -> Plan:
        plan = super().plan()
        (out,) = plan.monitors
        beat = msgspec.structs.replace(out, name="beat", match="own_pace")
        monitors = tuple(each for each in (out, beat) if each.name in self.monitors)
        return msgspec.structs.replace(plan, monitors=monitors)


@pytest.mark.parametrize("monitors", [("out", "beat"), ("beat",)])
def test_what_has_a_pace_of_its_own_has_no_latency(
    monitors: tuple[str, ...], tmp_path: Path
) -> None:
    """Its messages answer no step, so their number says nothing of the others."""
    required = {"all": objective("out.latency.p99 < 1 s", "beat.latency.p99 < 1 s", at="50 Hz")}
    simulated = Beating.of(CHAIN_GRAPH, objectives=required)
    (played,) = simulated.segments
    run = replace(simulated, monitors=monitors, segments=[replace(played, silent=("beat",))]).write(
        tmp_path / "run"
    )
    if "out" not in monitors:
        assert refused(Predictor(run), run.plan).startswith("every monitor has a pace of its own")
        return
    found = predict_deployment(run, run.plan)
    assert not found.reason
    assert [each.answer for each in found.requirements] == ["would hold", "not known"]
    assert found.requirements[1].reason == "what has a pace of its own has no latency"
    assert latency(replace_latencies(found, "out"), "latency.p99", 50.0)


def replace_latencies(found: Prediction, monitor: str) -> Prediction:
    latencies = tuple(each for each in found.latencies if each.monitor == monitor)
    return msgspec.structs.replace(found, latencies=latencies)


def test_a_peak_beyond_what_is_simulated_is_above_that(
    chain_run: Run, predictor: Predictor, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is not said to be below the rate at which the search for it ends."""
    monkeypatch.setattr(predict, "_FASTEST_HZ", 50.0)
    required = {
        "slow": objective("latency.p99 < 1 s", "sustained", at="40 Hz"),
        "fast": objective("latency.p99 < 1 s", "sustained", at="120 Hz"),
        "whole": objective("peak.rate >= 60 Hz", "peak.rate >= 200 Hz"),
    }
    found = predictor.predict(plan_of(CHAIN_GRAPH, chain_run, objectives=required))
    assert found.peak.value is None
    assert found.peak.low is not None
    assert 50.0 < found.peak.low < 120.0
    assert "rates above that are not simulated" in found.peak.reason
    answers = [each.answer for each in found.requirements]
    assert answers == ["would hold"] * 2 + ["not known"] * 2 + ["would hold", "not known"]
    assert "keep up" not in " ".join(each.reason for each in found.requirements)
    assert not found.rules_out
