"""Differences between nodes and the plan, and which of them keep messages from arriving."""

from __future__ import annotations

from collections.abc import Mapping

import pytest

from plans import node_plan
from r2bspec.execute.bringup.node_faults import (
    is_typing_error,
    require_declared_parameters,
    undeclared,
    unmatched_remappings,
)
from r2bspec.execute.diagnose.diagnosis import graph_mismatches, related_differences
from r2bspec.execute.diagnose.first_fault import NO_OUTPUT, NO_PUBLISHER, NO_SUBSCRIPTION, _fault
from r2bspec.execute.errors import GraphDifferencesError
from r2bspec.ipc.protocol import ParameterLists, Ready
from r2bspec.plan.plan import NodePlan

READY = Ready(
    endpoints=(
        ("/r2b/a", "/r2b/output", "T", "publishes"),
        ("/r2b/b", "/r2b/other", "T", "publishes"),
    ),
    undeclared=(("/r2b/a", "rtae"), ("/r2b/a", "size")),
    parameters={"/r2b/a": ("rate", "speed")},
    unmatched=(("/r2b/a", "outptu", "/r2b/last"), ("/r2b/b", "x", "/r2b/y")),
)


def test_every_undeclared_parameter_is_named_by_the_code_of_validate() -> None:
    with pytest.raises(GraphDifferencesError, match="'rtae'; .*'size'") as caught:
        require_declared_parameters(READY)
    assert (caught.value.code, caught.value.exit_code) == ("R2B211", 2)
    first, second = caught.value.differences
    assert (first.part, first.owner, first.name) == ("parameter", "/r2b/a", "rtae")
    assert first.help == "did you mean 'rate'?"
    assert second.help == "its parameters: rate, speed"


def test_a_remapping_that_changed_nothing_ends_no_run_by_itself() -> None:
    first, _ = unmatched_remappings(READY)
    assert (first.code, first.name, first.topic) == ("R2B204", "outptu", "/r2b/last")
    assert first.harmless
    assert first.help == "its topics: /r2b/output"
    assert graph_mismatches([], [first]) == ()


def test_a_remapping_is_the_cause_of_the_topic_that_it_did_not_make() -> None:
    missing = _fault(NO_PUBLISHER, "/r2b/last", "", "no publisher on /r2b/last")
    other = _fault(NO_SUBSCRIPTION, "/r2b/in", "/r2b/b", "no subscription to /r2b/in")
    found = graph_mismatches([missing, other], unmatched_remappings(READY))
    assert [(each.code, each.harmless) for each in found] == [("R2B204", False), ("R2B208", False)]


def test_a_node_without_output_is_no_difference_but_its_remappings_are_reported() -> None:
    no_output = _fault(NO_OUTPUT, "/r2b/out", "/r2b/a", "it publishes nothing")
    found = list(unmatched_remappings(READY))
    assert graph_mismatches([no_output], found) == ()
    assert "'outptu'" in related_differences([no_output], found)
    assert "'x'" not in related_differences([no_output], found)


def sets(name: str, *parameters: str) -> NodePlan:
    return node_plan(name, parameters=dict.fromkeys(parameters, 1))


NODE = sets("a", "gian", "speed", "size")


def said(
    node: NodePlan,
    lists: Mapping[str, tuple[str, ...]],
    lifecycle: tuple[str, ...] = (),
    *,
    own_name: bool = True,
) -> dict[str, bool]:
    """The undeclared parameters, and whether each is harmless."""
    found = [
        *undeclared([(node, own_name)], ParameterLists(parameters={**lists}, lifecycle=lifecycle))
    ]
    assert {each.code for each in found} <= {"R2B211"}
    return {each.name: each.harmless for each in found}


def test_only_a_typing_error_is_certain() -> None:
    lists = {"/r2b/a": ("gain", "size", "use_sim_time")}
    assert said(NODE, lists) == {"gian": False, "speed": True}
    [first, _] = undeclared([(NODE, True)], ParameterLists(parameters={**lists}))
    assert first.message == "/r2b/a declares no parameter 'gian'"
    assert first.help == "did you mean 'gain'?"


@pytest.mark.parametrize(
    ("written", "meant", "expected"),
    [
        ("gian", "gain", True),
        ("gan", "gain", True),
        ("gainn", "gain", True),
        ("gaim", "gain", True),
        ("again", "gain", True),
        ("gain", "gain", False),
        ("image_width", "image_height", False),
        ("speed", "gain", False),
        ("gnia", "gain", False),
        ("x", "y", False),
        ("", "a", False),
    ],
)
def test_a_typing_error_is_one_letter(written: str, meant: str, *, expected: bool) -> None:
    assert is_typing_error(written, meant) == expected
    assert is_typing_error(meant, written) == expected
