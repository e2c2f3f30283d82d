"""Differences between nodes and the plan, and which of them keep messages from arriving."""

from __future__ import annotations

import pytest

from r2bspec.execute.bringup.find_fault import Fault
from r2bspec.execute.bringup.graph_matching import graph_mismatches, related_differences
from r2bspec.execute.bringup.spec_mismatches import (
    require_declared_parameters,
    unmatched_remappings,
)
from r2bspec.execute.errors import GraphMismatchError
from r2bspec.ipc.protocol import Ready

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
    with pytest.raises(GraphMismatchError, match="'rtae'; .*'size'") as caught:
        require_declared_parameters(READY)
    assert (caught.value.code, caught.value.exit_code) == ("R2B211", 2)
    first, second = caught.value.differences
    assert (first.part, first.owner, first.name) == ("parameter", "/r2b/a", "rtae")
    assert first.help == "did you mean 'rate'?"
    assert second.help == "its parameters: rate, speed"


def test_a_node_that_declares_everything_is_not_refused() -> None:
    require_declared_parameters(Ready())


def test_a_remapping_that_changed_nothing_ends_no_run_by_itself() -> None:
    first, _ = unmatched_remappings(READY)
    assert (first.code, first.name, first.topic) == ("R2B204", "outptu", "/r2b/last")
    assert first.harmless
    assert first.help == "its topics: /r2b/output"
    assert graph_mismatches([], [first]) == ()


def test_a_remapping_is_the_cause_of_the_topic_that_it_did_not_make() -> None:
    missing = Fault("no publisher", "/r2b/last", "", "no publisher on /r2b/last")
    other = Fault("no subscription", "/r2b/in", "/r2b/b", "no subscription to /r2b/in")
    found = graph_mismatches([missing, other], unmatched_remappings(READY))
    assert [(each.code, each.harmless) for each in found] == [("R2B204", False), ("R2B208", False)]


def test_a_node_without_output_is_no_difference_but_its_remappings_are_reported() -> None:
    no_output = Fault("no output", "/r2b/out", "/r2b/a", "it publishes nothing")
    found = list(unmatched_remappings(READY))
    assert graph_mismatches([no_output], found) == ()
    assert "'outptu'" in related_differences([no_output], found)
    assert "'x'" not in related_differences([no_output], found)


def test_a_fault_that_may_disappear_is_no_difference() -> None:
    missing = Fault("no publisher", "/r2b/slow", "/r2b/program", "no publisher on /r2b/slow")
    assert graph_mismatches([missing], [], lambda _: False) == ()
    # A remapping that matches no topic of its node is one nevertheless.
    last = Fault("no publisher", "/r2b/last", "", "no publisher on /r2b/last")
    (found,) = graph_mismatches([last], unmatched_remappings(READY), lambda _: False)
    assert found.code == "R2B204"
