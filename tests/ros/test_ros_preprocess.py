"""Promise: preprocessors are recorded without loss, and are gone before anything is measured."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from nightly import only_nightly

pytest.importorskip("rclpy")

from ros_runs import IMAGE, STRING, Bench, Finished, quick_input, relay_node, relay_spec
from ros_runs import bench as bench

COUNT = 40
TOPICS = {"/camera": range(0, 33 * COUNT, 33)}

NODES = """
from rclpy.qos import qos_profile_sensor_data
from std_msgs.msg import String


class Preprocessor(Node):
    def __init__(self, **kwargs):
        super().__init__("preprocessor", **kwargs)
        self.kept = self.create_publisher(Image, "kept", 10)
        self.heard = self.create_publisher(Image, "heard", qos_profile_sensor_data)
        self.restamped = self.create_publisher(Image, "restamped", 10)
        self.named = self.create_publisher(String, "named", 10)
        self.create_subscription(Image, "raw", self.answer, 10)

    def answer(self, message):
        self.kept.publish(message)
        self.heard.publish(message)
        self.named.publish(String(data=str(message.data[0])))
        message.header.stamp.sec += 1000
        self.restamped.publish(message)


class Halver(Node):
    def __init__(self, **kwargs):
        super().__init__("halver", **kwargs)
        self.out = self.create_publisher(Image, "halved", 10)
        self.create_subscription(Image, "raw", self.answer, 10)

    def answer(self, message):
        if message.data[0] % 2 == 0:
            self.out.publish(message)


class Notebook(Node):
    def __init__(self, **kwargs):
        super().__init__("notebook", **kwargs)
        self.file = open(self.declare_parameter("file", "").value, "a", buffering=1)
        self.out = self.create_publisher(Image, "output", 10)
        self.create_subscription(Image, "input", self.note, 100)

    def note(self, message):
        self.file.write(f"{message.data[0]} {' '.join(self.get_node_names())}\\n")
        self.out.publish(message)
"""


def spec(folder: Path, source: str, kind: str, node: str) -> dict[str, Any]:
    """Play what a preprocessor publishes, to a node that takes notes."""
    notes = {"python": "./nodes.py:Notebook", "parameters": {"file": str(folder / "notes")}}
    return relay_spec(
        data_loader={"bag": "./bag", "topics": {"/camera": "raw"}},
        preprocessors={"prepare": {"python": f"./nodes.py:{node}"}},
        playback={"inputs": {"input": quick_input(source, kind)}},
        graph={"nodes": {"notebook": notes}},
    )


@pytest.fixture(scope="module")
def done(bench: Bench) -> Finished:
    """One run that plays what came out on four topics of one preprocessor."""
    used = spec(bench.folder, "kept", IMAGE, "Preprocessor")
    used["playback"]["inputs"] |= {
        "heard": quick_input("heard"),
        "named": quick_input("named", STRING),
    }
    used["graph"]["nodes"]["listener"] = relay_node(
        remappings={"input": "heard", "output": "ignored"}
    )
    used["graph"]["nodes"]["reader"] = {
        "python": "r2bspec.nodes.RelayNode",
        "parameters": {"format": STRING},
        "remappings": {"input": "named", "output": "also_ignored"},
    }
    used["benchmark"] |= {"rates": ["50 Hz"]}
    return bench.run(used)


@pytest.fixture(scope="module")
def notes(bench: Bench, done: Finished) -> list[list[str]]:
    return [line.split() for line in (bench.folder / "notes").read_text().splitlines()]


def test_the_run_is_complete(done: Finished) -> None:
    done.assert_complete()


def test_everything_that_came_out_is_played_in_its_order(notes: list[list[str]]) -> None:
    numbers = [int(note[0]) for note in notes]
    assert len(numbers) > COUNT
    assert numbers == (list(range(COUNT)) * len(numbers))[: len(numbers)]


def test_no_shortfall_is_reported_where_there_is_none(done: Finished) -> None:
    assert [event for event in done.events() if "came out" in event] == []
    assert [event for event in done.events() if "no partner" in event] == []


def test_preprocessors_are_gone_before_anything_is_measured(
    done: Finished, notes: list[list[str]]
) -> None:
    run = done.run()
    named = {each.name: number for number, each in enumerate(run.record.processes)}
    rows = run.resources()
    first_ns = min(segment.began_ns for segment in run.record.segments)
    for name in ("loader", "preprocess.prepare"):
        assert run.record.processes[named[name]].exit_code == 0
        assert np.all(rows["time_ns"][rows["process"] == named[name]] < first_ns)
    assert {name for note in notes for name in note[1:]} >= {"notebook", "player", "monitor"}
    assert not {name for note in notes for name in note[1:]} & {"loader", "prepare"}


def test_outputs_that_carry_no_stamp_or_another_are_not_waited_for_in_vain(
    done: Finished,
) -> None:
    # For each four messages that are taken to be unanswered, the loader waits five seconds.
    times = {text: time_ns for time_ns, text in done.run().record.events}
    took_s = (times["phase start"] - times["phase preprocess"]) / 1e9
    assert took_s < 5.0 * (COUNT // 4) / 2


@only_nightly()
def test_a_shortfall_of_a_chain_names_the_topic_and_the_counts(tmp_path: Path) -> None:
    bench = Bench(tmp_path, {"/camera": range(0, 6 * 33, 33)})
    bench.write_node("nodes.py", NODES)
    used = spec(tmp_path, "halved", IMAGE, "Halver")
    used["data_loader"]["topics"] = {"/camera": "loaded"}
    used["preprocessors"]["first"] = relay_node(remappings={"input": "loaded", "output": "raw"})
    done = bench.run(used)
    done.assert_complete()
    assert "/r2b/halved: the preprocessors published 3 messages for 6 inputs" in done.events()
    numbers = {line.split()[0] for line in (tmp_path / "notes").read_text().splitlines()}
    assert numbers == {"0", "2", "4"}
    names = [process.name for process in done.run().record.processes]
    assert set(names[:3]) == {"loader", "preprocess.prepare", "preprocess.first"}
    assert set(names[3:]) == {"harness.observer", "player", "notebook", "monitor"}


@only_nightly()
def test_a_preprocessor_that_publishes_nothing_ends_the_run(tmp_path: Path) -> None:
    bench = Bench(tmp_path, {"/camera": (0, 33)})
    silent = "class Silent(Node):\n    def __init__(self, **kwargs):\n"
    silent += "        super().__init__('silent', **kwargs)\n"
    silent += "        self.create_publisher(Image, 'kept', 10)\n"
    silent += "        self.create_subscription(Image, 'raw', lambda _: None, 10)\n"
    bench.write_node("nodes.py", silent)
    used = relay_spec(
        data_loader={"bag": "./bag", "topics": {"/camera": "raw"}},
        preprocessors={"prepare": {"python": "./nodes.py:Silent"}},
        playback={"inputs": {"input": quick_input("kept")}},
    )
    done = bench.run(used)
    assert done.status == 4
    assert done.error.startswith(
        "error[R2B641 no-output]: no messages on /r2b/kept: /r2b/prepare publishes nothing on "
        "/r2b/kept, although it subscribes to /r2b/raw (2 messages)\n"
    )
    assert done.run().record.status == "incomplete"
