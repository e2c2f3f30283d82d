"""What can never work is said as soon as it is certain, also of processes that are no Python hosts.

The start timeout of these specs is a minute. That it was not waited for is seen from what is said.
"""

from __future__ import annotations

import re
import sys
from typing import Any

import pytest

from nightly import only_nightly
from r2bspec.report.findings_text import code_with_slug

pytest.importorskip("rclpy")

from ros_runs import IMAGE, Bench, Finished, relay_spec
from ros_runs import nothing_left as nothing_left

# A program of its own, which stands for any process that r2bspec cannot look into.
PROGRAM = """
import rclpy
from rclpy.node import Node
from sensor_msgs.msg import Image

rclpy.init()
node = Node("plain")
node.declare_parameter("gain", 1.0)
publisher = node.create_publisher(Image, "out", 10)
node.create_subscription(Image, "image", publisher.publish, 10)
try:
    rclpy.spin(node)
except BaseException:
    pass
"""
NODES = """
import threading
import time

from rclpy.qos import QoSProfile, ReliabilityPolicy

OUTPUT, INPUT = "".join(["out", "put"]), "".join(["in", "put"])


class Picky(Node):
    def __init__(self, **kwargs):
        super().__init__("picky", **kwargs)
        publisher = self.create_publisher(Image, OUTPUT, 10)
        self.create_subscription(Image, INPUT, publisher.publish, 10)


class BestEffort(Node):
    def __init__(self, **kwargs):
        super().__init__("best_effort", **kwargs)
        profile = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
        publisher = self.create_publisher(Image, OUTPUT, profile)
        self.create_subscription(Image, INPUT, publisher.publish, 10)


class LoadsForLong(Node):
    def __init__(self, **kwargs):
        super().__init__("slow", **kwargs)
        threading.Thread(target=self.load, daemon=True).start()

    def load(self):
        began = time.monotonic()
        while time.monotonic() - began < 14:
            sum(range(1000))
        publisher = self.create_publisher(Image, OUTPUT, 10)
        self.create_subscription(Image, INPUT, publisher.publish, 10)


class Mute(Node):
    def __init__(self, **kwargs):
        super().__init__("mute", **kwargs)
        self.create_publisher(Image, OUTPUT, 10)
        self.create_subscription(Image, INPUT, lambda _: None, 10)
"""


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Bench:
    found = Bench(tmp_path_factory.mktemp("early"))
    (found.folder / "plain.py").write_text(PROGRAM, encoding="utf-8")
    found.write_node("nodes.py", NODES)
    return found


def program(**keys: Any) -> dict[str, Any]:
    return {"command": [sys.executable, "./plain.py"], **keys}


def run(bench: Bench, node: dict[str, Any], **changes: Any) -> Finished:
    return bench.run(relay_spec(graph={"nodes": {"plain": node}}, **changes))


def assert_certain(done: Finished, code: str, *words: str) -> None:
    assert done.status == 2
    assert f"error[{code_with_slug(code)}]" in done.error
    for each in words:
        assert each in done.stderr
    assert "will not be ready" in done.stderr
    assert "was not ready after" not in done.stderr


def test_a_remapping_of_a_program_that_matches_nothing(bench: Bench) -> None:
    node = program(remappings={"imgae": "input", "out": "output"})
    done = run(bench, node)
    assert_certain(done, "R2B204", "/r2b/plain has no topic 'imgae' to remap to /r2b/input")
    [found] = [each for each in done.run().record.differences if not each.harmless]
    assert (found.code, found.part, found.name) == ("R2B204", "remapping", "imgae")


@only_nightly()
def test_a_program_outside_of_the_namespace(bench: Bench) -> None:
    spec = relay_spec(graph={"nodes": {"plain": program()}})
    spec["playback"]["inputs"] = {"image": spec["playback"]["inputs"].pop("input")}
    spec["monitors"]["out"]["topic"] = "out"
    done = bench.run(spec)
    assert_certain(done, "R2B208", "the closest name is /image, to which /plain subscribes")


def test_incompatible_profiles(bench: Bench) -> None:
    spec = relay_spec(graph={"nodes": {"picky": {"python": "./nodes.py:Picky"}}})
    spec["playback"]["inputs"]["input"]["qos"] = {"reliability": "best_effort"}
    assert_certain(bench.run(spec), "R2B216", "requests a QoS on /r2b/input")


@only_nightly()
def test_incompatible_profiles_between_two_nodes(bench: Bench) -> None:
    spec = relay_spec(
        graph={
            "nodes": {
                "first": {"python": "./nodes.py:BestEffort", "remappings": {"output": "between"}},
                "second": {"python": "./nodes.py:Picky", "remappings": {"input": "between"}},
            }
        }
    )
    done = bench.run(spec)
    assert done.status == 2
    assert f"error[{code_with_slug('R2B216')}]" in done.error
    assert "/r2b/second requests a QoS on /r2b/between that /r2b/first does not offer" in done.error
    assert len([each for each in done.run().record.segments if each.kind == "warm_up"]) == 3


def test_a_node_that_never_answers_is_named_and_then_not_waited_for(bench: Bench) -> None:
    done = bench.run(relay_spec(graph={"nodes": {"mute": {"python": "./nodes.py:Mute"}}}))
    assert done.status == 4
    early, late = done.stderr.split("error[", 1)
    assert "no messages on /r2b/output so far: /r2b/mute publishes nothing on /r2b/output" in early
    assert "R2B641" in late
    assert "all nodes are idle and answer: the start is not waited for any longer" in early


def test_a_busy_node_is_waited_for(bench: Bench) -> None:
    spec = relay_spec(graph={"nodes": {"slow": {"python": "./nodes.py:LoadsForLong"}}})
    # It computes for longer than a third of this.
    spec["benchmark"]["start_timeout"] = "30 s"
    done = bench.run(spec)
    done.assert_complete()
    assert "idle" not in done.stderr
    assert "not ready so far: no subscription to /r2b/input" in done.stderr


def test_an_idle_program_without_the_topics_is_not_waited_for(bench: Bench) -> None:
    node = program(subscribes={"first": IMAGE}, publishes={"second": IMAGE})
    spec = relay_spec(graph={"nodes": {"plain": node}})
    spec["playback"]["inputs"] = {"first": spec["playback"]["inputs"].pop("input")}
    spec["monitors"]["out"]["topic"] = "second"
    spec["benchmark"]["start_timeout"] = "30 s"
    done = bench.run(spec)
    assert done.status == 4
    early, late = done.stderr.split("error[", 1)
    assert "not ready so far: no subscription to /r2b/first" in early
    assert re.search(r"is not ready and has not changed for \d+ s, with all nodes idle", late)


@only_nightly()
def test_a_misspelt_parameter_of_a_preprocessor(bench: Bench) -> None:
    remapped = {"image": "loaded", "out": "made"}
    node = program(remappings=remapped, parameters={"gian": 2.0})
    spec = relay_spec(preprocessors={"plain": node})
    spec["playback"]["inputs"]["input"]["from"] = "made"
    done = bench.run(spec)
    assert done.status == 2
    assert f"error[{code_with_slug('R2B211')}]" in done.error
    assert "declares no parameter 'gian'" in done.error
    assert re.search(r"spec\d+\.r2b\.yaml:\d+:\d+", done.stderr)
    # It is said once.
    assert done.stderr.count("declares no parameter 'gian'") == 1


def test_a_misspelt_parameter_of_a_program(bench: Bench) -> None:
    node = program(remappings={"image": "input", "out": "output"}, parameters={"gian": 2.0})
    done = run(bench, node)
    assert done.status == 2
    assert f"error[{code_with_slug('R2B211')}]" in done.error
    assert "/r2b/plain declares no parameter 'gian'" in done.error
    assert "did you mean 'gain'?" in done.error
    assert re.search(r"spec\d+\.r2b\.yaml:\d+:\d+", done.stderr)
    assert "warm-up" not in done.stderr


@only_nightly()
def test_a_parameter_of_a_program_that_resembles_no_other_is_a_warning(bench: Bench) -> None:
    node = program(remappings={"image": "input", "out": "output"}, parameters={"speed": 2.0})
    done = run(bench, node)
    done.assert_complete()
    [found] = done.run().record.differences
    assert (found.code, found.name, found.harmless) == ("R2B211", "speed", True)
    assert "/r2b/plain declares no parameter 'speed'; ROS ignores it" in done.stderr


def test_a_program_that_is_right_runs(bench: Bench) -> None:
    node = program(remappings={"image": "input", "out": "output"}, parameters={"gain": 2.0})
    done = run(bench, node)
    done.assert_complete()
    assert done.run().record.differences == ()
