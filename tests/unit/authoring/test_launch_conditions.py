"""Conditions, arguments, includes and groups of launch files in Python, XML and YAML."""

from __future__ import annotations

from pathlib import Path

import pytest

from launch_specs import made, stored

STARTED = ["real", "by_name", "compared", "evaluated", "inside", "rectify", "delayed"]


@pytest.fixture(autouse=True)
def included_file() -> None:
    Path("more.launch.xml").write_text(stored("more.launch.xml"))


@pytest.mark.parametrize(("suffix", "late"), [("py", ["late"]), ("xml", []), ("yaml", [])])
def test_only_what_is_started_is_a_node(suffix: str, late: list[str]) -> None:
    spec, _ = made(f"a.launch.{suffix}", stored(f"conditions.launch.{suffix}"))
    assert spec.namespace == "/"
    assert list(spec.graph.nodes) == STARTED + late
    inside, rectify = spec.graph.nodes["inside"], spec.graph.nodes["rectify"]
    assert (inside.namespace, inside.arguments) == ("/cell_left", ("--on", "3"))
    assert inside.parameters == {"lamp.watts": 3.5}
    assert (rectify.container, rectify.parameters) == ("vision", {"queue_size": 7})
    assert rectify.remappings == {"image": "/left_image"}


def test_delays_and_handlers_of_events_are_told() -> None:
    _, text = made("a.launch.py", stored("conditions.launch.py"))
    assert "the delay of a TimerAction is left out" in text
    assert "what an event handler starts after another process is started with it" in text
