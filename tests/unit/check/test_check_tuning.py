"""What is said of `tune:`: names, values and limits that lead to nothing."""

from __future__ import annotations

from pathlib import Path

import pytest
from check_specs import findings

from example_spec import example
from r2bspec.check import usable_settings
from r2bspec.check.engine import check_cases, context_of
from r2bspec.language.load_spec import load_cases
from r2bspec.language.located_tree import count_values
from r2bspec.language.selected_spec import SpecSelection
from r2bspec.plan.this_machine import scheduling_facts
from r2bspec.safe_io.limits import MAX_TRIED_VALUES

IMAGE = "sensor_msgs/msg/Image"
SPEC = example(
    monitors=f"""
        first: {{topic: output, format: {IMAGE}}}
        again: {{topic: output, format: {IMAGE}, match: order}}
    """
)


@pytest.mark.parametrize(
    ("metric", "words"),
    [
        ("throughput.mean", "better when it is larger"),
        ("peak.rate", "better when it is larger"),
        ("latency.p99", "of every monitor: 'first' and 'again'"),
        ("relay.callback.p99", "not observed"),
        ("first.latency.p98x", "no metric"),
        ("first.latency.p99", ""),
        ("cpu.relay.mean", ""),
        ("memory.graph.max", ""),
    ],
)
def test_what_is_minimized_is_one_value_that_is_better_when_it_is_smaller(
    metric: str, words: str
) -> None:
    found = findings(f"{SPEC}tune: {{minimize: {metric}}}\n", offline=True)
    said = [each.message for each in found if each.code == "R2B806"]
    assert len(said) == bool(words)
    assert all(words in message for message in said)


@pytest.mark.parametrize("cases", [1, 9])
def test_a_document_is_not_checked_again_for_any_number_of_values(cases: int) -> None:
    axes = f"matrix: {{axes: {{rate: [{', '.join(f'{n + 1} Hz' for n in range(cases))}]}}}}\n"
    values = ", ".join(str(n) for n in range(20, 1_020))
    text = SPEC.replace("[30 Hz]", "[$(var rate)]") + "variables: {rate: 30 Hz}\n" + axes
    text += f"tune: {{values: {{graph.nodes.relay.nice: [{values}]}}}}\n"
    loaded = load_cases(text, file="a.r2b.yaml", environ={})
    assert len(loaded) == cases
    assert loaded[0].tree is not None
    most = MAX_TRIED_VALUES // count_values(loaded[0].tree)
    refused = [each for each in check_cases(loaded, offline=True) if each.code == "R2B803"]
    assert 0 < len(refused) <= most < 1_000


def test_settings_of_a_large_spec_are_left_out_unchecked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(usable_settings, "MAX_VARIED_VALUES", 100)
    file = tmp_path / "a.r2b.yaml"
    values = ", ".join(map(str, range(1, 20)))
    file.write_text(f"{SPEC}tune: {{values: {{graph.nodes.relay.nice: [{values}]}}}}\n")
    selection = SpecSelection(file)
    context = context_of(selection.load(), offline=True)
    assert context is not None
    space = usable_settings.usable_space(selection, context, scheduling_facts())
    (left_out,) = (each for each in space.left_out if "not checked" in each)
    assert "graph.nodes.relay.nice" in left_out
