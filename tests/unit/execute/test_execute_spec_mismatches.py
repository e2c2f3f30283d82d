"""What a node did not take of the plan, and which of that is why messages do not arrive."""

from __future__ import annotations

import pytest

from r2bspec.execute.bringup.spec_mismatches import (
    differences_of,
    refuse_undeclared,
    suspicions,
    unmatched_remappings,
)
from r2bspec.execute.diagnosis.find_break import Break
from r2bspec.execute.errors import GraphDiffersError
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
    with pytest.raises(GraphDiffersError, match="'rtae'; .*'size'") as caught:
        refuse_undeclared(READY)
    assert (caught.value.code, caught.value.exit_code) == ("R2B211", 2)
    first, second = caught.value.differences
    assert (first.part, first.owner, first.name) == ("parameter", "/r2b/a", "rtae")
    assert first.help == "did you mean 'rate'?"
    assert second.help == "its parameters: rate, speed"


def test_a_node_that_declares_everything_is_not_refused() -> None:
    refuse_undeclared(Ready())


def test_a_remapping_that_changed_nothing_ends_no_run_by_itself() -> None:
    first, _ = unmatched_remappings(READY)
    assert (first.code, first.name, first.topic) == ("R2B204", "outptu", "/r2b/last")
    assert first.harmless
    assert first.help == "its topics: /r2b/output"
    assert differences_of([], [first]) == ()


def test_a_remapping_is_the_cause_of_the_topic_that_it_did_not_make() -> None:
    missing = Break("unwritten", "/r2b/last", "", "/r2b/last: nobody writes it")
    other = Break("unread", "/r2b/in", "/r2b/b", "/r2b/in: nobody reads it")
    found = differences_of([missing, other], unmatched_remappings(READY))
    assert [(each.code, each.harmless) for each in found] == [("R2B204", False), ("R2B208", False)]


def test_what_a_node_does_with_its_messages_is_no_difference_but_its_remappings_are_told() -> None:
    swallowed = Break("swallowed", "/r2b/out", "/r2b/a", "it publishes nothing")
    found = list(unmatched_remappings(READY))
    assert differences_of([swallowed], found) == ()
    assert "'outptu'" in suspicions([swallowed], found)
    assert "'x'" not in suspicions([swallowed], found)


def test_what_may_still_come_is_no_difference() -> None:
    missing = Break("unwritten", "/r2b/slow", "/r2b/program", "/r2b/slow: nobody writes it")
    assert differences_of([missing], [], lambda _: False) == ()
    # A remapping that the node itself has not taken is one all the same.
    last = Break("unwritten", "/r2b/last", "", "/r2b/last: nobody writes it")
    (found,) = differences_of([last], unmatched_remappings(READY), lambda _: False)
    assert found.code == "R2B204"
