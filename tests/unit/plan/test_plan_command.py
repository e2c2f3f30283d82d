"""``r2bspec plan``: what a run will do."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from r2bspec.cli.main import main
from r2bspec.plan.canonical_json import read_plan
from r2bspec.report.findings_text import code_with_slug

RELAY = Path(__file__).parents[3] / "specs" / "relay.r2b.yaml"


@pytest.fixture(autouse=True)
def without_real_datasets(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("R2B_DATASETS", raising=False)


def test_the_plan_goes_to_standard_output(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["plan", str(RELAY)]) == 0
    said = capsys.readouterr()
    assert json.loads(said.out)["name"] == "relay"
    assert said.err.startswith("a run takes about ")


def test_or_to_a_file_that_is_a_plan_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "relay.json"
    assert main(["plan", str(RELAY), "-o", str(file)]) == 0
    assert capsys.readouterr().out == ""
    assert read_plan(file).name == "relay"
    assert main(["plan", str(file)]) == 0
    assert capsys.readouterr().out == file.read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("form", "begins"),
    [("mermaid", "flowchart LR"), ("dot", "digraph"), ("html", "<!DOCTYPE html>")],
)
def test_it_can_be_drawn(form: str, begins: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["plan", str(RELAY), "--graph", form]) == 0
    said = capsys.readouterr().out
    assert said.startswith(begins)
    assert "/r2b/relay" in said


def test_options_change_the_plan_and_the_difference_shows_it(
    capsys: pytest.CaptureFixture[str],
) -> None:
    options = ["--var", "service_time_ms=20.0", "--set", "benchmark.iterations=3"]
    assert main(["plan", str(RELAY), *options, "--diff", str(RELAY)]) == 1
    assert capsys.readouterr().out.splitlines() == [
        "processes.relay.nodes['/r2b/relay'].parameters.service_time_ms: 10.0 -> 20.0",
        "play['50.0'].iterations: 10 -> 3",
        "starts: 5 -> 1",
    ]


def test_without_a_difference_nothing_is_shown(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["plan", str(RELAY), "--diff", str(RELAY)]) == 0
    assert capsys.readouterr().out == ""


def test_an_invalid_spec_is_wrong_usage_and_its_findings_are_shown(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    broken = tmp_path / "broken.r2b.yaml"
    text = RELAY.read_text(encoding="utf-8").replace("input: camera_info", "input: camera_inf")
    broken.write_text(text, encoding="utf-8")
    assert main(["plan", str(broken)]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert f"{broken}:" in said.err
    assert f"error[{code_with_slug('R2B207')}]" in said.err
    assert "did you mean 'camera_info'?" in said.err


def test_a_foreign_file_is_wrong_usage(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    foreign = tmp_path / "package.json"
    foreign.write_text('{"name": "x"}', encoding="utf-8")
    assert main(["plan", str(foreign)]) == 2
    assert "error[R2B611 unsupported-plan]" in capsys.readouterr().err


def test_drawing_and_comparing_exclude_each_other(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["plan", str(RELAY), "--graph", "dot", "--diff", str(RELAY)]) == 2
    assert "cannot be combined" in capsys.readouterr().err
