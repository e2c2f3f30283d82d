"""Requests of services and actions, and requirements on their answers."""

from __future__ import annotations

from pathlib import Path

import pytest
from check_specs import codes, findings

from r2bspec.judge.measure.metric_catalogue import METRICS, example_requirement
from r2bspec.plan.request_fields import field_mistakes

SPEC = """\
r2bspec: 1
name: planner
playback:
  calls:
    add: {service: {name: add, type: test_msgs/srv/BasicTypes, request: {int64_value: 1}}}
    plan: {action: {name: plan, type: test_msgs/action/Fibonacci, goal: {order: 5}}, feedback: true}
graph: {nodes: {planner: {command: [cat]}}}
benchmark: {duration: 10 s, rates: [200 Hz]}
slos: {main: {at: 200 Hz, require: ["REQUIREMENT"]}}
"""


@pytest.mark.parametrize("metric", METRICS)
@pytest.mark.parametrize("call", ["", "add.", "plan_feedback."])
def test_every_metric_of_a_call_is_checked(metric: str, call: str) -> None:
    info = METRICS[metric]
    if call and info.scope != "monitor":
        return
    found = codes(SPEC.replace("REQUIREMENT", call + example_requirement(info)), offline=True)
    assert "R2B690" not in found


@pytest.mark.parametrize("call", ["add", "plan", "plan_accepted", "plan_feedback"])
def test_answers_and_losses_can_be_required(call: str) -> None:
    for requirement in (f"{call}.latency.p90 < 50 ms", f"{call}.drop_rate <= 1 %"):
        found = codes(SPEC.replace("REQUIREMENT", requirement), offline=True)
        assert [code for code in found if code.startswith("R2B5")] == []


def test_values_that_types_take_are_checked() -> None:
    point = {
        "x": "double",
        "near": "sequence<float, 2>",
        "flags": "boolean[2]",
        "name": "string<3>",
    }
    types = {"geometry_msgs/Point": point}
    fields = {"at": "geometry_msgs/Point", "all": "sequence<geometry_msgs/Point>", "raw": "octet"}
    fitting = {"x": 1, "near": [0.5, 1], "flags": [True, False], "name": "abc"}
    request = {"at": fitting, "all": [fitting, {}]}
    assert [*field_mistakes(request, fields, types.get)] == []
    wrong = {
        "at": {"x": True, "near": [1, 2, 3], "flags": [True], "name": "abcd"},
        "all": [{}, {"y": 1}, 5],
        "raw": 1,
    }
    assert [(each.where, each.is_name) for each in field_mistakes(wrong, fields, types.get)] == [
        ("at.x", False),
        ("at.near", False),
        ("at.flags", False),
        ("at.name", False),
        ("all[1].y", True),
        ("all[2]", False),
        ("raw", False),
    ]


PACKAGE = {
    "srv/__init__.py": "from plan_msgs.srv._get import Get_Request\n"
    "from plan_msgs.srv._get import Get_Response\nfrom plan_msgs.srv._get import Get\n",
    "srv/_get.py": "raise SystemExit\n"
    "class Get_Request:\n    _fields_and_field_types = {'goal': 'plan_msgs/Goal', 'n': 'uint8'}\n"
    "class Get_Response:\n    _fields_and_field_types = {'done': 'boolean', 'text': 'string'}\n",
    "msg/__init__.py": "from plan_msgs.msg._goal import Goal\n",
    "msg/_goal.py": "class Goal:\n    _fields_and_field_types = {'x': 'double'}\n",
}
CALL = """\
r2bspec: 1
name: planner
playback:
  calls:
    get:
      service: {name: get, type: plan_msgs/srv/Get, request: {goal: {y: 1}, n: 256}}
      each: [{n: 1}, {m: 1}]
      success: text
graph: {nodes: {planner: {command: [cat]}}}
benchmark: {duration: 10 s, rates: [200 Hz]}
"""


def test_requests_are_checked_against_the_installed_type(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, text in PACKAGE.items():
        file = tmp_path / "plan_msgs" / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
    (tmp_path / "plan_msgs" / "__init__.py").touch()
    monkeypatch.syspath_prepend(tmp_path)
    found = [each for each in findings(CALL, offline=True) if each.code == "R2B240"]
    request = "in a request of plan_msgs/srv/Get:"
    assert [(each.span.line, each.message, each.help) for each in found] == [
        (6, f"goal.y {request} there is no field 'y'", "its fields: 'x'"),
        (
            6,
            f"n {request} it cannot be 256: its type is uint8",
            "write an integer from 0 to 255",
        ),
        (7, f"m {request} there is no field 'm'", "its fields: 'goal' and 'n'"),
        (
            8,
            "the response of plan_msgs/srv/Get has no field 'text' that is true or false",
            "such fields: 'done'",
        ),
    ]
    monkeypatch.undo()
    assert "R2B240" not in codes(CALL, offline=True)


def test_recorded_calls_are_no_messages() -> None:
    text = """\
r2bspec: 1
name: planner
data_loader: {bag: r2b_storage, topics: {/get_plan/_service_event: events}}
playback: {inputs: {events: {from: events, format: nav_msgs/msg/Path}}}
graph: {nodes: {planner: {python: r2bspec.nodes.RelayNode}}}
monitors: {plan: {topic: output, format: sensor_msgs/msg/Image}}
benchmark: {duration: 10 s, rates: [200 Hz]}
"""
    [found] = [each for each in findings(text, offline=True) if each.code == "R2B241"]
    assert "recorded calls of the service '/get_plan'" in found.message
    # That no node subscribes to them follows.
    assert "R2B208" not in codes(text, offline=True)
