"""Parameters that processes do not declare: what is certainly misspelt, and what may be right."""

from __future__ import annotations

from collections.abc import Mapping

import pytest

from r2bspec.execute.bringup.spec_mismatches import ExpectedParameters, is_typing_error, undeclared
from r2bspec.ipc.protocol import ParameterLists

NODE = ExpectedParameters("/r2b/a", ("gian", "speed", "size"), own_node_name=True)


def said(
    expected: ExpectedParameters,
    lists: Mapping[str, tuple[str, ...]],
    lifecycle: tuple[str, ...] = (),
) -> dict[str, bool]:
    """The undeclared parameters, and whether each is harmless."""
    found = [*undeclared([expected], ParameterLists(parameters={**lists}, lifecycle=lifecycle))]
    assert {each.code for each in found} <= {"R2B211"}
    return {each.name: each.harmless for each in found}


def test_only_a_typing_error_is_certain() -> None:
    lists = {"/r2b/a": ("gain", "size", "use_sim_time")}
    assert said(NODE, lists) == {"gian": False, "speed": True}
    [first, _] = undeclared([NODE], ParameterLists(parameters={**lists}))
    assert first.message == "/r2b/a declares no parameter 'gian'"
    assert first.help == "did you mean 'gain'?"


def test_a_lifecycle_node_may_declare_it_when_it_is_configured() -> None:
    assert said(NODE, {"/r2b/a": ("gain", "size")}, ("/r2b/a",)) == {"gian": True, "speed": True}


def test_nothing_is_said_of_a_node_that_has_not_responded() -> None:
    assert said(NODE, {}) == {}
    assert said(NODE, {"/r2b/b": ("gain",)}) == {}


def test_a_program_may_have_nodes_of_any_name() -> None:
    program = ExpectedParameters("/r2b/p", ("speed", "size"), own_node_name=False)
    lists = {"/plain": ("size",), "/helper": ("speed",)}
    assert said(program, lists) == {}
    assert said(program, {"/plain": ("size",)}) == {"speed": True}
    # Parameters of other nodes in the plan are not its own.
    other = ExpectedParameters("/helper", ("speed",), own_node_name=True)
    found = undeclared([program, other], ParameterLists(parameters={**lists}))
    assert [(each.owner, each.name) for each in found] == [("/r2b/p", "speed")]


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
