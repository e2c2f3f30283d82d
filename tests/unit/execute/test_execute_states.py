"""The states of a run: they follow each other as the documentation draws them, and only so."""

from __future__ import annotations

import re
from collections import defaultdict
from pathlib import Path

import pytest

from r2bspec.execute.progress import NullProgress
from r2bspec.execute.states import NEXT, RunState, RunStates

PAGE = Path(__file__).parents[3] / "docs" / "execution.md"


def drawn_transitions() -> dict[str, set[str]]:
    """The successors of each state; a choice is only a shorter way to draw several arrows."""
    drawing = PAGE.read_text(encoding="utf-8").partition("```mermaid")[2].partition("```")[0]
    successors: dict[str, set[str]] = defaultdict(set)
    for before, after in re.findall(r"(\S+) --> (\S+)", drawing):
        successors[before].add(after)
    for choice in re.findall(r"state (\w+) <<choice>>", drawing):
        chosen = successors.pop(choice)
        for after in successors.values():
            if choice in after:
                after.remove(choice)
                after |= chosen
    return successors


def test_the_drawing_shows_the_transitions() -> None:
    drawn = drawn_transitions()
    assert drawn.pop("[*]") == {RunState.PREPARE}
    assert drawn.pop(RunState.COLLECT) == {"[*]"}
    assert drawn == {state: set(after) for state, after in NEXT.items() if after}


def test_every_state_can_be_reached_and_leads_to_the_end() -> None:
    assert set(NEXT) == set(RunState)
    assert set().union(*NEXT.values()) | {RunState.PREPARE} == set(RunState)
    leading = {RunState.COLLECT}
    while more := {state for state, after in NEXT.items() if after & leading} - leading:
        leading |= more
    assert leading == set(RunState)


def test_a_run_cannot_skip_a_state() -> None:
    states = RunStates(NullProgress())
    states.enter(RunState.LOAD, "reading")
    with pytest.raises(RuntimeError, match="from 'load' to 'play'"):
        states.enter(RunState.PLAY, "playing")
    states.note("3 messages")
    assert states.state is RunState.LOAD
    assert [text for _, text in states.events] == ["phase load", "3 messages"]
    assert [phase.name for phase in states.clock.phases()] == ["prepare", "load"]
