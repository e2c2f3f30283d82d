"""Graphs of many kinds of nodes, inputs and outputs, in as few runs as possible."""

from __future__ import annotations

import sys
from collections import defaultdict
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rclpy")

from r2bspec.judge.measure.matching import match
from r2bspec.record.run_folder import read_loaded_files
from r2bspec.record.run_record import Segment
from ros_runs import IMAGE, STRING, Bench, Finished, relay_spec

NODES = """
from rclpy.qos import qos_profile_sensor_data
from std_msgs.msg import String

import beside


class Stamped(Node):
    def __init__(self, **kwargs):
        super().__init__("a_name_that_the_spec_replaces", **kwargs)
        self.out = self.create_publisher(Image, "stamped", 100)
        self.create_subscription(Image, "input", self.out.publish, 100)


def best_effort(**kwargs):
    node = Node("made_by_a_function", **kwargs)
    out = node.create_publisher(Image, "best_effort", qos_profile_sensor_data)
    node.create_subscription(Image, "left", out.publish, qos_profile_sensor_data)
    return node


class Notebook(Node):
    def __init__(self, **kwargs):
        super().__init__("notebook", **kwargs)
        path = self.declare_parameter("file", "").value
        self.file = open(path, "a", buffering=1)
        self.out = self.create_publisher(String, "noted", 100)
        for side in ("left", "right"):
            self.create_subscription(
                Image, side, lambda message, side=side: self.note(side, message), 100
            )
        self.create_subscription(String, "words", self.answer, 100)

    def note(self, side, message):
        stamp = message.header.stamp
        stamp_ns = stamp.sec * 10**9 + stamp.nanosec
        self.file.write(f"{side} {stamp_ns} {message.data[0]}\\n")

    def answer(self, message):
        self.file.write(f"words 0 {message.data}\\n")
        self.out.publish(String(data=beside.polite(message.data)))
"""

PROGRAM = """
import sys
import rclpy
rclpy.init(args=sys.argv)
node = Node("program")
assert node.declare_parameter("factor", 0).value == 3
assert node.declare_parameter("text", "").value == "10"
out = node.create_publisher(Image, "output", 100)
node.create_subscription(Image, "input", out.publish, 100)
print("arguments:", *sys.argv[1:2], flush=True)
try:
    rclpy.spin(node)
except KeyboardInterrupt:
    print("asked to end", flush=True)
"""

# The right camera has lost its second image, and the left one its last.
LEFT_MS = (0, 33, 66, 99, 132)
RIGHT_MS = (0, 66, 99, 132, 165)
PAIRS = {(0, 0), (2, 1), (3, 2), (4, 3)}


def spec(folder: Path) -> dict[str, object]:
    return relay_spec(
        name="menagerie",
        namespace="zoo",
        data_loader={
            "bag": "./bag",
            "topics": {"/left": "kept/left", "/right": "kept/right", "/text": "kept/text"},
        },
        playback={
            "buffer": 0,
            "inputs": {
                "left": {"from": "kept/left", "format": IMAGE},
                "right": {"from": "kept/right", "format": IMAGE},
                "words": {"from": "kept/text", "format": STRING},
            },
        },
        graph={
            "nodes": {
                "stamped": {"python": "./nodes/zoo.py:Stamped", "remappings": {"input": "left"}},
                "sensor": {"python": "./nodes/zoo.py:best_effort"},
                "notebook": {
                    "python": "./nodes/zoo.py:Notebook",
                    "parameters": {"file": str(folder / "notes")},
                },
                "program": {
                    "command": [sys.executable, "program.py", "an argument"],
                    "parameters": {"factor": 3, "text": "10"},
                    "remappings": {"input": "right", "output": "commanded"},
                    "publishes": {"output": IMAGE},
                    "subscribes": {"input": IMAGE},
                },
            }
        },
        monitors={
            "stamped": {"topic": "stamped", "format": IMAGE},
            "again": {"topic": "/zoo/stamped", "format": IMAGE},
            "best_effort": {"topic": "best_effort", "format": IMAGE},
            "commanded": {"topic": "commanded", "format": IMAGE},
            "noted": {"topic": "noted", "format": STRING, "match": "order"},
        },
    )


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Bench:
    found = Bench(
        tmp_path_factory.mktemp("zoo"),
        {"/left": LEFT_MS, "/right": RIGHT_MS, "/text": (1, 2), "/unused": (0, 33)},
    )
    (found.folder / "nodes").mkdir()
    found.write_node("nodes/zoo.py", NODES)
    found.write_node("nodes/beside.py", "def polite(words): return f'dear {words}'\n")
    found.write_node("program.py", PROGRAM)
    return found


@pytest.fixture(scope="module")
def done(bench: Bench) -> Finished:
    return bench.run(spec(bench.folder))


def test_a_command_in_python_names_the_modules_that_it_has_imported(
    bench: Bench, done: Finished
) -> None:
    loaded = read_loaded_files(done.folder)["program"]
    assert str(bench.folder / "program.py") in loaded
    assert any(file.endswith("/rclpy/__init__.py") for file in loaded)
    assert "modules of Python" not in done.stderr


def iteration(done: Finished) -> Segment:
    (found,) = done.segments()
    return found


@pytest.fixture(scope="module")
def notes(bench: Bench, done: Finished) -> dict[str, dict[int, int]]:
    """What the notebook saw: for each side, the number in the image by its stamp."""
    found: dict[str, dict[int, int]] = defaultdict(dict)
    for line in (bench.folder / "notes").read_text().splitlines():
        side, stamp_ns, number = line.split()
        found[side][int(stamp_ns)] = int(number)
    return found


def test_the_run_is_complete(done: Finished) -> None:
    done.assert_complete()
    assert [process.exit_code for process in done.run().record.processes] == [0] * 7
    assert done.run().record.differences == ()


@pytest.mark.parametrize("monitor", ["stamped", "again", "best_effort", "commanded"])
def test_every_answer_with_a_header_is_matched_by_its_stamp(done: Finished, monitor: str) -> None:
    run, segment = done.run(), iteration(done)
    matching = match(run.playback(segment), run.monitor(segment, monitor), "stamp")
    assert matching.missed == matching.unmatched == matching.duplicates == 0


def test_answers_without_a_header_are_matched_by_their_order(done: Finished) -> None:
    run, segment = done.run(), iteration(done)
    rows = run.monitor(segment, "noted")
    assert rows.size == run.playback(segment).size == segment.steps
    assert set(rows["stamp_ns"]) == {0}
    noted = done.monitor("noted")
    assert noted["answered"] == noted["sent"] == segment.steps
    assert noted["unmatched"] == 0


def test_all_inputs_of_a_step_have_the_same_stamp(
    done: Finished, notes: dict[str, dict[int, int]]
) -> None:
    run = done.run()
    played = np.concatenate([run.playback(segment)["stamp_ns"] for segment in run.record.segments])
    assert set(notes["left"]) == set(notes["right"]) == set(played.tolist())


def test_inputs_are_paired_by_their_recorded_stamps(notes: dict[str, dict[int, int]]) -> None:
    pairs = {(notes["left"][stamp], notes["right"][stamp]) for stamp in notes["left"]}
    assert pairs == PAIRS


def test_the_buffer_is_played_round_and_round(
    bench: Bench, notes: dict[str, dict[int, int]]
) -> None:
    numbers = [notes["left"][stamp] for stamp in sorted(notes["left"])]
    assert numbers == ([0, 2, 3, 4] * len(numbers))[: len(numbers)]
    lines = (bench.folder / "notes").read_text().splitlines()
    words = [line.split()[2] for line in lines if line.startswith("words")]
    # There are four steps and two words: the words start again with every second step.
    assert words == (["0", "1"] * len(words))[: len(words)]


def test_what_has_no_partner_is_counted(done: Finished) -> None:
    said = [event for event in done.events() if "no partner" in event]
    found = done.run().record.unplayed
    assert said == [f"{each.clause} and are not played" for each in found]
    assert [(each.count, each.total) for each in found] == [(1, 5), (1, 5)]


def test_a_command_gets_its_arguments_and_ends_when_it_is_asked_to(done: Finished) -> None:
    assert done.log("program") == "arguments: an argument\nasked to end\n"


def test_a_topic_of_the_bag_that_the_spec_does_not_name_is_not_touched(done: Finished) -> None:
    assert "/unused" not in (done.folder / "plan.json").read_text()
