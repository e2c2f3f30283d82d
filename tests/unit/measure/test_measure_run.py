"""The metrics of whole runs."""

from __future__ import annotations

from dataclasses import replace

import msgspec
import numpy as np
import pytest

from r2bspec.judge.measure.metric_catalogue import Subjects, names, resolve
from r2bspec.judge.measure.metric_values import metric_value
from r2bspec.judge.measure.metrics import RunMetrics, summarise
from run_simulation import Played, Simulation

NAN = float("nan")


def test_each_iteration_is_kept_and_the_pool_adds_them_up() -> None:
    samples = Simulation(
        segments=[
            Played(10, [0.9] * 5, kind="warm_up"),
            Played(10, [0.01] * 20),
            Played(10, [0.03] * 19 + [NAN], twice=(0,), strangers=2),
            Played(30, [0.02] * 30),
            Played(30, [0.5] * 30, complete=False),
        ]
    ).samples()
    metrics = summarise(samples)

    assert [rate.offered_hz for rate in metrics.rates] == [10, 30]
    assert metrics.incomplete == ("iteration-005",)
    ten = metrics.rates[0]
    assert len(ten.iterations) == 2
    assert [iteration.monitors["detections"].count("missed") for iteration in ten.iterations] == [
        0,
        1,
    ]
    pooled = ten.pooled.monitors["detections"]
    assert (pooled.count("sent"), pooled.count("answered"), pooled.count("missed")) == (40, 39, 1)
    assert (pooled.count("received"), pooled.count("duplicates"), pooled.count("unmatched")) == (
        42,
        1,
        2,
    )
    assert pooled.drop_rate == 1 / 40
    assert pooled.latency.p50 == pytest.approx(0.01)
    assert pooled.latency.max == pytest.approx(0.03)
    assert pooled.throughput_hz == pytest.approx(10, rel=0.04)
    spread = ten.spread["detections"]["latency.p50"]
    assert (spread.low, spread.high) == pytest.approx((0.01, 0.03))
    assert ten.pooled.number("cpu.apriltag.mean") == pytest.approx(0.5)
    assert ten.pooled.number("cpu.system.mean") == pytest.approx(0.65)
    assert ten.pooled.number("playback.rate") == pytest.approx(10)


def test_metrics_survive_json() -> None:
    samples = Simulation(
        segments=[Played(10, [NAN] * 5), Played(20, [0.1]), Played(30, [0.1, 0.1])]
    ).samples()
    metrics = summarise(samples)
    assert msgspec.json.decode(msgspec.json.encode(metrics), type=RunMetrics) == metrics


def test_an_interval_still_open_at_the_end_counts() -> None:
    died = Played(10, [0.01] * 10 + [NAN] * 40)
    samples = Simulation(segments=[died]).samples()
    seen = summarise(samples).rates[0].pooled.monitors["detections"]
    assert seen.times("interval").max == pytest.approx(4.09)
    assert seen.throughput_hz == pytest.approx(2.0)


def test_every_metric_of_the_catalogue_has_a_value() -> None:
    samples = Simulation(segments=[Played(10, np.linspace(0.01, 0.02, 50))]).samples()
    iteration = samples.iterations[10][0]
    for name in names(samples.subjects):
        monitor, info = resolve(name, samples.monitors, samples.subjects)
        if info.scope in {"search", "probe", "anatomy", "device"}:
            continue
        assert metric_value(info, monitor, iteration) is not None, name


def test_what_is_observed_from_inside_has_values_and_is_pooled() -> None:
    samples = Simulation(segments=[Played(10, [0.01] * 20), Played(10, [0.01] * 20)]).samples()
    callbacks = np.array([0.002, 0.004, 0.009])
    observed = {
        "relay.callback": callbacks,
        "relay.load": np.array([0.1, 0.3]),
        "path.relay.share": np.array([0.5, 0.7]),
        "camera/image.transport": np.empty(0),
    }
    first, second = (replace(each, anatomy=observed) for each in samples.iterations[10])
    samples = replace(samples, iterations={10: (first, second)})
    subjects = Subjects(nodes=("relay",), topics=("camera/image",))
    expected = {
        "relay.callback.p50": 0.004,
        "relay.callback.mean": 0.005,
        "relay.callback.max": 0.009,
        "relay.load": 0.2,
        "path.relay.share": 0.6,
        "camera/image.transport.p50": None,
        "relay.wait.p50": None,
    }
    for name, value in expected.items():
        _, info = resolve(name, (), subjects)
        assert metric_value(info, None, first) == (
            None if value is None else pytest.approx(value)
        ), name
    callback = summarise(samples).rates[0].pooled.times("relay.callback")
    assert (callback.n, callback.p50) == (6, 0.004)


def test_lost_messages_are_the_slowest_when_a_latency_is_asked_for() -> None:
    samples = Simulation(segments=[Played(10, [0.01] * 97 + [NAN] * 3)]).samples()
    iteration = samples.iterations[10][0]

    def measured(name: str) -> float | None:
        monitor, info = resolve(name, samples.monitors, samples.subjects)
        return metric_value(info, monitor, iteration)

    assert measured("latency.p90") == pytest.approx(0.01)
    assert measured("latency.p99") == float("inf")
    assert measured("latency.max") == float("inf")
    assert measured("latency.mean") == pytest.approx(0.01)
    assert measured("drop_rate") == 0.03
