"""Requirements on outputs that come whether inputs do or not."""

from __future__ import annotations

import pytest
from check_specs import codes, findings

SPEC = """\
r2bspec: 1
name: odometry
data_loader: {bag: r2b_storage, topics: {/d455_1_imu: recorded/imu}}
playback: {inputs: {imu: {from: recorded/imu, format: sensor_msgs/msg/Imu}}}
graph:
  nodes:
    odometer:
      command: [cat]
      subscribes: {imu: sensor_msgs/msg/Imu}
      publishes: {odom: nav_msgs/msg/Odometry, imu_out: sensor_msgs/msg/Imu}
monitors:
  imu: {topic: imu_out, format: sensor_msgs/msg/Imu}
  odom: {topic: odom, format: nav_msgs/msg/Odometry, match: own_pace}
benchmark: {duration: 10 s, rates: [200 Hz]}
slos: {main: {at: 200 Hz, require: [REQUIREMENT]}}
"""


@pytest.mark.parametrize(
    "requirement",
    [
        "odom.throughput.mean >= 49 Hz",
        "odom.age.p99 < 30 ms",
        "odom.jitter.p99 < 5 ms",
        "odom.interval.max < 50 ms",
        "imu.drop_rate <= 1 %",
        "imu.throughput.mean >= 97 % of offered",
    ],
)
def test_what_is_known_can_be_required(requirement: str) -> None:
    assert codes(SPEC.replace("REQUIREMENT", requirement), offline=True) == []


@pytest.mark.parametrize(
    ("requirement", "text"),
    [
        ("odom.drop_rate <= 1 %", "not available at monitor odom"),
        ("odom.latency.p99 < 30 ms", "not available at monitor odom"),
        # Without a name it is required of both.
        ("missed == 0", "not available at monitor odom"),
        ("odom.throughput.mean >= 97 % of offered", "cannot be 'of offered'"),
    ],
)
def test_what_is_unknown_is_refused_at_its_place(requirement: str, text: str) -> None:
    (found,) = [
        each
        for each in findings(SPEC.replace("REQUIREMENT", requirement), offline=True)
        if each.code == "R2B526"
    ]
    assert text in found.message
    assert found.span is not None
    assert found.span.line == len(SPEC.splitlines())


def test_a_search_needs_outputs_that_answer() -> None:
    spec = SPEC.replace("REQUIREMENT", "imu.drop_rate <= 1 %").replace(
        "rates: [200 Hz]", "rates: [200 Hz], search: {min: 20 Hz, max: 400 Hz}"
    )
    assert codes(spec, offline=True) == []
    lonely = spec.replace("  imu: {topic: imu_out, format: sensor_msgs/msg/Imu}\n", "")
    lonely = lonely.replace("imu.drop_rate <= 1 %", "odom.age.p99 < 30 ms")
    assert "R2B408" in codes(lonely, offline=True)


@pytest.mark.parametrize("key", ["ratio: {inputs: 4}", "taps: true"])
def test_what_needs_answers_has_no_effect(key: str) -> None:
    spec = SPEC.replace("REQUIREMENT", "odom.age.p99 < 30 ms")
    spec = spec.replace("match: own_pace", f"match: own_pace, {key}")
    assert any("has no effect" in each.message for each in findings(spec, offline=True))
