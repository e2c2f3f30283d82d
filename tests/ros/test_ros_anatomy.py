"""Graphs that are observed from inside: what a run says of each node, and that nothing is lost."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from nightly import only_nightly

pytest.importorskip("rclpy")

from c_nodes import c_node, c_node_spec
from r2bspec.judge.measure.anatomy import Anatomy
from r2bspec.judge.measure.anatomy_summary import join_segment
from r2bspec.judge.measure.run_samples import match_segment
from r2bspec.record.run_record import Segment
from ros_runs import Bench, Finished, relay_node, relay_spec
from ros_runs import bench as bench

STEPS = 20
"""Of an iteration of `relay_spec`."""

FIRST_MS, SECOND_MS = 5.0, 20.0
"""What the nodes compute for each message."""


def chain(**changes: Any) -> dict[str, Any]:
    """A node of rclpy, and after it one in C that takes longer."""
    second = c_node_spec(
        "relay", parameters={"service_time_ms": SECOND_MS}, remappings={"input": "middle"}
    )
    nodes = {"first": relay_node(FIRST_MS, remappings={"output": "middle"}), "second": second}
    return relay_spec(graph={"nodes": nodes}, **changes)


def anatomy_of(done: Finished, segment: Segment) -> Anatomy:
    run = done.run()
    (record,) = (each for each in run.record.anatomies if each.start == segment.start)
    assert record.error == ""
    return join_segment(run, segment, record)


def assert_parts_are_the_latency(done: Finished, segment: Segment) -> None:
    """See that each message was followed, and that its parts add up to what was measured."""
    (path,) = anatomy_of(done, segment).paths["out"]
    assert [part.owner for part in path.parts if part.name == "callback"] == ["first", "second"]
    monitor = done.run().plan.monitors[0]
    steps, rows, matching = match_segment(done.run(), segment, monitor)
    assert path.seconds.size == matching.answered.sum() == STEPS
    measured = (rows["received_ns"][matching.first_row] - steps["published_ns"]) / 1e9
    parts = sum(np.nan_to_num(part.seconds) for part in path.parts)
    np.testing.assert_allclose(np.sort(parts), np.sort(measured), rtol=0.02)


def test_one_more_iteration_observes_all_nodes_where_the_others_observe_one(bench: Bench) -> None:
    spec = chain()
    spec["benchmark"]["anatomy"] = ["second"]
    done = bench.run(spec, "--anatomy")
    done.assert_complete()
    (counted,), (observed,) = done.segments(), done.segments("anatomy")
    assert observed.began_ns > counted.ended_ns
    assert not list((done.folder / "samples").glob("*warm_up*/anatomy.npy"))
    # What is observed in addition is no start of the measurement.
    assert len(done.run().record.starts) == 1
    names = {
        record.start: {process.name for process in record.processes}
        for record in done.run().record.anatomies
    }
    assert names == {
        counted.start: {"second", "player", "monitor"},
        observed.start: {"first", "second", "player", "monitor"},
    }
    alone = anatomy_of(done, counted)
    assert set(alone.nodes) == {"second"}
    assert alone.paths["out"] == ()
    assert_parts_are_the_latency(done, observed)
    (shown,) = done.result()["anatomies"]
    assert shown["segment"] == observed.id
    assert [node["name"] for node in shown["nodes"]] == ["first", "second"]


@pytest.mark.parametrize("placement", [pytest.param("separate", marks=only_nightly()), "graph"])
def test_a_node_s_part_is_required_in_every_start(bench: Bench, placement: str) -> None:
    spec = chain(harness={"placement": placement})
    spec["benchmark"] |= {"anatomy": True, "iterations": 3, "starts": 3}
    spec["benchmark"]["gate"] = {"confirm": False, "interference": "tolerate"}
    requirements = [
        f"second.callback.max >= {SECOND_MS:g} ms",
        f"first.callback.max < {FIRST_MS / 2:g} ms",
        "path.second.share > 40 %",
        "first.overtaken <= 0.1 %",
    ]
    spec["slos"] = {"parts": {"at": "20 Hz", "require": requirements}}
    done = bench.run(spec)
    met, broken, share, overtaken = (done.requirement(text) for text in requirements)
    # Nothing but a player or a monitor that had no processor excuses the node.
    excuses = ("publications began", "playback reached", "had no processor")
    for requirement, outcome in ((met, "pass"), (broken, "fail")):
        excused = any(excuse in requirement["reason"] for excuse in excuses)
        wanted = "inconclusive" if excused else outcome
        assert requirement["outcome"] == wanted, requirement["reason"]
    assert broken["estimate"] >= FIRST_MS / 1e3
    assert 0 < share["estimate"] < 1
    assert overtaken["estimate"] == 0
    assert [record.start for record in done.run().record.anatomies] == [1, 2, 3]
    for segment in done.segments():
        assert_parts_are_the_latency(done, segment)
    # The events of a start leave the memory to the next.
    assert not list(Path("/dev/shm").glob("r2bspec-anatomy-*"))  # noqa: S108 - looked at only
    # What was stored is judged as what was seen.
    before = (done.folder / "result.json").read_bytes()
    bench.judge(done.folder)
    assert (done.folder / "result.json").read_bytes() == before


ASKING = """
from rcl_interfaces.srv import ListParameters


class Asks(Node):
    def __init__(self, **kwargs):
        super().__init__("asks", **kwargs)
        self.output = self.create_publisher(Image, "output", 10)
        self.client = self.create_client(ListParameters, "answer")
        self.create_subscription(Image, "input", self.ask, 10)

    def ask(self, image):
        if self.client.service_is_ready():
            answer = self.client.call_async(ListParameters.Request())
            answer.add_done_callback(lambda _: self.output.publish(image))


class Answers(Node):
    def __init__(self, **kwargs):
        super().__init__("answers", **kwargs)
        self.create_service(ListParameters, "answer", lambda _, response: response)
"""


@only_nightly()
def test_a_path_leads_through_a_service_that_a_node_awaits(bench: Bench) -> None:
    bench.write_node("asking.py", ASKING)
    names = {"asks": "Asks", "answers": "Answers"}
    nodes = {name: {"python": f"./asking.py:{kind}"} for name, kind in names.items()}
    done = bench.run(relay_spec(graph={"nodes": nodes}), "--anatomy")
    done.assert_complete()
    (seen,) = done.segments("anatomy")
    path = anatomy_of(done, seen).paths["out"][0]
    assert path.hops == (
        *("player", "/r2b/input", "asks", "/r2b/answer", "answers"),
        *("/r2b/answer", "asks", "/r2b/output"),
    )
    assert np.count_nonzero(path.last) == path.seconds.size == STEPS


PLANNER = """
import time

from rclpy.action import ActionServer
from test_msgs.action import Fibonacci


class Planner(Node):
    def __init__(self, **kwargs):
        super().__init__("planner", **kwargs)
        self.server = ActionServer(self, Fibonacci, "/plan", self.plan)

    def plan(self, goal):
        time.sleep(0.06)
        goal.publish_feedback(Fibonacci.Feedback())
        goal.succeed()
        return Fibonacci.Result()
"""
EXECUTION_S = 0.06
"""Of a goal, here and in nodes_c/planner.c."""


@pytest.mark.parametrize(
    ("library", "threads"),
    [*(pytest.param("rclpy", threads, marks=only_nightly()) for threads in (1, 3)), ("rcl", 1)],
)
def test_the_parts_of_a_result_begin_with_its_goal(
    bench: Bench, library: str, threads: int
) -> None:
    pytest.importorskip("test_msgs")
    bench.write_node("planning.py", PLANNER)
    server: dict[str, Any] = {"python": "./planning.py:Planner"}
    if threads > 1:
        server |= {"executor": "multi_threaded", "threads": threads}
    if library == "rcl":
        headers = ("rcl_action", "action_msgs", "unique_identifier_msgs")
        server = {"command": [str(c_node("planner", "test_msgs", *headers))]}
    call = {"name": "/plan", "type": "test_msgs/action/Fibonacci"}
    done = bench.run(
        {
            "r2bspec": 1,
            "name": "actions",
            "playback": {"calls": {"it": {"action": call}}},
            "graph": {"nodes": {"server": server}},
            "benchmark": {"duration": "2 s", "iterations": 1, "starts": 1, "rates": ["10 Hz"]},
        },
        "--anatomy",
    )
    (observed,) = done.segments("anatomy")
    (path,) = anatomy_of(done, observed).paths["it"]
    of_action = "/plan/_action"
    assert path.hops == ("player", f"{of_action}/send_goal", "server", f"{of_action}/get_result")
    (monitor,) = (each for each in done.run().plan.monitors if each.name == "it")
    steps, rows, matching = match_segment(done.run(), observed, monitor)
    assert path.seconds.size > STEPS // 2
    # Every goal was sent in its step.
    place = np.searchsorted(steps["published_ns"], path.began_ns, side="right") - 1
    assert np.unique(place).size == place.size
    assert (path.began_ns <= steps["done_ns"][place]).all()
    answered = matching.answered[place]
    assert answered.sum() == matching.answered.sum()
    measured = (rows["received_ns"][matching.first_row] - steps["published_ns"])[place] / 1e9
    parts = np.sum([np.nan_to_num(part.seconds) for part in path.parts], axis=0)
    np.testing.assert_allclose(parts, path.seconds, rtol=0, atol=1e-9)
    assert np.median(parts[answered] / measured[answered]) == pytest.approx(1, rel=0.02)
    inside = [part for part in path.parts if part.name in {"callback", "held"}]
    assert {part.owner for part in inside} == {"server"}
    if threads == 1:
        inside = [part for part in inside if part.name == "callback"]
    spent = np.sum([np.nan_to_num(part.seconds) for part in inside], axis=0)
    assert np.median(spent) >= EXECUTION_S
