"""What is said of `tune:`: names, values and limits that lead to nothing."""

from __future__ import annotations

from pathlib import Path

import pytest
from check_specs import findings

from r2bspec.check.engine import check_cases, context_of
from r2bspec.check.usable_settings import usable_space
from r2bspec.language.load_spec import load_cases
from r2bspec.language.located_tree import count_values
from r2bspec.language.selected_spec import SpecSelection
from r2bspec.plan.this_machine import scheduling_facts
from r2bspec.safe_io.limits import MAX_TRIED_VALUES, MAX_VARIED_VALUES

SPEC = """\
r2bspec: 1
name: tuned
data_loader: {bag: r2b_storage, topics: {/d455_1_rgb_image: loaded}}
playback: {inputs: {image: {from: loaded, format: sensor_msgs/msg/Image}}}
graph:
  nodes:
    relay:
      python: r2bspec.nodes.RelayNode
      parameters: {format: sensor_msgs/msg/Image}
      remappings: {input: image}
monitors:
  first: {topic: output, format: sensor_msgs/msg/Image}
  again: {topic: output, format: sensor_msgs/msg/Image, match: order}
benchmark: {rates: [30 Hz]}
"""


def said_of(tune: str) -> list[tuple[str, str]]:
    found = findings(f"{SPEC}tune: {tune}\n", offline=True)
    return [(each.code, each.message) for each in found if each.code.startswith("R2B8")]


@pytest.mark.parametrize(
    ("path", "code", "words"),
    [
        ("graph", "R2B803", "must be a map"),
        ("graph.nodes[", "R2B802", "not the path of a key"),
        ("benchmark.rates", "R2B802", "not the path of a key"),
        ("graph.nodes.rely.nice", "R2B802", "no node 'rely'"),
        ("graph.nodes.relay.nise", "R2B802", "no key 'nise'"),
        ("containers.vision.threads", "R2B802", "no container 'vision'"),
        ("containers", "R2B803", "must be a map"),
        ("graph.nodes.relay.threads", "R2B804", "its executor is single-threaded"),
        ("graph.nodes.relay.parameters.depht", "R2B803", "R2B211"),
    ],
)
def test_a_lever_is_a_key_of_the_deployment_that_changes_it(
    path: str, code: str, words: str
) -> None:
    (found,) = said_of(f"{{values: {{'{path}': [2]}}}}")
    assert found[0] == code
    assert words in found[1]


@pytest.mark.parametrize(
    ("metric", "words"),
    [
        ("throughput.mean", "better when it is larger"),
        ("peak.rate", "better when it is larger"),
        ("latency.p99", "of every monitor: 'first' and 'again'"),
        ("relay.callback.p99", "not observed"),
        ("first.latency.p98x", "no metric"),
    ],
)
def test_what_is_minimized_is_one_value_that_is_better_when_it_is_smaller(
    metric: str, words: str
) -> None:
    (found,) = said_of(f"{{minimize: {metric}}}")
    assert found[0] == "R2B806"
    assert words in found[1]


@pytest.mark.parametrize("metric", ["first.latency.p99", "cpu.relay.mean", "memory.graph.max"])
def test_of_a_metric_that_can_be_minimized_nothing_is_said(metric: str) -> None:
    assert said_of(f"{{minimize: {metric}}}") == []


def test_each_value_is_placed_where_it_is_written() -> None:
    text = f"{SPEC}tune: {{values: {{graph.nodes.relay.nice: [5, 0, 99]}}}}\n"
    found = [each for each in findings(text, offline=True) if each.code.startswith("R2B8")]
    assert [(each.code, each.span.line, each.span.column) for each in found] == [
        ("R2B804", 15, 45),
        ("R2B803", 15, 48),
    ]
    assert "R2B107" in found[1].message


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


def test_settings_of_a_large_spec_are_left_out_unchecked(tmp_path: Path) -> None:
    labels = ", ".join(f"k{n}: {'x' * 9}" for n in range(MAX_VARIED_VALUES // 2))
    file = tmp_path / "a.r2b.yaml"
    values = ", ".join(map(str, range(1, 20)))
    tune = f"tune: {{values: {{graph.nodes.relay.nice: [{values}]}}}}\n"
    file.write_text(f"{SPEC}labels: {{{labels}}}\n{tune}")
    selection = SpecSelection(file)
    context = context_of(selection.load(), offline=True)
    assert context is not None
    (left_out,) = (
        each
        for each in usable_space(selection, context, scheduling_facts()).left_out
        if "not checked" in each
    )
    assert "graph.nodes.relay.nice" in left_out


def test_a_group_without_settings_says_why() -> None:
    (found,) = said_of("{levers: [intra_process, transport]}")
    assert found == (
        "R2B804",
        "'intra_process' has one setting only, so there is nothing to vary",
    )


def test_a_limit_of_threads_holds_for_values() -> None:
    tune = "{values: {graph.nodes.relay.threads: [3]}, limits: {threads: 1}}"
    assert [code for code, _ in said_of(tune)] == ["R2B804", "R2B805"]
