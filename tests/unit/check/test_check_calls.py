"""Requests of services and actions, and requirements on their answers."""

from __future__ import annotations

import pytest
from check_specs import codes

from r2bspec.harness.request_fields import field_mistakes
from r2bspec.judge.measure.metric_catalogue import listed

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
