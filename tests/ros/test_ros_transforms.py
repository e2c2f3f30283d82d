"""Promise: recorded transforms come with the inputs, in their time, and belong to no step."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy")

from ros_runs import START_NS, Bench, Finished, quick_input, relay_spec
from ros_runs import bench as bench
from transform_bags import read_transforms, with_tf2, write_transform_bag

MS = 1_000_000
IMAGES = (0, 100, 200, 300)
TF = (-50, -10, 5, 40, 95, 100, 160, 240, 290)
STATIC = (("base", "camera"), ("base", "lidar"), ("arm", "camera"))

NODES = """
import time

from rclpy.qos import DurabilityPolicy, QoSProfile
from tf2_msgs.msg import TFMessage

LATCHED = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class Notebook(Node):
    def __init__(self, **kwargs):
        super().__init__("notebook", **kwargs)
        name = self.declare_parameter("file", "").value
        self.file = open(name, "a", buffering=1)
        self.out = self.create_publisher(Image, "output", 10)
        self.create_subscription(TFMessage, "/tf", self.note("tf"), 100, raw=True)
        self.create_subscription(TFMessage, "/tf_static", self.note("static"), LATCHED, raw=True)
        self.create_subscription(Image, "input", self.answer, 100)

    def note(self, kind):
        return lambda data: self.file.write(f"{kind} {bytes(data).hex()}\\n")

    def answer(self, message):
        stamp = message.header.stamp
        self.file.write(f"image {stamp.sec * 10**9 + stamp.nanosec} {time.monotonic_ns()}\\n")
        self.out.publish(message)
"""


def notebook(file: Path, **changes: Any) -> dict[str, Any]:
    return {"python": "./nodes.py:Notebook", "parameters": {"file": str(file)}} | changes


def spec(folder: Path, **changes: Any) -> dict[str, Any]:
    return relay_spec(
        **{
            "data_loader": {
                "bag": "./moving",
                "topics": {"/camera": "loaded"},
                "publish_tf": True,
                "publish_tf_static": True,
            },
            "playback": {"inputs": {"input": quick_input("loaded")}},
            "graph": {"nodes": {"notebook": notebook(folder / "graph")}},
            "benchmark": {
                "duration": "1 s",
                "iterations": 1,
                "rates": ["10 Hz"],
                "warm_up": "100 ms",
                "start_timeout": "60 s",
            },
        }
        | changes
    )


@pytest.fixture(scope="module", autouse=True)
def moving(bench: Bench) -> Any:
    """A bag with transforms; the children of a run inherit what tf2_msgs needs."""
    write_transform_bag(bench.folder / "moving", IMAGES, TF, STATIC)
    with pytest.MonkeyPatch.context() as patch:
        for name, value in with_tf2().items():
            patch.setenv(name, value)
        yield


@pytest.fixture(scope="module")
def timeline(bench: Bench) -> Finished:
    inputs = {"mode": "timeline", "inputs": {"input": quick_input("loaded")}}
    used = spec(bench.folder, playback=inputs)
    del used["benchmark"]["rates"]
    used["graph"]["nodes"]["notebook"]["parameters"]["file"] = str(bench.folder / "timeline")
    return bench.run(used)


@pytest.fixture(scope="module")
def looping(bench: Bench) -> Finished:
    """Through a preprocessor, which gets its messages as they were recorded in time."""
    used = spec(bench.folder)
    used["data_loader"]["real_time"] = True
    used["preprocessors"] = {
        "early": notebook(
            bench.folder / "before", remappings={"input": "loaded", "output": "prepared"}
        )
    }
    used["playback"] = {"inputs": {"input": quick_input("prepared")}}
    return bench.run(used)


def notes(path: Path) -> list[tuple[str, Any]]:
    """What a notebook holds: of transforms their messages, of images their stamp and time."""
    found: list[tuple[str, Any]] = []
    for line in path.read_text().splitlines():
        kind, *rest = line.split()
        if kind == "image":
            found.append((kind, (int(rest[0]), int(rest[1]))))
        else:
            found.append((kind, read_transforms(bytes.fromhex(rest[0]))))
    return found


@pytest.mark.parametrize("name", ["timeline", "before", "graph"])
def test_static_transforms_are_there_first_in_one_message(
    bench: Bench, timeline: Finished, looping: Finished, name: str
) -> None:
    timeline.assert_complete()
    looping.assert_complete()
    kinds = [kind for kind, _ in notes(bench.folder / name)]
    assert kinds[0] == "static"
    assert kinds.count("static") == 1
    assert notes(bench.folder / name)[0][1] == [
        ("arm", "camera", START_NS),
        ("base", "lidar", START_NS),
    ]


def test_in_a_timeline_all_stamps_are_shifted_by_the_same(bench: Bench, timeline: Finished) -> None:
    run = timeline.run()
    (segment,) = (each for each in run.record.segments if each.kind == "iteration")
    first_ns = int(run.playback(segment)["stamp_ns"][0])
    shift_ns = first_ns - START_NS
    seen = {
        stamp_ns - shift_ns
        for kind, value in notes(bench.folder / "timeline")
        if kind == "tf"
        for _, child, stamp_ns in value
        if child == "odom"
    }
    assert {START_NS + at * MS for at in TF} <= seen
    images = {value[0] for kind, value in notes(bench.folder / "timeline") if kind == "image"}
    assert {first_ns + at * MS for at in IMAGES} <= images


@pytest.mark.parametrize("name", ["timeline", "graph"])
def test_transforms_of_one_message_keep_their_distance(
    bench: Bench, timeline: Finished, looping: Finished, name: str
) -> None:
    found = [value for kind, value in notes(bench.folder / name) if kind == "tf"]
    assert len(found) > len(TF)
    for (_, first, at_ns), (_, second, before_ns) in found:
        assert (first, second) == ("odom", "base")
        assert at_ns - before_ns == 2 * MS


def test_transforms_are_counted_as_no_steps(timeline: Finished, looping: Finished) -> None:
    for done in (timeline, looping):
        run = done.run()
        for segment in run.record.segments:
            playback = run.playback(segment)
            assert playback.size == segment.steps
            assert set(run.monitor(segment, "out")["stamp_ns"]) <= set(playback["stamp_ns"])


def test_while_looping_transforms_lie_between_the_steps_that_they_lay_between(
    bench: Bench, looping: Finished
) -> None:
    run = looping.run()
    (segment,) = (each for each in run.record.segments if each.kind == "iteration")
    steps_ns = run.playback(segment)["stamp_ns"]
    found = np.array([value[0][2] for kind, value in notes(bench.folder / "graph") if kind == "tf"])
    between = [int(np.count_nonzero((found >= a) & (found < b))) for a, b in pairwise(steps_ns)]
    recorded = [sum(at <= time < at + 100 for time in TF) for at in IMAGES]
    # A late step may take a transform over its edge; over whole rounds none is lost or added.
    rounds = len(between) // len(IMAGES)
    assert rounds >= 2
    counted = sum(between[: rounds * len(IMAGES)])
    assert abs(counted - rounds * sum(recorded)) <= 1


def test_in_real_time_a_preprocessor_gets_messages_in_the_spacing_of_the_recording(
    bench: Bench, looping: Finished
) -> None:
    seen = [kind for kind, _ in notes(bench.folder / "before") if kind != "static"]
    assert seen.count("image") == len(IMAGES)
    assert seen.count("tf") == len(TF)
    times = [value[1] for kind, value in notes(bench.folder / "before") if kind == "image"]
    # Never sooner than recorded, by more than the first one can have been late.
    assert times[-1] - times[0] > (IMAGES[-1] - IMAGES[0]) * MS / 2
