"""``r2bspec plan``: what a run will do."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from command_line import Call
from r2bspec.plan.canonical_json import read_plan
from r2bspec.report.findings_text import code_with_slug

RELAY = Path(__file__).parents[3] / "specs" / "relay.r2b.yaml"


@pytest.fixture(autouse=True)
def without_real_datasets(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("R2B_DATASETS", raising=False)


def test_the_plan_goes_to_standard_output(call: Call) -> None:
    said = call("plan", RELAY, status=0)
    assert json.loads(said.out)["name"] == "relay"
    assert said.err.startswith("a run takes about ")


def test_or_to_a_file_that_is_a_plan_again(tmp_path: Path, call: Call) -> None:
    file = tmp_path / "relay.json"
    assert call("plan", RELAY, "-o", file, status=0).out == ""
    assert read_plan(file).name == "relay"
    assert call("plan", file, status=0).out == file.read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("form", "begins"),
    [("mermaid", "flowchart LR"), ("dot", "digraph"), ("html", "<!DOCTYPE html>")],
)
def test_it_can_be_drawn(form: str, begins: str, call: Call) -> None:
    said = call("plan", RELAY, "--graph", form, status=0).out
    assert said.startswith(begins)
    assert "/r2b/relay" in said


def test_options_change_the_plan_and_the_difference_shows_it(call: Call) -> None:
    options = ["--var", "service_time_ms=20.0", "--set", "benchmark.iterations=3"]
    ended = call("plan", RELAY, *options, "--diff", RELAY, status=1)
    assert ended.out.splitlines() == [
        "processes.relay.nodes['/r2b/relay'].parameters.service_time_ms: 10.0 -> 20.0",
        "play['50.0'].iterations: 10 -> 3",
        "starts: 5 -> 1",
    ]


def test_without_a_difference_nothing_is_shown(call: Call) -> None:
    assert call("plan", RELAY, "--diff", RELAY, status=0).out == ""


def test_an_invalid_spec_is_wrong_usage_and_its_findings_are_shown(
    tmp_path: Path, call: Call
) -> None:
    broken = tmp_path / "broken.r2b.yaml"
    text = RELAY.read_text(encoding="utf-8").replace("input: camera_info", "input: camera_inf")
    broken.write_text(text, encoding="utf-8")
    said = call("plan", broken, status=2)
    assert said.out == ""
    assert f"{broken}:" in said.err
    assert f"error[{code_with_slug('R2B207')}]" in said.err
    assert "did you mean 'camera_info'?" in said.err


def test_a_foreign_file_is_wrong_usage(tmp_path: Path, call: Call) -> None:
    foreign = tmp_path / "package.json"
    foreign.write_text('{"name": "x"}', encoding="utf-8")
    assert "error[R2B611 unsupported-plan]" in call("plan", foreign, status=2).err


def test_drawing_and_comparing_exclude_each_other(call: Call) -> None:
    ended = call("plan", RELAY, "--graph", "dot", "--diff", RELAY, status=2)
    assert "cannot be combined" in ended.err
