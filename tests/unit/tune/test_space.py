"""Combinations of values, and the overlay that is written of one."""

from __future__ import annotations

from pathlib import Path

import pytest

from example_spec import example
from r2bspec import api
from r2bspec.errors import UsageError
from r2bspec.language.selected_spec import SpecSelection
from r2bspec.tune.overlay import check_overlay_path, overlay_text, write_overlay
from r2bspec.tune.space import Space, assignments, changes_text

NICE, DEPTH = "graph.nodes.relay.nice", "graph.nodes.relay.parameters.depth"


def test_a_combination_is_the_values_that_differ_from_the_spec() -> None:
    space = Space({NICE: (5, 10), DEPTH: ("a",)})
    assert space.sizes == (3, 2)
    assert space.changes(space.today) == {}
    assert space.changes((2, 1)) == {NICE: 10, DEPTH: "a"}
    assert [space.changes(one) for one in space.single_changes()] == [
        {NICE: 5},
        {DEPTH: "a"},
        {NICE: 10},
    ]


def test_the_ends_of_paths_are_shown_as_far_as_they_differ() -> None:
    first, second = "graph.nodes.a.nice", "graph.nodes.b.nice"
    assert changes_text({first: 5, DEPTH: "x"}, [first, second, DEPTH]) == "a.nice 5, depth x"


@pytest.fixture
def spec(tmp_path: Path) -> Path:
    file = tmp_path / "spec.r2b.yaml"
    file.write_text(example())
    return file


CHANGES = {
    NICE: 5,
    "graph.nodes.relay.cpus": [0],
    "graph.nodes.relay.parameters['queue_depth']": 3,
    "graph.nodes.relay.parameters.service_time_ms": 1e-05,
    "graph.nodes.relay.description": "yes: [no]",
    "transport": "udp",
}


def test_an_overlay_is_the_spec_with_the_values_of_the_winner(spec: Path) -> None:
    selection = SpecSelection(spec)
    plan = api.prepare(selection, sets=assignments(CHANGES)).plan
    file = spec.with_name("tuned.r2b.yaml")
    check_overlay_path(file, spec)
    write_overlay(file, selection, CHANGES, plan, "Made by a test.")
    assert api.prepare(file).plan == plan
    assert file.read_text().startswith("# Made by a test.\nextends: spec.r2b.yaml\n")


def test_no_overlay_is_left_of_a_spec_that_has_changed(spec: Path) -> None:
    plan = api.prepare(spec, sets=assignments(CHANGES)).plan
    file = spec.with_name("tuned.r2b.yaml")
    spec.write_text(spec.read_text().replace("30 Hz", "20 Hz"))
    with pytest.raises(UsageError, match="has changed") as raised:
        write_overlay(file, SpecSelection(spec), CHANGES, plan, "x")
    assert f"{NICE}: 5" in raised.value.hint
    assert not file.exists()


def test_an_overlay_is_a_new_file_beside_its_spec(spec: Path, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="exists already"):
        check_overlay_path(spec, spec)
    with pytest.raises(UsageError, match="not in the folder"):
        check_overlay_path(tmp_path / "other" / "x.r2b.yaml", spec)


def test_an_overlay_nests_the_keys_of_its_paths() -> None:
    text = overlay_text("a.yaml", {"graph.nodes.a.nice": 1, "graph.nodes.b.nice": 2})
    assert text == (
        "extends: a.yaml\ngraph:\n  nodes:\n    a:\n      nice: 1\n    b:\n      nice: 2\n"
    )
