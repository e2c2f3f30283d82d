"""An output that stops: the graph's fault, or that of what carries the messages to it."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from graph_facts import graph, topic
from r2bspec.execute.errors import DeadInputError, RunError
from r2bspec.execute.start.silent_outputs import SilentOutputs
from run_simulation import monitor_plan, segment_of


def stopped(late: int = 0, **inputs: int) -> SilentOutputs:
    """What is found out about an output that has stopped; by input, how many messages arrived."""
    topics = [topic(f"/{name}", "player", "/b", passed=passed) for name, passed in inputs.items()]
    facts = graph(*topics, topic("/r2b/out", "/b", "monitor", passed=0))
    observer = SimpleNamespace(trace=lambda _, __, play: (play(), facts)[1])
    observed: Any = SimpleNamespace(
        plan=SimpleNamespace(inputs=("in",), called={}),
        observer=observer,
        supervisor=None,
        note=lambda _: None,
    )
    player: Any = SimpleNamespace(
        play_unrecorded=lambda *_: None, discard_new_rows=lambda: {"out": late}
    )
    nobody: Any = None
    return SilentOutputs(observed, Path(), nobody, player)


def test_silence_that_begins_at_the_input_ends_the_run_as_invalid() -> None:
    outputs = stopped(image=0)
    with pytest.raises(DeadInputError) as caught:
        outputs.explain_stop(segment_of(30, 300), monitor_plan("out"))
    assert "10 messages were played on /image, but none arrived" in str(caught.value)
    assert "r2bspec doctor" in caught.value.hint
    assert (caught.value.status, RunError("another").status) == ("invalid", "incomplete")
    (gap,) = outputs.records
    assert gap.reason == "10 messages were played on /image, but none arrived"


@pytest.mark.parametrize(
    ("inputs", "late"),
    [({"image": 10}, 0), ({"image": 0, "info": 10}, 0), ({"image": 0}, 3)],
    ids=["the node is silent", "the other input arrives", "the outputs were late"],
)
def test_any_other_silence_is_in_the_record_and_the_run_goes_on(
    inputs: dict[str, int], late: int
) -> None:
    outputs = stopped(late, **inputs)
    outputs.explain_stop(segment_of(30, 300), monitor_plan("out"))
    assert len(outputs.records) == 1
