"""Services and actions are called: with what a spec says, and when it is due."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from nightly import only_nightly

pytest.importorskip("rclpy")
pytest.importorskip("test_msgs")

from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.serialization import serialize_message
from test_msgs.srv import BasicTypes

from c_nodes import c_node
from r2bspec.errors import ExitStatus
from r2bspec.execute.errors import RunError
from r2bspec.harness.rclpy_tools import TypeNotFoundError, interface_class
from r2bspec.harness.service_client import ServiceCallError, fill_message
from r2bspec.ipc.arrivals import step_times_ns
from r2bspec.language.spec import Arrivals
from r2bspec.record.run_record import Segment
from r2bspec.record.sample_arrays import Rows
from ros_runs import Bench, quick_input, relay_spec
from ros_runs import bench as bench
from service_events import ADD_EVENTS, write_events

# Every fourth request fails. The service takes longer than its period.
NODES = """
import time

from rclpy.action import ActionServer
from test_msgs.action import Fibonacci
from test_msgs.srv import BasicTypes


class Slow(Node):
    def __init__(self, **kwargs):
        super().__init__("slow", **kwargs)
        self.calls = 0
        self.create_service(BasicTypes, "slow", self.answer)

    def answer(self, request, response):
        assert (request.int32_value, request.int64_value) == (7, self.calls % 2)
        time.sleep(0.15)
        self.calls += 1
        response.bool_value = self.calls % 4 != 0
        return response


class RelayWithService(Node):
    def __init__(self, **kwargs):
        super().__init__("relay", **kwargs)
        output = self.create_publisher(Image, "output", 10)
        self.create_subscription(Image, "input", output.publish, 10)
        self.create_service(BasicTypes, "double", lambda _, response: response)


class Planner(Node):
    def __init__(self, **kwargs):
        super().__init__("planner", **kwargs)
        self.goals = 0
        self.server = ActionServer(self, Fibonacci, "plan", self.plan)

    def plan(self, goal):
        assert goal.request.order == 7
        for number in range(3):
            goal.publish_feedback(Fibonacci.Feedback(sequence=[number]))
            time.sleep(0.005)
        self.goals += 1
        goal.abort() if self.goals % 4 == 0 else goal.succeed()
        return Fibonacci.Result()
"""

SLOW = {"name": "slow", "type": "test_msgs/srv/BasicTypes", "request": {"int32_value": 7}}
PLAN = {"name": "plan", "type": "test_msgs/action/Fibonacci", "goal": {"order": 7}}


def calls_spec(node: str, call: dict[str, Any]) -> dict[str, Any]:
    return {
        "r2bspec": 1,
        "name": "calls",
        "playback": {"calls": {"it": call}},
        "graph": {"nodes": {"server": {"python": f"./nodes.py:{node}"}}},
        "benchmark": {"duration": "2 s", "iterations": 1, "starts": 1, "rates": ["10 Hz"]},
    }


def test_nested_messages_and_sequences_of_them_are_made() -> None:
    values = {
        "parameters": [
            {"name": "ratio", "value": {"type": 3, "double_value": 2}},
            {"name": "names", "value": {"type": 9, "string_array_value": ["a", "b"]}},
        ]
    }
    request = fill_message(SetParameters.Request(), values)
    assert [parameter.name for parameter in request.parameters] == ["ratio", "names"]
    assert request.parameters[0].value.double_value == 2.0
    assert list(request.parameters[1].value.string_array_value) == ["a", "b"]


def test_nothing_said_leaves_the_defaults() -> None:
    assert list(fill_message(GetParameters.Request(), {}).names) == []


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"nmes": []}, "nmes of the request: there is no field 'nmes'; did you mean 'names'"),
        ({"names": 3}, "names of the request: it cannot be 3: its type is sequence<string>"),
    ],
)
def test_a_field_that_is_wrong_is_named(values: dict[str, object], said: str) -> None:
    with pytest.raises(ServiceCallError, match=said):
        fill_message(GetParameters.Request(), values)


def test_a_service_type_that_is_not_installed() -> None:
    assert interface_class("rcl_interfaces/srv/GetParameters") is GetParameters
    for wrong in ("nowhere/srv/Nothing", "rcl_interfaces/srv/Nothing", "nonsense", "a/action/B"):
        with pytest.raises(TypeNotFoundError, match=f"type {wrong} is not installed") as refused:
            interface_class(wrong)
        assert RunError(str(refused.value), code=refused.value.code).exit_code == ExitStatus.USAGE


def test_recorded_requests_are_sent_whether_or_not_earlier_ones_are_answered(bench: Bench) -> None:
    requests = [BasicTypes.Request(int64_value=number) for number in range(2)]
    events = [BasicTypes.Event(request=[request]) for request in requests]
    recorded = [(100 * number, serialize_message(each)) for number, each in enumerate(events)]
    write_events(bench.folder / "calls", recorded)
    spec = calls_spec("Slow", {"service": SLOW, "from": "buffer/add", "success": "bool_value"})
    spec["data_loader"] = {"bag": "./calls", "topics": {ADD_EVENTS: "buffer/add"}}
    spec["playback"]["mode"] = "timeline"
    del spec["benchmark"]["rates"]
    run = bench.run(spec).run()
    (segment,) = (each for each in run.record.segments if each.kind == "iteration")
    played, answers = run.playback(segment), run.monitor(segment, "it")
    assert played.size == 20
    assert np.allclose(np.diff(played["due_ns"]), 1e8)
    assert (played["published_ns"] >= played["due_ns"]).all()
    # A response in which `success` is false does not count, as one that never came.
    assert 0 < answers.size <= 16
    at = np.searchsorted(played["stamp_ns"], answers["stamp_ns"])
    assert (played["stamp_ns"][at] == answers["stamp_ns"]).all()
    assert (answers["received_ns"] - played["published_ns"][at] >= 150_000_000).all()
    # The next request does not wait for the answer.
    later = at < played.size - 1
    assert (played["published_ns"][at[later] + 1] < answers["received_ns"][later]).any()


POISSON = {"kind": "poisson", "seed": 3}


def assert_poisson(segment: Segment, played: Rows) -> None:
    """See that the steps of a segment came when they should."""
    arrivals = Arrivals(kind="poisson", seed=3)
    due_ns = step_times_ns(arrivals, segment.rate_hz, played.size, segment.id)
    assert (played["due_ns"] - played["due_ns"][0]).tolist() == due_ns.tolist()
    assert (played["published_ns"] >= played["due_ns"]).all()


def test_services_are_called_in_steps_of_inputs(bench: Bench) -> None:
    call = {"service": {**SLOW, "name": "double"}, "every": 4}
    spec = relay_spec(
        graph={"nodes": {"relay": {"python": "./nodes.py:RelayWithService"}}},
        playback={
            "inputs": {"input": quick_input("loaded")},
            "calls": {"it": call},
            "arrivals": POISSON,
        },
    )
    run = bench.run(spec).run()
    (segment,) = (each for each in run.record.segments if each.kind == "iteration")
    played, answers = run.playback(segment), run.monitor(segment, "it")
    assert played.size == 20
    assert_poisson(segment, played)
    assert run.monitor(segment, "out").size > 0
    at = np.searchsorted(played["stamp_ns"], answers["stamp_ns"])
    assert 0 < answers.size <= 5
    assert (played["stamp_ns"][at] == answers["stamp_ns"]).all()
    assert (np.diff(at) % 4 == 0).all()
    assert (answers["received_ns"] > played["published_ns"][at]).all()
    roles = {process.name: process.role for process in run.record.processes}
    assert (roles["player"], roles["caller"]) == ("player", "caller")


@only_nightly()
def test_a_service_in_c_is_called(bench: Bench) -> None:
    # A command without settings of ROS runs as it is written: in no namespace.
    called = {**SLOW, "name": "/double"}
    spec = calls_spec("Slow", {"service": called, "success": "bool_value"})
    spec["graph"]["nodes"] = {"doubler": {"command": [str(c_node("doubler", "test_msgs"))]}}
    run = bench.run(spec).run()
    (segment,) = (each for each in run.record.segments if each.kind == "iteration")
    played, answers = run.playback(segment), run.monitor(segment, "it")
    assert played.size == 20
    assert 0 < answers.size <= 15
    assert np.isin(answers["stamp_ns"], played["stamp_ns"]).all()


def test_of_an_action_acceptance_feedback_and_success_are_measured(bench: Bench) -> None:
    call = {"action": PLAN, "feedback": True, "each": [{"order": 7}, {}]}
    spec = calls_spec("Planner", call)
    spec["playback"]["arrivals"] = POISSON
    run = bench.run(spec).run()
    (segment,) = (each for each in run.record.segments if each.kind == "iteration")
    assert_poisson(segment, run.playback(segment))
    rows = {name: run.monitor(segment, name) for name in ("it_accepted", "it_feedback", "it")}
    first = {}
    for name, each in rows.items():
        stamps, place = np.unique(each["stamp_ns"], return_index=True)
        first[name] = dict(zip(stamps.tolist(), each["received_ns"][place].tolist(), strict=True))
    assert 0 < len(first["it"]) <= 16
    assert set(first["it"]) <= set(first["it_accepted"])
    assert all(first["it_accepted"][stamp] < result for stamp, result in first["it"].items())
    told = first["it"].keys() & first["it_feedback"].keys()
    assert told
    assert all(first["it_feedback"][stamp] < first["it"][stamp] for stamp in told)
    # Each message of the feedback is a row; the first one answers the step.
    assert rows["it_feedback"].size > len(first["it_feedback"])


@only_nightly()
def test_a_service_that_nobody_offers_is_named(bench: Bench) -> None:
    spec = calls_spec("Planner", {"service": {**SLOW, "name": "other"}})
    spec["benchmark"]["start_timeout"] = "3 s"
    ended = bench.run(spec)
    assert ended.status == 4
    assert "error[R2B640 graph-not-connected]: no node offers /r2b/other" in ended.stderr
