"""The metrics that exist, and what a requirement's dotted name means."""

from __future__ import annotations

import pytest

from r2bspec.judge.measure.distribution import quantile
from r2bspec.judge.measure.metric_catalogue import MetricError, Subjects, names, resolve
from r2bspec.language.comparison_grammar import parse_requirement

SUBJECTS = Subjects(
    processes=("apriltag",),
    nodes=("relay",),
    topics=("camera/image", "r2b/detections"),
    monitors=("detections",),
    namespace="r2b",
)


@pytest.mark.parametrize(
    ("name", "fraction"),
    [
        ("p50", 0.5),
        ("p99", 0.99),
        ("p99_9", 0.999),
        ("p99_95", 0.9995),
        ("p5", 0.05),
        ("p0", None),
        ("p100", None),
        ("q50", None),
        ("p", None),
    ],
)
def test_percentiles_are_read_from_their_names(name: str, fraction: float | None) -> None:
    assert quantile(name) == fraction


@pytest.mark.parametrize(
    ("text", "monitor", "name"),
    [
        ("latency.p99", "detections", "latency.p99"),
        ("detections.latency.p99", "detections", "latency.p99"),
        ("latency.p42", "detections", "latency.p42"),
        ("drop_rate", "detections", "drop_rate"),
        ("detections.missed", "detections", "missed"),
        ("cpu.apriltag.mean", None, "cpu.apriltag.mean"),
        ("cpu.system.max", None, "cpu.system.max"),
        ("playback.lateness.p99_9", None, "playback.lateness.p99_9"),
        ("sent", None, "sent"),
        ("peak.rate", None, "peak.rate"),
        ("sustained", None, "sustained"),
        ("relay.callback.p99_9", None, "relay.callback.p99_9"),
        ("relay.load", None, "relay.load"),
        ("path.relay.share", None, "path.relay.share"),
        ("camera/image.transport.p50", None, "camera/image.transport.p50"),
        ("r2b/detections.transport.p50", None, "r2b/detections.transport.p50"),
        ("detections.transport.p50", None, "r2b/detections.transport.p50"),
        ("detections.path.p99", None, "detections.path.p99"),
    ],
)
def test_names_resolve(text: str, monitor: str | None, name: str) -> None:
    found, info = resolve(text, ["detections"], SUBJECTS)
    assert (found, info.name) == (monitor, name)


def test_without_a_monitor_each_of_several_is_meant() -> None:
    assert resolve("latency.p99", ["a", "b"])[0] is None
    assert resolve("b.latency.p99", ["a", "b"])[0] == "b"


def test_a_monitor_may_have_the_name_of_a_metric() -> None:
    assert resolve("latency.p99", ["latency", "b"])[0] is None
    assert resolve("latency.latency.p99", ["latency", "b"])[0] == "latency"


@pytest.mark.parametrize(
    ("text", "message", "suggestion"),
    [
        ("latncy.p99", "there is no metric 'latncy.p99'", "latency.p99"),
        ("latency.p9x", "there is no metric", "latency.p99"),
        ("detection.latency.p99", "there is no monitor 'detection'", "detections.latency.p99"),
        ("detections.drop_rat", "there is no metric 'drop_rat'", "detections.drop_rate"),
        ("detections.callback.p50", "there is no metric 'callback.p50'", ""),
        ("detections", "is a monitor, without a metric", ""),
        ("detections.peak.rate", "is not a metric of a monitor", "peak.rate"),
        ("cpu.apriltg.mean", "there is no metric", "cpu.apriltag.mean"),
        ("relay.calback.p99", "there is no metric", "relay.callback.p99"),
        ("latency.avg", "there is no metric", "latency.mean"),
        ("detections.latency.median", "there is no metric", "detections.latency.p50"),
        ("detections.fps", "there is no metric", "detections.throughput.mean"),
        ("output_rate.mean", "there is no metric", "throughput.mean"),
        ("loss", "there is no metric", "drop_rate"),
        ("cpu.apriltag.avg", "there is no metric", "cpu.apriltag.mean"),
    ],
)
def test_wrong_names_are_answered_with_the_known_ones(
    text: str, message: str, suggestion: str
) -> None:
    with pytest.raises(MetricError, match=message) as raised:
        resolve(text, ["detections"], SUBJECTS)
    assert raised.value.known
    if suggestion:
        assert raised.value.suggestion == suggestion


def test_every_listed_name_resolves() -> None:
    for name in names(SUBJECTS):
        assert resolve(name, ["detections"], SUBJECTS)[1].name == name


@pytest.mark.parametrize(
    ("text", "fits"),
    [
        ("latency.p99 < 60 ms", True),
        ("latency.p99 < 60 Hz", False),
        ("latency.p99 < 60", False),
        ("throughput.mean >= 97 % of offered", True),
        ("latency.p50 >= 97 % of offered", False),
        ("throughput.mean >= 97 %", False),
        ("drop_rate <= 1 %", True),
        ("cpu.apriltag.mean < 120 %", True),
        ("memory.apriltag.max < 64 MiB", True),
        ("missed == 0", True),
    ],
)
def test_bounds_must_have_the_metric_s_dimension(text: str, fits: bool) -> None:
    requirement = parse_requirement(text)
    info = resolve(requirement.metric, ["detections"], SUBJECTS)[1]
    assert requirement.bound is not None
    assert info.accepts(requirement.bound) is fits
