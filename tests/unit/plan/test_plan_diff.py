"""Two plans, compared."""

from __future__ import annotations

from typing import Any

import msgspec
from hypothesis import given
from hypothesis import strategies as st
from plan_specs import PREPROCESSED, STRAIGHT, plan

from r2bspec.plan.comparability import ABSENT, PlanDifference, diff_plans


def test_equal_plans_do_not_differ() -> None:
    assert diff_plans(plan(), plan()) == []


def test_a_value_that_differs_has_its_path() -> None:
    resize = PREPROCESSED["preprocessors"]["resize"]
    wider = {"resize": {**resize, "parameters": {"width": 1280, "height": 480}}}
    (found,) = diff_plans(plan(), plan(preprocessors=wider))
    place = ("processes", "preprocess.resize", "nodes", "/r2b/resize", "parameters", "width")
    assert found == PlanDifference(place, 640, 1280)
    assert str(found) == (
        "processes['preprocess.resize'].nodes['/r2b/resize'].parameters.width: 640 -> 1280"
    )


def test_members_are_found_again_wherever_they_stand() -> None:
    full = plan(STRAIGHT)
    fewer = msgspec.structs.replace(full, processes=full.processes[1:])
    (found,) = diff_plans(full, fewer)
    assert found.path == ("processes", "player")
    assert found.after is ABSENT
    assert str(found).endswith("-> (absent)")
    (added,) = diff_plans(fewer, full)
    assert added.before is ABSENT


def test_another_order_is_a_difference() -> None:
    full = plan(STRAIGHT)
    turned = msgspec.structs.replace(full, processes=full.processes[::-1])
    (found,) = diff_plans(full, turned)
    assert found.path == ("processes", "order")
    assert found.before == ["player", "relay", "monitor"]


def test_an_integer_is_not_a_double() -> None:
    def with_gain(gain: Any) -> Any:
        return plan(STRAIGHT, graph={"nodes": {"n": {"python": "m.N", "parameters": gain}}})

    assert diff_plans(with_gain({"g": 1}), with_gain({"g": 1.0}))
    assert diff_plans(with_gain({"g": 1}), with_gain({"g": True}))


def test_lists_without_identity_are_compared_by_place() -> None:
    other = plan(benchmark={"rates": ["10 Hz"]})
    paths = {diff_plan.path for diff_plan in diff_plans(plan(), other)}
    assert ("phases", 6) in paths
    assert ("play", "30.0") in paths
    assert ("search",) in paths


@given(st.lists(st.sampled_from("abc"), max_size=4), st.lists(st.sampled_from("abc"), max_size=4))
def test_there_is_a_difference_if_and_only_if_plans_are_unequal(
    before: list[str], after: list[str]
) -> None:
    full = plan(STRAIGHT)

    def with_monitors(names: list[str]) -> Any:
        monitor = full.monitors[0]
        return msgspec.structs.replace(
            full, monitors=tuple(msgspec.structs.replace(monitor, name=name) for name in names)
        )

    assert bool(diff_plans(with_monitors(before), with_monitors(after))) == (before != after)
