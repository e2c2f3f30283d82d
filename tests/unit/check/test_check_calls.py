"""Requirements on the answers of services and actions."""

from __future__ import annotations

import pytest
from check_specs import codes

from r2bspec.judge.measure.metric_catalogue import METRICS, example_requirement

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
