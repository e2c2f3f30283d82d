"""``--require-slos``: a spec that nothing can fail is refused, with a way out."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from example_spec import example
from r2bspec import api
from r2bspec.cli.main import main
from r2bspec.plan.canonical_json import canonical_json

FAST = "fast: {at: 30 Hz, require: [latency.p90 < 50 ms]}"
HINT = "fast: {at: 30 Hz, level: warn, require: [latency.p90 < 50 ms]}"
CASES = "variables: {threads: 1}\nmatrix: {axes: {threads: [1, 2]}}\n"


def write_spec(folder: Path, name: str = "spec", slos: str = "", more: str = "") -> Path:
    path = folder / f"{name}.r2b.yaml"
    path.write_text((example(name, slos=slos) if slos else example(name)) + more)
    return path


@pytest.fixture(autouse=True)
def _folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize("slos", ["", HINT])
def test_run_refuses_a_spec_that_nothing_can_fail(
    tmp_path: Path, slos: str, capsys: pytest.CaptureFixture[str]
) -> None:
    write_spec(tmp_path, slos=slos)
    assert main(["run", "spec.r2b.yaml", "--require-slos"]) == 2
    said = capsys.readouterr().err
    assert "spec.r2b.yaml:1:1: error[R2B693 missing-objectives]: no active objective" in said
    assert said.count("R2B693") == 1
    assert "add a requirement under 'slos'" in said
    assert not (tmp_path / "runs").exists()


def test_run_refuses_a_plan_that_nothing_can_fail(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plan = api.compile_plan(write_spec(tmp_path))
    (tmp_path / "plan.json").write_bytes(canonical_json(plan))
    assert main(["run", "plan.json", "--require-slos"]) == 2
    assert "plan.json:1:1: error[R2B693 missing-objectives]" in capsys.readouterr().err


def test_a_comparison_refuses_a_head_that_nothing_can_fail(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_spec(tmp_path, "base", FAST)
    write_spec(tmp_path, "head")
    assert main(["run", "head.r2b.yaml", "--against", "base.r2b.yaml", "--require-slos"]) == 2
    assert "head.r2b.yaml:1:1: error[R2B693" in capsys.readouterr().err


def test_the_refusal_is_json_where_json_is_asked_for(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_spec(tmp_path)
    assert main(["run", "spec.r2b.yaml", "--require-slos", "--format", "json"]) == 2
    content = json.loads(capsys.readouterr().out)
    assert (content["code"], content["exit_status"]) == ("R2B693", 2)


def test_each_spec_of_a_suite_is_refused_on_its_own(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name, slos in (("a", ""), ("b", HINT)):
        write_spec(tmp_path, name, slos)
    assert main(["run", ".", "--require-slos", "--no-lock", "--output", "out"]) == 2
    said = capsys.readouterr().err
    assert "a.r2b.yaml:1:1: error[R2B693" in said
    assert "b.r2b.yaml:1:1: error[R2B693" in said
    runs = json.loads((tmp_path / "out" / "suite.json").read_text())["runs"]
    assert [each["exit_status"] for each in runs] == [2, 2]
    assert all("no active objective" in each["reason"] for each in runs)


def test_a_smoke_run_judges_nothing_and_cannot_require_objectives(tmp_path: Path) -> None:
    write_spec(tmp_path, slos=FAST)
    assert main(["run", "spec.r2b.yaml", "--require-slos", "--smoke"]) == 2


@pytest.mark.parametrize(("slos", "status"), [("", 1), (HINT, 1), (FAST, 0)])
def test_validate_finds_a_spec_that_nothing_can_fail(
    tmp_path: Path, slos: str, status: int, capsys: pytest.CaptureFixture[str]
) -> None:
    write_spec(tmp_path, slos=slos)
    assert main(["validate", "spec.r2b.yaml", "--offline", "--require-slos"]) == status
    found = "spec.r2b.yaml:1:1: error[R2B693 missing-objectives]" in capsys.readouterr().out
    assert found is bool(status)
    assert main(["validate", "spec.r2b.yaml", "--offline"]) == 0


def test_validate_names_the_cases_that_nothing_can_fail(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    slos = "fast: {at: 30 Hz, when: {threads: 1}, require: [latency.p90 < 50 ms]}"
    write_spec(tmp_path, slos=slos, more=CASES)
    assert main(["validate", "spec.r2b.yaml", "--offline", "--require-slos"]) == 1
    assert "no active objective of level error in threads=2: nothing" in capsys.readouterr().out


def test_no_comment_waives_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = write_spec(tmp_path)
    waived = path.read_text().replace("r2bspec: 1", "r2bspec: 1  # r2bspec: ignore[R2B693] reason")
    path.write_text(waived)
    assert main(["validate", "spec.r2b.yaml", "--offline", "--require-slos"]) == 1
    assert "R2B693" in capsys.readouterr().out


PLAIN_NODE = """
from rclpy.node import Node
from sensor_msgs.msg import Image


class Plain(Node):
    def __init__(self) -> None:
        super().__init__("plain")
        publisher = self.create_publisher(Image, "output", 10)
        self.create_subscription(Image, "input", publisher.publish, 10)
"""


@pytest.mark.parametrize("option", ["--quiet", "--verbose"])
def test_a_run_prints_findings_of_level_info_where_they_are_asked_for(
    tmp_path: Path, option: str, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "plain.py").write_text(PLAIN_NODE)
    spec = write_spec(tmp_path, slos=HINT)
    spec.write_text(spec.read_text().replace("r2bspec.nodes.RelayNode", "./plain.py:Plain"))
    assert main(["run", "spec.r2b.yaml", "--require-slos", option]) == 2
    assert ("info[R2B230" in capsys.readouterr().err) == (option == "--verbose")
