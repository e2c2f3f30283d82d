"""Promise: a timeline is played as it was recorded, each monitor is asked about its own inputs."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy")

from r2bspec.judge.measure.run_samples import match_segment, read_samples
from ros_runs import IMAGE, START_NS, Bench, Finished, quick_input, relay_node, relay_spec
from ros_runs import bench as bench

MS = 1_000_000
CAMERA = (0, 100, 170, 300)
LEFT = (0, 105, 170)
IMU = tuple(range(7, 300, 30))
LATER = 11
TOPICS = {"/camera": CAMERA, "/left": LEFT, "/imu": IMU}

SPEC = relay_spec(
    data_loader={
        "bag": "./bag",
        "topics": {"/camera": "camera_raw", "/left": "left_raw", "/imu": "imu_raw"},
    },
    playback={
        "mode": "timeline",
        "inputs": {
            "camera": quick_input("camera_raw"),
            "left": quick_input("left_raw"),
            "imu": quick_input("imu_raw"),
        },
        "timeline": {"translations": {"imu": f"{LATER} ms"}},
    },
    graph={
        "nodes": {
            "first": relay_node(remappings={"input": "camera", "output": "camera_out"}),
            "second": relay_node(remappings={"input": "left", "output": "left_out"}),
            "third": relay_node(remappings={"input": "imu", "output": "imu_out"}),
        }
    },
    monitors={
        "camera": {"topic": "camera_out", "format": IMAGE},
        "imu": {"topic": "imu_out", "format": IMAGE},
        "pairs": {"topic": "left_out", "format": IMAGE, "answers": ["camera", "left"]},
    },
    benchmark={
        "duration": "700 ms",
        "iterations": 2,
        "warm_up": "100 ms",
        "start_timeout": "60 s",
    },
)

STEPS = sorted({*CAMERA, *LEFT, *(time + LATER for time in IMU)})
"""When each step of a round is due, in milliseconds after the first one."""

SPAN = STEPS[-1]
ROUND_NS = -(-SPAN * MS * len(STEPS) // (len(STEPS) - 1))
COUNT = 2 * len(STEPS) + sum(at * MS < 700 * MS - 2 * ROUND_NS for at in STEPS)


@pytest.fixture(scope="module")
def done(bench: Bench) -> Finished:
    return bench.run(SPEC)


@pytest.fixture(scope="module")
def played(done: Finished) -> list[Any]:
    """What was played in each iteration."""
    run = done.run()
    return [run.playback(segment) for segment in run.record.segments if segment.kind == "iteration"]


def test_the_run_is_complete(done: Finished) -> None:
    done.assert_complete()


def test_each_iteration_plays_the_recording_from_its_beginning(played: list[Any]) -> None:
    assert [rows.size for rows in played] == [COUNT, COUNT]
    first, second = played
    assert np.array_equal(np.diff(first["due_ns"]), np.diff(second["due_ns"]))
    assert np.array_equal(np.diff(first["stamp_ns"]), np.diff(second["stamp_ns"]))
    assert np.array_equal(first["inputs"], second["inputs"])


def test_steps_are_due_in_the_spacing_of_the_recording(played: list[Any]) -> None:
    due_ns = played[0]["due_ns"] - played[0]["due_ns"][0]
    expected = [at * MS for at in STEPS] + [ROUND_NS + at * MS for at in STEPS]
    assert due_ns[: 2 * len(STEPS)].tolist() == expected


def test_all_stamps_of_a_round_are_those_of_the_recording_shifted_by_one_constant(
    played: list[Any],
) -> None:
    stamps_ns = played[0]["stamp_ns"][: len(STEPS)]
    shifts = {int(stamp) - (START_NS + at * MS) for stamp, at in zip(stamps_ns, STEPS, strict=True)}
    assert len(shifts) == 1


def test_no_stamp_is_played_twice(done: Finished) -> None:
    run = done.run()
    stamps = np.concatenate([run.playback(segment)["stamp_ns"] for segment in run.record.segments])
    assert np.unique(stamps).size == stamps.size
    assert np.all(np.diff(stamps) > 0)


def test_messages_of_one_stamp_are_one_step_and_others_are_steps_by_themselves(
    played: list[Any],
) -> None:
    inputs = dict(zip(STEPS, played[0]["inputs"].tolist(), strict=False))
    assert inputs[0] == inputs[170] == 0b011
    assert inputs[100] == inputs[300] == 0b001
    assert inputs[105] == 0b010
    assert {inputs[time + LATER] for time in IMU} == {0b100}


def test_each_monitor_is_asked_about_the_steps_of_its_inputs_only(
    done: Finished, played: list[Any]
) -> None:
    wanted = {"camera": 0b001, "imu": 0b100, "pairs": 0b011}
    samples = read_samples(done.run()).iterations[0.0][0]
    for name, bits in wanted.items():
        asked = np.count_nonzero((played[0]["inputs"] & bits) == bits)
        seen = samples.monitors[name]
        assert seen.sent == asked > 0
        assert seen.answered + seen.missed == asked
    # Images of the left camera alone answer no step that the pairs are asked about.
    assert samples.monitors["pairs"].unmatched > 0


def test_what_was_played_arrives_in_its_order(done: Finished) -> None:
    run = done.run()
    for segment in run.record.segments:
        for monitor in run.plan.monitors:
            _, rows, matching = match_segment(run, segment, monitor)
            assert np.all(np.diff(rows["stamp_ns"]) > 0)
            answers = matching.first_row[matching.answered]
            assert matching.duplicates == 0
            assert (np.diff(answers) > 0).all()


def test_the_report_says_as_recorded_and_no_rate(done: Finished) -> None:
    assert "as recorded" in done.stdout
    assert " 0 Hz" not in done.stdout


def test_a_monitor_that_joins_inputs_of_different_rates_must_say_which_it_answers(
    bench: Bench,
) -> None:
    spec = SPEC | {
        "data_loader": {"bag": "./bag", "topics": {"/camera": "camera_raw", "/imu": "imu_raw"}},
        "playback": {
            "mode": "timeline",
            "inputs": {"camera": quick_input("camera_raw"), "imu": quick_input("imu_raw")},
        },
        "graph": {
            "nodes": {
                "joining": {
                    "command": ["sleep", "60"],
                    "subscribes": {"camera": IMAGE, "imu": IMAGE},
                    "publishes": {"joined": IMAGE},
                }
            }
        },
        "monitors": {"joined": {"topic": "joined", "format": IMAGE}},
    }
    done = bench.run(spec)
    assert done.status == 2
    assert "error[R2B658 monitor-without-steps]" in done.error
    assert "camera, imu" in done.error
    assert "answers: [camera]" in done.error or "answers: [image]" in done.error
