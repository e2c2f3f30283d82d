"""Requests of services and actions, and requirements on their answers."""

from __future__ import annotations

from pathlib import Path

import pytest
from check_specs import codes, findings

from r2bspec.check.engine import check
from r2bspec.judge.measure.metric_catalogue import listed
from r2bspec.language.load_spec import load_spec
from r2bspec.plan.request_fields import field_mistakes
from service_events import ADD_EVENTS, ADD_TYPE, ANSWERED, RECEIVED, SENT, event, write_events

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


def required(*requirements: str) -> list[str]:
    """The codes of what is found in the spec with these requirements."""
    return codes(SPEC.replace("REQUIREMENT", '", "'.join(requirements)), offline=True)


def test_every_metric_is_checked_where_no_call_is_named() -> None:
    assert "R2B501" not in required(*(info.example for info in listed().values()))


@pytest.mark.parametrize("call", ["add", "plan", "plan_accepted", "plan_feedback"])
def test_every_metric_of_a_call_is_checked(call: str) -> None:
    infos = [info for info in listed().values() if info.scope == "monitor"]
    # Nothing reacts in a call. What the program offers is all that is not known.
    named = [*infos]
    assert required(*(f"{call}.{info.example}" for info in named)) == ["R2B234"]


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
    # The parts of an action are in its file alone.
    "action/__init__.py": "from plan_msgs.action._go import Go\n",
    "action/_go.py": "class Go_Goal:\n    _fields_and_field_types = {'order': 'int32'}\n",
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
    go: {action: {name: go, type: plan_msgs/action/Go, goal: {odrer: 1}}}
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
        (
            9,
            "odrer in a goal of plan_msgs/action/Go: there is no field 'odrer'",
            "did you mean 'order'?",
        ),
    ]
    monkeypatch.undo()
    assert "R2B240" not in codes(CALL, offline=True)


RECORDED = """\
r2bspec: 1
name: adder
data_loader: {bag: ./calls, topics: {/add/_service_event: buffer/add}}
playback:
  mode: timeline
  calls:
    add:
      service: {name: add, type: test_msgs/srv/BasicTypes}
      from: buffer/add
graph: {nodes: {adder: {command: [cat]}}}
benchmark: {duration: 10 s}
"""
REQUEST = event(RECEIVED, request=b"request")


def found_in_bag(tmp_path: Path, text: str) -> list[tuple[str, str, str]]:
    spec = tmp_path / "adder.r2b.yaml"
    spec.write_text(text)
    found = check(load_spec(spec), context=None)
    return [(each.code, each.message, each.help) for each in found if each.severity == "error"]


@pytest.mark.parametrize(
    ("events", "topic", "kind", "said", "helps"),
    [
        (
            [(0, event(SENT)), (1, event(ANSWERED, request=b"response"))],
            *(ADD_EVENTS, ADD_TYPE),
            *("has events of calls, and no request", "ServiceIntrospectionState.CONTENTS"),
        ),
        (
            [(0, REQUEST)],
            *(ADD_EVENTS, "nav_msgs/srv/GetPlan_Event"),
            *("has calls of nav_msgs/srv/GetPlan, not of test_msgs/srv/BasicTypes", "that type"),
        ),
        (
            [(0, REQUEST)],
            *("/add", "std_msgs/msg/String"),
            *("has no recorded calls", "configure_introspection"),
        ),
    ],
)
def test_a_recording_without_requests_of_a_call_is_refused(
    tmp_path: Path, events: list[tuple[int, bytes]], topic: str, kind: str, said: str, helps: str
) -> None:
    write_events(tmp_path / "calls", events, topic, kind)
    [(code, message, help_text)] = found_in_bag(tmp_path, RECORDED.replace(ADD_EVENTS, topic))
    assert code == "R2B242"
    assert said in message
    assert helps in help_text


def test_recorded_requests_are_called_at_their_times_or_at_a_rate(tmp_path: Path) -> None:
    write_events(tmp_path / "calls", [(0, REQUEST), (500, REQUEST)])
    at_rates = RECORDED.replace("  mode: timeline\n", "").replace("10 s", "10 s, rates: [5 Hz]")
    assert found_in_bag(tmp_path, RECORDED) == []
    assert found_in_bag(tmp_path, at_rates) == []
    goal = "action: {name: add, type: test_msgs/action/Fibonacci}"
    of_action = RECORDED.replace("service: {name: add, type: test_msgs/srv/BasicTypes}", goal)
    [(code, message, _)] = found_in_bag(tmp_path, of_action)
    assert (code, "not of test_msgs/action/Fibonacci_SendGoal" in message) == ("R2B242", True)
